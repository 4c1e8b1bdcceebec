"""The car with axle shafts that carry a curve over their twist beside what is in proportion to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cosim.diagnosis.plants.car import FullOrderCar
from cosim.diagnosis.plants.led import LedPlant
from cosim.diagnosis.plants.run import Run
from driveline.elements.curved_shaft import KNOTS, SIGNALS
from driveline.plants.assembly import Assembly
from driveline.plants.full_order import FullOrderParameters, input_variable

BEGIN, PITCH, *HEIGHTS = SIGNALS


class BentPlant(LedPlant):
    """The led plant with such a curve; both shafts have half of it."""

    inputs = (*LedPlant.inputs,
              input_variable(BEGIN, "rad", "twist at the curve's first knot"),
              input_variable(PITCH, "rad", "twist between its knots", start=1.0),
              *(input_variable(name, "N.m", "torque of both axle shafts at a knot") for name in HEIGHTS))

    def attach(self, net: Assembly, p: FullOrderParameters) -> None:
        super().attach(net, p)
        for side in ("left", "right"):
            net.curve(f"{side}_curve", f"{side}_axle_shaft", 0.5, net.signal(BEGIN))


class BentCar(FullOrderCar):
    """The full-order car whose plant has it; its heights are the errors of inputs, ``input.curve_0.offset`` ..."""

    plant = BentPlant

    @classmethod
    def like(cls, car: FullOrderCar) -> BentCar:
        """The same car."""
        return cls(car.vehicle, car.variant, car.values)

    def bent(self, run: Run, knots: np.ndarray) -> Run:
        """A run of the car without a curve, made ready for this one.

        Args:
            run: Which.
            knots: Twists at which the curve may bend [rad], equally far from each other.

        Raises:
            ValueError: They are not ``KNOTS``.
        """
        if knots.size != KNOTS:
            raise ValueError(f"{knots.size} knots: a curve has {KNOTS}")
        inputs = np.hstack([run.inputs, np.tile(self.idle_inputs[run.inputs.shape[1]:], (len(run.inputs), 1))])
        inputs[:, self.columns[BEGIN]] = knots[0]
        inputs[:, self.columns[PITCH]] = knots[1] - knots[0]
        return replace(run, inputs=inputs)
