"""From named elements to the flat arrays of the network kernel.

A plant is written down as nodes (inertias), branches (elements between them), lags, and outputs as
sums of what the network holds. A number that depends on the gear is given as ``ByGear``. Nothing
here is physics or time stepping: laws are in ``elements``, stepping in ``kernels.stepping``, and
``kernels.layout`` says what lies where.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from ..elements.curved_shaft import SIGNALS as CURVE_SIGNALS
from ..elements.damper_friction import DamperFriction
from ..elements.slip_control import SlipControl
from ..elements.torque_ripple import TorqueRipple
from ..elements.two_stage_stiffness import FirstStage
from ..kernels import layout as k
from ..quantities import InputError
from ..sensors.can_signal import CanSignal, can_signal_parameters, can_signal_state, jitter_table
from ..sensors.torque_meter import TorqueMeter, filter_sections

GROUND = -1


@dataclass(frozen=True)
class ByGear:
    """One number a gear, from reverse (-1) over neutral (0) upward."""

    values: tuple[float, ...]


Number = float | ByGear


@dataclass(frozen=True)
class StateEntry:
    """One entry of the state vector, for the list a user can print."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Term:
    """What an output is made of: ``coefficient`` times something the network holds."""

    kind: int
    of: int
    coefficient: Number = 1.0


@dataclass(frozen=True)
class Branch:
    """A branch as it was added; kept for initial states and linearisation."""

    name: str
    law: int
    node_a: int
    node_b: int
    ratio_a: Number
    ratio_b: Number
    numbers: tuple[Number, ...]
    signal: int = k.ONE
    reference: int = -1
    states: tuple[StateEntry, ...] = ()


def _hears(branch: Branch) -> set[int]:
    """The signals that a branch's law looks at."""
    if branch.law == k.ENGINE:
        return {k.DELAYED, k.NOISE, branch.signal}
    if branch.law == k.RIPPLE:
        return {k.RUNS}
    if branch.law == k.LEADING:
        return {branch.signal, branch.reference}
    if branch.law == k.CURVE:
        return set(range(branch.signal, branch.signal + len(CURVE_SIGNALS)))
    return {branch.signal, k.COS_GRADE} if branch.law in k.DRY else {branch.signal}


@dataclass(frozen=True)
class Channel:
    """A CAN channel that samples one output and shows another.

    Attributes:
        source, target: Names of the two outputs.
        parameters, table: The channel's numbers for its kernel; see ``sensors.can_signal``.
        place: Where its state begins in the state of the network.
    """

    source: str
    target: str
    parameters: np.ndarray
    table: np.ndarray
    place: int = 0


@dataclass(frozen=True)
class Network:
    """The assembled arrays, ready for ``network_run``.

    Attributes:
        plan, constants: Structure and numbers.
        state: Initial state; the continuous part is zero until a plant fills it.
        work: Scratch.
        nodes: Index of each node by name.
        branches: Index of each branch by name.
        outputs: Names of the outputs, in order.
        entries: What each entry of the continuous state is.
        twists: Place in the state of each branch's first state, by branch name.
        levels: Place in the state of each lag, by name.
        channels: The CAN channels.
        sections: Second-order sections of the torque meter's filter.
    """

    plan: np.ndarray
    constants: np.ndarray
    state: np.ndarray
    work: np.ndarray
    nodes: dict[str, int]
    branches: dict[str, int]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    entries: tuple[StateEntry, ...]
    twists: dict[str, int]
    levels: dict[str, int]
    channels: tuple[Channel, ...]
    sections: np.ndarray

    @property
    def modes(self) -> slice:
        """Where the contact and friction modes are in the state."""
        start = int(self.plan[k.STATE_MODES])
        return slice(start, start + int(self.plan[k.BRANCHES]))


@dataclass
class Assembly:
    """Collects nodes, branches, lags and outputs; ``build`` makes the arrays.

    Args:
        inputs: Names of the plant's inputs; an input is a signal of its own name.
        gears: Columns of a ``ByGear`` (reverse, neutral, 1 ...); 0 for a plant without gears.
    """

    inputs: tuple[str, ...]
    gears: int = 0
    nodes: dict[str, tuple[Number, StateEntry]] = field(default_factory=dict)
    branches: dict[str, Branch] = field(default_factory=dict)
    lags: dict[str, tuple[int, float, StateEntry]] = field(default_factory=dict)
    integrals: list[tuple[int, StateEntry]] = field(default_factory=list)
    outputs: dict[str, tuple[Term, ...]] = field(default_factory=dict)
    channels: list[Channel] = field(default_factory=list)
    settings: dict[int, float] = field(default_factory=dict)
    roles: dict[int, int] = field(default_factory=dict)
    sections: np.ndarray = field(default_factory=lambda: np.zeros((0, 5)))
    metered: tuple[str, str] | None = None

    # -- building blocks ------------------------------------------------------------------------

    def signal(self, name: str) -> int:
        """The signal number of an input."""
        return k.SIGNALS_HEAD + self.inputs.index(name)

    def node(self, name: str, inertia: Number, unit: str, meaning: str) -> int:
        """An inertia [kg.m2 or kg] with one speed [``unit``]; returns its index."""
        smallest = min(inertia.values) if isinstance(inertia, ByGear) else inertia
        if not smallest > 0.0:
            raise InputError(f"the inertia of {name} is {smallest:g}: it must be positive")
        self.nodes[name] = (inertia, StateEntry(f"{name}_speed", unit, meaning))
        return len(self.nodes) - 1

    def _branch(self, branch: Branch) -> int:
        self.branches[branch.name] = branch
        return len(self.branches) - 1

    def shaft(self, name: str, a: int, b: int, stiffness: Number, damping: Number,
              ratio_a: Number = 1.0, ratio_b: Number = 1.0, unit: str = "rad") -> int:
        """A spring and damper in parallel."""
        kind = "twist" if unit == "rad" else "deflection"
        entry = StateEntry(f"{name}_{kind}", unit, f"{kind} of the {name.replace('_', ' ')}")
        return self._branch(Branch(name, k.SHAFT, a, b, ratio_a, ratio_b, (stiffness, damping),
                                   states=(entry,)))

    def staged_shaft(self, name: str, a: int, b: int, stiffness: float, damping: float,
                     stage: FirstStage) -> int:
        """A shaft that may have a first stage; without one it is a plain shaft."""
        if not stage.present:
            return self.shaft(name, a, b, stiffness, damping)
        entry = StateEntry(f"{name}_twist", "rad", f"twist of the {name.replace('_', ' ')}")
        return self._branch(Branch(name, k.TWO_STAGE, a, b, 1.0, 1.0,
                                   (stiffness, damping, stage.stiffness_ratio, stage.twist), states=(entry,)))

    def lash(self, name: str, a: int, b: int, stiffness: Number, damping: Number, half_gap: Number,
             ratio_a: Number = 1.0, ratio_b: Number = 1.0) -> int:
        """A compliant shaft with backlash (thesis eq. 2.5 to 2.8)."""
        text = name.replace("_", " ")
        entries = (StateEntry(f"{name}_twist", "rad", f"twist across the {text}, lash included"),
                   StateEntry(f"{name}_shaft_twist", "rad", f"twist of the {text}'s shaft alone"))
        return self._branch(Branch(name, k.LASH, a, b, ratio_a, ratio_b,
                                   (stiffness, damping, half_gap, 0.0), states=entries))

    def turned(self, name: str, signal: int) -> None:
        """One side of a lash that is there is turned against the other as fast as a signal says [rad/s]."""
        branch = self.branches[name]
        self.branches[name] = replace(branch, numbers=(*branch.numbers[:3], 1.0), signal=signal)

    def friction(self, name: str, a: int, b: int, capacity: Number, static_ratio: float = 1.0,
                 drag: float = 0.0, ratio_a: Number = 1.0, ratio_b: Number = 1.0,
                 signal: int = k.ONE, lag: str | None = None, base: float = 0.0,
                 backward: float = 0.0, control: SlipControl | None = None) -> int:
        """Dry friction with sticking; ``capacity`` scales with a signal and a lag's level.

        ``base`` is capacity besides it that scales with the cosine of the grade, ``backward`` adds to the
        drag where the slip is negative, ``control`` holds the slip if it is present. Two dry frictions may not act
        between the same nodes: sticking, nothing would tell their shares.
        """
        reference = -1 if lag is None else list(self.lags).index(lag)
        numbers = (capacity, static_ratio, drag, base, backward)
        if control is None or not control.present:
            return self._branch(Branch(name, k.FRICTION, a, b, ratio_a, ratio_b, numbers, signal, reference))
        entry = StateEntry(f"{name}_held", "N.m", f"capacity of the {name.replace('_', ' ')} that its control holds")
        return self._branch(Branch(name, k.SLIPPING, a, b, ratio_a, ratio_b,
                                   (*numbers, control.torque, control.target, control.reset_time), signal, reference,
                                   (entry,)))

    def converter(self, name: str, impeller: int, turbine: int, tables: tuple[float, ...]) -> int:
        """A hydrodynamic converter; tables are speed ratio, torque ratio, capacity."""
        return self._branch(Branch(name, k.CONVERTER, impeller, turbine, 1.0, 1.0, tables))

    def contact(self, name: str, belt: int, body: int, slip_stiffness: float, relaxation_length: float,
                limit: float, radius: float) -> int:
        """A tyre's contact patch; ``limit`` [N] is the largest force."""
        stiffness = slip_stiffness / relaxation_length
        entry = StateEntry(f"{name}_deflection", "m", f"deflection of the {name.replace('_', ' ')} patch")
        return self._branch(Branch(name, k.CONTACT, belt, body, radius, 1.0,
                                   (stiffness, relaxation_length, limit / stiffness, radius),
                                   states=(entry,)))

    def rubbing(self, name: str, a: int, b: int, friction: DamperFriction) -> int:
        """Dry friction that builds up over a twist; ``elements.damper_friction``."""
        entry = StateEntry(f"{name}_deflection", "rad", f"twist that the {name.replace('_', ' ')} holds against")
        return self._branch(Branch(name, k.RUBBING, a, b, 1.0, 1.0,
                                   (friction.torque / friction.twist, 1.0, friction.twist, 0.0), states=(entry,)))

    def loss(self, name: str, node: int, carried: int, constant: Number, viscous: Number,
             fraction: Number, coast_excess: Number = 0.0) -> int:
        """A loss at a node that grows with the torque carried by an earlier branch.

        ``coast_excess`` adds to the fraction where that torque drives the node backward.
        """
        return self._branch(Branch(name, k.LOSS, node, GROUND, 1.0, 0.0,
                                   (constant, viscous, fraction, coast_excess), reference=carried))

    def aerodynamic(self, name: str, node: int, factor: float, ratio: float = 1.0) -> int:
        """Drag on a node; ``factor`` is half density times drag area."""
        return self._branch(Branch(name, k.AERO, node, GROUND, ratio, 0.0, (factor,)))

    def engine(self, name: str, node: int, numbers: tuple[float, ...], spark: int) -> int:
        """The engine's torque on its crankshaft; see ``elements.engine_torque``."""
        entry = StateEntry("air_torque", "N.m", "indicated torque of the air path")
        return self._branch(Branch(name, k.ENGINE, node, GROUND, 1.0, 0.0, numbers, spark, states=(entry,)))

    def ripple(self, name: str, node: int, ripple: TorqueRipple, angle: int) -> int:
        """A torque on a node that swings with an angle, the integral of that number."""
        return self._branch(Branch(name, k.RIPPLE, node, GROUND, 1.0, 0.0,
                                   (ripple.amplitude, ripple.order, ripple.phase), reference=angle))

    def source(self, name: str, node: int, gain: float, signal: int, ratio: float = 1.0) -> int:
        """A torque or force ``gain * signal`` on a node."""
        return self._branch(Branch(name, k.SOURCE, node, GROUND, ratio, 0.0, (gain,), signal))

    def curve(self, name: str, shaft: str, gain: float, signal: int) -> int:
        """A torque within a shaft, ``gain`` times a curve over its twist; ``elements.curved_shaft`` says what signals
        give that, from ``signal`` on."""
        along = self.branches[shaft]
        return self._branch(Branch(name, k.CURVE, along.node_a, along.node_b, along.ratio_a, along.ratio_b, (gain,),
                                   signal, list(self.branches).index(shaft)))

    def leading(self, name: str, node: int, gain: float, signal: int, share: int) -> int:
        """A torque or force ``gain * (signal - speed)`` on a node, times the signal ``share``."""
        return self._branch(Branch(name, k.LEADING, node, GROUND, 1.0, 0.0, (gain,), signal, share))

    def reaction(self, name: str, node: int, of: int, gain: float) -> int:
        """A torque ``gain`` times that of an earlier branch, which does not feel it (read-out only)."""
        return self._branch(Branch(name, k.REACTION, node, GROUND, 1.0, 0.0, (gain,), reference=of))

    def lag(self, name: str, signal: int, time_constant: float, meaning: str, unit: str = "1") -> str:
        """A first-order lag behind a signal; zero for none."""
        self.lags[name] = (signal, time_constant, StateEntry(name, unit, meaning))
        return name

    def integral(self, node: int, name: str, unit: str, meaning: str) -> int:
        """The integral of a node's speed; returns its number."""
        self.integrals.append((node, StateEntry(name, unit, meaning)))
        return len(self.integrals) - 1

    def place(self, name: str) -> int:
        """Where a state is in the state vector; every node, branch and lag must be there before."""
        return [entry.name for entry in self._entries()].index(name)

    def _entries(self) -> list[StateEntry]:
        entries = [entry for _, entry in self.nodes.values()]
        for branch in self.branches.values():
            entries.extend(branch.states)
        entries.extend(entry for _, _, entry in self.lags.values())
        entries.extend(entry for _, entry in self.integrals)
        entries.append(StateEntry("energy_supplied", "J", "work done on the plant by engine, grade and shifts"))
        entries.append(StateEntry("energy_dissipated", "J", "heat made by the plant"))
        return entries

    def _drivers(self) -> list[int]:
        """Branches that only drive a node, by what signals say; no other branch looks at their torque."""
        looked_at = {branch.reference for branch in self.branches.values() if branch.law in (k.LOSS, k.REACTION)}
        return [b for b, branch in enumerate(self.branches.values()) if branch.law in k.DRIVING and b not in looked_at]

    def _heard(self) -> list[int]:
        """Signals that anything but those hears."""
        drivers = self._drivers()
        found = {signal for signal, _, _ in self.lags.values()}
        for b, branch in enumerate(self.branches.values()):
            if b not in drivers:
                found |= _hears(branch)
        return sorted(found - {k.ONE})

    def output(self, name: str, *terms: Term) -> None:
        """An output as a sum of terms; none for an output that a sensor fills."""
        self.outputs[name] = terms

    def meter(self, source: str, target: str, meter: TorqueMeter) -> None:
        """A torque meter between two outputs; its sampling is the clock of all sensors."""
        self.output(target)
        self.metered = (source, target)
        self.sections = filter_sections(meter)
        self.settings |= {k.METER_GAIN: meter.gain, k.METER_OFFSET: meter.offset,
                          k.METER_ON: float(meter.enabled), k.TICK: 1.0 / meter.sampling_frequency}

    def sensor(self, source: str, target: str, signal: CanSignal, jitter_source: str) -> None:
        """A CAN channel between two outputs; the torque meter must be there before."""
        self.output(target)
        tick = self.settings[k.TICK]
        self.channels.append(Channel(
            source, target, can_signal_parameters(signal, tick, stream=len(self.channels), name=f"{source}_sensor"),
            jitter_table(jitter_source, signal.jitter_set, tick)))

    # -- arrays ---------------------------------------------------------------------------------

    def build(self) -> Network:
        """Make the arrays of the network kernel."""
        n_nodes, n_branches = len(self.nodes), len(self.branches)
        entries = self._entries()
        places = {entry.name: i for i, entry in enumerate(entries)}
        twists = {name: places[branch.states[0].name] if branch.states else 0
                  for name, branch in self.branches.items()}
        levels = {name: places[name] for name in self.lags}
        integral_places = [places[entry.name] for _, entry in self.integrals]
        n = len(entries)

        active = [0.0] * k.CONSTANTS_HEAD
        active[k.NOISE_PERIOD] = inf  # where a plant has no noise it cuts no step
        for place, value in self.settings.items():
            active[place] = value
        gear_rows: list[tuple[int, tuple[float, ...]]] = []

        def put(number: Number) -> int:
            if isinstance(number, ByGear):
                if len(number.values) != self.gears:
                    raise InputError(
                        f"a gear-dependent number has {len(number.values)} entries: {self.gears} are needed")
                gear_rows.append((len(active), number.values))
                active.append(float(number.values[0]))
            else:
                active.append(float(number))
            return len(active) - 1

        inertia = len(active)
        for number, _ in self.nodes.values():
            put(number)

        rows = []
        lag_names = list(self.lags)
        for index, branch in enumerate(self.branches.values()):
            parameter = put(branch.ratio_a)
            put(branch.ratio_b)
            for number in branch.numbers:
                put(number)
            reference = branch.reference
            if branch.law in k.DRY and reference >= 0:
                reference = levels[lag_names[reference]]
            if branch.law == k.RIPPLE:
                reference = integral_places[reference]
            if branch.law == k.CURVE:
                reference = list(twists.values())[reference]
            rows.append([branch.law, branch.node_a, branch.node_b, twists[branch.name], parameter,
                         branch.signal, reference, index])

        lag_rows = [[levels[name], signal, put(tau)] for name, (signal, tau, _) in self.lags.items()]
        integral_rows = [[place, node]
                         for place, (node, _) in zip(integral_places, self.integrals, strict=True)]
        names = list(self.outputs)
        term_rows = [[i, term.kind, term.of, put(term.coefficient)]
                     for i, terms in enumerate(self.outputs.values()) for term in terms]

        constants = list(active)
        gear_values = len(constants)
        for _, values in gear_rows:
            constants.extend(values)
        section_values = len(constants)
        constants.extend(self.sections.ravel())
        channel_rows = []
        channels = []
        plan = np.zeros(k.HEADER, dtype=np.int64)
        plan[k.STATE_MODES] = n
        plan[k.STATE_CLOCK] = n + n_branches
        plan[k.STATE_QUEUE] = plan[k.STATE_CLOCK] + k.CLOCK_SIZE
        plan[k.STATE_SECTIONS] = plan[k.STATE_QUEUE] + 2 * k.QUEUE_SIZE
        plan[k.STATE_CHANNELS] = plan[k.STATE_SECTIONS] + 2 * len(self.sections)
        size = int(plan[k.STATE_CHANNELS])
        for channel in self.channels:
            parameters = len(constants)
            constants.extend(channel.parameters)
            table = len(constants)
            constants.extend(channel.table)
            channel_rows.append([names.index(channel.source), names.index(channel.target), size,
                                 parameters, table])
            channels.append(replace(channel, place=size))
            size += can_signal_state(channel.parameters, channel.table, 0, 0.0).size
        state = np.zeros(size)

        plan[k.NODES], plan[k.BRANCHES], plan[k.CONTINUOUS] = n_nodes, n_branches, n
        plan[k.LAGS], plan[k.INTEGRALS], plan[k.TERMS] = len(lag_rows), len(integral_rows), len(term_rows)
        plan[k.OUTPUTS], plan[k.GEAR_ROWS], plan[k.INPUTS] = len(names), len(gear_rows), len(self.inputs)
        switches = [b for b, row in enumerate(rows) if row[0] in (k.LASH, *k.DRY, k.TWO_STAGE)]
        bent = [*range(n_nodes), *(places[entry.name] for branch in self.branches.values()
                                   if branch.law not in k.STRAIGHT for entry in branch.states)]
        drivers, heard = self._drivers(), self._heard()
        contacts = [b for b, row in enumerate(rows) if row[0] in k.PATCHES]
        plan[k.SWITCHES], plan[k.CONTACTS] = len(switches), len(contacts)
        plan[k.BENT], plan[k.DRIVERS], plan[k.HEARD] = len(bent), len(drivers), len(heard)
        plan[k.CHANNELS], plan[k.SECTIONS] = len(channel_rows), len(self.sections)
        plan[k.ACTIVE_SIZE], plan[k.GEARS], plan[k.INERTIA] = len(active), self.gears, inertia
        plan[k.GEAR_VALUES], plan[k.SECTION_VALUES] = gear_values, section_values
        plan[[k.GEAR_INPUT, k.DELAYED_INPUT, k.GRADE_INPUT, k.GEARSET_NODE, k.GEARSET_BRANCH]] = -1
        for role, index in self.roles.items():
            plan[role] = index
        if "shift_clutch_engagement" in levels:
            plan[k.SHIFT_LAG] = levels["shift_clutch_engagement"]
        if self.metered is not None:
            plan[k.FILTERED_OUTPUT], plan[k.FILTER_TARGET] = map(names.index, self.metered)
        parts = [plan]
        size = k.HEADER
        for role, table_rows in (
                (k.BRANCH_TABLE, rows), (k.LAG_TABLE, lag_rows), (k.INTEGRAL_TABLE, integral_rows),
                (k.TERM_TABLE, term_rows), (k.GEAR_TABLE, [[place] for place, _ in gear_rows]),
                (k.CHANNEL_TABLE, channel_rows), (k.SWITCH_TABLE, switches), (k.BENT_TABLE, bent),
                (k.DRIVER_TABLE, drivers), (k.HEARD_TABLE, heard), (k.CONTACT_TABLE, contacts)):
            plan[role] = size
            part = np.array(table_rows, dtype=np.int64).ravel()
            parts.append(part)
            size += part.size

        return Network(
            np.concatenate(parts), np.array(constants), state, np.zeros(k.work_size(plan)),
            {name: i for i, name in enumerate(self.nodes)},
            {name: i for i, name in enumerate(self.branches)},
            tuple(names), self.inputs, tuple(entries), twists, levels, tuple(channels), self.sections)
