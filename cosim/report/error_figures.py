"""Errors of many runs at a glance: bars side by side, and boxes of their distribution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from cosim.report.plots import MEASURED, draw_sheet
from cosim.report.study_figures import COLORS

_ORDER = ("first", "second", "third", "fourth")


@dataclass(frozen=True)
class Groups:
    """One pair of axes with groups of bars, or of boxes where every entry is a sequence.

    Attributes:
        title: Left above the panel.
        groups: What stands under each group.
        series: What the legend says, and for each group a number or the numbers of a box.
        y_label: Quantity with unit.
        x_label: What the groups are.
        marks: Printed values: for each group a number or None, drawn as a short line.
        y_range: What is shown; None for all. What lies outside is said at the edge.
    """

    title: str
    groups: Sequence[str]
    series: Mapping[str, Sequence[float] | Sequence[Sequence[float]]]
    y_label: str
    x_label: str = ""
    marks: Sequence[float | None] = ()
    y_range: tuple[float, float] | None = None


def draw_groups(path: Path, title: str, panels: Sequence[Groups], columns: int = 2) -> str:
    """Draw panels side by side, row by row; returns the file's name."""
    return draw_sheet(path, title, panels, _panel, columns, height=2.9)


def _panel(axis: Axes, panel: Groups) -> None:
    at = np.arange(len(panel.groups), dtype=float)
    width = 0.8 / len(panel.series)
    for i, (label, values) in enumerate(panel.series.items()):
        color = COLORS[_ORDER[i % len(_ORDER)]]
        where = at + (i - 0.5 * (len(panel.series) - 1)) * width
        if np.ndim(values[0]):
            _boxes(axis, where, values, 0.8 * width, color, label)
        else:
            axis.bar(where, values, 0.92 * width, color=color, alpha=0.75, label=label)
    for i, mark in enumerate(panel.marks):
        if mark is not None:
            axis.plot([i - 0.45, i + 0.45], [mark, mark], color=MEASURED, linewidth=1.4, linestyle="--",
                      label="printed" if mark == next(m for m in panel.marks if m is not None)
                      and i == [m is not None for m in panel.marks].index(True) else None)
    axis.axhline(0.0, color=MEASURED, linewidth=0.6)
    axis.set(xlabel=panel.x_label, ylabel=panel.y_label, xlim=(-0.6, len(panel.groups) - 0.4))
    axis.set_xticks(at, panel.groups)
    axis.set_title(panel.title, loc="left")
    axis.grid(False, axis="x")
    if panel.y_range:
        axis.set_ylim(panel.y_range)
        _say_what_is_outside(axis, panel, at, width)
    handles, labels = axis.get_legend_handles_labels()
    if len(handles) > 1:
        axis.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=min(len(handles), 4))


def _boxes(axis: Axes, where: np.ndarray, values: Sequence[Sequence[float]], width: float, color: str,
           label: str) -> None:
    drawn = axis.boxplot([list(entry) for entry in values], positions=where, widths=width, patch_artist=True,
                         showmeans=True, manage_ticks=False, meanprops={
                             "marker": "D", "markersize": 4, "markerfacecolor": "white",
                             "markeredgecolor": MEASURED},
                         flierprops={"marker": "o", "markersize": 3, "markeredgecolor": color},
                         medianprops={"color": MEASURED})
    for box in drawn["boxes"]:
        box.set(facecolor=color, alpha=0.55)
    drawn["boxes"][0].set_label(label)


def _say_what_is_outside(axis: Axes, panel: Groups, at: np.ndarray, width: float) -> None:
    """A bar or point beyond the axis is named there: nothing disappears silently."""
    low, high = panel.y_range
    for i, values in enumerate(panel.series.values()):
        where = at + (i - 0.5 * (len(panel.series) - 1)) * width
        for x, entry in zip(where, values):
            beyond = [value for value in np.atleast_1d(entry) if value > high or value < low]
            if beyond:
                extreme = max(beyond, key=abs)
                text = f"{extreme:.0f}" if len(beyond) == 1 else f"{len(beyond)} to {extreme:.0f}"
                axis.annotate(text, (x, high if extreme > 0 else low), ha="center", fontsize=6.5,
                              va="top" if extreme > 0 else "bottom")
