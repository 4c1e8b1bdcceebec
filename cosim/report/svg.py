"""Small pictures as SVG, to stand inside a page: no image files, sharp at any size, their colours from its style.

Colours are classes (``measured``, ``before``, ``after``, ...) that the page's style sheet knows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from matplotlib.ticker import MaxNLocator

from cosim.report.thinning import extremes

_WIDTH, _LEFT, _RIGHT = 560, 58, 8
_POINTS = 700
_LETTER = 6.4  # width of a letter, generously, at the font size of 11
_BOLD = 7.0  # the same, of what is printed bold
_FIRST, _ROW = 54.0, 16.0  # of lines of words: base line of the first, from one to the next

Window = tuple[float, float]


def number(value: float, digits: int = 4) -> str:
    """A number as people write it: few digits, no exponent where it can be avoided."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits}g}"
    whole = int(np.floor(np.log10(abs(value)))) + 1  # digits before the point, as long as it is not rounded
    if whole >= digits:
        return f"{value:.0f}"
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def text(x: float, y: float, words: str, anchor: str = "start", css: str = "") -> str:
    """A line of text; ``y`` is its base line."""
    return (f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"' + (f' class="{css}"' if css else "")
            + f">{escape(words)}</text>")


def line(x1: float, y1: float, x2: float, y2: float, css: str) -> str:
    """A straight line."""
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{css}"/>'


def picture(height: float, parts: Sequence[str], title: str, width: float = _WIDTH) -> str:
    """The parts as one picture; ``title`` is what is read out to who cannot see it."""
    return (f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(title, quote=True)}">'
            f'{"".join(parts)}</svg>')


class Panel:
    """Axes: what turns values into places of a picture.

    Args:
        x, y: Shown ranges.
        top, height: Of the panel in the picture.
        left, width: The same; by default all there is beside the numbers.
    """

    def __init__(self, x: Window, y: Window, top: float, height: float, left: float = _LEFT,
                 width: float = _WIDTH - _LEFT - _RIGHT) -> None:
        self.top, self.height, self.left, self.width = top, height, left, width
        self.x = x if x[1] > x[0] else (x[0] - 0.5, x[0] + 0.5)
        pad = 0.04 * (y[1] - y[0]) or 0.5
        self.y = (y[0] - pad, y[1] + pad)

    def place(self, x: np.ndarray | float, y: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Where values lie in the picture."""
        return (self.left + self.width * (np.asarray(x) - self.x[0]) / (self.x[1] - self.x[0]),
                self.top + self.height * (self.y[1] - np.asarray(y)) / (self.y[1] - self.y[0]))

    def axes(self, ticks: int = 4, below: str | None = None, times: int = 6) -> list[str]:
        """Grid and numbers; with ``below`` those of x, too, and these words at their end."""
        parts = []
        for value in _ticks(self.y, ticks):
            y = float(self.place(0.0, value)[1])
            parts += [line(self.left, y, self.left + self.width, y, "zero" if value == 0.0 else "grid"),
                      text(self.left - 5, y + 4, f"{value:.6g}", "end")]
        bottom = self.top + self.height
        if below is not None:
            end = self.left + self.width - _LETTER * len(below) - 12
            for value in _ticks(self.x, times):
                x = float(self.place(value, 0.0)[0])
                words = f"{value:.6g}"
                if x + 0.5 * _LETTER * len(words) < end:
                    parts += [line(x, bottom, x, bottom + 3, "grid"), text(x, bottom + 15, words, "middle")]
            parts.append(text(self.left + self.width, bottom + 15, below, "end"))
        return parts

    def curve(self, x: np.ndarray, y: np.ndarray, css: str) -> str:
        """Values over x as a line; where there are too many, each stretch by its least and largest."""
        inside = (x >= self.x[0]) & (x <= self.x[1])
        x, y = x[inside], y[inside]
        if x.size > 2 * _POINTS:
            keep = extremes(y, _POINTS)
            x, y = x[keep], y[keep]
        a, b = self.place(x, np.clip(y, *self.y))
        return f'<polyline class="{css}" points="{" ".join(f"{p:.1f},{q:.1f}" for p, q in zip(a, b))}"/>'

    def dots(self, x: np.ndarray, y: np.ndarray, css: str) -> str:
        """A cloud of dots, at most some hundreds of them."""
        step = max(1, x.size // _POINTS)
        a, b = self.place(x[::step], np.clip(y[::step], *self.y))
        return f'<path class="{css}" d="{"".join(f"M{p:.1f},{q:.1f}h0" for p, q in zip(a, b))}"/>'


def _ticks(window: Window, count: int) -> np.ndarray:
    found = MaxNLocator(count, steps=[1, 2, 2.5, 5, 10]).tick_values(*window)
    span = window[1] - window[0]
    found = found[(found >= window[0] - 1e-9 * span) & (found <= window[1] + 1e-9 * span)]
    return np.where(np.abs(found) < 1e-9 * span, 0.0, found)


def over_time(clock: np.ndarray, values: Mapping[str, np.ndarray], window: Window, title: str) -> str:
    """Measured and simulated values over time, and below them what each simulation misses.

    Args:
        clock: Instants [s].
        values: By class: ``measured``, then each simulation.
        window: Shown span [s].
    """
    shown = (clock >= window[0]) & (clock <= window[1])
    main = Panel(window, _range([v[shown] for v in values.values()]), 8.0, 150.0)
    errors = {name: v - values["measured"] for name, v in values.items() if name != "measured"}
    strip = Panel(window, _range([e[shown] for e in errors.values()] + [np.zeros(1)]), 178.0, 56.0)
    parts = main.axes()
    parts += [main.curve(clock, v, name) for name, v in values.items()]
    parts += strip.axes(3, "time [s]")
    parts += [strip.curve(clock, e, name) for name, e in errors.items()]
    parts.append(text(main.left + 4, strip.top - 4, "simulated \N{MINUS SIGN} measured", css="small"))
    return picture(254.0, parts, title)


def scatter(x: np.ndarray, y: np.ndarray, below: str, title: str) -> str:
    """A cloud of dots with the median and the middle 80 % over tenths of it."""
    low, high = np.percentile(y, [0.5, 99.5])
    panel = Panel((float(x.min()), float(x.max())), (min(low, 0.0), max(high, 0.0)), 8.0, 190.0)
    parts = [*panel.axes(5, below), panel.dots(x, y, "cloud")]
    order = np.array_split(np.argsort(x), 12)
    centres = np.array([np.median(x[i]) for i in order if i.size])
    for share, css in ((10.0, "edge"), (90.0, "edge"), (50.0, "median")):
        parts.append(panel.curve(centres, np.array([np.percentile(y[i], share) for i in order if i.size]), css))
    return picture(218.0, parts, title)


def interval(nominal: float, value: float, low: float, high: float, limits: Window, unit: str, title: str) -> str:
    """A parameter on its axis: the file's number, the one found with its interval, and what is plausible."""
    ends = np.array([nominal, value, low, high])
    reach = 0.6 * (float(np.ptp(ends)) or abs(nominal) or 1.0)
    panel = Panel((float(ends.min()) - reach, float(ends.max()) + reach), (0.0, 1.0), 22.0, 12.0, 24.0,
                  _WIDTH - 48.0)
    middle = panel.top + 0.5 * panel.height

    def at(x: float) -> float:
        return float(panel.place(np.clip(x, *panel.x), 0.0)[0])

    left, right = at(limits[0]), at(limits[1])
    parts = [f'<rect x="{panel.left}" y="{panel.top}" width="{panel.width}" height="{panel.height}" class="absurd"/>',
             f'<rect x="{left:.1f}" y="{panel.top}" width="{max(right - left, 0.0):.1f}" height="{panel.height}" '
             'class="plausible"/>',
             line(at(low), middle, at(high), middle, "whisker"),
             line(at(nominal), panel.top - 4, at(nominal), panel.top + panel.height + 4, "nominal"),
             f'<circle cx="{at(value):.1f}" cy="{middle:.1f}" r="5.5" class="found"/>']
    words = [(nominal, f"file {number(nominal)}", 14.0), (value, f"found {number(value)} {unit}".strip(), 52.0)]
    for x, label, y in words:
        half = 0.5 * _LETTER * len(label)
        parts.append(text(float(np.clip(at(x), half, _WIDTH - half)), y, label, "middle"))
    return picture(58.0, parts, title)


def dumbbells(rows: Sequence[tuple[str, float, float, float]], title: str) -> str:
    """A row a signal: error before and after [%], and the noise below which nothing can come."""
    label = 12.0 + _LETTER * max(len(name) for name, *_ in rows)
    top = 6.0
    largest = max(max(row[1:]) for row in rows)
    panel = Panel((0.0, 1.08 * largest), (0.0, float(len(rows))), top, 26.0 * len(rows), label,
                  _WIDTH - label - 14.0)
    bottom = top + panel.height
    parts = []
    for value in _ticks(panel.x, 5):
        x = float(panel.place(value, 0.0)[0])
        parts += [line(x, top, x, bottom, "grid"), text(x, bottom + 15, f"{number(value)} %", "middle")]
    for i, (name, before, after, floor) in enumerate(rows):
        y = top + 26.0 * (i + 0.5)
        a, b, c = (float(panel.place(x, 0.0)[0]) for x in (before, after, floor))
        parts += [text(label - 8, y + 4, name, "end"), line(a, y, b, y, "bar"), line(c, y - 8, c, y + 8, "floor"),
                  f'<circle cx="{a:.1f}" cy="{y:.1f}" r="5.5" class="before dot"/>',
                  f'<circle cx="{b:.1f}" cy="{y:.1f}" r="5.5" class="after dot"/>']
    return picture(bottom + 22.0, parts, title)


def chain(places: Sequence[str], marked: Mapping[str, Sequence[str]], title: str) -> str:
    """Boxes in a row, one driving the next; those marked stand out, with words below, each on a line of its own.

    Where there is no room beside those of the boxes before, they begin further down, at the end of a line.
    """
    width = _WIDTH * 1.6
    gap = 22.0
    size = (width - gap * (len(places) - 1)) / len(places)
    parts = []
    ends: list[float] = []  # of every line of words, so far
    for i, name in enumerate(places):
        x, middle = i * (size + gap), i * (size + gap) + 0.5 * size
        hit = name in marked
        parts.append(f'<rect x="{x + 1:.1f}" y="2" width="{size - 2:.1f}" height="34" rx="6" '
                     f'class="{"place hit" if hit else "place"}"/>')
        parts.append(text(middle, 23.0, name, "middle", "hit" if hit else ""))
        if i:
            parts.append(line(x - gap + 1, 19.0, x + 1, 19.0, "link"))
        if not hit:
            continue
        halves = [0.5 * _BOLD * len(words) for words in marked[name]]
        centres = [float(np.clip(middle, half, width - half)) for half in halves]
        begin = next(k for k in range(len(ends) + 1) if all(
            centre - half > end for centre, half, end in zip(centres, halves, ends[k:])))
        ends += [-_BOLD] * (begin + len(halves) - len(ends))
        if begin:
            parts.append(line(middle, 38.0, middle, _FIRST + _ROW * begin - 11.0, "lead"))
        for k, (words, centre, half) in enumerate(zip(marked[name], centres, halves), begin):
            ends[k] = centre + half + _BOLD
            parts.append(text(centre, _FIRST + _ROW * k, words, "middle", "hit"))
    return picture(_FIRST + _ROW * len(ends) - 10.0, parts, title, width)


def _range(values: Sequence[np.ndarray]) -> Window:
    together = np.concatenate([v for v in values if v.size] or [np.zeros(1)])
    return float(together.min()), float(together.max())
