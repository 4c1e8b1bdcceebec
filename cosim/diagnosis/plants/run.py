"""One stretch of a recording made ready for simulation, and what differs from one to the next."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline

from cosim.diagnosis.effect import SLOPE
from cosim.diagnosis.plants.gaps import Gap

STEP = 1e-3  # communication step of the simulations [s]


@dataclass(frozen=True)
class Nuisance:
    """What differs from run to run and is no cause: always estimated beside one.

    Attributes:
        start_speed: Added to the vehicle speed at the start [m/s].
        grade: Added to the road's slope [rad].
        torque: Added to the engine torque [N.m].
        wander: Heights of the hats that are added to it as well [N.m]; none for no such torque.
        filled: Heights of the waves that it was in each gap beside a straight line [N.m]; none for nothing.
    """

    start_speed: float = 0.0
    grade: float = 0.0
    torque: float = 0.0
    wander: tuple[float, ...] = ()
    filled: tuple[float, ...] = ()


NONE = Nuisance()


@dataclass(frozen=True)
class Run:
    """One stretch of a recording, ready to be simulated.

    Attributes:
        name: Of the manoeuvre, with a number where it was cut.
        kind: Of the manoeuvre; empty for a part of its recording in which it is not driven.
        gear: At the start.
        start: Begin of the simulation [s] on the recording's clock, which counts from where its file began.
        inputs: Steps x inputs of the plant.
        start_speed: Vehicle speed at the start as far as it was measured [m/s].
        clocks: Instants [s] at which each channel is compared.
        measured: Values of each channel at these.
        graded: Whether the road's slope was recorded.
        back: Whether the road was driven the other way than in the others, and its slope not recorded.
        anchors: Channels the simulation is led along, with what they are between their samples: a straight line cuts
            the peaks off, which acts as a damper. None: it runs freely.
        gaps: Where frames of the torque are lost, the worst first.
    """

    name: str
    kind: str
    gear: int
    start: float
    inputs: np.ndarray
    start_speed: float
    clocks: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]
    graded: bool = False
    back: bool = False
    anchors: Mapping[str, CubicSpline] = field(default_factory=dict)
    gaps: tuple[Gap, ...] = ()

    @property
    def manoeuvre(self) -> tuple[str, int, bool] | None:
        """What repeats of a run have in common with it: the kind of manoeuvre, the gear and the way; None: it has none.

        Where the kind is not written nobody knows what was driven, and every stretch of a drive is another road. What
        the road's slope does in one direction it does the other way round in the other.
        """
        return (self.kind, self.gear, self.back) if self.kind not in ("", "drive") else None

    @property
    def swing(self) -> float:
        """By how much what drives the plant, its first input, moves [N.m, or N of a carriage]."""
        return float(np.ptp(self.inputs[:, 0]))

    @property
    def time(self) -> np.ndarray:
        """Instants [s] of the simulated outputs."""
        return ends(self.start, len(self.inputs))

    @property
    def free(self) -> Run:
        """The same run, led by nothing that was measured but its inputs."""
        return replace(self, anchors={})

    def only(self, channels: Container[str]) -> Run:
        """The same run, compared by no other channels than these."""
        clocks, measured = ({name: of[name] for name in of if name in channels} for of in (self.clocks, self.measured))
        return replace(self, clocks=clocks, measured=measured)

    @property
    def unknown_road(self) -> bool:
        """Whether it is a drive, on a road whose slope nobody recorded; a proving ground is level."""
        return self.kind == "drive" and not self.graded

    @property
    def slices(self) -> dict[str, slice]:
        """Where each channel lies in ``stacked`` vectors."""
        ends = np.cumsum([clock.size for clock in self.clocks.values()])
        return {name: slice(int(end - clock.size), int(end))
                for (name, clock), end in zip(self.clocks.items(), ends)}

    @property
    def stacked(self) -> np.ndarray:
        """All measured values, channel after channel."""
        return np.concatenate([self.measured[name] for name in self.clocks])

    def driven_by(self, values: Mapping[str, float], columns: Mapping[str, int]) -> np.ndarray:
        """The inputs as they really were, as far as ``values`` know of their errors.

        Args:
            values: Errors of inputs, ``input.NAME.gain`` and ``input.NAME.offset``, among others.
            columns: Of the inputs.
        """
        inputs = self.inputs.copy()
        for name, i in columns.items():
            gain, offset = values.get(f"input.{name}.gain", 1.0), values.get(f"input.{name}.offset", 0.0)
            way = -1.0 if self.back and f"input.{name}.offset" == SLOPE else 1.0
            if (gain, offset) != (1.0, 0.0):  # one or two of some ten
                inputs[:, i] = gain * inputs[:, i] + way * offset
        return inputs

    def stack(self, of: Mapping[str, float]) -> np.ndarray:
        """A number of each channel at each of its samples, as ``stacked``."""
        return np.concatenate([np.full(clock.size, of[name]) for name, clock in self.clocks.items()])


def ends(start: float, steps: int) -> np.ndarray:
    """When each of some steps ends [s], of which the first begins at ``start``."""
    return start + STEP * np.arange(1, steps + 1)
