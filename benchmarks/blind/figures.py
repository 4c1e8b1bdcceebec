"""Figures beside their targets: shares, medians and means with their intervals, and calibration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, quantile_test

BINS = 10  # of probabilities, in the reliability table
# Cases of which drawing again says how sure their mean is: a few that happen to be alike say nothing of others.
_FEWEST = 8


@dataclass(frozen=True)
class Row:
    """One figure beside its target.

    Attributes:
        cases: Which cases it is taken over.
        quantity: What it is.
        target: In words; empty where there is none.
        here, low, high: Figure and its 95 % interval; None where there is nothing to take it from.
        n: Of how many.
        met: Whether the figure itself meets the target; None without one.
        shown: Whether the whole interval does, so that it is no luck of a few cases.
        percent: Whether it is a share.
    """

    cases: str
    quantity: str
    target: str
    here: float | None
    low: float | None
    high: float | None
    n: int
    met: bool | None
    shown: bool | None = None
    percent: bool = True

    def cells(self) -> list[str]:
        """The row of a table, as text."""
        def told(x: float | None) -> str:
            if x is None or not math.isfinite(x):
                return ""
            return f"{100.0 * x:.3g} %" if self.percent else f"{x:.3g}"

        interval = f"{told(self.low)} to {told(self.high)}" if told(self.low) and told(self.high) else ""
        met = {True: "yes" if self.shown else "not shown", False: "**no**", None: ""}[self.met]
        return [self.cases, self.quantity, self.target, told(self.here), interval, str(self.n), met]


HEADS = ("cases", "quantity", "target", "here", "95 % interval", "n", "met")


def rate(cases: str, quantity: str, hits: Iterable[bool], target: tuple[str, float] | None = None) -> Row:
    """A share with its Wilson interval; the target is ``(">=", 0.8)`` or ``("<=", 0.01)``."""
    hits = list(hits)
    if not hits:
        return Row(cases, quantity, _words(target), None, None, None, 0, None)
    here = sum(hits) / len(hits)
    interval = binomtest(sum(hits), len(hits)).proportion_ci(method="wilson")
    return Row(cases, quantity, _words(target), here, interval.low, interval.high, len(hits), _meets(here, target),
               _shown(interval.low, interval.high, target))


def median(cases: str, quantity: str, values: Iterable[float], target: tuple[str, float] | None = None,
           percent: bool = True) -> Row:
    """A median with the interval of its order statistics."""
    values = np.array(list(values), dtype=np.float64)
    if values.size == 0:
        return Row(cases, quantity, _words(target, percent), None, None, None, 0, None, percent=percent)
    here, interval = float(np.median(values)), quantile_test(values, p=0.5).confidence_interval()
    low, high = _number(interval.low), _number(interval.high)
    return Row(cases, quantity, _words(target, percent), here, low, high, values.size, _meets(here, target),
               _shown(low, high, target), percent)


def mean(cases: str, quantity: str, values: Iterable[float], target: tuple[str, float] | None = None) -> Row:
    """A mean with its bootstrapped interval, where there are enough for one."""
    values = np.array(list(values), dtype=np.float64)
    if values.size == 0:
        return Row(cases, quantity, _words(target, False), None, None, None, 0, None, percent=False)
    here, low, high = _bootstrapped(values, lambda some: float(np.mean(some)))
    return Row(cases, quantity, _words(target, False), here, low, high, values.size, _meets(here, target),
               _shown(low, high, target), False)


def _bootstrapped(items: np.ndarray,
                  figure: Callable[[np.ndarray], float]) -> tuple[float, float | None, float | None]:
    if len(items) < _FEWEST:
        return figure(items), None, None
    random = np.random.default_rng(0)
    drawn = [figure(items[random.integers(len(items), size=len(items))]) for _ in range(1000)]
    return figure(items), *(float(x) for x in np.quantile(drawn, [0.025, 0.975]))


def _number(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _words(target: tuple[str, float] | None, percent: bool = True) -> str:
    if target is None:
        return ""
    return f"{target[0]} {100.0 * target[1]:g} %" if percent else f"{target[0]} {target[1]:g}"


def _meets(here: float, target: tuple[str, float] | None) -> bool | None:
    if target is None:
        return None
    return bool(here >= target[1] if target[0] == ">=" else here <= target[1])


def _shown(low: float | None, high: float | None, target: tuple[str, float] | None) -> bool | None:
    if target is None or low is None or high is None:
        return None
    return _meets(low, target) and _meets(high, target)


# -- calibration ----------------------------------------------------------------------------------

def reliability(pairs: np.ndarray) -> list[dict[str, float]]:
    """What was said against how often it was so, by bins of probability."""
    places = np.minimum((pairs[:, 0] * BINS).astype(int), BINS - 1)
    return [{"low": i / BINS, "high": (i + 1) / BINS, "said": float(pairs[places == i, 0].mean()),
             "was": float(pairs[places == i, 1].mean()), "n": int(np.sum(places == i))}
            for i in range(BINS) if np.any(places == i)]


def calibration_error(pairs: np.ndarray) -> float:
    """Expected calibration error: mean distance of said and was, weighted by how often it was said."""
    return sum(row["n"] * abs(row["said"] - row["was"]) for row in reliability(pairs)) / max(len(pairs), 1)


def exact_calibration_errors(said: np.ndarray) -> np.ndarray:
    """Calibration errors that probabilities which are exactly right would show by chance: few cases fill no bin."""
    random = np.random.default_rng(0)
    return np.array([calibration_error(np.column_stack([said, random.random(said.size) < said]))
                     for _ in range(1000)])


def coverage(cases: str, hits: Sequence[bool]) -> Row:
    """How often 90 % intervals hold the truth, which may be too often as well."""
    row = rate(cases, "90 % intervals that hold the truth", hits)
    return Row(row.cases, row.quantity, "85 to 95 %", row.here, row.low, row.high, row.n,
               0.85 <= row.here <= 0.95 if row.n else None, row.n > 0 and bool(0.85 <= row.low and row.high <= 0.95))


def calibration(cases: str, forecasts: Sequence[np.ndarray], target: float | None = 0.05) -> list[Row]:
    """The expected calibration error, and what it would be if every probability were exact.

    Args:
        cases: What the forecasts are of.
        forecasts: Of each case, rows of what was said and whether it was so.
        target: At most that; None without one.
    """
    some = [pairs for pairs in forecasts if len(pairs)]
    name, aim = "expected calibration error", None if target is None else ("<=", target)
    if not some:
        return [Row(cases, name, _words(aim, False), None, None, None, 0, None, percent=False)]
    drawn = np.empty(len(some), dtype=object)
    drawn[:] = some
    here, low, high = _bootstrapped(drawn, lambda few: calibration_error(np.concatenate(list(few))))
    pairs = np.concatenate(some)
    exact = exact_calibration_errors(pairs[:, 0])
    return [Row(cases, name, _words(aim, False), here, low, high, len(pairs), _meets(here, aim),
                _shown(low, high, aim), False),
            Row(cases, "the same, if what was said were exact", "", float(np.mean(exact)),
                *(float(x) for x in np.quantile(exact, [0.025, 0.975])), len(pairs), None, percent=False)]
