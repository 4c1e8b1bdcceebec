"""Laws of the observer of lash position and size, and how well it does on the full-order plant."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from runs import plant, run

from driveline.estimators import dead_zone, samples
from driveline.estimators.lash_observer import LashObserver
from driveline.quantities import InputError
from driveline.vehicles import load

VEHICLE = load("pickup_10r80", "modified")
SIZE = 2.0 * LashObserver.defaults_from(VEHICLE)["shaft.half_gap"]


def make(gear=5, backend="auto", **parameters):
    observer = LashObserver(LashObserver.defaults_from(VEHICLE, gear), backend)
    for key, value in parameters.items():
        observer[key.replace("__", ".")] = value
    return observer


def listen(record, observer, milliseconds=10, phase=0, engine_delay=0, wheel_delay=0, spoil=None):
    """The observer over a record at 1 ms; delays in milliseconds; outputs by name, with ``time``."""
    rows = np.arange(milliseconds - 1 + phase, record["time"].size, milliseconds)
    frames = np.zeros((rows.size, len(observer.inputs)))
    for column, (name, delay) in enumerate((("crankshaft_torque", 0), ("engine_speed", engine_delay),
                                            ("wheel_speed", wheel_delay))):
        frames[:, column] = record[name][np.maximum(rows - delay, 0)]
    if spoil is not None:
        spoil(frames)
    observer["sampling.period"] = milliseconds * 1e-3
    observer.values[:frames.shape[1]] = frames[0]
    begin = record["time"][rows[0]] - milliseconds * 1e-3
    observer.initialize(begin)
    found = observer.simulate(frames, begin)
    return {v.name: found[:, i] for i, v in enumerate(observer.output_variables)} | {"time": record["time"][rows]}


def pulses(low, high, rate, count, period=2.4):
    """Trapezoids of torque from 0.5 s on."""
    def torque(time):
        phase = np.clip(time + 1e-3 - 0.5, 0.0, count * period) % period
        up = low + phase * rate
        down = high - (phase - 0.5 * period) * rate
        return np.clip(np.minimum(up, down), low, high)
    return torque


@functools.cache
def driven(rate, lash=1.0, count=1, gear=5, high=200.0):
    """The full-order plant through tip-ins and tip-outs of its crankshaft torque."""
    gaps = {name: lash * VEHICLE.values[name] for name in ("transmission.half_gap", "final_drive.half_gap")}
    full = plant("plant_fom", gaps | {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": 12.0},
                 gear=gear, engine_torque=-30.0)
    return run(full, 0.5 + 2.4 * count, engine_torque=pulses(-30.0, high, rate, count))


def traversals(record):
    """Start, end and direction of every complete traversal of both lashes together."""
    found, side, start = [], -1.0, None
    contacts = np.stack([record["transmission_contact"], record["final_drive_contact"]], axis=1)
    for time, pair in zip(record["time"], contacts, strict=True):
        if (pair == side).all():
            start = None
        elif start is None:
            start = time
        if (pair == -side).all():
            found.append((start, time, -side))
            side, start = -side, None
    return found


def settled(found, end):
    """The row in which the traversal that ended at ``end`` has its last word."""
    return int(np.searchsorted(found["time"], end + 0.11))


def toy(half_gap, stiffness=1500.0, offset=0.0, delay=0.0, seed=None, stop=4.0):
    """One inertia on one dead zone at a hub that turns as it likes: the observer's own model, finely integrated."""
    p = LashObserver.defaults_from(VEHICLE)
    i, i_fd, inertia = p["gear.transmission_ratio"], p["gear.final_drive_ratio"], p["engine_inertia"]
    step = 2e-4
    time = step * np.arange(1, round(stop / step) + 1)
    torque = pulses(-40.0, 120.0, 400.0, 2, 1.8)(time)
    hub = 30.0 + 0.4 * np.sin(2.0 * time)
    engine, twist = hub[0] * i * i_fd, 0.0
    speeds, places = np.empty(time.size), np.empty(time.size)
    flank = 40.0 * i / stiffness
    for n in range(time.size):
        depth = twist - flank
        shaft = stiffness * (min(depth, 0.0) + max(depth - 2.0 * half_gap, 0.0))
        if abs(depth - half_gap) > half_gap:
            shaft += 4.0 * (engine / i - i_fd * hub[n])
        engine += step * (torque[n] - offset - shaft / i) / inertia
        twist += step * (engine / i - i_fd * hub[n])
        speeds[n], places[n] = engine, twist - flank - half_gap
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 0.01, time.size) if seed is not None else 0.0
    pick = slice(4, None, 5)
    late = round(delay / step)
    delayed = np.concatenate([np.full(late, speeds[0]), speeds[:speeds.size - late]])
    record = {"time": time[pick], "crankshaft_torque": torque[pick], "engine_speed": (delayed + noise)[pick],
              "wheel_speed": hub[pick], "position": np.clip(places, -half_gap, half_gap)[pick]}
    free = {"gear__loss_constant": 0.0, "gear__loss_viscous": 0.0, "gear__loss_fraction": 0.0,
            "gear__final_drive_drag": 0.0, "output_inertia": 0.0, "shaft__damping": 4.0,
            "shaft__stiffness": stiffness, "wheel_inertia": 1e6}
    return record, free


# ---- pieces ------------------------------------------------------------------------------------------


def test_normal_distribution_is_the_one():
    from scipy.stats import norm

    z = np.linspace(-9.0, 9.0, 1001)
    np.testing.assert_allclose([dead_zone.share_below(x) for x in z], norm.cdf(z), atol=1e-7)
    np.testing.assert_allclose([dead_zone.bell(x) for x in z], norm.pdf(z), atol=1e-14)


def test_values_between_samples_are_exact_for_cubics_and_at_the_samples():
    count = 2 * samples.SAMPLES
    state, times = [0.0] * (count + 1), [0.0, 0.008, 0.021, 0.03, 0.043, 0.05]
    for time in times:
        samples.push(state, 0, count, time, 1.0 + 3.0 * time - 50.0 * time**3)
    for time in [*times, 0.004, 0.017, 0.035, 0.049]:
        assert samples.smooth(state, 0, count, time) == pytest.approx(1.0 + 3.0 * time - 50.0 * time**3, abs=1e-14)
    samples.push(state, 0, count, 0.049, 99.0)  # late: it is older than what is there
    assert state[count] == len(times)
    assert samples.linear(state, 0, count, 0.049) < 2.0


def test_the_prior_is_a_distribution_over_all_sizes_it_promises():
    constants = make().constants(make().parameters)
    sizes = [dead_zone.prior_size(constants, m) for m in range(dead_zone.BANK)]
    assert min(s[0] for s in sizes) < 0.25 * SIZE < 4.0 * SIZE < max(s[0] for s in sizes)
    assert sum(s[2] for s in sizes) == pytest.approx(1.0, abs=0.02)
    assert sizes[0][0] == pytest.approx(SIZE)


# ---- the observer on its own model -------------------------------------------------------------------


@pytest.mark.parametrize("worn", [0.4, 1.0, 2.3, 3.6])
def test_right_where_plant_and_model_agree(worn):
    record, free = toy(0.5 * worn * SIZE)
    found = listen(record, make(**free))
    assert found["lash_size"][-1] == pytest.approx(worn * SIZE, rel=0.01)
    late = found["time"] > 2.4  # by the second tip-in it knows the size
    rows = np.searchsorted(record["time"], found["time"] - 1e-9)
    # during an impact the twist moves by up to 3 rad/s
    assert np.abs(found["lash_position"] - record["position"][rows])[late].max() < 0.03 * worn * SIZE


def test_torque_offset_is_found_in_the_gap():
    record, free = toy(0.5 * SIZE, offset=3.0)
    found = listen(record, make(**free, uncertainty__torque=4.0))
    assert found["torque_offset"][-1] == pytest.approx(3.0, abs=0.4)


def test_a_delay_nobody_told_of_is_found():
    record, free = toy(0.5 * SIZE, delay=0.008)
    found = listen(record, make(**free))
    assert found["engine_speed_delay"][-1] == pytest.approx(0.008, abs=1e-3)
    assert found["lash_size"][-1] == pytest.approx(SIZE, rel=0.01)


def test_size_intervals_hold_what_they_promise_under_noise():
    """Sizes drawn from what the prior says of worn lash, noise in the speed: 90 % intervals, 30 drives."""
    inside = 0
    rng = np.random.default_rng(3)
    for seed in range(30):
        size = SIZE * np.exp(rng.normal(0.0, 0.4))
        record, free = toy(0.5 * size, stop=2.3, seed=seed, offset=rng.normal(0.0, 1.5))
        found = listen(record, make(**free, noise__speed=0.01))
        inside += found["lash_size_low90"][-1] <= size <= found["lash_size_high90"][-1]
    assert inside >= 23  # binomial: 27 on average, fewer than 23 once in 130 if 90 % is true


# ---- the observer on the full-order plant ------------------------------------------------------------


@pytest.mark.parametrize(("rate", "limit"), [(250.0, 7.0), (500.0, 4.5), (1000.0, 8.0)])
@pytest.mark.parametrize("gear", [5, 6])
def test_traversal_time_and_its_interval(rate, gear, limit):
    record = driven(rate, gear=gear)
    found = listen(record, make(gear))
    start, end, _ = traversals(record)[0]
    row = settled(found, end)
    assert found["traversal_settled"][row] == 1.0
    assert found["traversal_time"][row] == pytest.approx(end - start, rel=0.01 * limit)
    assert found["traversal_time_low90"][row] < end - start < found["traversal_time_high90"][row]
    assert abs(found["traversal_start"][row] - start) < 1.65 * found["traversal_start_deviation"][row]
    assert abs(found["traversal_end"][row] - end) < 1.65 * found["traversal_end_deviation"][row]


@pytest.mark.parametrize("lash", [1.0, 2.0, 3.0])
def test_size_after_one_traversal_and_surer_with_every_traversal(lash):
    record = driven(400.0, lash, 3, high=120.0)
    found = listen(record, make())
    ends = [settled(found, end) for _, end, _ in traversals(record)]
    assert len(ends) == 6
    assert found["traversals"][ends[-1]] == 6.0
    np.testing.assert_allclose(found["lash_size"][ends], lash * SIZE, rtol=0.04)
    assert found["lash_size"][-1] == pytest.approx(lash * SIZE, rel=0.015)
    deviations = found["lash_size_deviation"][ends]
    assert (np.diff(deviations) < 0.0).all() and deviations[-1] < 0.85 * deviations[0]


def test_size_does_not_depend_on_where_frames_fall():
    record = driven(400.0, 2.0, 2, high=120.0)
    sizes = [listen(record, make(), phase=phase)["lash_size"][-1] for phase in range(0, 10, 2)]
    assert np.ptp(sizes) < 0.02 * 2.0 * SIZE


@pytest.mark.parametrize(("name", "factor"), [("shaft.stiffness", 1.5), ("shaft.stiffness", 0.75),
                                              ("engine_inertia", 1.3), ("wheel_inertia", 1.5)])
def test_wrong_parameters_are_found_out(name, factor):
    record = driven(400.0, 1.0, 3, high=120.0)
    observer = make()
    observer[name] = factor * observer[name]
    found = listen(record, observer)
    assert found["lash_size"][-1] == pytest.approx(SIZE, rel=0.02)
    if name == "shaft.stiffness":
        assert found["stiffness_factor"][-1] == pytest.approx(1.0 / factor, rel=0.05)


def test_known_delays_cost_time_and_nothing_else():
    record = driven(400.0, 1.0, 2, high=120.0)
    right = listen(record, make())
    late = listen(record, make(delay__engine_speed=0.01, delay__wheel_speed=0.03), engine_delay=10, wheel_delay=30)
    row = settled(right, traversals(record)[2][1])
    for name in ("traversal_start", "traversal_end"):
        assert late[name][row] == pytest.approx(right[name][row], abs=2e-3)
    assert late["lash_size"][-1] == pytest.approx(right["lash_size"][-1], rel=5e-3)
    assert late["latency"][row] == pytest.approx(0.03, abs=1e-9)


def test_ages_do_what_known_delays_do():
    record = driven(400.0, 1.0, 1, high=120.0)

    def told(frames):
        frames[:, 3], frames[:, 4] = 0.01, 0.03

    known = listen(record, make(delay__engine_speed=0.01, delay__wheel_speed=0.03), engine_delay=10, wheel_delay=30)
    stamped = listen(record, make(), engine_delay=10, wheel_delay=30, spoil=told)
    for name in ("lash_size", "traversal_start", "traversal_end", "contact"):
        np.testing.assert_allclose(stamped[name], known[name], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("milliseconds", "wheel"), [(10, 20), (5, 30), (1, 30)])
def test_a_wheel_delay_nobody_told_of_is_found(milliseconds, wheel):
    """However many frames that are."""
    record = driven(400.0, 1.0, 3, high=120.0)
    observer = make(sampling__period=1e-3 * milliseconds)
    found = listen(record, observer, milliseconds, wheel_delay=wheel)
    late = found["wheel_speed_delay"][-1] - found["engine_speed_delay"][-1]
    assert late == pytest.approx(1e-3 * wheel, abs=2e-3)
    assert found["lash_size"][-1] == pytest.approx(SIZE, rel=0.02)


def test_missing_frames_cost_accuracy_not_sense():
    record = driven(400.0, 2.0, 3, high=120.0)

    def spoil(frames):
        lost = np.random.default_rng(4).uniform(size=frames.shape[0]) < 0.1
        frames[lost, 1] = np.nan
        frames[np.roll(lost, 7), 2] = np.nan

    found = listen(record, make(), spoil=spoil)
    assert found["lash_size"][-1] == pytest.approx(2.0 * SIZE, rel=0.04)


@pytest.mark.parametrize("milliseconds", [10, 1])
@pytest.mark.parametrize(("which", "length"),
                         [((2,), 0.6), ((0,), 0.6), ((0, 2), 0.3), ((1,), 0.09), ((0, 1, 2), 0.06)])
def test_a_gap_of_any_signal_teaches_no_size(which, length, milliseconds):
    """Wheel speeds or torques that nobody measured were learnt from: sizes up to ten times the lash, and trusted."""
    record = driven(250.0, count=4)
    for begin in (5.34, 5.46, 6.5):  # before and in the third tip-in, and before its tip-out
        def spoil(frames, begin=begin):
            time = 1e-3 * milliseconds * np.arange(1, len(frames) + 1)
            lost = (time >= begin) & (time < begin + length)
            frames[np.ix_(lost, which)] = np.nan

        found = listen(record, make(), milliseconds, spoil=spoil)
        sure = (found["trusted"] == 1.0) & (found["time"] > 3.0)
        np.testing.assert_allclose(found["lash_size"][sure], SIZE, rtol=0.03)
        assert found["trusted"][-1] == 1.0 and found["traversals"][-1] >= 6.0


@pytest.mark.parametrize(("lash", "rate", "high"), [(3.0, 250.0, 200.0), (3.0, 500.0, 200.0), (2.0, 750.0, 200.0)])
def test_with_frames_of_1_ms_contact_is_not_told_early(lash, rate, high):
    """What is learnt from an interval of 1 ms is the pick-up of the output shaft: it was told up to 60 ms early."""
    record = driven(rate, lash, high=high)
    found = listen(record, make(), 1)
    start, end, _ = traversals(record)[0]
    told = found["time"][np.argmax(found["contact"] == 1.0)]
    assert -1e-3 < told - end < 0.03
    row = settled(found, end)
    assert found["traversal_time_low90"][row] < end - start < found["traversal_time_high90"][row]
    assert found["traversal_time"][row] == pytest.approx(end - start, rel=0.05)


@pytest.mark.parametrize("rate", [50.0, 20.0])
def test_with_short_frames_the_start_of_a_slow_traversal_is_still_kept(rate):
    """In frames of 0.5 ms; linear between those of 1 ms, as the speeds are."""
    full = plant("plant_fom", {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": 12.0}, gear=5,
                 engine_torque=-10.0)
    record = run(full, 0.5 + 50.0 / rate + 0.5,
                 engine_torque=lambda t: np.clip(-10.0 + np.clip(t + 1e-3 - 0.5, 0.0, None) * rate, -10.0, 40.0))
    start, end, _ = traversals(record)[0]
    time = 5e-4 * np.arange(1, 2 * record["time"].size)
    observer = make(sampling__period=5e-4)
    names = ("crankshaft_torque", "engine_speed", "wheel_speed")
    frames = np.column_stack([np.interp(time, record["time"], record[name]) for name in names]
                             + [np.zeros(time.size)] * 2)
    observer.values[:5] = frames[0]
    observer.initialize()
    outputs = observer.simulate(frames)
    found = {v.name: outputs[:, i] for i, v in enumerate(observer.output_variables)}
    row = int(np.searchsorted(time, end + 0.11))
    assert found["traversal_time_low90"][row] < end - start < found["traversal_time_high90"][row]
    assert abs(found["traversal_start"][row] - start) < 1.65 * found["traversal_start_deviation"][row]


@pytest.mark.parametrize(("period", "offset"), [(10, 0), (10, 3), (10, 7), (20, 0)])
def test_a_bus_that_holds_its_speeds_is_no_measurement_every_millisecond(period, offset):
    """A speed stands for 10 ms, then jumps within one: no torque does that. A size 16 % too large was trusted.

    The wheel's may come every 20 ms, too. Values that repeat are no missing ones all the same: see the next test.
    """
    record = driven(250.0, count=4)
    held = {}
    for name, every in (("engine_speed", 10), ("wheel_speed", period)):
        rows = np.maximum((np.arange(record["time"].size) - offset) // every * every + offset, 0)
        held[name] = record[name][rows]
    found = listen({**record, **held}, make(), 1)
    sure = (found["trusted"] == 1.0) & (found["time"] > 3.0)
    assert sure[-1]
    np.testing.assert_allclose(found["lash_size"][sure], SIZE, rtol=0.03)


@pytest.mark.parametrize("milliseconds", [10, 1])
def test_a_speed_that_stands_in_its_bits_is_measured_all_the_same(milliseconds):
    """0.25 1/min and 0.005 rad/s: many frames repeat the last value to the bit, and all of them count."""
    record = driven(250.0, count=4)
    bits = {name: np.round(record[name] / bit) * bit for name, bit in (("engine_speed", 0.026), ("wheel_speed", 0.005))}
    assert (np.diff(bits["wheel_speed"][::milliseconds]) == 0.0).mean() > 0.1
    found = listen({**record, **bits}, make(), milliseconds)
    sure = (found["trusted"] == 1.0) & (found["time"] > 3.0)
    assert sure.mean() > 0.5
    np.testing.assert_allclose(found["lash_size"][sure], SIZE, rtol=0.03)
    np.testing.assert_array_equal(found["trusted"][found["time"] > 3.0], 1.0)


def test_covariances_stay_symmetric_and_positive():
    record = driven(400.0, 1.0, 2, high=120.0)
    observer = make()
    listen(record, observer)
    n = dead_zone.N
    for m in range(dead_zone.BANK):
        at = dead_zone.COVARIANCES + n * n * m
        P = observer.state[at:at + n * n].reshape(n, n)
        np.testing.assert_allclose(P, P.T, rtol=1e-9, atol=1e-12)
        scale = np.sqrt(np.maximum(np.diag(P), 1e-30))
        assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-4


@pytest.mark.parametrize(("parameter", "value"), [("shaft.half_gap", 0.0), ("shaft.half_gap", 0.5),
                                                  ("gear.transmission_ratio", -2.0), ("sampling.period", 1e-4)])
def test_what_cannot_be_worked_with_is_named(parameter, value):
    observer = make()
    with pytest.raises(InputError, match=parameter):
        observer[parameter] = value
        observer.initialize()


@pytest.mark.parametrize(("milliseconds", "trusts"), [(1, True), (20, True), (30, False), (50, False)])
def test_with_few_frames_it_does_not_trust_itself(milliseconds, trusts):
    record = driven(250.0, count=2)
    found = listen(record, make(), milliseconds)
    assert found["trusted"][-1] == trusts
    assert not trusts or found["lash_size"][-1] == pytest.approx(2.0 * make()["shaft.half_gap"], rel=0.05)


def test_a_vehicle_without_lash_is_named():
    vehicle = load("pickup_10r80", "modified")
    values = {**vehicle.values, "transmission.half_gap": 0.0, "final_drive.half_gap": 0.0}
    observer = LashObserver(LashObserver.defaults_from(replace(vehicle, values=values)))
    with pytest.raises(InputError, match="shaft.half_gap is 0"):
        observer.initialize()


@pytest.mark.parametrize("name", ["engine_speed", "wheel_speed"])
def test_a_delay_that_is_longer_than_what_is_kept_is_refused(name):
    """Of frames of 0.5 ms it never began, and said nothing."""
    make(**{"sampling__period": 1e-3, f"delay__{name}": 0.045}).initialize()
    with pytest.raises(InputError, match=f"delay.{name} is 0.045 s: .* 0.0005 s at most 0.031 s are kept"):
        make(**{"sampling__period": 5e-4, f"delay__{name}": 0.045}).initialize()
