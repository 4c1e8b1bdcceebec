"""Plants in a few lines, for the tests of several folders: built, driven, recorded by name."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from driveline.kernels import layout as k
from driveline.models import MODELS
from driveline.plants.assembly import Assembly, Network, Term
from driveline.plants.full_order import Solver, input_variable, output_variable
from driveline.plants.plant import Plant
from driveline.vehicles import load

PLANTS = ("plant_fom", "plant_rom_2dof", "plant_rom_3dof", "plant_rom_3dof_split")
REDUCED = PLANTS[1:]
Record = dict[str, np.ndarray]


@functools.cache
def start_values(model: str, vehicle: str, variant: str | None, gear: int) -> Mapping[str, float]:
    """Parameters of a model from a vehicle file."""
    return MODELS[model].defaults_from(load(vehicle, variant), gear)


def plant(model: str, parameters: Mapping[str, float] | None = None, *, gear: int = 5,
          vehicle: str = "pickup_10r80", variant: str | None = "modified", backend: str = "auto",
          initialize: bool = True, **inputs: float) -> Plant:
    """A plant of a vehicle with some parameters and start inputs changed."""
    values = {**start_values(model, vehicle, variant, gear), **(parameters or {})}
    made = MODELS[model](values, backend=backend)
    if "gear" in made.index:
        made["gear"] = gear
    unknown = set(parameters or {}) - set(made.index)
    assert not unknown, f"{model} has no {unknown}"
    for name, value in inputs.items():
        made[name] = value
    if initialize:
        made.initialize()
    return made


def input_rows(model: Plant, duration: float, dt: float, start: float = 0.0, **inputs) -> np.ndarray:
    """Inputs for ``simulate``: as they are, but where given as numbers or a function of time."""
    time = start + np.arange(round(duration / dt)) * dt
    rows = np.tile(model.values[:len(model.inputs)], (time.size, 1))
    names = [variable.name for variable in model.inputs]
    for name, value in inputs.items():
        rows[:, names.index(name)] = value(time) if callable(value) else value
    return rows


def run(model: Plant, duration: float, dt: float = 1e-3, start: float = 0.0, *, propagated: bool = False,
        **inputs) -> Record:
    """Drive an initialised plant; every output by name, with the ``time`` at the end of each step."""
    rows = input_rows(model, duration, dt, start, **inputs)
    outputs = model.simulate(rows, dt, start, propagated=propagated)
    record = {variable.name: outputs[:, i] for i, variable in enumerate(model.output_variables)}
    return {"time": start + np.arange(1, len(rows) + 1) * dt, **record}


def steps(*pieces: tuple[float, float]) -> Callable[[np.ndarray], np.ndarray]:
    """A function of time that takes each value from its time on."""
    times, values = map(np.array, zip(*pieces, strict=True))
    return lambda t: values[np.clip(np.searchsorted(times, t + 1e-9, side="right") - 1, 0, None)]


def ledger(record: Record) -> np.ndarray:
    """What the energy balance leaves over [J]; a law says it stays as it is."""
    return record["energy_stored"] - record["energy_supplied"] + record["energy_dissipated"]


def turnover(record: Record) -> float:
    """The energy that was at stake [J]: to measure errors of the ledger against."""
    return float(np.abs(record["energy_stored"]).max() + np.ptp(record["energy_supplied"])
                 + np.ptp(record["energy_dissipated"]))


def events(model: Plant) -> int:
    """How often a contact or a clutch changed its mode so far."""
    return int(model.state[model.network.plan[k.STATE_CLOCK] + k.EVENTS])


def mode(model: Plant, branch: str) -> float:
    """The contact or friction mode of a branch."""
    return float(model.state[model.network.modes][model.network.branches[branch]])


@dataclass(frozen=True)
class BenchParameters:
    """A bench's numbers stand in its network; only the solver has some."""

    solver: Solver


class Bench(Plant):
    """Any network as a plant: the nodes, branches and outputs that a test writes down.

    Args:
        build: Adds nodes, branches and outputs to an assembly.
        speeds: Speed of every node at the start.
        inputs: Name and start value of every input.
        substep: Longest Runge-Kutta sub-step [s].
    """

    name = "bench"
    Parameters = BenchParameters

    def __init__(self, build: Callable[[Assembly], None], speeds: Mapping[str, float],
                 inputs: Mapping[str, float] | None = None, substep: float = 1e-4,
                 backend: str = "auto") -> None:
        self.build, self.speeds, self.substep = build, speeds, substep
        self.inputs = tuple(input_variable(name, "1", name, start=value)
                            for name, value in (inputs or {"none": 0.0}).items())
        network = self.assemble(None)
        self.output_variables = tuple(output_variable(name, "1", name) for name in network.outputs)
        super().__init__({"solver.maximum_substep": substep}, backend)
        self.initialize()

    def assemble(self, parameters: BenchParameters | None) -> Network:
        net = Assembly(inputs=tuple(variable.name for variable in self.inputs))
        self.build(net)
        for name in list(net.nodes):
            net.output(f"{name}_speed", Term(k.SPEED, list(net.nodes).index(name)))
        for name, branch in list(net.branches.items()):
            number = list(net.branches).index(name)
            net.output(f"{name}_torque", Term(k.TORQUE, number))
            if branch.law in (*k.DRY, k.LASH):
                net.output(f"{name}_mode", Term(k.CONTACT_MODE, number))
            if branch.law == k.LASH:
                net.output(f"{name}_lash", Term(k.LASH_ANGLE, number))
            for entry in branch.states:
                net.output(entry.name, Term(k.LEVEL, net.place(entry.name)))
        net.output("energy_stored", Term(k.STORED, 0))
        for name in ("energy_supplied", "energy_dissipated"):
            net.output(name, Term(k.LEVEL, net.place(name)))
        net.settings = {k.SUBSTEP: self.substep}
        if "road_grade" in net.inputs:
            net.roles = {k.GRADE_INPUT: net.inputs.index("road_grade")}
        return net.build()

    def start_speeds(self, parameters: BenchParameters, network: Network) -> tuple[np.ndarray, bool]:
        return np.array([self.speeds[name] for name in network.nodes], dtype=float), False
