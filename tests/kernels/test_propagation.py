"""Whole steps at once: exact where a plant is linear, and left to Runge-Kutta where they would not do."""

import numpy as np
import pytest
from runs import PLANTS, Bench, input_rows, plant, run, steps

from driveline.kernels import layout as k
from driveline.kernels import propagation
from driveline.kernels.propagation import PATIENCE

TIP_IN = {"engine_torque": steps((0.0, -30.0), (0.2, 150.0), (1.2, -40.0))}
NO_DELAY = {"start.vehicle_speed": 12.0, "engine.air_delay": 0.0}


def derivatives_taken(model):
    """How often the last ``simulate`` took derivatives for whole steps."""
    return model.network.work[k.work_places(model.network.plan)[-1] + k.KEPT]


def rolling(name, substep=2e-4, torque=-30.0, **more):
    changes = {"start.vehicle_speed": 12.0, "solver.maximum_substep": substep}
    if name == "plant_fom":
        changes["engine.air_delay"] = 0.0
    return plant(name, {**changes, **more}, engine_torque=torque)


def off(record, reference):
    """The largest error of the signals that matter, of their ranges: at the edge of an impact, microseconds early."""
    return max(np.abs(record[name] - reference[name]).max() / np.ptp(reference[name])
               for name in ("engine_speed", "propeller_shaft_torque", "vehicle_speed"))


def swinging(substep):
    """Two inertias on an undamped shaft, 71 Hz, twisted by what one turns faster than the other."""
    def build(net):
        one, two = net.node("one", 0.2, "rad/s", "one"), net.node("two", 0.05, "rad/s", "two")
        net.shaft("shaft", one, two, 8000.0, 0.0)

    return Bench(build, {"one": 10.0, "two": 0.0}, substep=substep)


def test_an_undamped_swing_keeps_its_energy_in_steps_of_any_length():
    """Runge-Kutta damps it; a whole step, here of 0.3 periods, lacks only what derivatives by differences do."""
    def last_energies(propagated):
        model = swinging(2e-3)
        energy = run(model, 4.0, 4e-3, propagated=propagated)["energy_stored"][round(PATIENCE):]
        return energy, derivatives_taken(model)

    (exact, taken), (damped, none) = last_energies(True), last_energies(False)
    assert (taken, none) == (1, 0)
    assert np.ptp(exact) < 1e-7 * exact[0]
    assert damped[0] - damped[-1] > 0.1 * damped[0]


@pytest.mark.parametrize("name", PLANTS)
def test_through_contacts_it_goes_where_short_steps_go(name):
    fine = run(rolling(name, 1.25e-5), 2.0, **TIP_IN)
    model = rolling(name)
    whole = run(model, 2.0, propagated=True, **TIP_IN)
    assert derivatives_taken(model) >= 2  # on either flank
    cut = run(rolling(name), 2.0, **TIP_IN)
    assert off(whole, fine) < max(2.0 * off(cut, fine), 3e-4)
    contact = "final_drive_contact" if name == "plant_fom" else "contact"
    assert set(whole[contact]) >= {-1.0, 1.0}
    assert np.any(whole["engine_speed"] != cut["engine_speed"])


def test_what_is_not_linear_costs_an_error_of_order_two():
    """Slip, drag of the air and losses from 30 to 300 N.m, without a contact that changes."""
    torque = {"engine_torque": lambda t: 165.0 - 135.0 * np.cos(4.0 * (t - t % 8e-3))}

    def at_the_end(dt, propagated, substep=1e-4):
        model = rolling("plant_fom", substep, 30.0, **{"engine.air_lag": 0.05})
        record = run(model, 2.0, dt, propagated=propagated, **torque)
        assert set(record["final_drive_contact"]) == {1.0} == set(record["transmission_contact"])
        return np.array([record[name][-1] for name in ("engine_speed", "propeller_shaft_torque", "wheel_speed")])

    fine = at_the_end(1e-3, False, 2.5e-5)
    errors = [np.abs(at_the_end(dt, True) / fine - 1.0) for dt in (4e-3, 1e-3)]
    assert errors[1].max() < 1e-6
    assert (errors[1] < errors[0] / 8.0).all()  # order two gives 16


def test_the_firing_of_the_cylinders_is_followed_within_a_step():
    """At 100 Hz a step is two thirds of a radian of it; as a part of what changes from step to step it would be off by
    more than a tenth."""
    def ripple(substep, propagated):
        records = []
        for amplitude in (0.0, 20.0):
            model = rolling("plant_fom", substep, 150.0, **{"torque_ripple.amplitude": amplitude})
            records.append(run(model, 1.0, propagated=propagated)["engine_speed"])
        assert derivatives_taken(model) == float(propagated)
        return records[1] - records[0]

    fine, whole = ripple(1.25e-5, False), ripple(2e-4, True)
    assert np.abs(whole - fine).max() < 2e-3 * np.abs(fine).max()


@pytest.mark.parametrize("inputs", [
    {"lockup_command": steps((0.0, 1.0), (0.3, 0.08), (0.8, 1.0))}, {"gear": steps((0.0, 5.0), (0.6, 4.0))},
    {"brake_torque": steps((0.0, 0.0), (0.5, 900.0))}, {"road_grade": steps((0.0, 0.0), (0.5, 0.05))}],
    ids=["a clutch that slips", "a shift", "braking", "a slope"])
def test_what_it_cannot_do_is_left_to_short_steps(inputs):
    fine = run(rolling("plant_fom", 1.25e-5), 1.5, **TIP_IN, **inputs)
    whole = run(rolling("plant_fom"), 1.5, propagated=True, **TIP_IN, **inputs)
    cut = run(rolling("plant_fom"), 1.5, **TIP_IN, **inputs)
    assert off(whole, fine) < max(2.0 * off(cut, fine), 3e-4)


def stuck_and_led(backend):
    """Two inertias joined by friction that sticks, pushed at one end and led at the other, over a brake that slips."""
    def build(net):
        one, two = net.node("one", 0.2, "rad/s", "one"), net.node("two", 0.3, "rad/s", "two")
        end = net.node("end", 0.5, "rad/s", "end")
        net.friction("clutch", one, two, 1000.0)
        net.shaft("shaft", two, end, 500.0, 0.5)
        net.friction("brake", end, -1, 1.0, signal=net.signal("pressed"))
        net.source("push", one, 1.0, net.signal("pushed"))
        net.leading("lead", end, 3.0, net.signal("ahead"), net.signal("share"))

    return Bench(build, {"one": 10.0, "two": 10.0, "end": 10.0},
                 {"pressed": 1.0, "pushed": 0.0, "ahead": 10.0, "share": 0.5}, backend=backend)


def waves(*offsets):
    return [lambda t, a=offset, b=swing, c=rate: a + b * np.sin(c * t) for offset, swing, rate in offsets]


@pytest.mark.parametrize("made, inputs, share", [
    (lambda: plant("plant_fom", {**NO_DELAY, "engine.air_lag": 0.0}, backend="python", engine_torque=150.0),
     dict(zip(("engine_torque", "spark_efficiency"), waves((150.0, 20.0, 40.0), (0.95, 0.05, 60.0)))), 1.0),
    (lambda: plant("plant_fom", {**NO_DELAY, "engine.air_lag": 0.05, "torque_ripple.amplitude": 5.0}, backend="python",
                   engine_torque=150.0), dict(zip(["engine_torque"], waves((150.0, 20.0, 40.0)))), 1.0),
    (lambda: stuck_and_led("python"),
     dict(zip(("pushed", "ahead", "share"), waves((5.0, 20.0, 40.0), (11.0, 1.0, 10.0), (0.5, 0.5, 20.0)))), 1.0),
    (lambda: stuck_and_led("python"),
     dict(zip(("pushed", "pressed"), waves((5.0, 20.0, 40.0), (5.0, 1.0, 25.0)))), 0.0),
], ids=["an engine", "an engine whose air lags, that fires", "pushed and led", "braked by a signal"])
def test_what_only_drives_needs_no_rates_from_step_to_step(monkeypatch, made, inputs, share):
    """Rates are brought from one step's signals to the next one's, exactly: states, torques and the ledger."""
    same = propagation.same_heard
    said = []

    def records(answer):
        def asked(*place):
            said.append(same(*place))
            return said[-1] and answer

        monkeypatch.setattr(propagation, "same_heard", asked)
        model = made()
        found = run(model, 0.4, propagated=True, **inputs)
        assert derivatives_taken(model) == 1
        return found

    quick, whole = records(True), records(False)
    assert np.mean(said) == share
    assert len(said) > 2 * 300
    for name, values in whole.items():
        assert np.abs(quick[name] - values).max() <= 1e-9 * max(np.ptp(values), 1.0), name


def test_the_same_bits_uncompiled_and_nothing_outlives_a_call():
    rows = input_rows(rolling("plant_fom"), 0.15, 1e-3, engine_torque=150.0)
    found = []
    for backend in ("auto", "python"):
        model = plant("plant_fom", {**NO_DELAY, "torque_ripple.amplitude": 5.0}, backend=backend, engine_torque=150.0)
        begun = model.save()
        for _ in range(2 if backend == "auto" else 1):
            model.restore(begun)
            model.network.work[:] = np.nan
            found.append(model.simulate(rows, 1e-3, propagated=True))
            assert derivatives_taken(model) == 1
    assert all(np.array_equal(one, found[0]) for one in found[1:])


def test_step_by_step_it_is_as_before():
    """What a call of ``simulate`` may do stays with that call."""
    one, other = rolling("plant_fom"), rolling("plant_fom")
    begun = one.save()
    run(one, 0.5, propagated=True, **TIP_IN)
    one.restore(begun)
    for first, second in zip(run(one, 0.5, **TIP_IN).values(), run(other, 0.5, **TIP_IN).values(), strict=True):
        assert np.array_equal(first, second)
