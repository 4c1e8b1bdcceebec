"""All ten gears: ratio from the planetary sets, inertia, shuffle, lash crossing and losses.

The thesis stays in 5th gear; its transmission is said to have ten. Ratios are compared with the published
ones of the 10R80, shuffle and lash crossing between full-order and 3DOF model; the engine turns as fast as
in the validation tip-in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.report.study_figures import Curve, Panel, draw
from cosim.studies.findings import THESIS, Findings
from cosim.studies.manoeuvre import (
    FULL_ORDER,
    TipIn,
    drive,
    drive_fmu,
    lash_crossing,
    parameters,
    prepare,
)
from driveline import vehicles
from driveline.elements.mesh_loss import loss_torque
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.linear import Mode, shuffle_mode
from driveline.plants.reduced import reduce
from driveline.quantities import parameter_variables
from driveline.vehicles import Vehicle

SOURCE = f"{THESIS}, section 2.1.1 (ten gears; printed for 5th only), tables 2.4, 2.6"
PUBLISHED = (4.696, 2.985, 2.146, 1.769, 1.520, 1.275, 1.000, 0.854, 0.689, 0.636)
LOAD = 120.0  # [N.m] engine torque about which the vibrations are small, and at which losses are taken
THREE_MASS = "plant_rom_3dof"


@dataclass(frozen=True)
class GearResult:
    """What one gear gives.

    Attributes:
        ratio: From the planetary sets.
        engine_inertia: Everything up to the pinion, at the engine [kg.m2].
        wheel_inertia: The same at the wheels [kg.m2].
        full, three: Shuffle mode of the full-order and of the 3DOF model.
        crossing_full, crossing_three: Time to cross the lash in the tip-in [s].
        gap: Total lumped lash at the propeller shaft [rad].
        efficiency: Power at the axle over power at the transmission's input.
    """

    ratio: float
    engine_inertia: float
    wheel_inertia: float
    full: Mode
    three: Mode
    crossing_full: float
    crossing_three: float
    gap: float
    efficiency: float


def in_gear(vehicle: Vehicle, gear: int, tip_in: TipIn) -> tuple[GearResult, float | None]:
    """One gear; also the largest difference of the FMU's torque from the run in process [N.m]."""
    p = vehicle.parameters(FullOrderParameters)
    fifth = p.transmission.ratio[6]
    ratio = vehicle.gearbox.ratio(gear)
    tip_in = replace(tip_in, gear=gear, vehicle_speed=tip_in.vehicle_speed * fifth / ratio)
    referred = ratio * p.final_drive.ratio
    full_values = parameters(FULL_ORDER, vehicle, gear)
    steady = replace(tip_in, before=LOAD, after=LOAD + 1.0)
    less = vehicle.values["engine.accessory_torque"]
    full, _ = prepare(FULL_ORDER, full_values, steady)
    three = reduce(p, gear, tip_in.vehicle_speed, LOAD).three_mass
    three_values = {v.name: v.start for v in parameter_variables(three)}
    small, _ = prepare(THREE_MASS, three_values, steady.less(less))
    run_full = drive(FULL_ORDER, full_values, tip_in)
    run_three = drive(THREE_MASS, three_values, tip_in.less(less))
    through_fmu = drive_fmu(FULL_ORDER, full_values, tip_in)
    difference = None if through_fmu is None else float(np.abs(
        through_fmu["propeller_shaft_torque"] - run_full["propeller_shaft_torque"]).max())
    result = GearResult(
        ratio=ratio, engine_inertia=three.engine_inertia, wheel_inertia=three.engine_inertia * referred**2,
        full=shuffle_mode(full), three=shuffle_mode(small),
        crossing_full=lash_crossing(run_full.time, run_full["lash_position"]).duration,
        crossing_three=lash_crossing(run_three.time, run_three["lash_position"]).duration,
        gap=2.0 * three.shaft.half_gap,
        efficiency=efficiency(p, gear, tip_in.vehicle_speed / p.tyre.radius * referred))
    return result, difference


def efficiency(p: FullOrderParameters, gear: int, engine_speed: float, torque: float = LOAD) -> float:
    """Power at the axle over power at the transmission's input, at steady ``torque`` [N.m] there.

    Args:
        engine_speed: [rad/s]
    """
    t, final = p.transmission, p.final_drive
    ratio = t.ratio[gear + 1]
    # the loss is taken off what comes in, and depends on what goes on: carried + loss(carried) = torque
    at_rest = loss_torque(engine_speed, 0.0, t.loss_constant[gear + 1], t.loss_viscous[gear + 1], 0.0)
    carried = (torque - at_rest) / (1.0 + t.loss_fraction[gear + 1])
    at_pinion = carried * ratio
    pinion_speed = engine_speed / ratio
    at_rest = loss_torque(pinion_speed, 0.0, final.loss_constant, 0.0, 0.0)
    at_axle = (at_pinion - at_rest) / (1.0 + final.loss_fraction)
    return float(at_axle * pinion_speed / (torque * engine_speed))


def run(out: Path, progress: Callable[[float], None], gears: Sequence[int] = tuple(range(1, 11)),
        tip_in: TipIn | None = None) -> Findings:
    """Rows and a picture; fewer gears or a shorter tip-in make the study smaller."""
    findings = Findings()
    vehicle = vehicles.load("pickup_10r80", "modified")
    tip_in = tip_in or TipIn(stop=3.0)
    results: dict[int, GearResult] = {}
    differences = []
    for number, gear in enumerate(gears):
        progress(number / len(gears))
        results[gear], difference = in_gear(vehicle, gear, tip_in)
        differences.append(difference)
        _rows(findings, gear, results[gear])
    if None in differences:
        findings.add("FMU against in-process run, all gears", "N.m", None, None,
                     "no FMU is built: `driveline build`")
    else:
        findings.add("FMU against in-process run, all gears", "N.m", None, max(differences),
                     "largest difference of the propeller shaft torque; the FMU was stepped by the master")
    findings.figures.append(_figure(out, results))
    return findings


def _rows(findings: Findings, gear: int, r: GearResult) -> None:
    name = f"gear {gear}"
    fifth = gear == 5
    findings.add(f"ratio, {name}", "1", PUBLISHED[gear - 1], r.ratio,
                 "from tooth counts and clutch table; published to three digits")
    findings.add(f"inertia up to the pinion at the engine, {name}", "kg.m2", None, r.engine_inertia)
    findings.add(f"inertia up to the pinion at the wheels, {name}", "kg.m2", None, r.wheel_inertia)
    findings.add(f"shuffle frequency, FOM, {name}", "Hz", 5.88 if fifth else None, r.full.frequency,
                 f"small vibration about {LOAD:g} N.m; fitted to the tip-in it is in fom-validation"
                 if fifth else "")
    findings.add(f"shuffle frequency, 3DOF, {name}", "Hz", 5.85 if fifth else None, r.three.frequency,
                 f"{100.0 * (r.three.frequency / r.full.frequency - 1.0):+.2f} % from FOM")
    findings.add(f"damping ratio, FOM, {name}", "1", None, r.full.damping_ratio)
    findings.add(f"damping ratio, 3DOF, {name}", "1", None, r.three.damping_ratio)
    findings.add(f"lash crossing time, FOM, {name}", "ms", 130.0 if fifth else None, 1e3 * r.crossing_full,
                 f"{np.degrees(r.gap):.2f} deg at the propeller shaft")
    findings.add(f"lash crossing time, 3DOF, {name}", "ms", None, 1e3 * r.crossing_three)
    findings.add(f"efficiency of transmission and final drive, {name}", "%", None, 100.0 * r.efficiency,
                 f"at {LOAD:g} N.m")


def _figure(out: Path, results: dict[int, GearResult]) -> str:
    gears = np.array(list(results))

    def of(read: Callable[[GearResult], float]) -> np.ndarray:
        return np.array([read(r) for r in results.values()])

    def pair(full: Callable[[GearResult], float], three: Callable[[GearResult], float]) -> list[Curve]:
        return [Curve(gears, of(full), "FOM", "measured", "o-"),
                Curve(gears, of(three), "3DOF", "first", "s--")]

    def panel(title: str, curves: list[Curve], y_label: str, right_label: str = "") -> Panel:
        return Panel(title, curves, y_label, "gear", right_label, ticks=gears)

    return draw(out / "gears.png", "All gears: the engine at the same speed, converter locked", [
        panel("(a) ratio and inertia at the engine", [
            Curve(gears, of(lambda r: r.ratio), "ratio", "first", "o-"),
            Curve(gears, np.array([PUBLISHED[g - 1] for g in gears]), "ratio, published", "measured", "x"),
            Curve(gears, of(lambda r: r.engine_inertia), "inertia", "second", "s--", right=True)],
            "ratio [1]", "inertia [kg m²]"),
        panel("(b) shuffle frequency", pair(lambda r: r.full.frequency, lambda r: r.three.frequency),
              "frequency [Hz]"),
        panel("(c) damping ratio of shuffle",
              pair(lambda r: r.full.damping_ratio, lambda r: r.three.damping_ratio), "damping ratio [1]"),
        panel("(d) lash crossing time, and efficiency", [
            *pair(lambda r: 1e3 * r.crossing_full, lambda r: 1e3 * r.crossing_three),
            Curve(gears, of(lambda r: 100.0 * r.efficiency), "efficiency", "third", "^:", right=True)],
            "time [ms]", "efficiency [%]"),
    ])
