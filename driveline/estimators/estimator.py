"""What every estimator has in common: frames at its sampling time, and bad frames survived."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..kernel_model import KernelModel
from ..plants.reduced import LashShaft, ThreeMassDriveline, three_mass_at_hub
from ..quantities import InputError, Variable, declared, parameter_variables, quantity


@dataclass(frozen=True)
class Sampling:
    """When frames are taken in."""

    period: float = quantity("s", "sampling time of the estimator", start=0.01, minimum=1e-4, maximum=0.1)


@dataclass(frozen=True)
class Delays:
    """Delays that are known."""

    engine_speed: float = quantity("s", "from taking an engine speed to reading it",
                                   start=0.0, minimum=0.0, maximum=0.05)
    wheel_speed: float = quantity("s", "from taking a wheel speed to reading it",
                                  start=0.0, minimum=0.0, maximum=0.05)

    def longest(self, period: float, kept: int) -> float:
        """The longest delay [s] that so many frames reach back, one ``period`` [s] apart.

        Raises:
            InputError: One of these is longer.
        """
        oldest = (kept - 2) * period
        for name, delay in (("engine_speed", self.engine_speed), ("wheel_speed", self.wheel_speed)):
            if delay > oldest:
                raise InputError(f"delay.{name} is {delay:g} s: with a sampling.period of {period:g} s at most "
                                 f"{oldest:g} s are kept")
        return oldest


@dataclass(frozen=True)
class Noise:
    """Covariances of the thesis's estimators, appendix A (eq. A.1 to A.4)."""

    q_1: float = quantity("rad2", "process noise of the shaft's twist", start=1e-2, minimum=0.0)
    q_2: float = quantity("rad2/s2", "process noise of the engine speed", start=1e3, minimum=0.0)
    q_3: float = quantity("rad2", "process noise of the wheel shaft's twist", start=5e-3, minimum=0.0)
    q_4: float = quantity("rad2/s2", "process noise of the final drive speed", start=4e-3, minimum=0.0)
    q_5: float = quantity("rad2/s2", "process noise of the wheel speed", start=1e-1, minimum=0.0)
    q_6: float = quantity("rad2", "process noise of the lash angle", start=1e-3, minimum=0.0)
    r_1: float = quantity("rad2/s2", "measurement noise of the engine speed", start=2e-5, minimum=1e-12)
    r_2: float = quantity("rad2/s2", "measurement noise of the wheel speed", start=3e-5, minimum=1e-12)

    @property
    def process(self) -> np.ndarray:
        """q_1 to q_6."""
        return np.array([self.q_1, self.q_2, self.q_3, self.q_4, self.q_5, self.q_6])

    @property
    def measurement(self) -> np.ndarray:
        """r_1 and r_2."""
        return np.array([self.r_1, self.r_2])


def retuned(kind: type, name: str, start: float, **bounds: float) -> Any:
    """The field of a dataclass of quantities with another start value, and other bounds, for a subclass."""
    return field(default=start, metadata={**kind.__dataclass_fields__[name].metadata, **bounds})


@dataclass(frozen=True)
class Trust:
    """How much of what it cannot explain an estimator puts up with before it says so.

    Both means are over about ``AVERAGED`` seconds. The second bound is the sharper one where Q is as
    large as in appendix A, which promises innovations of 30 rad/s.
    """

    surprise: float = quantity("1", "bound on the mean normalised innovation", start=9.0, minimum=0.0)
    torque: float = quantity("N.m", "bound on the torque the innovations stand for, at the crankshaft",
                             start=60.0, minimum=0.0)
    missing: float = quantity("s", "time without a complete frame", start=0.05, minimum=0.0)


AVERAGED = 0.2

FRAME_INPUTS = (
    Variable("engine_torque", "N.m", "torque at the crankshaft, brake (T_e,inst,brake)",
             "input", "continuous", nominal=100.0),
    Variable("engine_speed", "rad/s", "engine speed as it arrives; NaN for a frame that is missing",
             "input", "continuous", nominal=100.0),
    Variable("wheel_speed", "rad/s", "driven wheel speed as it arrives; NaN for a frame that is missing",
             "input", "continuous", nominal=30.0),
)


FRAME = len(FRAME_INPUTS)


def estimate(name: str, unit: str, meaning: str, nominal: float | None = None) -> Variable:
    """An output of an estimator."""
    return Variable(name, unit, meaning, "output", "discrete", nominal=nominal)


class Estimator(KernelModel):
    """A step function over frames behind the model boundary.

    A frame is taken in at every multiple of ``sampling.period`` that a communication step reaches;
    between them the outputs are held. Of several frames in one communication step only the last has
    measurements, the others are missing: what is set once was measured once. Inputs may be anything: what
    is not a plausible number counts as a missing frame. After a run has left the finite numbers for
    whatever reason, an estimator starts anew with the next good frame.

    Subclasses give ``Parameters``, ``inputs``, ``output_variables``, ``entry_point`` (name of the
    step's kernel), ``constants``, ``state_size``, ``work_size`` and the ``flank`` on which they need the
    stiffness right (1 driving, -1 coasting, 0 both).
    """

    default_step = 1e-2
    inputs: ClassVar[tuple[Variable, ...]] = FRAME_INPUTS
    state_size: ClassVar[int]
    work_size: ClassVar[int]
    flank: ClassVar[float] = 0.0

    @classmethod
    def defaults_from(cls, vehicle: Any, gear: int = 5) -> dict[str, float]:
        """What ``Parameters`` has of the driveline lumped from a vehicle file, for one gear.

        That is all of ``ThreeMassDriveline`` where it is derived from that, and else what bears the same name and
        unit; of an estimator that stands on no driveline, nothing.
        """
        from ..plants.full_order import FullOrderParameters

        wanted = {name: unit for name, (unit, _) in declared(cls.Parameters).items()}
        if not any(wanted.get(name) == unit for name, (unit, _) in declared(ThreeMassDriveline).items()):
            return {}
        driveline = three_mass_at_hub(vehicle.parameters(FullOrderParameters), gear, flank=cls.flank)
        return {v.name: v.start for v in parameter_variables(driveline) if wanted.get(v.name) == v.unit}

    def constants(self, parameters: Any) -> np.ndarray:
        """The numbers the step's kernel needs, as its documentation lays them out."""
        raise NotImplementedError

    def _check(self, causality: str) -> None:
        if causality != "input":  # a bad frame is no error here, it is a missing one
            super()._check(causality)

    def _prepare(self) -> None:
        parameters = self.parameters
        self._period = parameters.sampling.period
        self._constants = self.constants(parameters)
        # frames taken in so far, then the kernel's own state
        self.state = np.zeros(1 + self.state_size)
        self._work = np.zeros(self.work_size)
        self._warned = False
        self._run = self._kernel.bind(self.state, self._constants, self._work, self._inputs, self._outputs)

    def _initialize(self, start_time: float) -> None:
        self.state[0] = np.floor(start_time / self._period + 1e-6)
        self._outputs[:] = 0.0
        self._run(start_time)

    def _step(self, time: float, dt: float) -> None:
        reached = np.floor((time + dt) / self._period + 1e-6)
        if self.state[0] + 1.0 < reached:
            if not self._warned:
                self._warned = True
                self.log.append(
                    f"a communication step of {dt:g} s holds several frames of {self._period:g} s: only the last is "
                    "measured, the others are missing. Set sampling.period to the communication step, or step shorter")
            came = self._inputs[:FRAME].copy()
            self._inputs[:FRAME] = np.nan
            while self.state[0] + 1.0 < reached:
                self.state[0] += 1.0
                self._run(self.state[0] * self._period)
            self._inputs[:FRAME] = came
        if self.state[0] < reached:
            self.state[0] += 1.0
            self._run(self.state[0] * self._period)

    def simulate(self, inputs: np.ndarray, start_time: float = 0.0) -> np.ndarray:
        """Many frames in one go, for studies: frames x inputs, one every sampling period.

        Returns:
            frames x outputs, after each frame.
        """
        found = np.empty((len(inputs), len(self._outputs)))
        for row, frame in enumerate(inputs):
            self._inputs[:] = frame
            self.state[0] += 1.0
            self._run(start_time + (row + 1) * self._period)
            found[row] = self._outputs
        return found


def check_forward(ratio: float) -> None:
    """Raise InputError unless a transmission ratio is that of a forward gear, where drive is taken to be on flank 1."""
    if not ratio > 0.0:
        raise InputError(f"gear.transmission_ratio is {ratio:g}: a forward gear is needed")


def check_shaft(shaft: LashShaft) -> None:
    """Raise InputError unless a shaft with lash can be worked with: its lash angle follows k_s / c_s."""
    if not 0.0 < shaft.half_gap < 1.0:
        raise InputError(f"shaft.half_gap is {shaft.half_gap:g} rad: an estimator of lash needs one "
                         "between 0 and 1 rad")
    if not shaft.damping > 0.0:
        raise InputError(f"shaft.damping is {shaft.damping:g} N.m.s/rad: an estimator of lash needs one "
                         "above 0")
