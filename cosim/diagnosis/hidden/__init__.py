"""Measurements with effects hidden in them, to try a diagnosis on: the folder tells nothing, the truth is apart.

The plant is one of its own (``model``), so are its sensors (``recordings``); with the model that a diagnosis
inverts it shares the vehicle file and the meaning of the parameters, no more. Beyond the hidden effects

- every parameter that no effect of the catalogue has as its target drifts by 3 to 5 percent either way; one
  that has would be an effect itself. ``drift="all"`` moves those of the plant too, save the tyres' radius and
  the engine's torque gain, which one look at a log would show;
- the road slopes by some tenths of a per mille and the torque estimate is off by half a newton metre, anew in
  every recording, and the true torque wanders about it;
- phases of ripple and eccentricity are drawn anew in every recording;
- in a third of all seeds the plant has another structure.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim import units
from cosim.diagnosis.catalogue import CATALOGUE, apply_all, effect
from cosim.diagnosis.effect import SLOPE, Effect, EffectParameter
from cosim.diagnosis.hidden.model import PRE_ROLL, packed, simulate
from cosim.diagnosis.hidden.outside import OUTSIDE, PREFIX
from cosim.diagnosis.hidden.recordings import Drive, asked, driven, logged, usual, write
from cosim.files import replacing
from cosim.messages import did_you_mean
from driveline import vehicles
from driveline.plants.full_order import FullOrderParameters
from driveline.quantities import InputError, behind, parameter_variables

STRUCTURES = ("same", "other")
DRIFTS = ("nuisance", "all", "none")
COCKTAIL = "thesis_cocktail"
VEHICLE, VALIDATED = "pickup_10r80", "modified"
DRIFT = (0.03, 0.05)  # smallest and largest relative drift
GRADE, TORQUE, WANDER = 5e-4, 0.5, 1.0  # standard deviations a recording: rad, N.m, N.m about the estimate
_DRAWS = 100  # of sizes, until one changes something
LARGEST_STRENGTH = 5.0  # of a drawn size, in detection limits; the smallest is one

# What is known for sure, or is no physics of the plant: it does not drift.
_FIXED = re.compile(r"ratio|_sensor\.|^torque_meter\.|^start\.|^solver\.|noise|enabled|^converter\.(capacity|speed)"
                    r"|^vehicle\.(frontal_area|air_density)$|^engine\.(maximum_torque|idle|torque)|^observe\.|^input\.")
_LOOKED_UP = ("tyre.radius",)  # of the catalogue's targets, what even ``drift="all"`` leaves alone
_COUNTED = {"torque_ripple.order"}  # half the engine's cylinders: never drifts, and no draw is spent on it
_SIZE = re.compile(r"^\s*(\+?)\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\d.])\s*(.*?)\s*$")


@dataclass(frozen=True)
class Hidden:
    """What was hidden.

    Attributes:
        vehicle, variant: The nominal vehicle the measurement names.
        seed: Of all that is drawn.
        effects: ``{effect: {parameter: size}}``.
        outside: ``{name: size}`` of effects outside the catalogue.
        changed: What the effects changed: name to (nominal, true).
        drift: Relative drift of the others.
        structure: ``same`` or ``other``.
        recordings: What each recording had of its own.
    """

    vehicle: str
    variant: str | None
    seed: int
    effects: dict[str, dict[str, float]]
    outside: dict[str, float]
    changed: dict[str, tuple[float, float]]
    drift: dict[str, float]
    structure: str
    recordings: list[dict[str, Any]] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """For the file of the truth."""
        return {
            "vehicle": self.vehicle, "variant": self.variant, "seed": self.seed, "effects": self.effects,
            "outside": {name: {"size": size, "unit": OUTSIDE[name].unit, "balance": OUTSIDE[name].balance,
                               "driving_variables": list(OUTSIDE[name].driving_variables)}
                        for name, size in self.outside.items()},
            "changed": {name: {"nominal": a, "true": b} for name, (a, b) in self.changed.items()},
            "structure": self.structure, "drift": self.drift, "recordings": self.recordings}


def hide(effects: Sequence[str], seed: int, out: Path, *, vehicle: str = VEHICLE,
         variant: str | None = None, structure: str | None = None, drift: str = "nuisance",
         manoeuvres: Sequence[str] | None = None, truth: Path | None = None,
         progress: Callable[[float], None] | None = None) -> Hidden:
    """Write a measurement folder with effects hidden in it.

    Args:
        effects: ``EFFECT``, ``EFFECT=SIZE`` or ``EFFECT=PARAMETER:SIZE,...``, of the catalogue or, as
            ``outside:NAME``, of those it does not know; ``thesis_cocktail`` is all of thesis table 2.3 on the
            baseline vehicle. None: nothing is hidden. See ``sizes_of`` for what a size may be.
        seed: Of everything that is drawn; the same seed gives the same files.
        vehicle, variant: The nominal vehicle; a file given by its path is copied into the folder. Without a
            variant the shipped vehicle is the one the thesis validated.
        out: The folder; made if need be, and only written when all is simulated.
        structure: ``same`` or ``other``; None: other for every third seed.
        drift: ``nuisance``, ``all`` or ``none``, see the module.
        manoeuvres: ``KIND``, ``KIND:GEAR`` or, with the road driven the other way, ``KIND:GEAR:back``; None: six
            usual ones.
        truth: Where the truth goes as JSON, outside ``out``; None: nowhere.

    Raises:
        InputError: No such effect, parameter, vehicle or manoeuvre, a size that is not plausible, or a truth
            that would lie in the measurement.
    """
    if truth is not None and out.resolve() in (truth.resolve(), *truth.resolve().parents):
        raise InputError(f"the truth {truth} would lie inside the measurement {out}: put it elsewhere")
    for what, value, known in (("structure", structure, STRUCTURES), ("drift", drift, DRIFTS)):
        if value is not None and value not in known:
            raise InputError(f"{what} is {value!r}{did_you_mean(str(value), known)}")
    random = np.random.default_rng([seed, 4])
    structure = structure or ("other" if np.random.default_rng([seed, 7]).uniform() < 1 / 3 else "same")
    wanted = sorted(effects, key=lambda entry: entry != COCKTAIL)  # which says what the others are of
    variant = None if COCKTAIL in wanted else variant or usual_variant(vehicle)
    nominal = _file_values(vehicle, variant)
    mixed, sizes, chosen, outside = nominal, {}, {}, {}
    for entry in wanted:
        name, sized, text = entry.partition("=")
        if sized and not text.strip():
            raise InputError(f"{entry}: a size is needed behind =, or {name} alone where it is to be drawn")
        if name == COCKTAIL:
            if sized:
                raise InputError(f"{entry}: {name} is what its table says, and takes no size")
            mixed, sizes = cocktail(vehicle, nominal)
        elif name.startswith(PREFIX):
            name = name.removeprefix(PREFIX)
            outside[name] = _outside_size(name, text, random)
        else:
            _require(name)
            if name in sizes:
                raise InputError(f"{name} is there twice: one entry for each effect, for several of its numbers "
                                 f"{name}=PARAMETER:SIZE,PARAMETER:SIZE")
            found, before = effect(name), apply_all(chosen, mixed)
            for _ in range(1 if text else _DRAWS):
                sizes[name] = chosen[name] = sizes_of(found, text, nominal, random)
                if _changed(before, apply_all(chosen, mixed)):
                    break
            else:
                raise InputError(f"{entry} changes nothing of {vehicle}" + (f", {variant}" if variant else ""))
    values = apply_all(chosen, mixed)
    changed = _changed(nominal, values)
    drifted = _drift(nominal, changed, drift, np.random.default_rng([seed, 5]))
    values |= {name: values[name] * (1.0 + share) for name, share in drifted.items()}
    values |= {f"outside.{name}": size for name, size in outside.items()}
    if "engine_mount_coupling" in outside:  # so many times as far, at the same frequency
        values |= {f"engine_mount.{key}": values[f"engine_mount.{key}"] / outside["engine_mount_coupling"]
                   for key in ("inertia", "stiffness", "damping")}
        values["outside.engine_mount_coupling"] = 1.0

    drives = _drives(manoeuvres, nominal, np.random.default_rng([seed, 6]))
    for name, one in chosen.items():
        _check_simulated(name, apply_all({name: one}, nominal), nominal, {drive.gear for drive in drives}, structure)
    hidden = Hidden(vehicle, variant, seed, sizes, outside, changed, drifted, structure)
    channels = []
    for number, drive in enumerate(drives):
        own = _recording(drive, values, np.random.default_rng([seed, 8, number]))
        slope = {SLOPE: -values[SLOPE]} if drive.back and SLOPE in values else {}
        channels.append(_recorded(drive, {**values, **slope, **own.pop("values")}, own, structure,
                                  np.random.default_rng([seed, 9, number])))
        hidden.recordings.append({"kind": drive.kind, "gear": drive.gear, "back": drive.back, **own})
        if progress is not None:
            progress((number + 1) / len(drives))
    with contextlib.nullcontext() if truth is None else replacing(truth) as place:
        if place is not None:  # before the measurement: one without its truth is worth nothing
            place.write_text(json.dumps(hidden.as_json(), indent=2) + "\n", encoding="utf-8")
        write(out, vehicle, variant, drives, channels)
    return hidden


def usual_variant(vehicle: str) -> str | None:
    """The variant that is nominal where nobody asks for one: of the shipped vehicle that the thesis validated."""
    return VALIDATED if vehicle == VEHICLE else None


def _file_values(vehicle: str, variant: str | None) -> dict[str, float]:
    """All numbers of a car's vehicle file, which are those that the plant declares; the meter's also where it has none.

    Raises:
        InputError: No such vehicle or variant, it is a bench, or the plant refuses the file.
    """
    read = vehicles.load(vehicle, variant)
    highest_gear(read.values)  # first: of a bench the numbers of a car are missing too
    meter = parameter_variables(read.parameters(FullOrderParameters).torque_meter, "torque_meter.")
    return {**{number.name: number.start for number in meter}, **read.values}


def _check_simulated(name: str, values: Mapping[str, float], nominal: Mapping[str, float], gears: Collection[int],
                     structure: str) -> None:
    """Refuse an effect on the plant that the hidden one does not have: nothing would be hidden.

    Raises:
        InputError: So it is.
    """
    changed = [key for key in _changed(nominal, values) if not key.startswith(("observe.", "input."))]
    other = structure == "other"
    if changed and all(packed(values, gear, 0.0, other) == packed(nominal, gear, 0.0, other) for gear in gears):
        raise InputError(f"{name}: the hidden plant knows nothing of {', '.join(changed)}, so that nothing would be "
                         "hidden: it has to be simulated in cosim/diagnosis/hidden/model.py first")


def _changed(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """What is not as it was; an error that was not mentioned was none."""
    was = {name: before.get(name, 1.0 if name.endswith(("gain", "_ratio")) else 0.0) for name in after}
    return {name: (was[name], value) for name, value in after.items() if value != was[name]}


def _require(name: str) -> None:
    """Say what else there is where a name is none of the catalogue."""
    if name not in CATALOGUE:
        known = [*CATALOGUE, COCKTAIL, *(PREFIX + outside for outside in OUTSIDE)]
        raise InputError(f"there is no effect '{name}'{did_you_mean(name, known)}")


# -- sizes ----------------------------------------------------------------------------------------

def sizes_of(effect: Effect, text: str, nominal: Mapping[str, float],
             random: np.random.Generator) -> dict[str, float]:
    """The sizes a user wrote, or drawn ones.

    A bare number is the size as the catalogue counts it: a factor, or what is added in SI. ``+15 %`` is a
    factor of 1.15; a number with a unit is the value the parameter shall have, ``+334 kg`` what it shall have
    more, ``-100 kg`` less, and for what has no value of its own (``30 ms`` of delay) simply the size. One number
    for an effect of several parameters is for all of its first kind (factors or sums); of the others, and of those
    that are not named, those that mean nothing alone get a usual one.

    Raises:
        InputError: Not a size, or not a plausible one.
    """
    if not text:
        sizes = drawn(effect, random)
        return {p.name: p.within(sizes[p.name], nominal) for p in effect.parameters if p.name in sizes}
    if ":" in text:
        parts = [part.partition(":") for part in text.split(",")]
        named = {name.strip(): size for name, _, size in parts}
        if len(named) < len(parts):
            raise InputError(f"{effect.name}={text}: one size for each of its numbers")
        effect.complete(dict.fromkeys(named, 0.0))
        sizes = {p.name: _size(p, named[p.name], nominal) if p.name in named else (p.probes or (p.neutral,))[0]
                 for p in effect.parameters if p.name in named or effect.joint}
    else:
        kind = effect.parameters[0].scale
        sizes = {p.name: _size(p, text, nominal) if p.scale == kind else (p.probes or (p.neutral,))[0]
                 for p in effect.parameters}
    for parameter in effect.parameters:
        if parameter.name in sizes:
            parameter.check(sizes[parameter.name], nominal)
    return sizes


def _size(parameter: EffectParameter, text: str, nominal: Mapping[str, float]) -> float:
    match = _SIZE.match(text)
    if match is None:
        raise InputError(f"{parameter.name}={text}: a number is needed, such as "
                         f"{parameter.size(2.0 * parameter.detection):.3g}, if need be with a unit")
    plus, number, unit = match[1] or match[2].startswith("+"), float(match[2]), match[3]
    if not unit:
        return number
    if unit == "%" and parameter.scale == "log":
        return 1.0 + number / 100.0 if plus or number < 0.0 else number / 100.0
    value = units.in_unit(f"{number} {unit}", parameter.unit, parameter.name)
    if parameter.scale == "linear":
        return value
    now, _, _ = parameter.physical(1.0, nominal)
    if len(parameter.targets) > 1:
        raise InputError(f"{parameter.name}={text}: it changes {', '.join(parameter.targets)} together, so a "
                         "factor is needed")
    return (now + value) / now if plus or value < 0.0 else value / now


def drawn(effect: Effect, random: np.random.Generator) -> dict[str, float]:
    """Sizes from the detection limit up to five times that, within what is plausible."""
    if effect.joint:
        chosen = list(effect.parameters)
    else:
        chosen = [effect.parameters[random.integers(len(effect.parameters))]]
    sizes = {}
    for parameter in chosen:
        ends = [parameter.coordinate(limit) for limit in parameter.limits]
        sides = [end for end in ends if 0.7 * abs(end) >= parameter.detection]
        end = sides[random.integers(len(sides))]
        strength = parameter.detection * np.exp(random.uniform(0.0, np.log(LARGEST_STRENGTH)))
        sizes[parameter.name] = float(parameter.size(np.sign(end) * min(strength, 0.7 * abs(end))))
    return sizes


def _outside_size(name: str, text: str, random: np.random.Generator) -> float:
    if name not in OUTSIDE:
        raise InputError(f"there is no effect '{PREFIX}{name}'{did_you_mean(name, OUTSIDE)}")
    about = OUTSIDE[name]
    if not text:
        return float(random.uniform(*about.sizes))
    size = units.in_unit(text, about.unit, PREFIX + name)
    if not 0.0 <= size <= about.limit:
        raise InputError(f"{PREFIX}{name}={text}: from 0 to {about.limit:g}{behind(about.unit)} is possible")
    return size


def cocktail(vehicle: str, values: dict[str, float]) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """All of thesis table 2.3 at once: the vehicle's variant ``modified`` as the truth on its baseline.

    Returns:
        The true values, and the sizes of the catalogue's effects in them. The inertias of converter and
        transmission, which the table changes with the engine's, stand in the values alone.
    """
    true = _file_values(vehicle, "modified")
    changed = {name: value for name, value in true.items() if not name.startswith("torque_meter.")}
    filtered = 1.0 / true["torque_meter.stopband_frequency"]
    rigid = -1.0 / values["suspension.stiffness"] if values["suspension.enabled"] else 0.0

    def factor(name: str) -> float:
        return true[name] / values[name]

    sizes = {
        "vehicle_mass": {"vehicle_mass": factor("vehicle.mass")},
        "rolling_resistance": {"rolling_resistance": factor("tyre.rolling_resistance")},
        "engine_inertia": {"engine_inertia": factor("engine.inertia")},
        "shaft_stiffness": {"propeller_shaft_stiffness": factor("propeller_shaft.stiffness"),
                            "axle_shaft_stiffness": factor("axle_shaft.stiffness")},
        "suspension_mode": {"suspension_compliance": rigid},
        "torque_meter_filter": {"torque_meter_filter_period": filtered},
    }
    return {**values, **changed, "observe.propeller_shaft_torque.filter_period": filtered}, sizes


# -- nuisances ------------------------------------------------------------------------------------

def _targets() -> set[str]:
    return {target.removesuffix("[*]") for e in CATALOGUE.values() for p in e.parameters for target in p.targets}


def _drift(values: Mapping[str, float], changed: Mapping[str, Any], drift: str,
           random: np.random.Generator) -> dict[str, float]:
    """Relative drift of every parameter that may; the same draw for a table's entries."""
    targets, shares, found = _targets(), {}, {}
    for name in sorted(values.keys() - _COUNTED):
        table = name.partition("[")[0]
        if table not in shares:  # drawn for all, so that what is hidden leaves the drift of the others alone
            shares[table] = float(random.uniform(*DRIFT) * random.choice([-1.0, 1.0]))
        named = table in targets
        if drift == "none" or name in changed or _FIXED.search(name) or values[name] == 0.0:
            continue
        if named and (drift != "all" or table in _LOOKED_UP):
            continue
        found[name] = shares[table]
    return found


def highest_gear(values: Mapping[str, float]) -> int:
    """The highest gear of a vehicle.

    Raises:
        InputError: It has none.
    """
    gears = [gear for gear in range(1, 11) if values.get(f"transmission.ratio[{gear + 2}]")]
    if not gears:
        raise InputError("that vehicle has no gears: effects are hidden in a car's driveline, not in a bench")
    return max(gears)


def _drives(manoeuvres: Sequence[str] | None, nominal: Mapping[str, float],
            random: np.random.Generator) -> list[Drive]:
    top = highest_gear(nominal)
    return [replace(driven(kind, gear, random), back=back) for kind, gear, back in asked(manoeuvres or usual(top), top)]


def _recording(drive: Drive, values: Mapping[str, float], random: np.random.Generator) -> dict[str, Any]:
    """What one recording has of its own."""
    phases = {name: float(random.uniform(0.0, 2.0 * np.pi)) for name in sorted(
        {name for e in CATALOGUE.values() for name in e.nuisances})}
    return {"grade": float(random.normal(0.0, GRADE)), "torque_bias": float(random.normal(0.0, TORQUE)),
            "values": phases}


def _recorded(drive: Drive, values: dict[str, float], own: dict[str, Any], structure: str,
              random: np.random.Generator) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Simulate one recording, and what the loggers write of it."""
    ratio = values[f"transmission.ratio[{drive.gear + 2}]"] * values["final_drive.ratio"]
    # the true torque wanders about the estimate
    steps = np.arange(-PRE_ROLL - 1.0, drive.duration + 1.0, 0.02)
    wander = np.zeros(steps.size)
    kick = random.normal(0.0, WANDER * np.sqrt(1.0 - np.exp(-0.4)), steps.size)
    for i in range(1, steps.size):
        wander[i] = np.exp(-0.2) * wander[i - 1] + kick[i]
    times = np.union1d(steps, drive.times)
    torque = (np.interp(times, drive.times, drive.torque) + np.interp(times, steps, wander) + own["torque_bias"])
    speed = drive.engine_speed / ratio * values["tyre.radius"]
    recorded = simulate(values, drive.gear, speed, times, torque, drive.duration, own["grade"],
                        structure == "other")
    return logged(drive, recorded, values, random)
