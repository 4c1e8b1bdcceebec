"""A plant of a few lines whose landscape is known, to search in."""

from dataclasses import replace

import numpy as np

from cosim.diagnosis.effect import factor
from cosim.diagnosis.fit.predict import Coordinate, Predictor
from cosim.diagnosis.plants import Run
from cosim.diagnosis.search.identify import Search

CLOCK = np.arange(0.0, 6.0, 0.02)
NOISE, RUNS, DETECTION = 0.05, 2, 0.1
PERIOD = 1.0


def coordinate(cause, run=None):
    p = factor(cause or "start", cause or "start", unit="1", meaning="", spread=1.0, limits=(np.exp(-1.0), np.e),
               detection=DETECTION)
    if not cause:
        return Coordinate("start", "", "", run, None, 0.3, 0.3, 0.01)
    return Coordinate(cause, cause, cause, None, p, 0.2 * DETECTION, 1.0, 0.02, -1.0, 1.0)


class Plant(Predictor):
    """A vibration of which one cause changes the phase, one the size, and two the slope alike.

    One of these can be less than the other, or go one way only.
    """

    def __init__(self, hidden, seed=1, lowest=-0.9):
        coordinates = [coordinate(cause) for cause in ("phase", "size", "slope", "tilt", "curve")]
        coordinates[3] = replace(coordinates[3], low=lowest)
        coordinates += [coordinate("", r) for r in range(RUNS)]
        random = np.random.default_rng(seed)
        super().__init__(None, [], coordinates)
        truth = np.array([hidden.get(c.cause, 0.0) for c in coordinates])
        self.runs = []
        for r in range(RUNS):
            values = self.predict(truth, r) + NOISE * random.standard_normal(CLOCK.size)
            self.runs.append(Run(f"{r}", "tip_in", 5, 0.0, np.zeros((6000, 1)), 10.0, {"engine_speed": CLOCK},
                                 {"engine_speed": values}))

    def predict(self, u, run, change=None):
        phase, size, slope, tilt, curve = u[:5]
        wave = (1.0 + run) * np.exp(size) * np.sin(2.0 * np.pi * CLOCK * (1.0 + 0.2 * run) / PERIOD + 8.0 * phase)
        return wave + (slope + tilt) * CLOCK + curve * (CLOCK / 6.0) ** 2 + u[5 + run]

    def bent(self, points):
        return [np.zeros(CLOCK.size) for _ in points]


class WithPlay(Plant):
    """One cause does nothing while it is small."""

    def predict(self, u, run, change=None):
        u = u.copy()
        u[4] = np.sign(u[4]) * max(abs(u[4]) - 0.8 * DETECTION, 0.0)
        return super().predict(u, run, change)


class WithStages(Plant):
    """The slope may be another up to some moment, which may be the end of the recording or later."""

    def __init__(self, hidden, stage=0.0, width=0.0):
        super().__init__(hidden | {"tilt": stage, "curve": width})  # their places
        for place, name, probe in ((3, "stage", 0.4), (4, "width", 0.2)):
            c = coordinate("stages")
            p = replace(c.parameter, name=name, probes=(float(np.exp(probe)),), same_as="slope" * (name == "stage"))
            self.coordinates[place] = replace(c, name=name, parameter=p, low=-1.0 if name == "stage" else 0.0)

    def predict(self, u, run, change=None):
        u = u.copy()
        stage, width, u[3:5] = u[3], u[4], 0.0
        return super().predict(u, run, change) + stage * np.minimum(CLOCK, 8.0 * width)


def found(hidden):
    """A search on a plant with something hidden, and its result."""
    search = Search(Plant(hidden), lambda text: None)
    return search, search.run()


def leading(search, fit, changes):
    """A fit with some sizes changed, as if it had been settled there."""
    def changed(vector):
        vector = vector.copy()
        for cause, size in changes.items():
            vector[search.predictor.index(cause)] = size
        return vector

    causes = tuple(sorted(changes))
    there = search.fitter.placed(fit, causes, changed(fit.shared), [changed(point) for point in fit.points])
    there = replace(search.fitter.assess(there, search.pool.noise), near=True, settled=True)
    search.pool.fits[causes] = there
    return there
