"""What every plant has in common: parameters to arrays, equilibrium at the start, stepping."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ..kernel_model import KernelModel
from ..kernels import layout as k
from ..kernels import native
from ..kernels.network import apply_gear
from ..quantities import InputError
from ..sensors.can_signal import can_signal_state
from ..sensors.torque_meter import steady_state
from .assembly import GROUND, Network

# Runge-Kutta's method of order four is stable for step times rate below 2.78; this keeps off it.
STABLE = 2.5
_NOTHING = 1e-9  # N.m
_NEARLY = 1e-2  # relative step of Newton's method below which its derivatives are kept
_POINTS = 16  # states whose rates are asked for in one call
_SLIDING = 0.5  # slip over the vehicle's speed beyond which a wheel slides rather than rolls
_MORE_FRICTION = (8.0, 4.0, 2.0, 1.5, 1.2, 1.1, 1.05, 1.0)  # times what there is

STATUS = {
    k.NOT_FINITE: "a state is no longer finite; look for a parameter far from its usual size, or "
                  "reduce solver.maximum_substep",
    k.TOO_MANY_EVENTS: "contacts open and close without end; look for a lash or clutch with almost "
                       "no inertia beside it",
    k.QUEUE_FULL: f"the requested torque changed more than {k.QUEUE_SIZE} times within "
                  "engine.air_delay; take longer communication steps or a shorter delay",
    k.SLIDES_TOO_FAST: "a tyre, or a damper that rubs, slides faster than can be followed; look for a torque that "
                       "spins it without end, a friction coefficient or a twist of friction near zero, or reduce "
                       "solver.maximum_substep",
}


class Plant(KernelModel):
    """A network of elements behind the model boundary.

    Subclasses give, beside what a ``KernelModel`` needs, the name of the ``body`` node (the
    vehicle), and implement ``assemble`` and ``start_speeds``.
    """

    entry_point = "network_run"
    body: ClassVar[str]

    def __init__(self, defaults: Mapping[str, float], backend: str = "auto") -> None:
        super().__init__(defaults, backend)
        self._rates_kernel = native.load("network_rates", backend)
        self.network: Network | None = None
        self._assembled: Any = None  # the parameters it was made from
        self._told: list[str] = []  # what the log was told of the start

    def assemble(self, parameters: Any) -> Network:
        """The network for these parameters."""
        raise NotImplementedError

    def start_speeds(self, parameters: Any, network: Network) -> tuple[np.ndarray, bool]:
        """Speeds of all nodes at the start, and whether to look for the equilibrium there."""
        raise NotImplementedError

    def _prepare(self) -> None:
        self._assembled = self.parameters
        self.network = self.assemble(self._assembled)
        self.state = self.network.state
        net = self.network
        self._run = self._kernel.bind(
            self.state, net.plan, net.constants, net.work, self._inputs, self._outputs)
        self._points = np.empty((_POINTS, net.modes.stop))
        self._found = np.empty_like(self._points)
        self._evaluate = self._rates_kernel.bind(self._points.reshape(-1), net.plan, net.constants, net.work,
                                                 self._inputs, self._found.reshape(-1))

    def _initialize(self, start_time: float) -> None:
        net = self.network
        speeds, steady = self.start_speeds(self._assembled, net)
        n_nodes = len(net.nodes)
        self.state[:n_nodes] = speeds
        self._set_gear()
        self._set_levels()
        self._set_modes()
        self.log[:] = [message for message in self.log if message not in self._told]
        self._told = []
        if steady:
            found = self._find_start(speeds)
            self._told = self._about_the_start(speeds, found)
            self.log.extend(self._told)
        else:
            self._fill_air_path()
        self._check_substep()
        self._settle_sensors(start_time)
        self._call(start_time, 0.0, 0)

    def _step(self, time: float, dt: float) -> None:
        self._check_gear()
        self._call(time, dt, 1)

    def _call(self, time: float, dt: float, steps: int) -> None:
        try:
            status = self._run(time, dt, steps)
        except (ArithmeticError, ValueError):  # what compiled code gives as infinity, plain Python raises
            status = k.NOT_FINITE
        if status != k.OK:
            raise ArithmeticError(f"{self.name} at {time:g} s: {STATUS[status]}")

    def simulate(self, inputs: np.ndarray, dt: float, start_time: float = 0.0, *,
                 propagated: bool = False) -> np.ndarray:
        """Many steps in one call, for studies and fits.

        Args:
            inputs: steps x number of inputs, in the order of ``inputs``; each row held over ``dt``.
            dt: Communication step [s].
            start_time: Time of the first step's beginning [s].
            propagated: Take steps in which no contact changes at once, by what the plant does to small changes
                (``kernels.propagation``). More exact and quicker, but other bits than step by step.

        Returns:
            steps x number of outputs, at the end of each step.

        Raises:
            InputError: The step is not a positive length, or an input is not possible; nothing moved.
            ArithmeticError: As ``step``.
        """
        net = self.network
        inputs = np.require(inputs, np.float64, ["C", "W"])  # what is passed to compiled code must be writable
        self._check_rows(inputs, dt)
        outputs = np.empty((inputs.shape[0], len(self.output_variables)))
        net.constants[k.PROPAGATED] = float(propagated)
        run = self._kernel.bind(
            self.state, net.plan, net.constants, net.work, inputs.reshape(-1), outputs.reshape(-1))
        status = run(float(start_time), float(dt), inputs.shape[0])
        net.constants[k.PROPAGATED] = 0.0
        if status != k.OK:
            raise ArithmeticError(f"{self.name}: {STATUS[status]}")
        self._inputs[:] = inputs[-1]
        self._outputs[:] = outputs[-1]
        return outputs

    def _check_rows(self, inputs: np.ndarray, dt: float) -> None:
        if not 0.0 < dt < float("inf"):
            raise InputError(f"the communication step is {dt:g} s: a positive length is needed")
        if inputs.ndim != 2 or inputs.shape[1] != len(self.inputs) or not len(inputs):
            raise InputError(f"the inputs have shape {inputs.shape}: (steps, {len(self.inputs)}) is needed")
        bad = ~((inputs >= self._lower[:len(self.inputs)]) & (inputs <= self._upper[:len(self.inputs)])
                & np.isfinite(inputs))
        for i, variable in enumerate(self.inputs):
            suspects = np.unique(inputs[:, i]) if variable.kind != "real" else inputs[bad[:, i], i][:1]
            for value in suspects:
                variable.check(float(value))
        if self.network.plan[k.GEARS]:
            for gear in np.unique(inputs[:, self.network.plan[k.GEAR_INPUT]]):
                self._require_gear(int(gear))

    # -- gears ----------------------------------------------------------------------------------

    def _gear_exists(self, gear: int) -> bool:
        return True

    def _check_gear(self) -> None:
        net = self.network
        if not net.plan[k.GEARS]:
            return
        gear = int(self._inputs[net.plan[k.GEAR_INPUT]])
        if gear != int(self.state[net.plan[k.STATE_CLOCK] + k.GEAR]):
            self._require_gear(gear)

    def _require_gear(self, gear: int) -> None:
        if not self._gear_exists(gear):
            raise InputError(f"gear is {gear}: the ratio table has no such gear")

    def _set_gear(self) -> None:
        net = self.network
        if net.plan[k.GEARS]:
            gear = int(self._inputs[net.plan[k.GEAR_INPUT]])
            self._require_gear(gear)
            self.state[net.plan[k.STATE_CLOCK] + k.GEAR] = gear

    # -- the state at the start -----------------------------------------------------------------

    def _set_levels(self) -> None:
        """Every lag starts where its signal is."""
        net = self.network
        for row, place in enumerate(net.levels.values()):
            signal = net.plan[net.plan[k.LAG_TABLE] + 3 * row + 1] - k.SIGNALS_HEAD
            if signal >= 0:
                self.state[place] = self._inputs[signal]
            else:  # the shift element: engaged unless in neutral
                self.state[place] = float(self.state[net.plan[k.STATE_CLOCK] + k.GEAR] != 0.0)

    def _fill_air_path(self) -> None:
        """An engine that turns gives what it was asked for before, also where nothing else is steady: with an open
        clutch."""
        for row in self._branch_rows():
            if row[k.LAW] == k.ENGINE and self.state[row[k.NODE_A]] > 0.0:
                lag = self.network.constants[row[k.PARAMETER] + 11]
                self.state[row[k.TWIST]] += lag * self.rates()[0][row[k.TWIST]]

    def _branch_rows(self) -> np.ndarray:
        net = self.network
        start = net.plan[k.BRANCH_TABLE]
        return net.plan[start:start + len(net.branches) * k.BRANCH_COLUMNS].reshape(-1, k.BRANCH_COLUMNS)

    def kinematics(self) -> np.ndarray:
        """Branches x nodes: the matrix that gives each branch's rate from the speeds, in this gear."""
        net = self.network
        constants = net.constants.copy()
        if net.plan[k.GEARS]:
            gear = int(self.state[net.plan[k.STATE_CLOCK] + k.GEAR])
            apply_gear(net.plan, constants, net.constants, gear)
        matrix = np.zeros((len(net.branches), len(net.nodes)))
        for b, row in enumerate(self._branch_rows()):
            p = row[k.PARAMETER]
            matrix[b, row[k.NODE_A]] = constants[p]
            if row[k.NODE_B] != GROUND:
                matrix[b, row[k.NODE_B]] = -constants[p + 1]
        return matrix

    def branch_rates(self) -> np.ndarray:
        """Rate of every branch at the present state [rad/s or m/s]."""
        return self.kinematics() @ self.state[:len(self.network.nodes)]

    def _set_modes(self) -> None:
        """Friction sticks where nothing slips; lashes begin on the driving flank."""
        net = self.network
        modes = self.state[net.modes]
        scale = 1e-9 * max(1.0, np.abs(self.state[:len(net.nodes)]).max())
        for b, (row, rate) in enumerate(zip(self._branch_rows(), self.branch_rates(), strict=True)):
            if row[k.LAW] in k.DRY:
                modes[b] = 0.0 if abs(rate) <= scale else np.sign(rate)
            elif row[k.LAW] == k.LASH:
                modes[b] = 1.0
        self._set_flanks()

    def _set_flanks(self) -> None:
        """Make the total twist of every lash agree with its contact mode and its shaft's twist."""
        net = self.network
        for b, row in enumerate(self._branch_rows()):
            if row[k.LAW] == k.LASH:
                half_gap = net.constants[row[k.PARAMETER] + 4]
                at = row[k.TWIST]
                self.state[at] = self.state[at + 1] + self.state[net.modes][b] * half_gap

    def rates(self, state: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the continuous states, and the branch torques [N.m], at a state (default: now)."""
        rates, torques = self.rates_at((self.state if state is None else state)[None, :self.network.modes.stop])
        return rates[0], torques[0]

    def rates_at(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates of the continuous states, and the branch torques [N.m], at many states with the present inputs.

        Args:
            states: Continuous states and contact modes of each, as ``state`` begins with.

        Returns:
            states x continuous states, states x branches.
        """
        found = np.empty(states.shape)
        for first in range(0, len(states), _POINTS):
            part = states[first:first + _POINTS]
            self._points[:len(part)] = part
            self._evaluate(len(part))
            found[first:first + len(part)] = self._found[:len(part)]
        modes = self.network.modes
        return found[:, :modes.start], found[:, modes]

    def state_matrix(self) -> tuple[np.ndarray, list[str]]:
        """Jacobian of the rates of all continuous states but the integrals and the energy ledger.

        Central differences at the present state with the present contact modes and inputs held. What
        stands still to one side, as a control that is at its end, does so.

        Returns:
            The square matrix, and the names of its states.
        """
        net = self.network
        size = int(net.plan[k.CONTINUOUS] - net.plan[k.INTEGRALS]) - 2
        here = self.state[:net.modes.stop]
        steps = 1e-5 * (1.0 + np.abs(here[:size]))
        states = np.tile(here, (2 * size + 1, 1))
        each = np.arange(size)
        states[each, each] += steps
        states[size + each, each] -= steps
        rates = self.rates_at(states)[0][:, :size]
        more, less = rates[:size] - rates[-1], rates[-1] - rates[size:-1]
        matrix = np.where((more == 0.0) | (less == 0.0), 0.0, more + less) / (2.0 * steps[:, None])
        return np.ascontiguousarray(matrix.T), [entry.name for entry in net.entries[:size]]

    def possible_gears(self) -> list[int | None]:
        """The gears it may get into from here; None for the present one."""
        count = int(self.network.plan[k.GEARS])
        return [gear for gear in range(-1, count - 1) if self._gear_exists(gear)] if count else [None]

    def _check_substep(self) -> None:
        """Refuse a sub-step at which Runge-Kutta's method would not be stable, in any gear it may get into.

        Dry friction that sticks now may slip later; what it holds together then moves faster.
        """
        net = self.network
        inputs, modes = self._inputs.copy(), self.state[net.modes].copy()
        substep = self["solver.maximum_substep"]
        rows = self._branch_rows()
        self.state[net.modes][(rows[:, k.LAW] == k.FRICTION) & (modes == 0.0)] = 1.0
        patches = rows[np.isin(rows[:, k.LAW], k.PATCHES), k.TWIST]
        fastest = 0.0
        for gear in self.possible_gears():
            if gear is not None:
                self._inputs[net.plan[k.GEAR_INPUT]] = gear
            matrix, _ = self.state_matrix()
            if not np.isfinite(matrix).all():
                raise ArithmeticError(f"{self.name} at the start: {STATUS[k.NOT_FINITE]}")
            # a patch that slides so fast that stepping takes it in parts only follows
            parts = patches[-substep * matrix[patches, patches] > STABLE]
            matrix = np.delete(np.delete(matrix, parts, 0), parts, 1)
            fastest = max(fastest, np.abs(np.linalg.eigvals(matrix)).max())
        self._inputs[:], self.state[net.modes] = inputs, modes
        if substep * fastest <= STABLE:
            return
        shortest = self.variables[self.index["solver.maximum_substep"]].range[0]
        if shortest * fastest > STABLE:
            raise InputError(f"the fastest motion of this plant, {fastest:.3g} 1/s, is followed by no "
                             "solver.maximum_substep: look for a parameter far from its usual size")
        raise InputError(f"solver.maximum_substep is {substep:g} s: the fastest motion of this plant, "
                         f"{fastest:.0f} 1/s, needs at most {STABLE / fastest:.3g} s")

    def _find_equilibrium(self, speeds: np.ndarray) -> bool:
        """Twists, torques and tyre slip of steady rolling: every node accelerates with the vehicle.

        Newton's method on the rates. The vehicle keeps its speed; all other speeds may leave the
        rolling ones by the tyres' slip. Clutches that stick do not slip: their torques fix only
        accelerations, so the speeds need equations of their own. What a control lets slip has the
        capacity that it then holds, which may be none. Lashes lie on the flank their torque asks for, shafts are in
        the stage of their twist.

        Returns:
            Whether there is such a state; with more torque than the tyres carry there is none.
        """
        net = self.network
        n_nodes = len(net.nodes)
        rows = self._branch_rows()
        first = [int(r[k.TWIST]) for r in rows]
        lashes = [b for b, r in enumerate(rows) if r[k.LAW] == k.LASH]
        gaps = np.array([first[b] for b in lashes], dtype=int)
        twisted = [first[b] + (r[k.LAW] == k.LASH) for b, r in enumerate(rows)
                   if r[k.LAW] in (k.SHAFT, k.LASH, k.CONTACT, k.TWO_STAGE)]
        staged = [(b, first[b], net.constants[r[k.PARAMETER] + 5]) for b, r in enumerate(rows)
                  if r[k.LAW] == k.TWO_STAGE]
        modes = self.state[net.modes]
        settled = [first[b] for b, r in enumerate(rows) if r[k.LAW] == k.ENGINE]
        controlled = [b for b, r in enumerate(rows) if r[k.LAW] == k.SLIPPING and modes[b] != 0.0]
        held = [first[b] for b in controlled]
        reset_time = net.constants[[rows[b][k.PARAMETER] + 9 for b in controlled]]
        body = net.nodes[self.body]
        unknown = np.array([i for i in range(n_nodes) if i != body] + twisted + settled + held, dtype=int)
        shape = speeds / speeds[body]
        stuck = [b for b, r in enumerate(rows) if r[k.LAW] in k.DRY and modes[b] == 0.0]
        slips = self.kinematics()[stuck]
        def residuals(points: np.ndarray) -> np.ndarray:
            """What has to vanish (points x equations); leaves the plant at the last point."""
            states = np.tile(self.state[:net.modes.stop], (len(points), 1))
            states[:, unknown] = points[:, :-1]
            states[:, gaps] = states[:, gaps + 1]  # the rate of the shaft's own twist
            for b, twist, width in staged:
                states[:, net.modes][:, b] = np.sign(states[:, twist]) * (np.abs(states[:, twist]) > width)
            rates = self.rates_at(states)[0]
            self.state[:net.modes.stop] = states[-1]
            # a control holds its slip, or nothing: where what is beside the clutch carries the torque with less
            holding = np.maximum(rates[:, held], -states[:, held] / reset_time)
            return np.hstack([rates[:, :n_nodes] - shape * points[:, -1:], rates[:, twisted], rates[:, settled],
                              holding, states[:, :n_nodes] @ slips.T])

        x, change = np.append(self.state[unknown], 0.0), np.inf
        for _ in range(3):
            for _ in range(12):
                [r] = residuals(x[None])
                if not np.isfinite(r).all():
                    return False
                if change > _NEARLY:
                    steps = 1e-6 * (1.0 + np.abs(x))
                    jacobian = ((residuals(x + np.diag(steps)) - r) / steps[:, None]).T
                    inverse = np.linalg.pinv(jacobian, rcond=np.finfo(float).eps * max(jacobian.shape))
                delta = inverse @ -r
                x = x + delta
                change = np.abs(delta).max() / (1.0 + np.abs(x).max())
                if change < 1e-12:
                    break
            residuals(x[None])
            torques = self.rates()[1]
            wrong = [b for b in lashes if torques[b] * modes[b] < 0.0]
            modes[wrong] *= -1.0
            if not wrong:
                break
        # nothing, not nearly nothing: that would still fall
        self.state[held] = np.where(self.state[held] > _NOTHING, self.state[held], 0.0)
        self._set_flanks()
        return bool(change < 1e-9)

    def _find_start(self, speeds: np.ndarray) -> bool:
        """The equilibrium, where controls let slip what they hold; where there is none all rolls, with no twist.

        Returns:
            Whether it was found.
        """
        rolling = self.state.copy()
        for find in (self._find_equilibrium, self._find_from_more_friction):
            self.state[:] = rolling
            found = find(speeds)
            if self._let_slip():
                closed = self.state.copy()
                if self._find_equilibrium(speeds):
                    found = True
                else:
                    self.state[:] = closed  # and begins to slip from there
            if found:
                return True
        self.state[:] = rolling
        self._fill_air_path()
        return False

    def _find_from_more_friction(self, speeds: np.ndarray) -> bool:
        """The equilibrium followed from a road that carries more to this one, as long as the tyres do not slide.

        Near what tyres carry Newton's method does not get there from rolling. Where they would slide, the vehicle
        had better start rolling as it was asked to.
        """
        constants, rows = self.network.constants, self._branch_rows()
        places = rows[rows[:, k.LAW] == k.CONTACT, k.PARAMETER] + 4
        if not places.size:
            return False
        limits = constants[places]
        try:
            for more in _MORE_FRICTION:
                constants[places] = more * limits
                if not self._find_equilibrium(speeds) or self._slides():
                    return False
        finally:
            constants[places] = limits
        return True

    def _slides(self) -> bool:
        """Whether a tyre slides rather than rolls."""
        slips = np.abs(self.branch_rates()[self._branch_rows()[:, k.LAW] == k.CONTACT])
        return bool((slips > _SLIDING * abs(self.state[self.network.nodes[self.body]])).any())

    def _about_the_start(self, rolling: np.ndarray, found: bool) -> list[str]:
        """What the log is told of a start where the tyres carry less than is asked of them, or hardly more."""
        if found and not self._slides():
            return []
        net = self.network
        rows, torques = self._branch_rows(), self.rates()[1]
        patches = rows[:, k.LAW] == k.CONTACT
        start = f"{self.name} starts rolling, with its shafts untwisted: no equilibrium was found"
        if not patches.any():
            return [start]
        if found:
            slip = np.abs(self.branch_rates()[patches]).max()
            start = f"{self.name} starts with its tyres sliding at {slip:.3g} m/s"
        outside = (rows[:, k.NODE_B] == GROUND) & (rows[:, k.NODE_A] != net.nodes[self.body])
        power = (torques * (self.kinematics() @ rolling))[outside].sum()
        push = abs(power / rolling[net.nodes[self.body]])
        places = rows[patches, k.PARAMETER]
        limit = (net.constants[places + 2] * net.constants[places + 4]).sum()
        engine = -torques[rows[:, k.LAW] == k.ENGINE].sum()
        gear = f" in gear {int(self._inputs[net.plan[k.GEAR_INPUT]])}" if net.plan[k.GEARS] else ""
        return [f"{start}; {engine:.0f} N.m of the engine{gear}, losses and brakes come to {push:.0f} N at the tyres, "
                f"which carry {limit:.0f} N"]

    def _let_slip(self) -> bool:
        """Whether a control lets something slip that sticks: the way its torque turns it, with as much capacity."""
        modes, rows = self.state[self.network.modes], self._branch_rows()
        controlled = np.flatnonzero((rows[:, k.LAW] == k.SLIPPING) & (modes == 0.0))
        if not controlled.size:
            return False
        torques = self.rates()[1][controlled]
        modes[controlled] = np.where(torques < 0.0, -1.0, 1.0)
        self.state[rows[controlled, k.TWIST]] = np.abs(torques)
        return True

    def _settle_sensors(self, start_time: float) -> None:
        """Sensors start as if the plant had been in its first state for long."""
        net = self.network
        self._call(start_time, 0.0, 0)
        tick = net.constants[k.TICK]
        for channel in net.channels:
            value = self._outputs[net.outputs.index(channel.source)]
            held = can_signal_state(channel.parameters, channel.table, int(np.floor(start_time / tick + 1e-9)), value)
            self.state[channel.place:channel.place + held.size] = held
        if net.sections.size:
            raw = (net.constants[k.METER_GAIN] * self._outputs[net.plan[k.FILTERED_OUTPUT]]
                   + net.constants[k.METER_OFFSET])
            at = int(net.plan[k.STATE_SECTIONS])
            self.state[at:at + 2 * len(net.sections)] = steady_state(net.sections, raw)
            self.state[net.plan[k.STATE_CLOCK] + k.METER_HELD] = raw
