"""What every plant under diagnosis has in common: its numbers, its instruments, and how a recording drives it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from cosim.diagnosis.plants.gaps import filled
from cosim.diagnosis.plants.hats import row
from cosim.diagnosis.plants.observation import observe
from cosim.diagnosis.plants.run import NONE, STEP, Nuisance, Run
from cosim.measured import Manoeuvre, Measurement
from driveline import vehicles
from driveline.plants.plant import Plant
from driveline.quantities import InputError

SLOWEST = 1.0  # s: between samples of what drives a plant; slower ones show nothing of a driveline
SHORTEST = 2.0  # s: of what shorter stretches show little can be said
_RATE = 500.0  # Hz: channels that are sampled faster are thinned, as the driveline does nothing up there


class Stretches(NamedTuple):
    """What recordings are cut into.

    Attributes:
        runs: What is fitted and compared.
        further: Other stretches of long manoeuvres, which may judge what these show.
        left_out: What of the recordings is none of them though it might be meant to, and why, in words.
    """

    runs: list[Run]
    further: list[Run]
    left_out: list[str]


class InstrumentedPlant:
    """A plant in process with the instruments that were on it.

    Subclasses name the plant and the channels, and give ``_start`` and ``runs``.

    Args:
        vehicle: Name or path of the vehicle file.
        variant: Variant of it, or None.
        changes: Values that replace those of the file.

    Attributes:
        name: Of the plant, as in ``driveline.models``.
        plant: Its class.
        driver: The input that drives it, to which the torque nuisance is added.
        channels: Canonical names of what may be compared.
        values: Every parameter of the plant as the vehicle file has it.
    """

    name: ClassVar[str]
    plant: ClassVar[type[Plant]]
    driver: ClassVar[str]
    channels: ClassVar[tuple[str, ...]]

    def __init__(self, vehicle: str, variant: str | None = None,
                 changes: Mapping[str, float] | None = None) -> None:
        self.vehicle, self.variant = vehicle, variant
        self.source = vehicles.load(vehicle, variant)
        self.values: dict[str, float] = self.plant.defaults_from(self.source) | dict(changes or {})
        # where a contact changes; else a step is taken at once
        self.values["solver.maximum_substep"] = STEP / 2.0
        self._plant = self.plant(self.values)
        self._names = [variable.name for variable in self._plant.output_variables]
        self._parameters = {v.name for v in self._plant.variables if v.causality == "parameter"}
        self._given = np.array([v.causality != "output" for v in self._plant.variables])
        self._begun: tuple[tuple, bytes] = ((), b"")
        # as built: defaults of parameters the file need not give
        self.values = {v.name: v.start for v in self._plant.variables if v.causality == "parameter"} | self.values

    def __reduce__(self) -> tuple:
        return type(self), (self.vehicle, self.variant, self.values)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter of the plant."""
        return {v.name: v.unit for v in self._plant.variables if v.causality == "parameter"}

    @property
    def columns(self) -> dict[str, int]:
        """The column of each input in ``Run.inputs``."""
        return {variable.name: i for i, variable in enumerate(self._plant.inputs)}

    @property
    def idle_inputs(self) -> np.ndarray:
        """Every input at its start value."""
        return np.array([variable.start for variable in self._plant.inputs])

    def knows(self, name: str) -> bool:
        """Whether a value of this name does anything here: of the plant, an input or an instrument."""
        where, _, rest = name.partition(".")
        known = {"input": self.columns, "observe": self.channels}
        return rest.partition(".")[0] in known[where] if where in known else name in self._parameters

    def raw(self, values: Mapping[str, float], run: Run, nuisance: Nuisance = NONE,
            torque: np.ndarray | float = 0.0) -> dict[str, np.ndarray]:
        """All outputs of the plant over ``run.time``, without instruments.

        Args:
            torque: Added to what drives it at every step [N.m, or N of a carriage].

        Raises:
            ArithmeticError: The simulation left the finite numbers.
            InputError: A value the plant refuses.
        """
        inputs = self._prepared(values, run, nuisance, torque)
        return self._simulated(inputs, run)

    def _prepared(self, values: Mapping[str, float], run: Run, nuisance: Nuisance,
                  torque: np.ndarray | float) -> np.ndarray:
        """The plant initialised for a run; returns its inputs."""
        plant = self._plant
        for name in self._parameters:
            plant.values[plant.index[name]] = values[name]
        inputs, columns = run.driven_by(values, self.columns), self.columns
        inputs[:, columns[self.driver]] += nuisance.torque + torque
        if nuisance.wander:
            inputs[:, columns[self.driver]] += row(run, np.array(nuisance.wander))
        if nuisance.filled:
            inputs[:, columns[self.driver]] += filled(run.gaps, nuisance.filled, run.time - STEP)
        inputs[:, columns[self.driver]] = self._arriving(inputs[:, columns[self.driver]])
        if "road_grade" in columns:
            inputs[:, columns["road_grade"]] += nuisance.grade
        self._start(run, nuisance)
        self._anchor(inputs, values, run)
        for name, i in columns.items():
            plant[name] = inputs[0, i]
        self._begin(values["solver.maximum_substep"])
        return inputs

    def _arriving(self, drive: np.ndarray) -> np.ndarray:
        """What drives the plant at every step as it is put in; the plant itself delays it."""
        return drive

    def _begin(self, substep: float) -> None:
        """Initialise the plant; what begins as the one before, and is driven otherwise later, begins from its state."""
        plant = self._plant
        begun = (plant.values[self._given].tobytes(), *self._attached())
        if begun == self._begun[0]:
            plant.restore(self._begun[1])
            return
        self._begun = (), b""
        for finer in (1.7, 3.0, 5.0, None):
            try:
                plant.initialize()
                break
            except InputError as error:  # stiffer or more damped than the file's: it takes shorter sub-steps
                if finer is None or "maximum_substep" not in str(error):
                    raise
                plant["solver.maximum_substep"] = substep / finer
        self._begun = begun, plant.save()

    def _attached(self) -> tuple:
        """What the plant is made of beside its parameters."""
        return ()

    def _simulated(self, inputs: np.ndarray, run: Run) -> dict[str, np.ndarray]:
        """All outputs by name, of the plant as it is initialised."""
        return self._named(self._plant.simulate(inputs, STEP, run.start, propagated=True))

    def _named(self, table: np.ndarray) -> dict[str, np.ndarray]:
        return {name: table[:, i] for i, name in enumerate(self._names)}

    def instruments(self, raw: Mapping[str, np.ndarray], values: Mapping[str, float], run: Run) -> np.ndarray:
        """What the channels of ``run`` read of the plant's outputs, stacked as ``run.stacked``."""
        time = run.time
        return np.concatenate([observe(raw, time, values, name, clock)
                               for name, clock in run.clocks.items()])

    def predict(self, values: Mapping[str, float], run: Run, nuisance: Nuisance = NONE) -> np.ndarray:
        """What the channels of ``run`` should read, stacked as ``run.stacked``; errors as ``raw``."""
        return self.instruments(self.raw(values, run, nuisance), values, run)

    def runs(self, measurement: Measurement) -> list[Run]:
        """The manoeuvres of a measurement, long ones cut into stretches.

        Raises:
            InputError: What drives the plant or every output is missing, or there is nothing to compare.
        """
        raise NotImplementedError

    def stretches(self, measurement: Measurement) -> Stretches:
        """``runs``, and what else the manoeuvres are cut into; errors as ``runs``."""
        return Stretches(self.runs(measurement), [], [])

    def _start(self, run: Run, nuisance: Nuisance) -> None:
        """Set the plant's start parameters."""
        raise NotImplementedError

    def _anchor(self, inputs: np.ndarray, values: Mapping[str, float], run: Run) -> None:
        """Put what was measured into the inputs of a plant that follows it; this one does not."""

    def _span(self, manoeuvre: Manoeuvre) -> tuple[float, float]:
        """From when to when [s] all channels are there together.

        Raises:
            InputError: Less than ``SHORTEST``.
        """
        start, stop = manoeuvre.start, manoeuvre.stop
        if stop - start < SHORTEST:
            raise InputError(f"manoeuvre '{manoeuvre.name}': all channels together are there for "
                             f"{np.floor(1e3 * max(stop - start, 0.0)) / 1e3:g} s; at least {SHORTEST:g} s are needed")
        return start, stop

    def _driven(self, manoeuvre: Manoeuvre) -> None:
        """Raise InputError unless what drives the plant was recorded, often enough."""
        if self.driver not in manoeuvre:
            raise InputError(f"manoeuvre '{manoeuvre.name}' has no channel '{self.driver}': without what drives "
                             "the plant nothing can be simulated")
        times = manoeuvre[self.driver].time
        if times.size > 2 and (apart := float(np.median(np.diff(times)))) > SLOWEST:
            raise InputError(f"manoeuvre '{manoeuvre.name}': the samples of {self.driver} are {apart:.4g} s apart, and "
                             f"at most {SLOWEST:g} s are of use: is the unit of its clock right?")

    def _inputs(self, manoeuvre: Manoeuvre, start: float, stop: float) -> np.ndarray:
        """Steps x inputs from the channels that are inputs; the others at their start values."""
        time = start + STEP * np.arange(int((stop - start) / STEP))
        inputs = np.tile(self.idle_inputs, (time.size, 1))
        for name, i in self.columns.items():
            if name in manoeuvre:
                inputs[:, i] = manoeuvre[name].at(time)
        return inputs


def compared(manoeuvre: Manoeuvre, names: Iterable[str], start: float, stop: float,
             fastest: float = _RATE) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Clocks and values of the channels between two instants [s], thinned where they are faster [Hz].

    A channel with fewer than ten samples there is left out.
    """
    clocks, measured = {}, {}
    for name in names:
        channel = manoeuvre[name]
        inside = np.flatnonzero((channel.time >= start) & (channel.time <= stop))
        if inside.size < 10:
            continue
        rate = (inside.size - 1) / max(np.ptp(channel.time[inside]), 1e-9)
        inside = inside[::max(1, round(rate / fastest))]
        clocks[name], measured[name] = channel.time[inside], channel.values[inside]
    return clocks, measured
