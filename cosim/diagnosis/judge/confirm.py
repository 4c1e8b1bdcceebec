"""What was found on some stretches of a drive, judged on those that were left out whole.

A long drive has many stretches; a few are fitted, and what is consistent in these may still be an error they have in
common. So every cause has to make the others better as well: left to themselves, each on a road of its own, with the
cause and without it. All their channels together are one pair of errors a stretch, so that neighbouring samples, which
are alike, do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.fit.fitting import Fit, as_found
from cosim.diagnosis.fit.predict import Predictor, effect_of
from cosim.diagnosis.fit.regression import paired
from cosim.diagnosis.judge.road import on_its_road
from cosim.diagnosis.plants import FullOrderCar, Run
from cosim.diagnosis.search.identification import Identification
from driveline.quantities import InputError

FEWEST = 8  # stretches that judge
_CHANCE = 0.05  # that anything is confirmed where nothing is there, whatever was tried
_CANNOT = 1e9  # times the noise: error where nothing can be simulated
_FAR = 12.0  # log evidence below the best: what is not asked for


@dataclass(frozen=True)
class Verdict:
    """What the stretches say of one cause.

    Attributes:
        cause: Which.
        share: Error with it over that without it, geometric mean over stretches and channels.
        better: Stretches that it makes better.
        chance: That they look so where it is not there.
        confirmed: Whether that is too little, for as many causes as could have been found.
    """

    cause: str
    share: float
    better: int
    chance: float
    confirmed: bool

    @property
    def effect(self) -> str:
        """The effect of the catalogue that it belongs to."""
        return effect_of(self.cause)


class Jury:
    """Stretches that were not fitted.

    Args:
        predictor: Over those that were.
        runs: The others.
        floors: Noise of each channel.
    """

    def __init__(self, predictor: Predictor, runs: Sequence[Run], floors: Mapping[str, float]) -> None:
        self.predictor, self.runs, self.floors = predictor, list(runs), floors
        # the same causes are asked for in several sizes: as fitted together with others, and without them
        self._known: dict[tuple[tuple[str, ...], bytes], np.ndarray] = {}

    def judged(self, found: Identification,
               fitted: Callable[[tuple[str, ...]], Fit]) -> tuple[Identification, list[Verdict]]:
        """Only suppositions of which every cause is confirmed; and what is said of the causes of the best before.

        What is confirmed of that one is a supposition too, also where nobody fitted it. The phases of what swings are
        not known in other stretches, so such causes are neither simulated nor asked for.

        Args:
            found: What was found on the stretches that were fitted.
            fitted: Fits some of the causes of the best without the others.
        """
        best, *others = found.alternatives
        fits = {fit.causes: fit for fit in found.alternatives}
        verdicts = self._asked(fits, best)
        denied = {verdict.cause for verdict in verdicts if not verdict.confirmed}
        part = tuple(cause for cause in best.causes if cause not in denied)
        if part not in fits:
            fits[part] = fitted(part)
            others = sorted([*others, fits[part]], key=lambda fit: -fit.score)
        kept = [] if denied else [best]
        for fit in others:
            if kept and kept[0].score - fit.score > _FAR:
                break
            if all(verdict.confirmed for verdict in self._asked(fits, fit)):
                kept.append(fit)
        return replace(found, best=kept[0], alternatives=kept), verdicts

    def _asked(self, fits: Mapping[tuple[str, ...], Fit], fit: Fit) -> list[Verdict]:
        return [self._judged(fits, fit, cause) for cause in fit.causes if not self._swings(cause)]

    def _judged(self, fits: Mapping[tuple[str, ...], Fit], fit: Fit, cause: str) -> Verdict:
        rest = fit.without(cause)
        without = fits.get(rest) or self._stripped(fit, rest)
        before, after = self._errors(without), self._errors(fit)
        chance = paired(before, after)
        return Verdict(cause, float(np.exp(np.mean(np.log(after / before)))), int(np.sum(after < before)), chance,
                       chance < _CHANCE / self.predictor.tried)

    def _swings(self, cause: str) -> bool:
        return any(self.predictor.coordinates[i].run is not None for i in self.predictor.index(cause))

    def _stripped(self, fit: Fit, causes: tuple[str, ...]) -> Fit:
        """A fit that keeps only some causes, as large as they are."""
        gone = [i for cause in set(fit.causes) - set(causes) for i in self.predictor.index(cause)]
        shared = fit.shared.copy()
        shared[gone] = 0.0
        return replace(fit, causes=causes, shared=shared)

    def _errors(self, fit: Fit) -> np.ndarray:
        """Error of every stretch: root mean squares over noise, geometric mean over its channels."""
        asked = fit.causes, fit.shared.tobytes()
        if asked not in self._known:
            shared = [0.0 if c.run is not None else x for c, x in zip(self.predictor.coordinates, fit.shared)]
            values, _ = self.predictor.values(as_found(self.predictor, fit, np.array(shared)), 0)
            self._known[asked] = np.array([self._error(values, run) for run in self.runs])
        return self._known[asked]

    def _error(self, values: Mapping[str, float], run: Run) -> float:
        car: FullOrderCar = self.predictor.car
        try:
            left = run.stacked - car.predict(values, on_its_road(car, values, run, self.floors))
        except (ArithmeticError, InputError):  # a car that cannot drive there is no better
            return _CANNOT
        left /= run.stack(self.floors)
        return float(np.exp(np.mean([0.5 * np.log(np.mean(left[place] ** 2)) for place in run.slices.values()])))


def words(verdicts: Sequence[Verdict], count: int) -> list[str]:
    """What some stretches say of causes, in words."""
    said = []
    for verdict in verdicts:
        name = verdict.cause.replace("_", " ").replace(":", ", ")
        how = (f"the error there is {100.0 * verdict.share:.0f} % of that without it, less in {verdict.better} of "
               f"{count} (p = {verdict.chance:.1g})")
        said.append(f"{count} further stretches {'confirm' if verdict.confirmed else 'do not confirm'} {name}: {how}")
    return said
