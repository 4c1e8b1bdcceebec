"""Small models with exact solutions, for the master: shipped in test FMUs and used in process."""

from __future__ import annotations

import math

import numpy as np

from driveline.model import Model
from driveline.quantities import Variable


class Lag(Model):
    """First-order lag, exact for held inputs; ``fast`` passes its input through within the step."""

    name = "lag"
    description = "First-order lag"

    def __init__(self, defaults: dict[str, float]) -> None:
        declared = (
            Variable("time_constant", "s", "time constant", start=0.1, minimum=1e-6),
            Variable("start_angle", "rad", "start value", start=0.0),
            Variable("u", "rad", "input", "input", "continuous"),
            Variable("gear", "1", "passed on", "input", "discrete", "integer", start=1, minimum=1, maximum=6),
            Variable("y", "rad", "lagged input", "output", "continuous"),
            Variable("y_speed", "rad/s", "its derivative", "output", "continuous", depends_on=("u",)),
            Variable("gear_out", "1", "the gear it was given", "output", "discrete", "integer"),
        )
        self.variables = tuple(
            Variable(**{**vars(v), "start": defaults.get(v.name, v.start)}) for v in declared)
        super().__init__()

    def _prepare(self) -> None:
        self.state = np.zeros(1)

    def _initialize(self, start_time: float) -> None:
        self.state[0] = self.values[1]
        self._outputs()

    def _step(self, time: float, dt: float) -> None:
        decay = math.exp(-dt / self.values[0])
        self.state[0] = self.values[2] + (self.state[0] - self.values[2]) * decay
        if abs(self.state[0]) > 1e6:
            raise ArithmeticError("y has left the finite numbers")
        self._outputs()

    def _outputs(self) -> None:
        self.values[4] = self.state[0]
        self.values[5] = (self.values[2] - self.state[0]) / self.values[0]
        self.values[6] = self.values[3]


class Counter(Model):
    """Adds its input to a sum once a step: shows which value of a source a step saw."""

    name = "counter"
    description = "Sum of sampled inputs"

    def __init__(self, defaults: dict[str, float]) -> None:
        self.variables = (
            Variable("u", "deg", "input", "input", "continuous"),
            Variable("seen", "deg", "the input of the last step", "output", "continuous"),
            Variable("steps", "1", "number of steps", "output", "discrete", "integer"),
            Variable("ended", "s", "end of the last step", "output", "continuous"),
        )
        super().__init__()

    def _prepare(self) -> None:
        self.state = np.zeros(1)

    def _initialize(self, start_time: float) -> None:
        self.values[1:] = 0.0

    def _step(self, time: float, dt: float) -> None:
        self.values[1] = self.values[0]
        self.values[2] += 1.0
        self.values[3] = time + dt


MODELS = {model.name: model for model in (Lag, Counter)}
