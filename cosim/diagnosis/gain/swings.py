"""What swings with an angle has a phase of its own in every recording, and how large it is in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from cosim.diagnosis.judge.road import on_its_road
from cosim.diagnosis.plants import FullOrderCar, Run
from driveline.quantities import InputError


def in_phase(car: FullOrderCar, values: Mapping[str, float], run: Run, floors: Mapping[str, float],
             unknown: Iterable[str]) -> dict[str, float]:
    """Phases [rad] with which a car comes nearest to what was measured in one run; none where it cannot drive there.

    A channel is a constant and a swing in cosine and sine of its phase, which three simulations tell; the size stays.

    Args:
        values: Of the car, with what swings in them.
        run: Simulated as it is.
        floors: Noise of each channel.
        unknown: Values that hold these phases; found one after the other.
    """
    found, scale = {}, run.stack(floors)
    for phase in unknown:
        def shown(angle: float, phase: str = phase) -> np.ndarray:
            return car.predict({**values, **found, phase: angle}, run) / scale

        try:
            right, up, left = (shown(angle) for angle in (0.0, 0.5 * np.pi, np.pi))
        except (ArithmeticError, InputError):
            break
        middle = 0.5 * (right + left)
        parts = np.column_stack([right - middle, up - middle])
        cosine, sine = np.linalg.lstsq(parts, run.stacked / scale - middle, rcond=None)[0]
        found[phase] = float(np.arctan2(sine, cosine))
    return found


def as_driven(car: FullOrderCar, values: Mapping[str, float], run: Run, floors: Mapping[str, float],
              unknown: Iterable[str] = ()) -> tuple[dict[str, float], Run]:
    """A car with what swings in phase with a recording, and the recording left to itself on the road that suits it.

    As two cars are compared with what was measured. Arguments as of ``in_phase``.
    """
    run = on_its_road(car, values, run, floors)
    return {**values, **in_phase(car, values, run, floors, unknown)}, run
