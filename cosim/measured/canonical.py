"""The signals a measurement may hold: name, SI unit, meaning; said once."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CanonicalSignal:
    """One signal every reader, scenario and study calls by the same name.

    Attributes:
        name: Canonical name.
        unit: SI unit, in which all values are held.
        meaning: One line.
        discrete: Whether it jumps, so that between two samples the last one holds.
    """

    name: str
    unit: str
    meaning: str
    discrete: bool = False


CANONICAL: dict[str, CanonicalSignal] = {signal.name: signal for signal in (
    CanonicalSignal("time", "s", "time since the start of the recording"),
    CanonicalSignal("engine_torque", "N.m", "torque the engine is asked for, or estimated to give"),
    CanonicalSignal("gear", "1", "engaged gear; 0 is neutral, -1 reverse", discrete=True),
    CanonicalSignal("road_grade", "rad", "slope of the road, uphill positive"),
    CanonicalSignal("brake_torque", "N.m", "brake torque of the whole car; plants brake their driven wheels with it"),
    CanonicalSignal("engine_speed", "rad/s", "crankshaft speed"),
    CanonicalSignal("turbine_speed", "rad/s", "speed of the converter's turbine, the transmission's input"),
    CanonicalSignal("transmission_output_speed", "rad/s", "speed of the transmission's output shaft"),
    CanonicalSignal("wheel_speed", "rad/s", "mean speed of the driven wheels"),
    CanonicalSignal("vehicle_speed", "m/s", "speed of the vehicle over ground"),
    CanonicalSignal("propeller_shaft_torque", "N.m", "torque in the propeller shaft"),
    CanonicalSignal("seat_acceleration", "m/s2", "longitudinal acceleration at the seat track"),
    CanonicalSignal("differential_acceleration", "m/s2", "vertical acceleration of the differential's nose"),
    CanonicalSignal("motor_torque", "N.m", "torque of a bench's motor"),
    CanonicalSignal("motor_speed", "rad/s", "speed of a bench's motor"),
    CanonicalSignal("motor_position", "rad", "angle of a bench's motor"),
    CanonicalSignal("inline_torque", "N.m", "torque at a bench's inline sensor"),
    CanonicalSignal("force", "N", "force on a bench's carriage"),
    CanonicalSignal("position", "m", "position of a bench's carriage"),
)}
