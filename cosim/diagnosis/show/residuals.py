"""What a simulation gets wrong, on the physics an engineer names, with how sure that is.

A feature is wrong where the recording's lies outside what a healthy car would have shown in that run: a
car whose numbers are the vehicle file's but for their tolerance, recorded with the same sensors. Those
draws carry noise and resolution as the recording does, so what noise does to a feature cancels.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter
from scipy.stats import chi2, f, kurtosis, t

from cosim.diagnosis.plants import Run
from cosim.diagnosis.show.features import FEATURES, Feature, Key, Reader, unit_of, words

Each = Callable[[Callable[[np.ndarray], dict[Key, float]], Iterable[np.ndarray]], Iterable[dict[Key, float]]]

SIGNIFICANT = 0.01  # after correction for the number of features looked at
_REPEATED = 0.05  # repeats that differ by more than healthy draws do, this significantly, set the scale
_OF_A_SHIFT = ("lag", "lag behind the others", "amplitude")
_SHARE = 0.8  # of the misfit that a shift or a scale must explain to be called one
_OF_THE_SHAPE = ("shuffle frequency", "shuffle damping", "speed ratio")  # where they are wrong, channels shift apart
_USUAL = 1.5  # times a healthy car's: a misfit that leaves room for nothing but the shift
_MISSING = 0.2  # of the draws in which a feature may be absent
_BLOCK, _BOOTSTRAP = 0.3, 16  # s; resampled noise
_LAGS = 20  # of the test for whiteness


@dataclass(frozen=True)
class Wrong:
    """One thing a simulation gets wrong.

    Attributes:
        signal, feature: Which number of which channel, ``engine_speed`` and ``shuffle frequency``.
        where: The run where it is clearest, gear and time span, and in how many recordings it shows.
        what: The difference, in words.
        measured, simulated: The feature's values; for a waveform the error, and a healthy car's.
        size: Simulated minus measured; for what measures a difference already: that.
        low90, high90: Of the size, by the run-to-run scatter of repeats or of the healthy draws.
        noise_floor: Standard deviation of the feature with nothing changed, from repeats where they exist, else
            by a moving-block bootstrap of the channel's noise.
        unit: SI, of all of these.
        p_value: That a healthy car would show it, corrected for the number of features looked at.
        run, begin, end: Where it is clearest: name of the recording, span [s] on its clock.
        runs: Names of all recordings in which it shows.
        whiteness_p: Ljung-Box: that the residual of the channel in that run is white; small: structure is left.
        effective_samples: That the residual is worth, being coloured.
    """

    signal: str
    feature: str
    where: str
    what: str
    measured: float
    simulated: float
    size: float
    low90: float
    high90: float
    noise_floor: float
    unit: str
    p_value: float
    run: str
    begin: float
    end: float
    runs: tuple[str, ...]
    whiteness_p: float
    effective_samples: int

    def as_json(self) -> dict:
        """For the finding; the contract's keys first."""
        first = ("signal", "where", "what", "size", "unit", "p_value")
        found = {key: getattr(self, key) for key in first} | vars(self) | {"runs": list(self.runs)}
        return {key: None if value != value else value for key, value in found.items()}  # JSON knows no NaN


@dataclass
class _Row:
    """One feature of one run: measured, simulated and what healthy cars show, logarithms where it is one."""

    run: int
    key: Key
    measured: float
    simulated: float
    healthy: np.ndarray
    scale: float = 0.0
    freedom: float = 0.0  # degrees of it that the scale has
    p: float = 1.0

    @property
    def kind(self) -> Feature:
        return FEATURES[self.key[1]]

    @property
    def excess(self) -> float:
        """How far the recording lies from what healthy cars show."""
        return self.measured - float(np.mean(self.healthy))


def wrong(runs: Sequence[Run], nominal: Sequence[np.ndarray], healthy: Sequence[Sequence[np.ndarray]],
          firing_order: float = Reader.firing_order, each: Each = map) -> list[Wrong]:
    """Every feature in which recordings differ from the vehicle file by more than a healthy car would.

    Args:
        runs: The recordings.
        nominal: Per run, the stacked channels simulated freely with the vehicle file as it is.
        healthy: Per run, many (some 30) stacked channels as a healthy car would have shown them: numbers
            within tolerance, torque estimate, slope, sensor noise and resolution drawn. The k-th of every
            run is the same car.
        firing_order: Firings of the engine per revolution of its crankshaft.
        each: Does a thing to each of many, as ``map``; in several processes where there are.

    Returns:
        What tells most first: one entry of each feature, then the others; each feature of a signal once,
        where it is clearest.
    """
    readers = [Reader(run, simulated, firing_order) for run, simulated in zip(runs, nominal)]
    rows: dict[Key, list[_Row]] = defaultdict(list)
    for r, reader in enumerate(readers):
        for row in _rows(r, reader, nominal[r], each(reader.read, healthy[r])):
            rows[row.key].append(row)
    scatter = _repeats(runs, rows)
    tests = []
    for key, found in rows.items():
        for row in found:
            _judge(row, *scatter.get((runs[row.run].manoeuvre, key), (0.0, 0)))
        tests += [(row.p, key) for row in found] + [(p, key) for p in _together(found)]
    surest: dict[Key, float] = {}
    corrected = 0.0
    for rank, (p, key) in enumerate(sorted(tests)):
        corrected = max(corrected, min(1.0, (len(tests) - rank) * p))  # Holm
        if corrected > SIGNIFICANT:
            break
        surest.setdefault(key, corrected)
    odd = any(feature in _OF_THE_SHAPE for _, feature in surest)
    return _ordered([_wrong(rows[key], p, readers, nominal, scatter) for key, p in surest.items()
                     if _is_one(rows[key], readers, healthy, odd)])


def _rows(r: int, reader: Reader, nominal: np.ndarray, healthy: Iterable[Mapping[Key, float]]) -> list[_Row]:
    """The features of a run that the recording and nearly all healthy draws show, which are read already."""
    measured, simulated, drawn = reader.read(reader.run.stacked), reader.read(nominal), list(healthy)
    rows = []
    for key, value in measured.items():
        seen = np.array([d.get(key, np.nan) for d in drawn])
        kind = FEATURES[key[1]]
        if np.isnan(seen).mean() > _MISSING or not np.nanstd(seen) > 0.0:
            continue
        seen[np.isnan(seen)] = np.nanmean(seen)
        # what measures a difference from the simulation is none in the simulation itself
        then = float(np.median(seen)) if kind.name == "waveform" else simulated.get(key)
        if then is None or kind.log and min(value, then, *seen) <= 0.0:
            continue
        if kind.log:
            value, then, seen = np.log(value), np.log(then), np.log(seen)
        rows.append(_Row(r, key, float(value), float(then), seen))
    return rows


def _repeats(runs: Sequence[Run], rows: Mapping[Key, Sequence[_Row]]) -> dict[tuple, tuple[float, int]]:
    """By what repeats have in common and feature: standard deviation of the recording less the simulation over them,
    and its degrees of freedom."""
    groups: dict[tuple, list[float]] = defaultdict(list)
    for row in itertools.chain(*rows.values()):
        if common := runs[row.run].manoeuvre:
            groups[(common, row.key)].append(row.measured - row.simulated)
    return {key: (float(np.std(values, ddof=1)), len(values) - 1)
            for key, values in groups.items() if len(values) > 1}


def _judge(row: _Row, repeated: float, freedom: int) -> None:
    """Scale and p-value: of one more draw from the same distribution, by Student's t with the scale's freedom."""
    scale, own = float(np.std(row.healthy, ddof=1)), row.healthy.size - 1
    if freedom and scale > 0.0 and f.sf((repeated / scale) ** 2, freedom, own) < _REPEATED:
        scale, own = repeated, freedom
    size = 1.0 if row.kind.log else abs(float(np.mean(row.healthy)))
    row.scale = float(np.hypot(scale, row.kind.tolerance * size))
    row.freedom = own * (row.scale / scale) ** 4  # Welch and Satterthwaite: the tolerance is known
    row.p = _student(row.excess / row.scale, row.healthy, row.freedom, row.kind.one_sided)


def _together(rows: Sequence[_Row]) -> list[float]:
    """P-values of a feature's mean deviation over all runs. What a healthy car deviates by in all of them is
    in the draws, as a draw is one car in all runs."""
    count = min(row.healthy.size for row in rows)
    if len(rows) < 2:
        return []
    signs = {(1.0,) * len(rows)}
    if rows[0].key[1] == "drift":  # less mass gains and loses speed faster; a slope only does one
        signs.add(tuple(float(np.sign(row.simulated)) for row in rows))
    found = []
    for sign in signs:
        excess = sum(s * row.excess / row.scale for s, row in zip(sign, rows))
        drawn = sum(s * (row.healthy[:count] - np.mean(row.healthy)) / row.scale for s, row in zip(sign, rows))
        # as much larger as repeats and honest models differ by more than draws
        shares = np.array([(row.scale / np.std(row.healthy, ddof=1)) ** 2 for row in rows])
        wider = np.sqrt(np.mean(shares))
        # Satterthwaite's, of scales that err together: those of repeats are one and the same
        freedom = float(np.average([row.freedom ** -0.5 for row in rows], weights=shares)) ** -2
        found.append(_student(excess / (wider * float(np.std(drawn, ddof=1))), drawn, freedom, rows[0].kind.one_sided))
    return found


def _student(score: float, drawn: np.ndarray, freedom: float, one_sided: bool) -> float:
    """P-value of one more value, ``score`` standard deviations, of so many degrees of freedom, from the mean of those
    drawn."""
    # draws with heavy tails: the Student distribution that has their kurtosis
    tails = float(kurtosis(drawn, bias=False))
    degrees = min(freedom, drawn.size - 1, 4.0 + 6.0 / tails if tails > 0.0 else np.inf)
    score /= np.sqrt(1.0 + 1.0 / drawn.size)
    return float(t.sf(score, degrees)) if one_sided else 2.0 * float(t.sf(abs(score), degrees))


def _is_one(rows: Sequence[_Row], readers: Sequence[Reader], healthy: Sequence[Sequence[np.ndarray]],
            odd: bool) -> bool:
    """Whether a lag is a lag: shifting and scaling the simulation takes most of what is wrong away, or, unless
    the shape is ``odd``, there is little else that is."""
    signal, feature = rows[0].key
    if feature not in _OF_A_SHIFT or feature == "lag behind the others" and not odd:
        return True
    before, after, usual = 0.0, 0.0, 0.0
    for row in rows:
        reader = readers[row.run]
        unit = float(np.median([reader.shifted_share(signal, stacked)[0] for stacked in healthy[row.run]]))
        now, then = reader.shifted_share(signal, reader.run.stacked)
        before, after, usual = before + now / unit, after + then / unit, usual + 1.0
    return before < _USUAL * usual and not odd or before - after > _SHARE * max(before - usual, 0.1 * before)


def _wrong(rows: Sequence[_Row], p: float, readers: Sequence[Reader], nominal: Sequence[np.ndarray],
           scatter: Mapping[tuple, tuple[float, int]]) -> Wrong:
    """One feature of one signal, where it is clearest."""
    row = min(rows, key=lambda row: (row.p, -abs(row.excess) / row.scale))
    reader = readers[row.run]
    run, (signal, feature), kind = reader.run, row.key, row.kind
    invert = np.exp if kind.log else lambda x: x
    measured, simulated = float(invert(row.measured)), float(invert(row.simulated))
    reach = float(t.ppf(0.95, row.freedom)) * row.scale
    ends = [float(invert(row.measured + side * reach)) for side in (-1.0, 1.0)]
    own = kind.one_sided
    low, high = ends if own else (simulated - ends[1], simulated - ends[0])
    repeated, freedom = scatter.get((run.manoeuvre, row.key), (0.0, 0))
    floor = repeated * (measured if kind.log else 1.0) if freedom else _bootstrap(reader, row.key)
    residual = run.stacked - nominal[row.run]
    whiteness, effective = coloured(residual[run.slices[signal.split(" over ")[0]]])
    shown = tuple(readers[r.run].run.name for r in rows if r.p < SIGNIFICANT or r is row)
    begin, end = reader.span(feature)
    where = f"{run.name}, gear {run.gear}, {begin:.1f} to {end:.1f} s"
    if len(rows) > 1:
        where += f"; in {len(shown)} of {len(rows)} recordings"
    return Wrong(signal, feature, where,
                 words(signal, feature, measured, simulated), measured, simulated,
                 measured if own else simulated - measured, low, high, floor, unit_of(signal, feature), p,
                 run.name, begin, end, shown, whiteness, effective)


def _ordered(listed: Sequence[Wrong]) -> list[Wrong]:
    """The surest of each feature first, features in the order an engineer asks for them where equally sure;
    a lag once; waveforms last, and only where nothing else tells what is wrong with that signal."""
    named = {entry.signal for entry in listed if entry.feature != "waveform"}
    late = {entry.signal for entry in listed if entry.feature == "lag"}
    listed = [entry for entry in listed if not (entry.feature == "waveform" and entry.signal in named
                                                or entry.feature == "lag behind the others" and entry.signal in late)]
    place = {name: i for i, name in enumerate(FEATURES)}
    listed = sorted(listed, key=lambda entry: (entry.p_value, place[entry.feature]))
    seen: dict[str, int] = defaultdict(int)
    ranked = []
    for entry in listed:
        ranked.append(((entry.feature == "waveform", seen[entry.feature] > 0), entry))
        seen[entry.feature] += 1
    return [entry for _, entry in sorted(ranked, key=lambda pair: pair[0])]


def _bootstrap(reader: Reader, key: Key, seed: int = 1) -> float:
    """Standard deviation of a feature under the noise of its channels, resampled in moving blocks."""
    run, random = reader.run, np.random.default_rng(seed)
    smooth, noise = np.empty(run.stacked.size), np.empty(run.stacked.size)
    for name, place in run.slices.items():
        values = run.measured[name]
        smooth[place] = savgol_filter(values, min(7, values.size // 2 * 2 - 1), 3)
        noise[place] = (values - smooth[place]) / np.sqrt(0.67)  # the filter takes a third of white noise
    found = []
    for _ in range(_BOOTSTRAP):
        drawn = np.concatenate([_blocks(noise[place], run.clocks[name], random)
                                for name, place in run.slices.items()])
        found.append(reader.read(smooth + drawn).get(key))
    values = np.array([value for value in found if value is not None])
    return float(np.std(values, ddof=1)) if values.size > 1 else float("nan")


def _blocks(noise: np.ndarray, clock: np.ndarray, random: np.random.Generator) -> np.ndarray:
    length = int(np.clip(round(_BLOCK / float(np.median(np.diff(clock)))), 1, noise.size))
    starts = random.integers(0, noise.size - length + 1, -(-noise.size // length))
    return np.concatenate([noise[start:start + length] for start in starts])[:noise.size]


def coloured(residual: np.ndarray) -> tuple[float, int]:
    """Ljung-Box p-value of a residual, and how many independent samples it is worth for its mean (Geyer's
    initial positive sequence)."""
    count = residual.size
    centred = residual - residual.mean()
    spectrum = np.fft.rfft(centred, 2 * count)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not correlation[0] > 0.0:
        return 1.0, count
    rho = correlation / correlation[0]
    lags = np.arange(1, min(_LAGS, count // 5) + 1)
    statistic = count * (count + 2.0) * float(np.sum(rho[lags] ** 2 / (count - lags)))
    pairs = rho[:count // 2 * 2].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    time = 2.0 * float(pairs[:ends[0] if ends.size else None].sum()) - 1.0
    return float(chi2.sf(statistic, lags.size)), int(np.clip(round(count / time), 1, count))
