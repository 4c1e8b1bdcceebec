"""Signals over time as PNG, all in one style."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

os.environ.setdefault("MPLBACKEND", "Agg")  # pictures go to files: no window system is needed

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cosim.files import replacing
from cosim.measured.compare import Comparison
from cosim.report.thinning import extremes
from cosim.result import Result

STYLE: dict[str, Any] = {
    "figure.dpi": 100, "savefig.dpi": 150, "font.size": 9, "axes.titlesize": 10, "axes.grid": True,
    "grid.alpha": 0.3, "axes.spines.top": False, "axes.spines.right": False, "lines.linewidth": 1.1,
    "legend.frameon": False, "legend.fontsize": 8, "axes.formatter.useoffset": False,
}
MEASURED, SIMULATED, RESIDUAL = "#222222", "#1f77b4", "#d62728"
_WIDTH, _HEIGHT = 7.0, 1.7  # inches, a panel
_POINTS = 4000  # more than a picture can show


def axis_label(name: str, unit: str) -> str:
    """``engine speed [rad/s]``; no unit where it is only a number."""
    words = name.replace("_", " ")
    return _as_it_is(f"{words} [{unit}]" if unit not in ("", "1") else words)


Panel = TypeVar("Panel")


def draw_sheet(path: Path, title: str, panels: Sequence[Panel], draw: Callable[[Axes, Panel], None], columns: int,
               height: float) -> str:
    """Panels side by side, row by row, as PNG; returns the file's name.

    Args:
        path: Where.
        title: Above all of them.
        panels: What is drawn.
        draw: Draws one.
        columns: Panels in a row.
        height: Of a row [inches].
    """
    rows = -(-len(panels) // columns)
    with rc_context(STYLE):
        width = 4.9 * columns if columns > 1 else 7.0
        figure = Figure(figsize=(width, height * rows + 0.4), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis, panel in zip(axes, panels):
            draw(axis, panel)
        for axis in axes[len(panels):]:
            axis.remove()
        figure.suptitle(title)
        with replacing(path) as temporary:
            figure.savefig(temporary, format="png", metadata={"Software": None})
    return path.name


def plot_signals(result: Result, path: str | Path, names: Sequence[str] | None = None,
                 title: str = "") -> Path | None:
    """One panel for each quantity: signals of the same name share one, whoever they belong to.

    Args:
        names: Which signals; by default the first eight quantities of the result.

    Returns:
        The picture; None where there is no signal to show.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for name in names or result.names:
        quantity = name.partition(".")[2] or name
        groups.setdefault((quantity, result.units[name]), []).append(name)
    if names is None:
        groups = dict(list(groups.items())[:8])
    if not groups:
        return None
    with rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, _HEIGHT * len(groups) + 0.6), layout="constrained")
        axes = figure.subplots(len(groups), 1, sharex=True, squeeze=False)[:, 0]
        for axis, ((quantity, unit), members) in zip(axes, groups.items()):
            for name in members:
                _line(axis, result.time, result[name], label=_as_it_is(name.partition(".")[0]))
            axis.set_title(axis_label(quantity, unit), loc="left")
            if len(members) > 1:
                axis.legend(ncols=len(members), loc="best")
        return _save(figure, axes[-1], path, title)


def plot_comparison(comparisons: Sequence[Comparison], path: str | Path, title: str = "") -> Path:
    """For each comparison one panel with both signals, and under it what is between them."""
    with rc_context(STYLE):
        figure = Figure(figsize=(_WIDTH, 1.6 * _HEIGHT * len(comparisons) + 0.6), layout="constrained")
        axes = figure.subplots(2 * len(comparisons), 1, sharex=True, squeeze=False,
                               height_ratios=[2, 1] * len(comparisons))[:, 0]
        for comparison, both, residual in zip(comparisons, axes[0::2], axes[1::2]):
            _line(both, comparison.time, comparison.measured, color=MEASURED, label="measured")
            _line(both, comparison.time, comparison.simulated, color=SIMULATED, label="simulated")
            both.set_title(axis_label(comparison.channel, comparison.unit), loc="left")
            both.legend(ncols=2, loc="best")
            error = comparison.simulated - comparison.measured
            _line(residual, comparison.time, error, color=RESIDUAL)
            residual.axhline(0.0, color=MEASURED, linewidth=0.5)
            normalised = "" if comparison.nrmse is None else f", {100 * comparison.nrmse:.1f} % of the range"
            residual.set_title(f"simulated - measured: rms {comparison.rms_error:.3g} {comparison.unit}"
                               f"{normalised}", loc="left")
        return _save(figure, axes[-1], path, title)


def _line(axis: Axes, time: np.ndarray, values: np.ndarray, **style: Any) -> None:
    """A line; of very many points the extremes of each stretch, so that no peak gets lost."""
    if time.size > 2 * _POINTS:
        keep = np.unique([0, *extremes(values, _POINTS), time.size - 1])
        time, values = time[keep], values[keep]
    axis.plot(time, values, **style)


def _as_it_is(text: str) -> str:
    """Text that matplotlib shows without taking what is between two ``$`` for a formula."""
    return text.replace("$", r"\$")


def _save(figure: Figure, last: Axes, path: str | Path, title: str) -> Path:
    last.set_xlabel("time [s]")
    if title:
        figure.suptitle(_as_it_is(title))
    with replacing(Path(path)) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})
    return Path(path)
