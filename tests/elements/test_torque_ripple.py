"""Ripple: at its order, of its amplitude, booked as work, and silent while an equilibrium is sought."""

import numpy as np
import pytest
from runs import Bench, ledger, plant, run

from driveline.elements.torque_ripple import TorqueRipple

J, SPEED = 0.4, 150.0


def free_crankshaft(amplitude, order, phase):
    def build(net):
        a = net.node("a", J, "rad/s", "crankshaft")
        net.ripple("ripple", a, TorqueRipple(amplitude, order, phase), net.integral(a, "angle", "rad", "angle"))

    return Bench(build, {"a": SPEED}, substep=5e-5)


def test_a_free_crankshaft_gains_what_the_ripple_does():
    """J w^2 / 2 + (A / n) cos(n angle + phase) is a constant of its motion."""
    amplitude, order, phase = 60.0, 3.0, 0.7
    record = run(free_crankshaft(amplitude, order, phase), 0.5, dt=5e-4)
    speed = record["a_speed"]
    angle = np.interp(record["time"], *angle_of(record))
    constant = 0.5 * J * speed**2 + amplitude / order * np.cos(order * angle + phase)
    assert np.ptp(speed) == pytest.approx(2.0 * amplitude / (J * order * SPEED), rel=0.05)
    assert np.ptp(constant) < 1e-3 * amplitude
    assert np.ptp(ledger(record)) < 1e-6


def angle_of(record):
    """The angle by the trapezoid of the speed, on a hundred times its ends' correction."""
    time = np.concatenate([[0.0], record["time"]])
    speed = np.concatenate([[SPEED], record["a_speed"]])
    from scipy.interpolate import CubicSpline

    return time, CubicSpline(time, speed).antiderivative()(time)


def test_the_plant_starts_in_its_mean_equilibrium_and_ripples_at_the_order():
    values = {"start.vehicle_speed": 12.0, "torque_ripple.amplitude": 40.0, "torque_ripple.phase": 1.0}
    quiet = plant("plant_fom", {"start.vehicle_speed": 12.0}, engine_torque=80.0)
    model = plant("plant_fom", values, engine_torque=80.0)
    assert (model.state[: len(model.network.nodes)] == quiet.state[: len(quiet.network.nodes)]).all()
    record = run(model, 2.0)
    speed = record["engine_speed"] - np.polyval(np.polyfit(record["time"], record["engine_speed"], 3), record["time"])
    order = record["engine_speed"].mean() * 3.0 / (2.0 * np.pi)
    spectrum = np.abs(np.fft.rfft(speed * np.hanning(speed.size)))
    assert np.fft.rfftfreq(speed.size, 1e-3)[spectrum.argmax()] == pytest.approx(order, abs=1.5)
    assert np.ptp(ledger(record)) < 1e-6 * record["energy_stored"].max()
