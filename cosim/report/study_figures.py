"""Pictures of the studies: panels of curves over one another, redrawn figures of the papers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cosim.report.plots import MEASURED, RESIDUAL, SIMULATED, draw_sheet

THIRD, FOURTH = "#2ca02c", "#9467bd"
COLORS = {"measured": MEASURED, "first": SIMULATED, "second": RESIDUAL, "third": THIRD, "fourth": FOURTH}


@dataclass(frozen=True)
class Curve:
    """One line, or points.

    Attributes:
        x, y: Values of equal length.
        label: What the legend says; empty for none.
        color: A key of ``COLORS``.
        style: Line style and marker as matplotlib writes them.
        width: Line width.
        right: Whether it belongs to the axis on the right.
    """

    x: np.ndarray
    y: np.ndarray
    label: str = ""
    color: str = "first"
    style: str = "-"
    width: float = 1.1
    right: bool = False


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        title: Left above the panel; ``(a) ...`` where the paper letters its panels.
        y_label, right_label: Quantity with unit; the second only with curves on the right.
        marks: Positions of vertical lines, with their labels.
        levels: Positions of horizontal lines, with their labels.
        x_range, y_range: What is shown; None for all.
    """

    title: str
    curves: Sequence[Curve]
    y_label: str
    x_label: str = "time [s]"
    right_label: str = ""
    marks: dict[float, str] = field(default_factory=dict)
    levels: dict[float, str] = field(default_factory=dict)
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    log_y: bool = False
    ticks: Sequence[float] | None = None


def draw(path: Path, title: str, panels: Sequence[Panel], columns: int = 2) -> str:
    """Draw panels side by side, row by row; returns the file's name."""
    return draw_sheet(path, title, panels, _panel, columns, height=2.75)


def _panel(axis: Axes, panel: Panel) -> None:
    right = axis.twinx() if panel.right_label else None
    lines = []
    for curve in panel.curves:
        where = right if curve.right else axis
        lines += where.plot(curve.x, curve.y, curve.style, color=COLORS[curve.color], linewidth=curve.width,
                            markersize=4, label=curve.label)
    for x, label in panel.marks.items():
        axis.axvline(x, color=MEASURED, linewidth=0.7, linestyle=":")
        axis.annotate(label, (x, 1.0), xycoords=("data", "axes fraction"), xytext=(3, -3),
                      textcoords="offset points", va="top", fontsize=7)
    for y, label in panel.levels.items():
        axis.axhline(y, color=MEASURED, linewidth=0.7, linestyle=":")
        axis.annotate(label, (1.0, y), xycoords=("axes fraction", "data"), xytext=(-3, 2),
                      textcoords="offset points", ha="right", fontsize=7)
    axis.set(xlabel=panel.x_label, ylabel=panel.y_label)
    axis.set_title(panel.title, loc="left")
    if panel.log_y:
        axis.set_yscale("log")
    if panel.ticks is not None:
        axis.set_xticks(panel.ticks)
    if panel.x_range:
        axis.set_xlim(panel.x_range)
    if panel.y_range:
        axis.set_ylim(panel.y_range)
    if right is not None:
        right.set_ylabel(panel.right_label)
        right.grid(False)
        right.spines["right"].set_visible(True)
    named = [line for line in lines if not line.get_label().startswith("_")]
    if len(named) > 1:
        # under the panel: curves fill it, and nothing may cover them
        columns = 2 if len(named) == 4 else min(len(named), 3)
        axis.legend(handles=named, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=columns)
