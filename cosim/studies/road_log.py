"""Estimators on a recorded drive, through the master: what they can and cannot tell there."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cosim.master import Master
from cosim.master.scenario import SHIPPED
from cosim.measured import Manoeuvre, load
from cosim.report.study_figures import Curve, Panel
from cosim.result import Result
from cosim.signals import Table
from cosim.studies.estimation import is_built
from cosim.studies.estimator_findings import RPM, color, draw
from cosim.studies.findings import Findings
from cosim.toml import TomlFile
from driveline import vehicles
from driveline.estimators import ESTIMATORS
from driveline.quantities import InputError
from driveline.vehicles import Vehicle

log = logging.getLogger("cosim")

VEHICLE = "suv_6l80"
PERIOD = 0.03  # [s], about the log's own rate
SHARE = 0.05  # gears used less than this are left out
SETTLED = 0.5  # [s]: for so long a gear is engaged before what an estimator says is of it
LOCKED = 2.0  # [rad/s]: a converter that slips less is taken as locked


@dataclass(frozen=True)
class RoadLog:
    """A recorded drive.

    Attributes:
        signals: The estimators' inputs by name; time from 0.
        vehicle: Driven.
        length: Of the recording [s].
    """

    signals: dict[str, Table]
    vehicle: Vehicle
    length: float

    @classmethod
    def read(cls, measurement: Path | None) -> RoadLog | None:
        """From a folder with measurement.toml, that file, or a data file; None where there is none.

        Raises:
            InputError: It cannot be understood, a signal that is needed is not in it, it is too short to look at, or in
                a gear that its vehicle does not have.
        """
        if measurement is None:
            return None
        manoeuvre, vehicle = _load(measurement)
        drive = cls(_signals(manoeuvre, vehicle), vehicle, manoeuvre.stop - manoeuvre.start)
        if drive.length < SETTLED:
            raise InputError(f"{measurement}: the drive is {drive.length:g} s long: at least {SETTLED:g} s are needed")
        for gear in _gears(drive.signals["gear"], drive.length):
            for estimator in ESTIMATORS.values():
                estimator.defaults_from(vehicle, gear)
        return drive


def road_log(findings: Findings, out: Path, drive: RoadLog | None, seconds: float | None = None) -> None:
    """Rows and a picture; a row that says so where there is no recording.

    Args:
        seconds: How much of it; None for all.
    """
    if drive is None:
        findings.add("road log", "1", None, None, "not run: give a recording with --measurement")
        return
    signals, vehicle = drive.signals, drive.vehicle
    stop = PERIOD * np.floor(min(drive.length, seconds or np.inf) / PERIOD)
    gears = _gears(signals["gear"], float(stop))
    if not gears:
        findings.add("road log", "1", None, None, f"no forward gear is engaged for {100.0 * SHARE:g} % of the time")
        return
    result = _run(signals, gears, vehicle, round(float(stop), 6))
    _rows(findings, result, gears, vehicle)
    findings.figures.append(_figure(out, result, gears))


def _load(path: Path) -> tuple[Manoeuvre, Vehicle]:
    """The recording and its vehicle; columns of a bare data file are those of the shipped scenario ``road_log``.

    Its logger has no engine speed but the converter's slip; this is read in place of the engine speed
    and the turbine's is added.
    """
    if Path(path).is_dir() or Path(path).suffix == ".toml":
        measurement = load(path)
        return measurement.manoeuvres[0], vehicles.load(measurement.vehicle or VEHICLE, measurement.variant)
    channels = dict(TomlFile.read(SHIPPED / "road_log.toml").table["measurement"]["channels"])
    channels["engine_speed"] = {"column": "converter_slip_rpm", "unit": "rpm"}
    found = load(path, {"manoeuvre": [{"kind": "drive"}], "channels": channels}).manoeuvres[0]
    slip, turbine = found["engine_speed"], found["turbine_speed"]
    engine = replace(slip, time=turbine.time, values=turbine.values + slip.at(turbine.time),
                     source=f"{turbine.source} and {slip.source}")
    return replace(found, channels={**found.channels, "engine_speed": engine}), vehicles.load(VEHICLE)


def _signals(manoeuvre: Manoeuvre, vehicle: Vehicle) -> dict[str, Table]:
    """The estimators' inputs as they arrive, held between frames; time from 0."""
    if "wheel_speed" in manoeuvre:
        wheel = manoeuvre["wheel_speed"]
    else:
        speed = manoeuvre["vehicle_speed"]
        wheel = replace(speed, values=speed.values / vehicle.values["tyre.radius"])
    channels = {"engine_torque": manoeuvre["engine_torque"], "engine_speed": manoeuvre["engine_speed"],
                "wheel_speed": wheel, "gear": manoeuvre["gear"]}
    if "turbine_speed" in manoeuvre:
        channels["turbine_speed"] = manoeuvre["turbine_speed"]
    return {name: Table(times=channel.time - manoeuvre.start, data=channel.values, interpolation="hold")
            for name, channel in channels.items()}


def _gears(signal: Table, stop: float) -> list[int]:
    """The forward gears that are engaged for more than a small share of the time."""
    values = signal.values(np.arange(0.0, stop, PERIOD))
    return [gear for gear in range(1, 11) if (values == gear).mean() >= SHARE]


def _run(signals: dict[str, Table], gears: list[int], vehicle: Vehicle, stop: float) -> Result:
    """Every estimator, once for each gear, over the whole recording: its gear is a parameter."""
    master = Master(step=PERIOD)
    for name, signal in signals.items():
        master.signal(name, replace(signal, unit="1" if name == "gear" else
                                    "N.m" if name == "engine_torque" else "rad/s"))
    for estimator in ESTIMATORS:
        built = is_built(estimator)
        if not built:
            log.warning("%s is not built: its twin runs in process", estimator)
        for gear in gears:
            name = f"{estimator}_{gear}"
            values = ESTIMATORS[estimator].defaults_from(vehicle, gear)
            master.add(name, estimator, parameters=values | {"sampling.period": PERIOD}, twin=not built)
            for target in ("engine_torque", "engine_speed", "wheel_speed"):
                master.connect(target, f"{name}.{target}")
    return master.run(stop)


def _engaged(result: Result, gear: int) -> np.ndarray:
    """Whether a gear is engaged and was for a while; what an estimator says before is of another gear."""
    engaged = result["gear"] == gear
    frames = round(SETTLED / PERIOD)
    return np.array([i >= frames and engaged[i - frames:i + 1].all() for i in range(engaged.size)])


def _rows(findings: Findings, result: Result, gears: list[int], vehicle: Vehicle) -> None:
    slip = result["engine_speed"] - result["turbine_speed"] if "turbine_speed" in result else None
    torque = result["engine_torque"]
    finite = all(np.isfinite(result[name]).all() for name in result.names)
    findings.add("road log: every output of every estimator is finite (0 no, 1 yes)", "1", None, float(finite),
                 f"{vehicle.name}, {result.time[-1]:.0f} s through the master, a frame every {1e3 * PERIOD:g} ms; "
                 "in process: " + (", ".join(name for name in ESTIMATORS if not is_built(name)) or "none"))
    for gear in gears:
        there = _engaged(result, gear)
        if not there.any():
            findings.add(f"road log: time in gear {gear}", "s", None, 0.0, f"never for {SETTLED:g} s on end")
            continue
        reversals = np.sum((torque[:-1] < 0.0) & (torque[1:] >= 0.0) & there[1:])
        locked = "whether the converter is locked is not known without a turbine speed"
        if slip is not None:
            share = 100.0 * np.mean(np.abs(slip[there]) < LOCKED)
            locked = f"converter locked (slip below {LOCKED:g} rad/s) {share:.0f} % of it"
        findings.add(f"road log: time in gear {gear}", "s", None, PERIOD * there.sum(),
                     f"{locked}, torque turns positive {reversals} times")
        for estimator in ESTIMATORS:
            _estimator_rows(findings, result, f"{estimator}_{gear}", estimator, gear, there, vehicle)
    findings.add("road log: frames in a lash traversal of 0.13 s", "1", None, 0.13 / PERIOD,
                 "the log has about 33 frames a second, its torque is an estimate, its wheel speed the vehicle's; "
                 "an open or slipping converter lets the engine turn freely, and the estimators take that for "
                 "a lash. There is no truth to compare with")


def _estimator_rows(findings: Findings, result: Result, name: str, estimator: str, gear: int, there: np.ndarray,
                    vehicle: Vehicle) -> None:
    def said(output: str) -> np.ndarray:
        return result[f"{name}.{output}"]

    which = f"gear {gear}, {estimator}"
    outputs = {v.name for v in ESTIMATORS[estimator].output_variables}
    if "trusted" in outputs:
        findings.add(f"road log: share of frames in which it trusts itself, {which}", "%", None,
                     100.0 * said("trusted")[there].mean())
    if "traversal_end" in outputs:
        ends = said("traversal_end")
        # one that is revised for a while counts when it is settled
        told = np.diff(said("traversal_settled")) > 0.0 if "traversal_settled" in outputs else np.diff(ends) != 0.0
        new = np.flatnonzero(told & there[1:]) + 1
        times = ends[new] - said("traversal_start")[new]
        findings.add(f"road log: traversals reported, {which}", "1", None, new.size,
                     f"median duration {1e3 * np.median(times):.0f} ms" if new.size else "")
    if "lash_size" in outputs:
        sizes = said("lash_size")
        new = np.flatnonzero((np.diff(sizes) != 0.0) & there[1:]) + 1
        believed = 2.0 * ESTIMATORS[estimator].defaults_from(vehicle, gear)["shaft.half_gap"]
        if new.size:
            low, middle, high = np.degrees(np.percentile(sizes[new], (10, 50, 90)))
            findings.add(f"road log: lash size, median, {which}", "deg", None, middle,
                         f"{new.size} new values, 80 % of them from {low:.1f} to {high:.1f} deg; the vehicle "
                         f"file estimates {np.degrees(believed):.1f} deg")
        else:
            findings.add(f"road log: lash size, median, {which}", "deg", None, None, "never estimated there")


def _figure(out: Path, result: Result, gears: list[int]) -> str:
    """The whole drive: torque and gear, speeds, position and size as said for the engaged gear."""
    gear = result["gear"]
    positions = [name for name in ESTIMATORS if f"{name}_{gears[0]}.lash_position" in result]
    sizes = [name for name in ESTIMATORS if f"{name}_{gears[0]}.lash_size" in result]

    def engaged(estimator: str, output: str) -> np.ndarray:
        picked = np.full(gear.size, np.nan)
        for g in gears:
            picked = np.where(gear == g, result[f"{estimator}_{g}.{output}"], picked)
        return picked

    t = result.time
    torque = [Curve(t, result["engine_torque"], "torque", "measured", width=0.7),
              Curve(t, gear, "gear", "second", width=0.7, right=True)]
    speeds = [Curve(t, RPM * result["engine_speed"], "engine", "measured", width=0.7)]
    if "turbine_speed" in result:
        speeds.append(Curve(t, RPM * result["turbine_speed"], "turbine", "first", width=0.7))
    panels = [Panel("(a) torque and gear", torque, "torque [N.m]", right_label="gear"),
              Panel("(b) speeds", speeds, "speed [rpm]")]
    panels.append(Panel(f"(c) lash position, of the engaged gear ({', '.join(positions)})", [
        Curve(t, np.degrees(engaged(name, "lash_position")), name, color(i), width=0.6)
        for i, name in enumerate(positions)], "position [deg]"))
    panels.append(Panel(f"(d) lash size, of the engaged gear ({', '.join(sizes)})", [
        Curve(t, np.degrees(engaged(name, "lash_size")), name, color(i), width=0.8)
        for i, name in enumerate(sizes)], "size [deg]"))
    return draw(out / "road_log.png", "Estimators on the road log", panels, columns=1)
