"""The two linear modes of the 3DOF model: in contact and inside the lash (thesis section 3.1.1).

Derived from eq. 2.11 to 2.22 with their misprints corrected (docs/errata.md). With the shaft's twist
``theta_d = theta_e / i_tr - i_fdr theta_fdr`` and the lash angle ``theta_b`` behind the spring:

    J_1 theta_e''               = T_e - T_s / i_tr
    J_2 theta_fdr''             = i_fdr T_s - T_w
    (M r_w^2 + J_3) theta_w''   = T_w - r_w F_load
    T_w                         = k_w (theta_fdr - theta_w) + c_w (theta_fdr' - theta_w')
    contact                     T_s = k_s (theta_d - theta_b) + c_s theta_d',   theta_b' = 0
    lash                        T_s = 0,   theta_b' = theta_d' + k_s / c_s (theta_d - theta_b)

``F_load`` [N] is positive against the motion: the printed B has it with the other sign. ``T_e`` is
the crankshaft torque less the gear-train losses.

Entries are computed with whatever numbers the parameters hold: floats give float64 matrices,
``fractions.Fraction`` gives exact ones (dtype object), for exact ranks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..quantities import InputError

CONTACT, BACKLASH = "contact", "backlash"

POSITION_STATES = ("engine_angle", "engine_speed", "final_drive_angle", "final_drive_speed",
                   "wheel_angle", "wheel_speed", "lash_angle")
TWIST_STATES = ("shaft_twist", "engine_speed", "wheel_shaft_twist", "final_drive_speed",
                "wheel_speed", "lash_angle")
REDUCED_STATES = ("engine_speed", "wheel_shaft_twist", "final_drive_speed", "wheel_speed")
INPUTS = ("engine_torque", "load_force")
MEASUREMENTS = ("engine_speed", "wheel_speed")


class _Number(Protocol):
    def __add__(self, other): ...
    def __mul__(self, other): ...
    def __truediv__(self, other): ...


@dataclass(frozen=True)
class Lumped:
    """The numbers of the 3DOF model in the thesis's symbols (floats or Fractions).

    Attributes:
        J_1, J_2: Engine side, and final drive with rims [kg.m2].
        J_v: Tyres and vehicle, M r_w^2 + J_3 [kg.m2].
        k_s, c_s: Shaft at the propeller shaft [N.m/rad, N.m.s/rad].
        k_w, c_w: Shaft at the wheels [N.m/rad, N.m.s/rad].
        i_tr, i_fdr: Transmission and final drive ratio.
        r_w: Tyre radius [m].
    """

    J_1: _Number
    J_2: _Number
    J_v: _Number
    k_s: _Number
    c_s: _Number
    k_w: _Number
    c_w: _Number
    i_tr: _Number
    i_fdr: _Number
    r_w: _Number

    @classmethod
    def of(cls, p, number=float) -> Lumped:
        """From ``plants.reduced.ThreeMassParameters``; ``number`` converts every one first.

        Raises:
            InputError: The shaft has no damping: eq. 2.7 then has no rate of the lash angle.
        """
        if not p.shaft.damping > 0.0:
            raise InputError(f"shaft.damping is {p.shaft.damping:g} N.m.s/rad: a positive one is needed, "
                             "the lash angle relaxes with stiffness over damping")
        radius = number(p.vehicle.tyre_radius)
        return cls(
            J_1=number(p.engine_inertia), J_2=number(p.final_drive_inertia),
            J_v=number(p.vehicle.mass) * radius * radius + number(p.wheel_inertia),
            k_s=number(p.shaft.stiffness), c_s=number(p.shaft.damping),
            k_w=number(p.wheel_shaft.stiffness), c_w=number(p.wheel_shaft.damping),
            i_tr=number(p.gear.transmission_ratio), i_fdr=number(p.gear.final_drive_ratio), r_w=radius)


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B u, y = C x.

    Attributes:
        A: states x states.
        B: states x inputs (``INPUTS``).
        C: measurements (``MEASUREMENTS``) x states.
        states: Names, in order.
    """

    A: NDArray
    B: NDArray
    C: NDArray
    states: tuple[str, ...]


def _assemble(states: tuple[str, ...], rates: dict[str, dict[str, _Number]], p: Lumped) -> StateSpace:
    """Matrices from the rate of every state as factors of the others, by name."""
    zero = p.J_1 - p.J_1
    one = p.J_1 / p.J_1

    def matrix(rows: tuple[dict[str, _Number], ...], columns: tuple[str, ...]) -> NDArray:
        entries = [[row.get(name, zero) for name in columns] for row in rows]
        return np.array(entries, dtype=np.float64 if isinstance(zero, float) else object)

    forces = {"engine_speed": {"engine_torque": one / p.J_1}, "wheel_speed": {"load_force": -p.r_w / p.J_v}}
    return StateSpace(
        A=matrix(tuple(rates.get(state, {}) for state in states), states),
        B=matrix(tuple(forces.get(state, {}) for state in states), INPUTS),
        C=matrix(tuple({state: one} for state in MEASUREMENTS), states),
        states=states)


def _accelerations(p: Lumped, shaft: dict[str, _Number],
                   wheel: dict[str, _Number]) -> dict[str, dict[str, _Number]]:
    """Rates of the three speeds for the torques T_s and T_w as factors of the states."""
    final_drive = {name: p.i_fdr / p.J_2 * value for name, value in shaft.items()}
    for name, value in wheel.items():
        final_drive[name] = final_drive[name] - value / p.J_2 if name in final_drive else -value / p.J_2
    return {
        "engine_speed": {name: -value / (p.J_1 * p.i_tr) for name, value in shaft.items()},
        "final_drive_speed": final_drive,
        "wheel_speed": {name: value / p.J_v for name, value in wheel.items()},
    }


def _lash_rate(p: Lumped, twist: dict[str, _Number], one: _Number) -> dict[str, _Number]:
    """theta_b' inside the lash; ``twist`` is theta_d as factors of the states."""
    relaxation = p.k_s / p.c_s
    return {**{name: relaxation * value for name, value in twist.items()}, "lash_angle": -relaxation,
            "engine_speed": one / p.i_tr, "final_drive_speed": -p.i_fdr}


def _check(mode: str) -> None:
    if mode not in (CONTACT, BACKLASH):
        raise InputError(f"mode is {mode!r}: {CONTACT!r} or {BACKLASH!r} is needed")


def _model(p: Lumped, mode: str, states: tuple[str, ...], shaft_twist: dict[str, _Number],
           wheel_twist: dict[str, _Number], kinematics: dict[str, dict[str, _Number]]) -> StateSpace:
    """A model whose twists are given as factors of its states, and whose positions have these rates."""
    _check(mode)
    one = p.J_1 / p.J_1
    shaft: dict[str, _Number] = {}
    if mode == CONTACT:
        shaft = {**{name: p.k_s * value for name, value in shaft_twist.items()}, "lash_angle": -p.k_s,
                 "engine_speed": p.c_s / p.i_tr, "final_drive_speed": -p.c_s * p.i_fdr}
    wheel = {**{name: p.k_w * value for name, value in wheel_twist.items()},
             "final_drive_speed": p.c_w, "wheel_speed": -p.c_w}
    rates = kinematics | _accelerations(p, shaft, wheel)
    if mode == BACKLASH:
        rates["lash_angle"] = _lash_rate(p, shaft_twist, one)
    return _assemble(states, rates, p)


def positions(p: Lumped, mode: str) -> StateSpace:
    """State space model I, with the three angles as states (eq. 3.5 to 3.11)."""
    one = p.J_1 / p.J_1
    return _model(
        p, mode, POSITION_STATES,
        shaft_twist={"engine_angle": one / p.i_tr, "final_drive_angle": -p.i_fdr},
        wheel_twist={"final_drive_angle": one, "wheel_angle": -one},
        kinematics={f"{name}_angle": {f"{name}_speed": one} for name in ("engine", "final_drive", "wheel")})


def twists(p: Lumped, mode: str) -> StateSpace:
    """State space model II, with the two twists in place of the angles (eq. 3.13 to 3.17)."""
    one = p.J_1 / p.J_1
    return _model(
        p, mode, TWIST_STATES,
        shaft_twist={"shaft_twist": one}, wheel_twist={"wheel_shaft_twist": one},
        kinematics={"shaft_twist": {"engine_speed": one / p.i_tr, "final_drive_speed": -p.i_fdr},
                    "wheel_shaft_twist": {"final_drive_speed": one, "wheel_speed": -one}})


def reduced(p: Lumped) -> StateSpace:
    """Model II in the lash without what cannot be seen there: twist and lash angle (eq. 3.18 to 3.21)."""
    full = twists(p, BACKLASH)
    keep = [TWIST_STATES.index(state) for state in REDUCED_STATES]
    return StateSpace(full.A[np.ix_(keep, keep)], full.B[keep], full.C[:, keep], REDUCED_STATES)


def observability_matrix(A: NDArray, C: NDArray) -> NDArray:
    """[C; C A; ...; C A^(n-1)] (eq. 3.12)."""
    rows = [C]
    for _ in range(len(A) - 1):
        rows.append(rows[-1] @ A)
    return np.concatenate(rows)


def scaled(model: StateSpace, rate: float) -> StateSpace:
    """The same model with time in units of 1 / ``rate`` and angles in units of speed over ``rate``.

    All speeds keep their unit, all angles are multiplied by ``rate`` [1/s]; with ``rate`` at the
    model's own vibration every entry is of the order of the ratio of its frequencies, and the
    singular values of the observability matrix can be compared.
    """
    unit = np.array([1.0 if state.endswith("speed") else 1.0 / rate for state in model.states])
    return StateSpace(model.A * unit / unit[:, None] / rate, model.B / unit[:, None] / rate,
                      model.C * unit, model.states)
