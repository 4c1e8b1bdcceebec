"""Parameters of the assemblies between engine and wheels that have no law of their own.

They are inertias, shafts, lashes and losses; the laws are in the files beside this one.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..quantities import InputError, quantity
from .shaft import Bushing, Shaft

GEARS = (-1, 0, *range(1, 11))  # the gear each of the twelve entries of a gear table belongs to
# What ratios of any driveline are within.
GEAR_RATIO = {"minimum": -50.0, "maximum": 50.0}
FINAL_DRIVE_RATIO = {"minimum": 0.1, "maximum": 20.0}


@dataclass(frozen=True)
class DualMassFlywheel(Shaft):
    """Arc springs between the crankshaft with the primary mass and the impeller side."""

    enabled: bool = quantity("1", "whether there is a dual-mass flywheel", kind="boolean", minimum=0, maximum=1)
    secondary_inertia: float = quantity("kg.m2", "secondary mass", minimum=0.0)


@dataclass(frozen=True)
class Transmission(Shaft):
    """The automatic gearbox: ratios and inertias by gear, losses, lash and stiffness at its input.

    Tables have one entry for reverse, neutral, then gears 1 to 10; a ratio of 0 marks a gear that
    does not exist. Reverse has a negative ratio, all others have positive ones.
    """

    ratio: tuple[float, ...] = quantity("1", "input speed over output speed, by gear", **GEAR_RATIO)
    inertia: tuple[float, ...] = quantity("kg.m2", "planetary sets referred to the input, by gear", minimum=1e-6)
    loss_constant: tuple[float, ...] = quantity("N.m", "drag torque at the input, by gear", minimum=0.0)
    loss_viscous: tuple[float, ...] = quantity("N.m.s/rad", "drag over input speed, by gear", minimum=0.0)
    loss_fraction: tuple[float, ...] = quantity(
        "1", "loss over carried input torque, by gear", minimum=0.0, maximum=0.9)
    input_inertia: float = quantity("kg.m2", "input shaft and clutch drum", minimum=0.0)
    output_inertia: float = quantity("kg.m2", "output shaft and parking gear", minimum=0.0)
    half_gap: float = quantity("rad", "half the total lash, at the input", minimum=0.0, maximum=1.0)
    shift_capacity: float = quantity("N.m", "torque capacity of the engaged shift element, at the input", minimum=1.0)
    shift_lag: float = quantity("s", "first-order lag of the oncoming shift element", minimum=0.0)

    def __post_init__(self) -> None:
        for name in ("inertia", "loss_constant", "loss_viscous", "loss_fraction"):
            if len(getattr(self, name)) != len(self.ratio):
                raise InputError(f"transmission.{name} has {len(getattr(self, name))} entries: "
                                 f"transmission.ratio has {len(self.ratio)}")
        if len(self.ratio) != len(GEARS):  # entries that are not said would stay what an FMU was built with
            raise InputError(f"transmission.ratio has {len(self.ratio)} entries: {len(GEARS)} are needed, reverse, "
                             f"neutral and gears 1 to {GEARS[-1]}, 0 where there is no such gear")
        for gear, ratio in zip(GEARS, self.ratio, strict=True):
            if gear != 0 and ratio * gear < 0.0:
                raise InputError(f"{in_gear('ratio', gear)} is {ratio:g}: gear {gear} needs a "
                                 f"{'positive' if gear > 0 else 'negative'} ratio, or 0 where there is no such gear")


def in_gear(table: str, gear: int) -> str:
    """The name of a gear's entry in a table of the transmission, as a vehicle's values have it."""
    return f"transmission.{table}[{gear + 2}]"


@dataclass(frozen=True)
class TransferCase:
    """A four-wheel-drive transfer case carried along in two-wheel drive."""

    enabled: bool = quantity("1", "whether there is a transfer case", kind="boolean", minimum=0, maximum=1)
    inertia: float = quantity("kg.m2", "chain and shafts, at the transmission output", minimum=0.0)
    drag_viscous: float = quantity("N.m.s/rad", "viscous drag at the transmission output", minimum=0.0)


@dataclass(frozen=True)
class FinalDrive:
    """Hypoid gear and differential; lash and mesh at the propeller shaft."""

    ratio: float = quantity("1", "propeller shaft speed over axle speed", **FINAL_DRIVE_RATIO)
    pinion_inertia: float = quantity("kg.m2", "pinion and flange, at the propeller shaft", minimum=1e-5)
    ring_inertia: float = quantity("kg.m2", "ring gear and differential, at the axle", minimum=1e-4)
    half_gap: float = quantity("rad", "half the total lash, at the propeller shaft", minimum=0.0, maximum=1.0)
    mesh_stiffness: float = quantity("N.m/rad", "mesh and bearings, at the propeller shaft", minimum=1.0)
    mesh_damping: float = quantity("N.m.s/rad", "mesh damping, at the propeller shaft", minimum=0.0)
    loss_constant: float = quantity("N.m", "drag torque at the pinion", minimum=0.0)
    loss_fraction: float = quantity("1", "loss over carried torque", minimum=0.0, maximum=0.9)


@dataclass(frozen=True)
class Suspension(Bushing):
    """Fore-aft compliance of the driven axle in the body."""

    enabled: bool = quantity(
        "1", "whether the axle moves fore and aft in the body", kind="boolean", minimum=0, maximum=1)
    unsprung_mass: float = quantity("kg", "mass of the driven axle that moves with the wheels", minimum=1.0)


@dataclass(frozen=True)
class Hub:
    """What turns with one driven wheel inside the tyre."""

    inertia: float = quantity("kg.m2", "hub, brake disc and rim of one wheel", minimum=1e-4)


@dataclass(frozen=True)
class Seat(Bushing):
    """Driver and seat on their track."""

    mass: float = quantity("kg", "driver and moving part of the seat", minimum=1.0)


@dataclass(frozen=True)
class DifferentialCase(Shaft):
    """Pitch of the axle housing on its springs; driven by the axle torque, read out only."""

    inertia: float = quantity("kg.m2", "axle housing about the axle", minimum=1e-3)
    lever_arm: float = quantity("m", "from the axle to the accelerometer on the case", minimum=0.0)


@dataclass(frozen=True)
class EngineMount(Shaft):
    """Roll of engine and transmission on their mounts; driven by the output torque, read out only."""

    inertia: float = quantity("kg.m2", "powertrain about its roll axis", minimum=1e-2)
