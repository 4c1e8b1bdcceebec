"""What a study gives: rows of paper, here and deviation, and pictures."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

THESIS = "000_04412de56ba07ac9.txt"  # the seed file the studies of this package answer


@dataclass(frozen=True)
class Row:
    """One number of a paper's table or text beside the one found here.

    Attributes:
        quantity: What it is.
        unit: Unit of both numbers.
        paper: The printed number; None where none is printed.
        here: The number found here; None where there is none (the note says why).
        note: What a reader must know to compare the two.
    """

    quantity: str
    unit: str
    paper: float | None
    here: float | None
    note: str = ""

    @property
    def deviation_percent(self) -> float | None:
        """Deviation of ``here`` from ``paper`` in percent of the latter; None where there is none."""
        if self.paper is None or self.here is None or self.paper == 0.0:
            return None
        return 100.0 * (self.here - self.paper) / abs(self.paper)

    def as_dict(self) -> dict[str, Any]:
        """As it stands in the JSON file."""
        return {
            "quantity": self.quantity, "unit": self.unit,
            "paper": _plain(self.paper), "here": _plain(self.here),
            "deviation_percent": _plain(self.deviation_percent), "note": self.note,
        }


@dataclass
class Findings:
    """Rows and the names of the pictures of one study."""

    rows: list[Row] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)

    def add(self, quantity: str, unit: str, paper: float | None, here: float | None, note: str = "") -> None:
        """Add a row."""
        self.rows.append(Row(quantity, unit, paper, here, note))


def percent(value: float, reference: float) -> float:
    """How far ``value`` is from ``reference``, in percent of the latter, without sign."""
    return 100.0 * abs(value - reference) / abs(reference)


def _plain(value: float | None) -> float | None:
    return None if value is None else float(value)
