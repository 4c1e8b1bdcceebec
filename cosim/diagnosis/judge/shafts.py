"""Whether axle shafts resist otherwise than in proportion to their twist, by no law of the catalogue: by fits.

What a torque would do that is missing is told by derivatives where a fit without it ended (``localise``). Of one within
shafts they say little: with it these twist otherwise, and so it is another, lashes are crossed at other moments, and
the fit without it has bent everything else towards it. So a curve over their twist is fitted from the vehicle file, as
causes are. What was found has to stand against it with such a curve as healthy shafts may have.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.effect import shift
from cosim.diagnosis.fit.evidence import Layout
from cosim.diagnosis.fit.fitting import Fit, Fitter, Tangent, as_found
from cosim.diagnosis.fit.noise import Noise
from cosim.diagnosis.fit.predict import Coordinate, Predictor
from cosim.diagnosis.judge.localise import Disturbance, joined, pictured, sampled
from cosim.diagnosis.judge.torques import bent, signals_of
from cosim.diagnosis.plants.bent import HEIGHTS, KNOTS, BentCar
from cosim.diagnosis.search.identification import Identification

PLACE, VARIABLE = "within the axle shafts", "twist"
_CURVE = "curve"  # in the place of a cause's name
_RISE = 0.5  # of the curve of healthy shafts from knot to knot, over how high it is: near ones are alike
_RISES = KNOTS - 1
_STRANGER = 12.0  # times what healthy shafts have of it, one sigma
_STEP = 0.3  # of differences, in sigmas of healthy shafts
# Log evidence over what was found that a curve that is not settled yet has to have, alone or beside that: from the file
# with what may only imitate it in its place a fit has further to go.
_PROMISING = (-50.0, 0.0)


@dataclass(frozen=True)
class Bent:
    """A curve within the axle shafts that no healthy ones have.

    Attributes:
        lead: Log evidence over what was found, with shafts as healthy ones are.
        disturbance: That of the curve alone; its gain is that over a healthy car.
    """

    lead: float
    disturbance: Disturbance


def rises(knots: np.ndarray) -> list[Coordinate]:
    """By how much a curve over some knots [rad] rises from each to the next [N.m]; where it begins shows in nothing."""
    found = []
    for k, size in enumerate(_RISE * bent(PLACE, VARIABLE, knots[1:]), start=1):
        beyond = [f"input.{name}.offset" for name in HEIGHTS[k:]]
        p = shift(f"{_CURVE}_{k}", *beyond, unit="N.m", meaning="of both axle shafts, beyond a twist",
                  spread=_STRANGER * size, limits=(-np.inf, np.inf), detection=size)
        found.append(Coordinate(p.name, "", _CURVE, None, p, size, p.spread, _STEP * size))
    return found


class Curves:
    """Fits with a curve within the axle shafts.

    Args:
        base: Of the runs, without one.
        noise: Under which they are fitted.
        over: A fit that says how far the shafts twist.
    """

    def __init__(self, base: Predictor, noise: Noise, over: Fit) -> None:
        twists = [signals_of(base, over, r)[VARIABLE] for r in range(len(base.runs))]
        knots = np.linspace(min(map(np.min, twists)), max(map(np.max, twists)), KNOTS)
        car = BentCar.like(base.car)
        self.noise, self._before = noise, Layout(base.coordinates, base.repeats).shared.size
        self.predictor = Predictor(car, [car.bent(run, knots) for run in base.runs],
                                   [*base.coordinates, *rises(knots)], base.workers)
        self.fitter, self.knots = Fitter(self.predictor), knots

    def start(self, fit: Fit, strange: bool) -> Fit:
        """A fit without a curve, to go on from.

        Args:
            fit: Where.
            strange: Whether the curve is a cause, or as healthy shafts have it.
        """
        straight = np.zeros(_RISES)
        tangents = [Tangent(np.insert(t.jacobian, [self._before] * _RISES, 0.0, axis=1), np.inf) for t in fit.tangents]
        shared, *points = (np.concatenate([x, straight]) for x in (fit.shared, *fit.points))
        predicted = self.predictor.all_runs(points)
        if predicted is None:
            raise ArithmeticError("what could be simulated cannot be with straight axle shafts")
        causes = (*fit.causes, _CURVE) if strange else fit.causes
        # by the curve there are no derivatives yet, and where it is no cause only those by everything are also by it
        start = self.fitter.relinearise(Fit(causes, shared, points, predicted, tangents), everything=not strange)
        return self.fitter.assess(start, self.noise)

    def cooled(self, start: Fit) -> Fit:
        """Fitted from the vehicle file, with derivatives by its causes and the runs' own."""
        fit = self.fitter.assess(self.fitter.cooled(start, self.noise), self.noise)
        return self.fitter.settle(fit, self.noise, everything=False)

    def settled(self, fit: Fit) -> Fit:
        """Until new derivatives by everything gain no more."""
        return self.fitter.settle(replace(fit, near=False, settled=False), self.noise)

    def sound(self, fit: Fit) -> Fit:
        """From where a fit with a curve is, with one as healthy shafts have it."""
        causes = tuple(cause for cause in fit.causes if cause != _CURVE)
        return self.settled(self.fitter.assess(replace(fit, causes=causes), self.noise))

    def torque(self, fit: Fit) -> dict[str, np.ndarray]:
        """The curve of a fit, as that of a ``Disturbance`` is pictured."""
        tables = []
        # 0 without twist; what each rise of 1 makes of that
        heights = [np.where(np.arange(KNOTS) >= k, 1.0, 0.0) for k in range(1, KNOTS)]
        heights = [one - np.interp(0.0, self.knots, one) for one in heights]
        for r, run in enumerate(self.predictor.runs):
            at = sampled(run, signals_of(self.predictor, fit, r))
            shown = np.column_stack([np.interp(at[VARIABLE], self.knots, one) for one in heights])
            own, covariance = fit.points[r][-_RISES:], fit.posterior.covariance[-_RISES:, -_RISES:]
            tables.append(pictured(r, shown, own, covariance, at))
        return joined(tables)


def bent_shafts(fitter: Fitter, found: Identification, file: Fit) -> Bent | None:
    """Whether such a curve, alone or beside what was found, explains the runs better; None where it does not.

    Args:
        fitter: Of the runs.
        found: By the search.
        file: The vehicle file as it is.
    """
    base, noise = fitter.predictor, found.noise.undoubted
    best, healthy = (fitter.assess(replace(fit), noise) for fit in (found.best, found.healthy))
    starts = [file]
    if best.causes:
        shared, *points = (as_found(base, best, x) for x in (best.shared, *best.points))
        starts.append(replace(best, shared=shared, points=points))
    curves = Curves(base, noise, best)
    with curves.predictor:
        cooled = curves.predictor.at_once(
            [lambda start=start: curves.cooled(curves.start(start, strange=True)) for start in starts])
        # the last is beside what was found, also where that is nothing
        settled = [curves.settled(fit) if fit.score - best.score > least else None
                   for fit, least in zip(cooled, _PROMISING[-len(starts):])]
        if max((fit.score for fit in settled if fit), default=-np.inf) <= best.score:
            return None
        # alone it has further to go, and may get further
        settled = [done or curves.settled(fit) for done, fit in zip(settled, cooled)]
        strange = max(settled, key=lambda fit: fit.score)
        # as many ways as the curve had, and from where it was beside that
        ways = (lambda: curves.settled(curves.start(best, strange=False)), lambda: curves.sound(settled[-1]),
                lambda: curves.settled(curves.cooled(curves.start(starts[-1], strange=False))))
        lead = strange.score - best.score
        for way in ways:
            lead = min(lead, strange.score - way().score)
            if lead <= 0.0:
                return None
        # what was found beside it may only imitate it: what is shown is what a healthy car lacks
        alone = settled[0]
        torque = curves.torque(alone)
    return Bent(lead, Disturbance(PLACE, alone.score - healthy.score, np.array([]), torque, VARIABLE))
