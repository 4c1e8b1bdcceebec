"""Laws of the triggered size estimator, and the sizes it finds on the full-order plant."""

import functools

import numpy as np
import pytest
from runs import plant, run
from scipy.linalg import expm

from cosim.master.scenario import Scenario
from driveline.estimators.dskse import Dskse
from driveline.estimators.state_space import CONTACT, Lumped, twists
from driveline.estimators.tkbse import Tkbse
from driveline.quantities import InputError
from driveline.vehicles import load

N = 6
# nothing that goes beyond it
THESIS = {"delay.wheel_speed_deviation": 0.0, "trigger.tip_ins": 1.0, "trigger.measured_twist": 0.0}


def make(gear=5, period=0.01, **inputs):
    estimator = Tkbse(Tkbse.defaults_from(load("pickup_10r80", "modified"), gear))
    estimator["sampling.period"] = period
    for key, value in inputs.items():
        estimator[key] = value
    return estimator


def columns(estimator, outputs):
    return {v.name: outputs[:, i] for i, v in enumerate(estimator.output_variables)}


def pulses(*edges, low=-30.0, rate=250.0):
    """Torque that goes up and down at a rate, to one height after another: (from, to, height)."""
    def torque(t):
        level = np.full(t.size, low)
        for start, end, high in edges:
            rise = np.clip(low + (t + 1e-3 - start) * rate, low, high)
            fall = np.clip(high - (t + 1e-3 - end) * rate, low, high)
            level = np.maximum(level, np.minimum(rise, fall))
        return level
    return torque


TIP_INS = ((0.5, 2.5, 200.0), (4.5, 6.5, 200.0))


@functools.cache
def record(scale=1, gear=5, edges=TIP_INS, rate=250.0, low=-30.0):
    """The full-order plant with all its lash so many times as large."""
    values = load("pickup_10r80", "modified").values
    parameters = {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": 15.0}
    parameters |= {f"{name}.half_gap": scale * values[f"{name}.half_gap"] for name in ("transmission", "final_drive")}
    return run(plant("plant_fom", parameters, gear=gear, engine_torque=low), edges[-1][1] + 1.0,
               engine_torque=pulses(*edges, low=low, rate=rate))


def estimate(found, gear=5, milliseconds=10, phase=0, estimator=None):
    """The outputs over a record of the plant at 1 ms, with frames every few milliseconds."""
    estimator = estimator or make(gear, milliseconds * 1e-3)
    signals = np.column_stack([found[name] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")])
    estimator.values[:3] = signals[phase]
    estimator.initialize()
    taken = np.arange(milliseconds - 1 + phase, len(signals), milliseconds)
    return columns(estimator, estimator.simulate(signals[taken])) | {"time": found["time"][taken]}


def true_size(scale=1, gear=5):
    return 2.0 * scale * make(gear)["shaft.half_gap"]


def size_error(scale=1, gear=5, milliseconds=10, phase=0, **profile):
    """Error [%] at the end of the last tip-in."""
    found = estimate(record(scale, gear, **profile), gear, milliseconds, phase)
    assert found["triggers"][-1] == len(profile.get("edges", TIP_INS)) and found["trusted"][-1] == 1.0
    return 100.0 * (found["lash_size"][-1] / true_size(scale, gear) - 1.0)


# ---- laws --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_exact_when_the_plant_is_the_model_and_never_leaves_contact(period):
    """No lash is crossed, so no size is found; all other states are those of the plant."""
    estimator = make(period=period, engine_torque=-1.0, engine_speed=150.0, wheel_speed=29.81, **THESIS)
    estimator.initialize()
    estimator.simulate(np.array([[-1.0, 150.0, 29.81]] * 3))
    estimator.simulate(np.array([[1.0, 150.0, 29.81]]))
    assert estimator["triggered"] == 1.0
    p, parameters = Lumped.of(estimator.parameters), estimator.parameters
    gear, vehicle = parameters.gear, parameters.vehicle
    model = twists(p, CONTACT)
    joined = np.zeros((N + 2, N + 2))
    joined[:N] = np.hstack([model.A, model.B])
    step = expm(joined * period)[:N]
    x = estimator._outputs[:N].copy()
    torques = 1.0 + 100.0 * period * np.arange(round(1.0 / period))
    for before, now in zip(torques[:-1], torques[1:], strict=True):
        shaft = p.k_s * (x[0] - x[5]) + p.c_s * (x[1] / p.i_tr - p.i_fdr * x[3])
        drive = (0.5 * (before + now) - gear.loss_constant - gear.loss_viscous * x[1] - gear.loss_fraction * abs(shaft))
        speed = p.r_w * x[4]
        load_force = vehicle.aerodynamic_factor * speed * abs(speed) + vehicle.rolling_resistance_force
        x = step @ np.concatenate([x, [drive, load_force]])
        estimator.simulate(np.array([[now, x[1], x[3]]]))
        np.testing.assert_allclose(estimator._outputs[:N], x, rtol=1e-9, atol=1e-9)
    assert estimator["triggered"] == 1.0 and abs(estimator["lash_size_unconstrained"]) < 1e-9


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_a_speed_corrects_as_the_textbook_filter_does_that_has_run_for_long(period):
    """The lash moves evenly over a frame, not by a jump at its beginning; all else is noise at its end."""
    estimator = make(period=period, engine_torque=-1.0, engine_speed=150.0, wheel_speed=29.81, **THESIS)
    estimator.initialize()
    estimator.simulate(np.array([[-1.0, 150.0, 29.81]] * 3 + [[1.0, 150.0, 29.81], [3.0, 150.0, 29.81]]))
    saved = estimator.save()

    def after(engine, wheel):
        estimator.restore(saved)
        return estimator.simulate(np.array([[5.0, 150.0 + engine, 29.81 + wheel]]))[0, :N]

    assert estimator["triggered"] == 1.0
    gain = np.column_stack([after(1e-3, 0.0) - after(0.0, 0.0), after(0.0, 1e-3) - after(0.0, 0.0)]) / 1e-3
    rates = twists(Lumped.of(estimator.parameters), CONTACT).A
    way = np.mean([expm(rates * period * (i + 0.5) / 100) for i in range(100)], axis=0)[:, 5]
    q, r = np.diag([1e-9, 1e-2, 1e-9, 1e-8, 1e2, 0.0]) + 1e-4 * np.outer(way, way), np.diag([2e-5, 3e-5])
    a, p, c = expm(rates * period), np.zeros((N, N)), np.eye(N)[[1, 3]]
    for _ in range(3000):
        p = a @ p @ a.T + q
        expected = np.linalg.solve(c @ p @ c.T + r, c @ p).T
        p = (np.eye(N) - expected @ c) @ p
        p = 0.5 * (p + p.T)
    largest = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(gain / largest, expected / largest, atol=1e-4)


def test_the_twist_is_the_integral_of_the_measured_speeds():
    """By the trapezoidal rule; speeds, and the torque that twist and offset make, are those of the filter alone."""
    data = record()
    found = estimate(data, estimator=make(**THESIS | {"trigger.measured_twist": 1.0}))
    plain = estimate(data, estimator=make(**THESIS))
    rate = data["engine_speed"][9::10] / make()["gear.transmission_ratio"] - make()["gear.final_drive_ratio"] * data[
        "wheel_speed"][9::10]
    grown = 0.005 * (rate[1:] + rate[:-1])
    on = (found["triggered"][1:] == 1.0) & (found["triggered"][:-1] == 1.0)
    assert on.sum() > 100
    np.testing.assert_allclose(np.diff(found["shaft_twist"])[on], grown[on], atol=1e-12)
    assert np.abs(np.diff(plain["shaft_twist"])[on] - grown[on]).max() > 1e-4
    for name in ("engine_speed_estimate", "wheel_speed_estimate", "wheel_shaft_twist", "tyre_speed"):
        np.testing.assert_allclose(found[name], plain[name], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found["shaft_twist"] - found["lash_size_unconstrained"],
                               plain["shaft_twist"] - plain["lash_size_unconstrained"], atol=1e-10)


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_a_trigger_starts_from_the_twist_of_the_coast_flank(period):
    """Exact where the torque in the shaft rises evenly, with the stiffness it has while coasting."""
    estimator = make(period=period, **THESIS)
    ratio, final = estimator["gear.transmission_ratio"], estimator["gear.final_drive_ratio"]
    stiffness = estimator["coast_stiffness_factor"] * estimator["shaft.stiffness"]
    assert 0.9 < estimator["coast_stiffness_factor"] < 0.99
    slope, engine = 300.0, 150.0
    rate = slope / stiffness
    wheel = (engine / ratio - rate) / final
    shaft = -150.0 + slope * period * np.arange(round(0.6 / period))
    torque = shaft / ratio + (estimator["gear.loss_constant"] + estimator["gear.loss_viscous"] * engine
                              + estimator["gear.loss_fraction"] * np.abs(shaft))
    frames = np.column_stack([torque, np.full(torque.size, engine), np.full(torque.size, wheel)])
    estimator.values[:3] = frames[0]
    estimator.initialize()
    found = columns(estimator, estimator.simulate(frames))
    first = np.argmax(found["triggered"] == 1.0)
    assert shaft[first] < -5.0
    # the loss at the middle of a frame is that of its last torque
    late = estimator["gear.loss_fraction"] * ratio * slope * period
    expected = (shaft[first] - estimator["shaft.damping"] * rate) / stiffness
    assert found["shaft_twist"][first] == pytest.approx(expected, abs=late / stiffness)


def test_triggers_on_positive_torque_that_rises_fast_enough():
    """And once a tip-in: torque has to come from below."""
    def triggers(torques):
        estimator = make(engine_torque=torques[0], engine_speed=150.0, wheel_speed=29.81)
        estimator.initialize()
        return columns(estimator, estimator.simulate(np.array([[t, 150.0, 29.81] for t in torques])))["triggers"][-1]

    frames = np.arange(100) * 0.01
    assert triggers(-10.0 + 20.0 * frames) == 1  # 20 N.m/s through zero
    assert triggers(-2.0 + 5.9 * frames) == 0
    assert triggers(-2.0 + 6.1 * frames) == 1
    assert triggers(-30.0 + 29.0 * frames) == 0
    assert triggers(10.0 + 50.0 * frames) == 0
    assert triggers(np.concatenate([-10.0 + 50.0 * frames, np.full(20, 40.0), 40.0 + 50.0 * frames])) == 1
    assert triggers(np.concatenate([-10.0 + 50.0 * frames, 40.0 - 50.0 * frames, -10.0 + 50.0 * frames])) == 2


def test_a_torque_frame_that_is_missing_makes_no_slope():
    """The rise over two periods is divided by two periods."""
    estimator = make(engine_torque=-1.0, engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    estimator.simulate(np.array([[-0.05, 150.0, 29.81], [np.nan, 150.0, 29.81], [0.05, 150.0, 29.81]]))
    assert estimator["triggers"] == 0.0
    estimator.simulate(np.array([[-0.05, 150.0, 29.81], [0.05, 150.0, 29.81]]))
    assert estimator["triggers"] == 1.0


def test_everything_is_held_between_triggers():
    found = estimate(record())
    off = found["triggered"] == 0.0
    held = off[1:] & off[:-1]
    assert held.any() and not held.all()
    for name in ("shaft_twist", "engine_speed_estimate", "wheel_speed_estimate", "lash_size_unconstrained"):
        assert not np.diff(found[name])[held].any()


def test_speeds_start_from_those_measured_at_each_trigger():
    data = record()
    found = estimate(data, estimator=make(**THESIS))
    for i in np.nonzero(np.diff(found["triggered"]) > 0.0)[0] + 1:
        at = np.searchsorted(data["time"], found["time"][i] - 1e-6)
        assert found["engine_speed_estimate"][i] == data["engine_speed"][at]
        assert found["wheel_speed_estimate"][i] == data["wheel_speed"][at]
        assert found["lash_size_unconstrained"][i] == 0.0


def test_constrained_size_changes_only_when_a_trigger_ends():
    found = estimate(record())
    changes = np.nonzero(np.diff(found["lash_size"]))[0] + 1
    ends = np.nonzero(np.diff(found["triggered"]) < 0.0)[0] + 1
    assert changes.size == 2
    assert set(changes) <= set(ends)


def test_a_tip_in_too_short_to_cross_the_lash_leaves_the_size_as_it_was():
    """The second one turns back inside the lash."""
    found = estimate(record(3, edges=((0.5, 2.5, 150.0), (4.5, 4.62, 60.0))))
    assert found["triggers"][-1] == 2
    first = found["lash_size"][np.searchsorted(found["time"], 4.0)]
    assert found["lash_size"][-1] == first == pytest.approx(true_size(3), rel=0.02)
    assert found["lash_size_unconstrained"][-1] < 0.8 * first


# ---- the full-order plant ----------------------------------------------------------------------------


@pytest.mark.parametrize(("milliseconds", "bound"), [(10, 1.5), (5, 0.5), (1, 0.5)])
@pytest.mark.parametrize("scale", [1, 2, 3])
def test_size_is_found(scale, milliseconds, bound):
    assert abs(size_error(scale, milliseconds=milliseconds)) <= bound
    assert abs(size_error(scale, milliseconds=milliseconds, rate=500.0)) <= bound


@pytest.mark.parametrize(("scale", "spread"), [(1, 2.5), (3, 1.5)])
def test_size_hardly_depends_on_where_the_frames_fall(scale, spread):
    """The plant's milliseconds 0 to 9 as the first frame; the smaller the lash, the more one frame is of it."""
    errors = [size_error(scale, phase=phase) for phase in range(10)]
    assert np.ptp(errors) <= spread
    assert np.abs(errors).max() <= spread


@pytest.mark.parametrize("milliseconds", [10, 5, 1])
@pytest.mark.parametrize("scale", [1, 2, 3])
def test_size_has_no_bias(scale, milliseconds):
    """Mean over where the frames fall; 0.3 % of 2 alpha is what 0.5 N.m turn the shaft by."""
    phases = range(0, milliseconds, max(milliseconds // 5, 1))
    for profile in ({}, {"rate": 500.0}):
        errors = [size_error(scale, milliseconds=milliseconds, phase=phase, **profile) for phase in phases]
        assert abs(np.mean(errors)) <= 0.35


@pytest.mark.parametrize("milliseconds", [10, 1])
def test_sixth_gear(milliseconds):
    assert abs(size_error(2, 6, milliseconds)) <= 2.0


@pytest.mark.parametrize("tip_ins", [2, 10])
def test_the_size_is_the_mean_of_the_last_tip_ins(tip_ins):
    edges = tuple((0.5 + 4.0 * i + 0.013 * i, 2.5 + 4.0 * i, 200.0) for i in range(4))
    data = record(edges=edges)
    single = estimate(data, estimator=make(**THESIS))["lash_size"]
    mean = estimate(data, estimator=make(**THESIS | {"trigger.tip_ins": tip_ins}))["lash_size"]
    ends = np.nonzero(np.diff(single))[0] + 1
    assert ends.size == 4
    expected = single[ends[0]]
    for i, end in enumerate(ends, start=1):
        expected += (single[end] - expected) / min(i, tip_ins)
        assert mean[end] == pytest.approx(expected, rel=1e-12)


def test_another_lash_starts_another_mean():
    """Twice as much from one tip-in to the next: what was found before no longer counts."""
    first, second = (np.column_stack([record(scale)[name] for name in ("crankshaft_torque", "engine_speed",
                                                                       "wheel_speed")]) for scale in (1, 2))
    estimator = make()
    estimator.values[:3] = first[0]
    estimator.initialize()
    sizes = [columns(estimator, estimator.simulate(part[9::10]))["lash_size"][-1] for part in (first, second)]
    assert sizes == [pytest.approx(true_size(1), rel=0.02), pytest.approx(true_size(2), rel=0.02)]


def in_bits(torque):
    return np.round(2.0 * torque) / 2.0


def every_10_ms(torque):
    return torque[np.arange(torque.size) // 10 * 10]


@pytest.mark.parametrize("milliseconds", [10, 5, 1])
@pytest.mark.parametrize("told", [in_bits, every_10_ms])
def test_a_torque_in_bits_or_updated_rarely_rises_all_the_same(told, milliseconds):
    """Of frames of 1 ms the first in which it stood ended the trigger, and no tip-in ever gave a size."""
    data = record() | {"crankshaft_torque": told(record()["crankshaft_torque"])}
    found = estimate(data, milliseconds=milliseconds)
    assert found["triggers"][-1] == len(TIP_INS) and found["trusted"][-1] == 1.0
    assert found["lash_size"][-1] == pytest.approx(true_size(), rel=0.015)


def test_short_frames_trigger_as_soon_as_long_ones_would():
    """A torque that jumps through zero triggers in its first frame, however short."""
    estimator = make(period=1e-3, engine_torque=-20.0, engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    frames = [[torque, 150.0, 29.81] for torque in np.append(np.full(14, -20.0), 5.0)]
    found = columns(estimator, estimator.simulate(np.array(frames)))
    np.testing.assert_array_equal(np.flatnonzero(found["triggered"]), [14])


# ---- lost frames -------------------------------------------------------------------------------------


def single_sizes(lost):
    """Sizes, each of one tip-in alone, as frames of 10 ms end them; some of the inputs are lost in some frames."""
    frames = np.column_stack([record()[name] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")])[9::10]
    frames[lost] = np.nan
    estimator = make(**{"trigger.tip_ins": 1.0})
    estimator.values[:3] = frames[0]
    estimator.initialize()
    found = columns(estimator, estimator.simulate(frames))
    assert found["triggers"][-1] >= 1 and found["trusted"][-1] == 1.0
    return found["lash_size"][np.flatnonzero(np.diff(found["lash_size"])) + 1]


@pytest.mark.parametrize("inputs", [[0], [1], [2], [0, 1, 2]])
@pytest.mark.parametrize("frames", [5, 30])
def test_a_tip_in_says_nothing_of_what_a_gap_hid(inputs, frames):
    """It took an offset that stood still because nothing was measured for settled, and trusted a hundredth of the lash.
    """
    for begin in (456, 462, 466, 470, 474, 480):  # from before the trigger to contact
        sizes = single_sizes(np.ix_(range(begin, begin + frames), inputs))
        assert sizes == pytest.approx(true_size(), rel=0.02)


def test_a_size_that_had_settled_is_not_lost_with_later_frames():
    assert single_sizes(np.ix_(range(560, 590), [0, 1, 2])).size == 2


def test_the_twist_goes_on_over_a_lost_frame():
    """By the speeds before and after it; one frame without them in the crossing cost a seventh of the lash."""
    for lost in range(455, 500, 4):
        sizes = single_sizes(np.ix_([lost], [0, 1, 2]))
        assert sizes.size == 2 and sizes[1] == pytest.approx(true_size(), rel=0.06)


# ---- late speeds -------------------------------------------------------------------------------------


def late(data, engine, wheel, estimator, milliseconds=10):
    """The estimator's outputs over a record of the plant, the speeds late by so many ms."""
    signals = [data["crankshaft_torque"], data["engine_speed"], data["wheel_speed"]]
    for i, lag in ((1, engine), (2, wheel)):
        if lag:
            signals[i] = np.concatenate([np.full(lag, signals[i][0]), signals[i][:-lag]])
    signals = np.column_stack(signals)
    estimator.values[:3] = signals[0]
    estimator.initialize()
    return columns(estimator, estimator.simulate(signals[milliseconds - 1::milliseconds]))


@pytest.mark.parametrize(("engine", "wheel"), [(0, 30), (10, 30), (20, 0), (10, 10)])
def test_delays_that_are_told_only_make_it_later(engine, wheel):
    """By whole frames; what is left of how it began, when the first frame counts as all before it, dies away."""
    age = max(engine, wheel)
    plain = late(record(), 0, 0, make(**THESIS))
    told = {"delay.engine_speed": 1e-3 * engine, "delay.wheel_speed": 1e-3 * wheel}
    found = late(record(), engine, wheel, make(**THESIS, **told))
    assert (found["latency"] == 1e-3 * age).all()
    frames = slice(30, None)
    for name in ("lash_size", "lash_size_unconstrained", "triggered", "shaft_twist"):
        np.testing.assert_allclose(found[name][age // 10:][frames], plain[name][:-age // 10][frames], atol=2e-8)


@pytest.mark.parametrize("milliseconds", [10, 5, 1])
@pytest.mark.parametrize(("engine", "wheel"), [(0, 0), (0, 30), (10, 30), (20, 0)])
def test_a_late_speed_is_found_and_does_no_harm(engine, wheel, milliseconds):
    found = late(record(), engine, wheel, make(period=1e-3 * milliseconds), milliseconds)
    assert found["wheel_speed_delay"][-1] == pytest.approx(1e-3 * (wheel - engine), abs=1e-3)
    assert found["wheel_speed_delay_deviation"][-1] < 2e-3 and found["trusted"][-1] == 1.0
    assert found["lash_size"][-1] == pytest.approx(true_size(), rel=0.02)


def test_without_that_a_late_wheel_speed_does_harm():
    """What the thesis's estimator makes of it: the twist is off by the lag times the speed gained."""
    found = late(record(), 0, 20, make(**THESIS))
    plain = late(record(), 0, 0, make(**THESIS))
    wheel = record()["wheel_speed"][9::10]
    first = np.argmax(plain["triggered"] == 1.0)
    for after in (0.3, 0.5, 0.7):  # since the trigger, in contact
        row = first + round(after / 0.01)
        expected = 0.02 * make()["gear.final_drive_ratio"] * (wheel[row - 1] - wheel[first - 1])
        drift = found["lash_size_unconstrained"][row] - plain["lash_size_unconstrained"][row]
        assert drift == pytest.approx(expected, abs=0.1 * expected + 0.02 * true_size())


@pytest.mark.parametrize(("parameter", "factor"), [("shaft.stiffness", 1.5), ("engine_inertia", 1.3),
                                                   ("vehicle.mass", 1.5)])
def test_the_delay_is_found_with_wrong_parameters_too(parameter, factor):
    estimator = make()
    estimator[parameter] = factor * estimator[parameter]
    found = late(record(), 0, 25, estimator)
    assert found["wheel_speed_delay"][-1] == pytest.approx(0.025, abs=1e-3)


def test_a_size_is_not_trusted_before_the_delay_is_known():
    """A tip-in right at the start, with no time in contact before."""
    cut = round((TIP_INS[0][0] - 0.1) * 1000)
    data = {name: record()[name][cut:] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")}
    found = late(data, 0, 0, make())
    unsure = found["wheel_speed_delay_deviation"] > make()["trust.delay"]
    assert unsure[0] and not unsure[-1]
    assert not found["trusted"][unsure].any() and found["trusted"][-1] == 1.0


@pytest.mark.parametrize(("milliseconds", "wheel", "trusts"),
                         [(1, 80, 0.0), (1, 45, 1.0), (10, 80, 1.0), (10, 120, 0.0)])
def test_a_lag_at_the_end_of_what_is_looked_for_is_not_trusted(milliseconds, wheel, trusts):
    """Of 64 frames of 1 ms the oldest is 62 ms old; what the lag is beyond that is lash to the estimator."""
    found = late(record(), 0, wheel, make(period=1e-3 * milliseconds), milliseconds)
    assert found["lash_size"][-1] > 0.0 and found["trusted"][-1] == trusts
    assert not found["trusted"][np.abs(found["lash_size"] / true_size() - 1.0) > 0.02].any()


# ---- together with the state estimator -----------------------------------------------------------------


def test_the_size_it_finds_is_what_the_state_estimator_needs():
    """Lash worn to twice its size: without the size the traversal seems to end too early."""
    data = record(2)
    size = estimate(data)["lash_size"][-1]
    signals = np.column_stack([data[name] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")])
    final, transmission = data["final_drive_contact"], data["transmission_contact"]
    end = np.argmax((final == 1.0) & (transmission == 1.0))
    start = np.argmax((final != -1.0) | (transmission != -1.0))
    true = data["time"][end] - data["time"][start]
    errors = []
    for lash_size in (0.0, size):
        estimator = Dskse(Dskse.defaults_from(load("pickup_10r80", "modified")))
        estimator.values[:4] = *signals[0], lash_size
        estimator.initialize()
        frames = np.column_stack([signals, np.full(len(signals), lash_size)])[9:2400:10]
        found = columns(estimator, estimator.simulate(frames))
        errors.append(found["traversal_time"][np.argmax(found["contact"] == 1.0)] / true - 1.0)
    assert errors[0] < -0.15
    assert abs(errors[1]) < 0.1


def test_both_in_the_loop_with_the_plant():
    """The scenario that ships: the size found at one tip-in is the state estimator's from then on."""
    result = Scenario.load("estimators_in_loop", twins=True).run()
    size, used = np.asarray(result["size.lash_size"]), np.asarray(result["state.lash_size"])
    assert size[-1] == pytest.approx(true_size(), rel=0.03)
    assert used[-1] == size[-1] and used[0] == 0.0
    assert np.asarray(result["size.triggers"])[-1] == 3 and np.asarray(result["state.trusted"])[-1] == 1.0
    assert 0.08 < np.asarray(result["state.traversal_time"])[-1] < 0.16


@pytest.mark.parametrize(("settled", "milliseconds"), [(0.0, 10), (0.005, 10), (0.03, 60)])
def test_a_size_settles_with_frames_as_far_apart_as_it_has_to_be_calm(settled, milliseconds):
    estimator = make(period=milliseconds * 1e-3)
    estimator["trigger.settled_time"] = settled
    found = estimate(record(2), milliseconds=milliseconds, estimator=estimator)
    assert found["lash_size"][-1] == pytest.approx(true_size(2), rel=0.15)


@pytest.mark.parametrize(("parameters", "message"), [
    ({"gear.transmission_ratio": -2.0}, "a forward gear is needed"),
    ({"shaft.damping": 5e3, "wheel_shaft.damping": 5e3}, "nothing vibrates")])
def test_what_it_cannot_listen_to_is_named(parameters, message):
    estimator = make()
    for name, value in parameters.items():
        estimator[name] = value
    with pytest.raises(InputError, match=message):
        estimator.initialize()
