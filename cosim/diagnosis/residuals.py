"""What a simulation gets wrong, on the physics an engineer names, with how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from cosim.diagnosis.features import FEATURES, Reader, words
from cosim.diagnosis.identify import Identification
from cosim.diagnosis.noise import Noise
from cosim.diagnosis.predict import Predictor
from cosim.measured import CANONICAL

DRAWS = 30
SIGNIFICANT = 0.01  # after correction for the number of features looked at


@dataclass(frozen=True)
class Wrong:
    """One thing a simulation gets wrong.

    Attributes:
        signal, feature: Which number of which channel, ``engine_speed`` and ``shuffle frequency``.
        where: The run, in words.
        what: The difference, in words.
        measured, simulated, size, unit: The numbers; size is simulated minus measured.
        low90, high90: Of the size.
        p_value: That a healthy car would show it, corrected for the number of features.
        effective_samples: Of the channel in that run, as its noise is coloured.
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
    unit: str
    p_value: float
    effective_samples: int

    def as_json(self) -> dict:
        """For the finding."""
        return {"signal": self.signal, "where": self.where, "what": self.what, "size": self.size,
                "unit": self.unit, "p_value": self.p_value, "feature": self.feature, "measured": self.measured,
                "simulated": self.simulated, "low90": self.low90, "high90": self.high90,
                "effective_samples": self.effective_samples}


def wrong(predictor: Predictor, found: Identification, seed: int = 1) -> list[Wrong]:
    """Every feature in which a recording differs from the vehicle file by more than a healthy car would.

    A healthy car's features are drawn: its numbers within their tolerance, by the sensitivities of its
    simulation, and noise of the colour that the best model leaves. So nothing counts as wrong that a car
    like the file's, recorded as these were, would also show.
    """
    random = np.random.default_rng(seed)
    spread = np.array([0.0 if c.name == "start_speed" else c.tolerance for c in predictor.coordinates])
    cars = spread * random.standard_normal((DRAWS, spread.size))
    rows = []
    for r, run in enumerate(predictor.runs):
        reader = Reader(run, found.nominal[r])
        measured, simulated = reader.read(run.stacked), reader.read(found.nominal[r])
        drawn = [reader.read(found.nominal[r] + found.healthy.jacobians[r] @ car + found.noise.drawn(r, random))
                 for car in cars]
        for key in measured.keys() & simulated.keys():
            seen = np.array([d[key] for d in drawn if key in d])
            if seen.size < 0.7 * DRAWS or not np.std(seen) > 0.0:
                continue
            # what is read off noisy signals is biased: the draws have that bias too
            deviation = float(np.std(seen, ddof=2))
            z = (measured[key] - float(np.mean(seen))) / deviation
            rows.append((r, key, measured[key], simulated[key], deviation,
                         2.0 * float(student.sf(abs(z), seen.size - 1))))
    rows.sort(key=lambda row: row[-1])
    result, corrected = [], 0.0
    for rank, (r, (channel, feature), now, then, deviation, p) in enumerate(rows):
        corrected = max(corrected, min(1.0, (len(rows) - rank) * p))  # Holm
        if corrected > SIGNIFICANT:
            break
        run = predictor.runs[r]
        canonical = CANONICAL.get(channel)
        what, size, unit = words(feature, channel, canonical.unit if canonical else "1", now, then)
        result.append(Wrong(
            channel, feature, _where(run.name, run.gear, run.clocks), what, now, then, size,
            size - 1.645 * deviation, size + 1.645 * deviation, unit, corrected,
            _effective(found.noise, channel, run)))
    order = {name: i for i, name in enumerate(FEATURES)}
    return sorted(result, key=lambda w: (round(np.log10(w.p_value + 1e-300)), order[w.feature]))


def _effective(noise: Noise, channel: str, run) -> int:
    name = channel.split(" over ")[0]
    return max(1, round(noise.colours[name].sample_share * run.clocks[name].size))


def _where(name: str, gear: int, clocks) -> str:
    start = min(float(clock[0]) for clock in clocks.values())
    stop = max(float(clock[-1]) for clock in clocks.values())
    return f"{name}, gear {gear}, {start:.1f} to {stop:.1f} s"
