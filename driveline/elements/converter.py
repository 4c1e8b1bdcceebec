"""Hydrodynamic torque converter: torque ratio and capacity factor over speed ratio."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from ..kernels.backend import kernel
from ..quantities import InputError, quantity

POINTS = 11


@dataclass(frozen=True)
class Converter:
    """Tables over speed ratio (turbine over impeller), and the two inertias."""

    impeller_inertia: float = quantity("kg.m2", "impeller, cover and entrained fluid", minimum=1e-4, nominal=0.1)
    turbine_inertia: float = quantity("kg.m2", "turbine and entrained fluid", minimum=1e-4, nominal=0.05)
    speed_ratio: tuple[float, ...] = quantity("1", "speed ratio, ascending from 0 to 1", minimum=0.0, maximum=1.0)
    torque_ratio: tuple[float, ...] = quantity("1", "turbine torque over impeller torque", minimum=0.0)
    capacity: tuple[float, ...] = quantity(
        "N.m.s2/rad2", "impeller torque over impeller speed squared", minimum=0.0, nominal=1e-3)

    def __post_init__(self) -> None:
        for name in ("speed_ratio", "torque_ratio", "capacity"):
            if len(getattr(self, name)) != POINTS:
                raise InputError(
                    f"converter.{name} has {len(getattr(self, name))} entries: {POINTS} are needed")
        if any(low >= high for low, high in pairwise(self.speed_ratio)):
            raise InputError("converter.speed_ratio must ascend from entry to entry")


@kernel
def converter_table(work, table, ratio):
    """Linear interpolation in a table of POINTS speed ratios at ``table``; the values follow them.

    Returns capacity and torque ratio; the ratio is clipped to the table's ends.
    """
    first = table
    if ratio <= work[first]:
        return work[first + 2 * POINTS], work[first + POINTS]
    i = 1
    while i < POINTS - 1 and ratio > work[first + i]:
        i += 1
    low = work[first + i - 1]
    high = work[first + i]
    part = (ratio - low) / (high - low)
    if part > 1.0:
        part = 1.0
    c = first + 2 * POINTS + i
    r = first + POINTS + i
    return (work[c - 1] + part * (work[c] - work[c - 1]),
            work[r - 1] + part * (work[r] - work[r - 1]))


@kernel
def converter_torques(work, table, impeller_speed, turbine_speed):
    """Torque taken from the impeller and given to the turbine [N.m].

    Driving (impeller faster): capacity * impeller speed squared, times the torque ratio at the
    turbine. Overrun (turbine faster): the stator freewheels, the roles change and the torque
    ratio is one, so both torques meet continuously, at zero, at equal speeds.
    """
    if impeller_speed >= turbine_speed:
        if impeller_speed <= 0.0:
            return 0.0, 0.0
        capacity, torque_ratio = converter_table(work, table, turbine_speed / impeller_speed)
        torque = capacity * impeller_speed * impeller_speed
        return torque, torque_ratio * torque
    if turbine_speed <= 0.0:
        return 0.0, 0.0
    capacity, torque_ratio = converter_table(work, table, impeller_speed / turbine_speed)
    torque = -capacity * turbine_speed * turbine_speed
    return torque, torque
