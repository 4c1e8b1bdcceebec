"""What the driver does, how the loggers write it down, and the files a measurement consists of."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import cheb2ord, cheby2, sosfilt

from cosim import units
from cosim.diagnosis.hidden.model import PRE_ROLL, Recorded
from cosim.files import write_text
from cosim.measured import CANONICAL
from cosim.messages import did_you_mean
from driveline import vehicles
from driveline.quantities import InputError


@dataclass(frozen=True)
class Drive:
    """One recording as the driver makes it.

    Attributes:
        kind: Of the manoeuvre.
        gear: Engaged throughout.
        engine_speed: At the start [rad/s], roughly.
        times, torque: Requested torque [N.m], linear between the instants [s].
        duration: [s].
        back: Whether the road is driven the other way than in the other recordings.
    """

    kind: str
    gear: int
    engine_speed: float
    times: np.ndarray
    torque: np.ndarray
    duration: float = 7.0
    back: bool = False


BACK = "back"
# kinds and gears of a measurement when nothing else is asked for; the first two repeat each other
USUAL = (("tip_in", 5), ("tip_in", 5), ("tip_out", 5), ("pulse_train", 4), ("ramp", 6), ("coast_down", 7))
KINDS = ("tip_in", "tip_out", "ramp", "step", "pulse_train", "coast_down", "cruise", "sweep")


def usual(top: int) -> list[str]:
    """The entries of a measurement when nothing else is asked for, in a vehicle whose highest gear is ``top``."""
    return [f"{kind}:{min(gear, top)}" for kind, gear in USUAL]


def asked(entries: Iterable[str], top: int) -> list[tuple[str, int, bool]]:
    """Manoeuvres, gears and ways of entries like ``tip_in:4``, ``tip_in`` for the fifth gear, ``tip_in:4:back``.

    Args:
        entries: What was asked for.
        top: The highest gear there is.

    Raises:
        InputError: No such manoeuvre or gear.
    """
    found = []
    for entry in entries:
        kind, gear, way = (*entry.split(":", 2), "", "")[:3]
        if kind not in KINDS:
            raise InputError(f"manoeuvre {entry}{did_you_mean(kind, KINDS, 20)}")
        if (gear and not gear.isdigit()) or way not in ("", BACK):
            raise InputError(f"manoeuvre {entry}: KIND:GEAR is needed, such as tip_in:5, or tip_in:5:{BACK} for the "
                             "same road driven the other way")
        if not 1 <= int(gear or 5) <= top:
            raise InputError(f"manoeuvre {entry}: the vehicle has gears 1 to {top}")
        found.append((kind, int(gear or 5), way == BACK))
    return found


def driven(kind: str, gear: int, random: np.random.Generator) -> Drive:
    """A driver's torque for a kind of manoeuvre; never twice the same."""
    low, high = random.uniform(-25.0, -10.0), random.uniform(160.0, 230.0)
    begin, quick = random.uniform(0.9, 1.3), random.uniform(0.05, 0.12)
    speed, duration = random.uniform(130.0, 165.0), 7.0
    if kind == "tip_in":
        corners = [(begin, low), (begin + quick, high)]
    elif kind == "tip_out":
        corners = [(begin, high), (begin + quick, low)]
    elif kind == "ramp":
        corners = [(begin, low), (begin + random.uniform(2.0, 3.0), high)]
    elif kind == "step":
        corners = []
        for i, level in enumerate(random.permutation([low, 0.4 * high, 0.7 * high, high])):
            corners += [(begin - 0.05 + 1.6 * i, level), (begin + 1.5 + 1.6 * i, level)]
    elif kind == "pulse_train":
        corners, at = [], begin
        while at < duration - 1.0:
            width = random.uniform(0.4, 0.8)
            corners += [(at, low), (at + quick, high), (at + width, high), (at + width + quick, low)]
            at += width + random.uniform(0.5, 0.9)
    elif kind == "coast_down":
        duration, speed = 12.0, random.uniform(170.0, 230.0)
        corners = [(begin, random.uniform(30.0, 60.0)), (begin + 0.3, -80.0)]
    elif kind == "cruise":
        level = random.uniform(30.0, 60.0)
        corners = [(t, level + random.uniform(-12.0, 12.0)) for t in np.arange(-2.0, duration, 0.5)]
    else:  # sweep: gently to and fro through the lash, faster and faster
        times, swing = np.arange(-PRE_ROLL, duration, 0.01), random.uniform(35.0, 50.0)
        slow, fast = random.uniform(0.35, 0.5), random.uniform(0.9, 1.3)
        angle = 2.0 * np.pi * np.where(times > 0.0, (slow + 0.5 * (fast - slow) * times / duration) * times, 0.0)
        return Drive(kind, gear, speed, times, 0.5 * swing - swing * np.cos(angle), duration)
    times, torque = map(np.array, zip(*corners))
    return Drive(kind, gear, speed, times, torque, duration)


@dataclass(frozen=True)
class Logger:
    """How one channel is written: column, unit, period and jitter of its clock [s], noise and resolution in
    ``unit``, and the share of frames that are lost."""

    column: str
    unit: str
    period: float
    jitter: float
    noise: float
    resolution: float
    lost: float = 0.01


LOGGERS = {
    "engine_torque": Logger("EngTrq", "N.m", 0.010, 3e-4, 0.0, 0.25),
    "engine_speed": Logger("EngSpd", "rpm", 0.010, 5e-4, 0.6, 0.25),
    "turbine_speed": Logger("TurbSpd", "rpm", 0.010, 5e-4, 0.6, 0.25),
    "transmission_output_speed": Logger("OutSpd", "rpm", 0.010, 5e-4, 0.6, 0.25),
    "wheel_speed": Logger("WhlSpdRr", "rpm", 0.020, 1e-3, 0.12, 0.05, 0.02),
    "vehicle_speed": Logger("VehSpd", "km/h", 0.050, 2e-3, 0.02, 0.01, 0.02),
    "propeller_shaft_torque": Logger("PropTrq", "N.m", 0.004, 0.0, 1.5, 0.1, 0.0),
    "seat_acceleration": Logger("SeatAcc", "m/s2", 0.004, 0.0, 0.03, 0.001, 0.0),
    "differential_acceleration": Logger("DiffAcc", "m/s2", 0.004, 0.0, 0.5, 0.01, 0.0),
}
_ANGLES = {"engine_speed": "crank_angle", "turbine_speed": "crank_angle", "wheel_speed": "wheel_angle",
           "transmission_output_speed": "output_angle"}


def logged(drive: Drive, recorded: Recorded, values: Mapping[str, float],
           random: np.random.Generator) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Stamps [s] and values in the logger's unit of every channel."""
    channels = {}
    for name, logger in LOGGERS.items():
        if name == "engine_torque":
            true = np.interp(recorded.time, drive.times, drive.torque)
        else:
            true = _sensed(name, recorded, values)
        stamps = np.arange(random.uniform(0.0, logger.period), drive.duration, logger.period)
        stamps = np.clip(stamps + random.normal(0.0, logger.jitter, stamps.size), 0.0, drive.duration)
        stamps = np.unique(np.round(stamps, 4))
        kept = random.uniform(size=stamps.size) >= logger.lost
        if logger.lost:  # and once the bus is busy for a while
            busy = random.uniform(0.0, drive.duration)
            kept &= ~((stamps > busy) & (stamps < busy + random.uniform(0.03, 0.1)))
        stamps = stamps[kept]
        error = {e: values.get(f"observe.{name}.{e}", 0.0) for e in ("clock_drift", "clock_offset", "delay")}
        late = error["delay"] + values.get(f"{name}_sensor.delay", 0.0)
        true_time = (stamps - error["clock_offset"]) / (1.0 + error["clock_drift"]) - late
        factor, offset = units.conversion(CANONICAL[name].unit, logger.unit)
        shown = factor * np.interp(true_time, recorded.time, true) + offset
        shown = shown + random.normal(0.0, logger.noise, shown.size)
        channels[name] = stamps, np.round(shown / logger.resolution) * logger.resolution
    return channels


def _sensed(name: str, recorded: Recorded, values: Mapping[str, float]) -> np.ndarray:
    """What the sensor makes of the true signal before it is sampled."""
    true = recorded.signals[name]
    swing = values.get(f"observe.{name}.eccentricity", 0.0)
    if swing:
        phase = values.get(f"observe.{name}.eccentricity_phase", 0.0)
        true = true * (1.0 + swing * np.cos(recorded.signals[_ANGLES[name]] + phase))
    gain, offset = values.get(f"observe.{name}.gain", 1.0), values.get(f"observe.{name}.offset", 0.0)
    period = values.get(f"observe.{name}.filter_period", 0.0)
    if name == "propeller_shaft_torque":
        gain, offset = gain * values["torque_meter.gain"], offset + values["torque_meter.offset"]
        if values["torque_meter.enabled"]:
            period += 1.0 / values["torque_meter.stopband_frequency"]
    true = gain * true + offset
    if period > 1e-3:
        # designed by SciPy for the meter's 1 kHz, with the pass band in proportion
        meter = {key: values[f"torque_meter.{key}"] for key in (
            "passband_frequency", "stopband_frequency", "passband_ripple", "stopband_attenuation")}
        edge = min(1.0 / period, 450.0)
        order, _ = cheb2ord(edge * meter["passband_frequency"] / meter["stopband_frequency"], edge,
                            meter["passband_ripple"], meter["stopband_attenuation"], fs=1000.0)
        clock = np.arange(recorded.time[0], recorded.time[-1], 1e-3)
        sections = cheby2(order, meter["stopband_attenuation"], edge, output="sos", fs=1000.0)
        smooth = sosfilt(sections, np.interp(clock, recorded.time, true) - true[0]) + true[0]
        true = np.interp(recorded.time, clock, smooth)
    return true


def write(folder: Path, vehicle: str, variant: str | None, drives: list[Drive],
          channels: list[dict[str, tuple[np.ndarray, np.ndarray]]]) -> None:
    """The folder of a measurement; nothing in it tells what is hidden."""
    if vehicle not in vehicles.names():  # a file of the user's goes with the measurement
        write_text(folder / Path(vehicle).name, Path(vehicle).read_text(encoding="utf-8"))
        vehicle = Path(vehicle).name
    toml = ["# Generated, not measured.", f'vehicle = "{vehicle}"']
    toml += [f'variant = "{variant}"'] if variant else []
    for number, (drive, columns) in enumerate(zip(drives, channels), start=1):
        file = f"{number:02d}_{drive.kind}_{drive.gear}{'_back' * drive.back}.csv"
        write_text(folder / file, _csv(columns))
        toml += ["", "[[manoeuvre]]", f'file = "{file}"', f'kind = "{drive.kind}"', f"gear = {drive.gear}"]
        toml += ["back = true"] if drive.back else []
    toml += ["", "[channels.time]", 'column = "Time"', 'unit = "s"']
    for name, logger in LOGGERS.items():
        toml += ["", f"[channels.{name}]", f'column = "{logger.column}"', f'unit = "{logger.unit}"']
    write_text(folder / "measurement.toml", "\n".join(toml) + "\n")


def _csv(channels: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """One file with a column a channel, blank where a channel has no sample."""
    ticks = {name: np.round(stamps * 1e4).astype(int) for name, (stamps, _) in channels.items()}
    rows = np.unique(np.concatenate(list(ticks.values())))
    cells = np.full((rows.size, len(channels)), "", dtype="<U16")
    for column, (name, (_, values)) in enumerate(channels.items()):
        cells[np.searchsorted(rows, ticks[name]), column] = [f"{value:.8g}" for value in values]
    lines = [",".join(["Time", *(LOGGERS[name].column for name in channels)])]
    lines += [f"{row / 1e4:.4f}," + ",".join(line) for row, line in zip(rows.tolist(), cells)]
    return "\n".join(lines) + "\n"
