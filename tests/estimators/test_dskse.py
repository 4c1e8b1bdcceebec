"""Laws of the switched state estimator, and how well it does on the full-order plant."""

import functools

import numpy as np
import pytest
from runs import plant, run
from scipy.linalg import expm, solve_discrete_are

from driveline.estimators.dskse import Dskse
from driveline.estimators.lumped import measurement_matrix
from driveline.estimators.state_space import BACKLASH, CONTACT, Lumped, observability_matrix, scaled, twists
from driveline.vehicles import load

N = 6
SPEEDS = [1, 3]


def make(gear=5, period=0.01, **parameters):
    estimator = Dskse(Dskse.defaults_from(load("pickup_10r80", "modified"), gear))
    estimator["sampling.period"] = period
    for key, value in parameters.items():
        estimator[key.replace("__", ".")] = value
    return estimator


def columns(estimator, outputs):
    return {v.name: outputs[:, i] for i, v in enumerate(estimator.output_variables)}


def ramp(rate, low=-30.0, high=200.0):
    return lambda t: np.clip(low + np.clip(t + 1e-3 - 0.5, 0.0, None) * rate, low, high)


@functools.cache
def tip_in(rate, gear=5):
    """The full-order plant over a torque ramp of the crankshaft, without the air path's lag."""
    full = plant("plant_fom", {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": 12.0},
                 gear=gear, engine_torque=-30.0)
    return run(full, 1.5, engine_torque=ramp(rate))


def true_traversal(record):
    """Start and end of the lumped lash (section 2.2.2.2): the first leaves its flank, both reach theirs."""
    final, transmission = record["final_drive_contact"], record["transmission_contact"]
    end = np.argmax((final == 1.0) & (transmission == 1.0))
    apart = (final != -1.0) | (transmission != -1.0)
    start = end - np.argmin(apart[:end][::-1])
    return record["time"][start], record["time"][end]


def estimate(record, gear=5, milliseconds=10, phase=0, lash_size=0.0, **parameters):
    """The estimator over a record of the plant at 1 ms, taking frames every few milliseconds."""
    estimator = make(gear, milliseconds * 1e-3, **parameters)
    signals = np.column_stack([record[name] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")])
    estimator.values[:4] = *signals[phase], lash_size
    estimator.initialize()
    taken = np.arange(milliseconds - 1 + phase, len(signals), milliseconds)
    frames = np.column_stack([signals[taken], np.full(taken.size, lash_size)])
    found = columns(estimator, estimator.simulate(frames, record["time"][phase] - 1e-3))
    return found | {"time": record["time"][taken]}


def traversal_error(record, **options):
    """Error of the traversal's duration [%]; the first crossing from coast to drive."""
    found = estimate(record, **options)
    first = np.argmax(found["contact"] == 1.0)
    start, end = true_traversal(record)
    assert found["traversal_end"][first] == pytest.approx(found["time"][first])
    return 100.0 * (found["traversal_time"][first] / (end - start) - 1.0)


# ---- laws --------------------------------------------------------------------------------------------


def test_what_the_sensors_see_of_each_mode():
    """Contact: all but where twist and lash angle are together. Lash: the four states of eq. 3.18."""
    p = Lumped.of(make().parameters)
    ranks = []
    for mode in (CONTACT, BACKLASH):
        model = scaled(twists(p, mode), 50.0)
        ranks.append(np.linalg.matrix_rank(observability_matrix(model.A, measurement_matrix()), tol=1e-9))
    assert ranks == [5, 4]


@pytest.mark.parametrize("period", [1e-3, 1e-2])
def test_in_contact_it_settles_at_the_riccati_solution(period):
    """Variances after many frames, against scipy's for the five states that can be seen."""
    estimator = make(period=period, engine_torque=100.0, engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    frames = np.tile([100.0, 150.0, 29.81, 0.0], (3000, 1))
    found = columns(estimator, estimator.simulate(frames))
    model = twists(Lumped.of(estimator.parameters), CONTACT)
    joined = np.zeros((N + 2, N + 2))
    joined[:N] = np.hstack([model.A, model.B])
    a = expm(joined * period)[:N, :N]
    seen = np.eye(N)[:5]
    seen[0, 5] = -1.0
    small, c = seen @ a @ np.eye(N)[:, :5], measurement_matrix()[:, :5]
    q, r = np.diag([1e-2, 1e3, 5e-3, 4e-3, 1e-1, 1e-3]), np.diag([2e-5, 3e-5])
    p = solve_discrete_are(small.T, c.T, seen @ q @ seen.T, r)
    p = p - p @ c.T @ np.linalg.solve(c @ p @ c.T + r, c @ p)
    assert (found["contact"][-1000:] == 1.0).all()
    variances = [found[f"variance[{i}]"][-1] for i in range(1, 6)]
    np.testing.assert_allclose(variances, np.diag(p), rtol=1e-5)
    assert found["variance[6]"][-1] == 0.0  # on its flank


@pytest.mark.parametrize("torque", [-40.0, 120.0])
def test_it_starts_on_the_flank_that_the_torque_lies_on_with_all_masses_accelerating_alike(torque):
    estimator = make(engine_torque=torque, engine_speed=150.0, wheel_speed=0.0)
    p, parameters = Lumped.of(estimator.parameters), estimator.parameters
    estimator["wheel_speed"] = 150.0 / (p.i_tr * p.i_fdr)  # nothing twists
    estimator.initialize()
    x = np.array([estimator[v.name] for v in estimator.output_variables[:N]])
    assert x[5] == estimator["contact"] * parameters.shaft.half_gap and np.sign(torque) == estimator["contact"]
    gear, vehicle, speed = parameters.gear, parameters.vehicle, p.r_w * x[4]
    drive = torque - gear.loss_constant - gear.loss_viscous * 150.0
    resistance = vehicle.aerodynamic_factor * speed * speed + vehicle.rolling_resistance_force
    model = twists(p, CONTACT)
    change = model.A @ x + model.B @ np.array([drive, resistance])
    assert change[[0, 2]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert change[1] / (p.i_tr * p.i_fdr) == pytest.approx(change[3]) == pytest.approx(change[4])
    assert np.sign(change[4]) == np.sign(torque)


def reference(estimator, x, torques, period):
    """One page of the same driveline: two linear modes, switched where eq. 3.32 and 3.33 say, from x on."""
    p, parameters = Lumped.of(estimator.parameters), estimator.parameters
    gear, vehicle, alpha = parameters.gear, parameters.vehicle, parameters.shaft.half_gap
    steps = {}
    for mode in (CONTACT, BACKLASH):
        model = twists(p, mode)
        joined = np.zeros((N + 2, N + 2))
        joined[:N] = np.hstack([model.A, model.B])
        steps[mode] = expm(joined * period)[:N]

    def shaft(x):
        return p.k_s * (x[0] - x[5]) + p.c_s * (x[1] / p.i_tr - p.i_fdr * x[3])

    side, states = np.sign(x[5]), []
    for before, now in zip(torques[:-1], torques[1:], strict=True):
        carried = shaft(x) if side else 0.0
        drive = (0.5 * (before + now) - gear.loss_constant - gear.loss_viscous * x[1]
                 - gear.loss_fraction * abs(carried))
        speed = p.r_w * x[4]
        load = vehicle.aerodynamic_factor * speed * abs(speed) + vehicle.rolling_resistance_force
        x = steps[CONTACT if side else BACKLASH] @ np.concatenate([x, [drive, load]])
        if side and side * shaft(x) <= 0.0:
            side = 0.0
        elif not side and abs(x[5]) >= alpha:
            x[5] = np.sign(x[5]) * alpha
            side = np.sign(x[5]) if np.sign(x[5]) * shaft(x) > 0.0 else 0.0
        states.append(np.append(x, side))
    return np.array(states)


@pytest.mark.parametrize("period", [1e-3, 5e-3, 1e-2])
def test_exact_when_the_plant_is_the_model_and_there_is_no_noise(period):
    count = round(3.0 / period)
    torques = -40.0 + 200.0 * np.clip(np.sin(np.arange(count + 1) * period * 4.0), -0.3, 0.7)
    estimator = make(period=period, engine_torque=torques[0], engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    x0 = np.array([estimator[v.name] for v in estimator.output_variables[:N]])
    truth = reference(estimator, x0, torques, period)
    frames = np.column_stack([torques[1:], truth[:, SPEEDS], np.zeros(count)])
    outputs = estimator.simulate(frames)
    np.testing.assert_array_equal(outputs[:, 12], truth[:, N])
    np.testing.assert_allclose(outputs[:, :N], truth[:, :N], rtol=1e-9, atol=1e-10)
    assert set(truth[:, N]) == {-1.0, 0.0, 1.0}
    assert outputs[-1, 16] < 1e-12


def test_covariance_stays_symmetric_and_positive_through_switching():
    estimator = make(engine_torque=-40.0, engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    rng, modes = np.random.default_rng(8), set()
    for step in range(600):
        torque = 150.0 * np.sin(step * 0.1)
        frame = [torque, 150.0 + 2.0 * np.sin(step * 0.1 - 1.0) + rng.normal(0.0, 0.3), 29.81 + rng.normal(0.0, 0.1)]
        if rng.random() < 0.1:
            frame[rng.integers(3)] = np.nan
        estimator.simulate(np.array([[*frame, rng.choice([0.0, 0.05, 0.3])]]))
        modes.add(estimator["contact"])
        covariance = estimator.state[1 + N:1 + N + N * N].reshape(N, N)
        np.testing.assert_array_equal(covariance, covariance.T)
        scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > -1e-9
    assert modes == {-1.0, 0.0, 1.0}


def test_lash_stays_between_its_flanks_and_stands_on_one_in_contact():
    found = estimate(tip_in(250))
    half_gap = make()["shaft.half_gap"]
    assert np.abs(found["lash_position"]).max() <= half_gap
    touching = found["contact"] != 0.0
    np.testing.assert_array_equal(found["lash_position"][touching], found["contact"][touching] * half_gap)


def test_a_new_lash_size_moves_the_flank_and_no_torque():
    estimator = make(engine_torque=100.0, engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    frame = np.array([[100.0, 150.0, 29.81, 0.0]])
    for _ in range(50):
        estimator.simulate(frame)
    before = estimator["shaft_twist"] - estimator["lash_position"]
    speed = estimator["tyre_speed"]
    frame[0, 3] = 0.3
    estimator.simulate(frame)
    assert estimator["lash_position"] == 0.15
    assert estimator["shaft_twist"] - 0.15 == pytest.approx(before, rel=0.05)
    assert estimator["tyre_speed"] == pytest.approx(speed, rel=1e-4)


def test_leaving_a_flank_and_coming_back_is_no_traversal():
    estimator = make(engine_torque=-40.0, engine_speed=150.0, wheel_speed=29.81)
    estimator.initialize()
    torques = np.concatenate([np.full(20, -40.0), np.full(5, 25.0), np.full(60, -60.0)])
    x0 = np.array([estimator[v.name] for v in estimator.output_variables[:N]])
    truth = reference(estimator, x0, np.append(-40.0, torques), 0.01)
    frames = np.column_stack([torques, truth[:, SPEEDS], np.zeros(torques.size)])
    found = columns(estimator, estimator.simulate(frames))
    assert 0.0 in found["contact"] and 1.0 not in found["contact"] and found["contact"][-1] == -1.0
    assert not found["traversal_time"].any()


# ---- the full-order plant ----------------------------------------------------------------------------


@pytest.mark.parametrize(("milliseconds", "bound"), [(10, 14.29), (5, 14.29), (1, 5.59)])
def test_traversal_time_on_the_validation_ramp(milliseconds, bound):
    """Tables 3.3 and 3.4, wherever the frames fall."""
    start, end = true_traversal(tip_in(250))
    assert end - start == pytest.approx(0.13, abs=0.005)
    for phase in range(0, milliseconds, 3):
        assert abs(traversal_error(tip_in(250), milliseconds=milliseconds, phase=phase)) <= bound


@pytest.mark.parametrize(("milliseconds", "bound"), [(10, 9.0), (1, 4.0)])
def test_mean_error_over_ramps(milliseconds, bound):
    errors = [abs(traversal_error(tip_in(rate), milliseconds=milliseconds, phase=phase))
              for rate in (200, 300, 500, 700, 1000) for phase in range(0, milliseconds, 5)]
    assert np.mean(errors) <= bound


def test_speeds_are_those_measured():
    """Table 3.3: within 2.5e-8 % for the engine and 1e-5 % for the wheels."""
    record = tip_in(250)
    found = estimate(record)
    taken = np.searchsorted(record["time"], found["time"] - 1e-6)
    for name, bound in (("engine_speed", 2.5e-10), ("wheel_speed", 1e-7)):
        assert np.abs(found[f"{name}_estimate"] / record[name][taken] - 1.0).max() <= bound
    assert (found["trusted"] == 1.0).all()


def test_sixth_gear():
    """Figure 3.24: only the gear's numbers differ."""
    assert abs(traversal_error(tip_in(250, 6), gear=6)) <= 14.29
    assert traversal_error(tip_in(250, 6), gear=6, milliseconds=1) == pytest.approx(0.0, abs=9.0)


def test_wrong_on_purpose_is_noticed():
    """A driveline in another gear, a wheel speed 2 % off, a stuck engine speed."""
    record = tip_in(250)
    assert not estimate(record, gear=6)["trusted"][-1]
    assert not estimate(record | {"wheel_speed": 1.02 * record["wheel_speed"]})["trusted"][-1]
    stuck = np.where(record["time"] > 0.7, record["engine_speed"][700], record["engine_speed"])
    assert not estimate(record | {"engine_speed": stuck})["trusted"].all()


@pytest.mark.parametrize("milliseconds", [10, 1])
def test_after_a_gap_in_which_the_torque_reversed_it_starts_anew(milliseconds):
    """It hung in the lash for more than a second, on the wrong side, and trusted itself."""
    full = plant("plant_fom", {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": 15.0}, gear=5,
                 engine_torque=200.0)
    record = run(full, 3.0, engine_torque=lambda t: np.clip(200.0 - np.clip(t + 1e-3 - 0.5, 0.0, None) * 250.0,
                                                            -30.0, 200.0))
    true = np.where(record["final_drive_contact"] == record["transmission_contact"], record["final_drive_contact"], 0.0)
    estimator = make(period=milliseconds * 1e-3)
    signals = np.column_stack([record[name] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")])
    estimator.values[:3] = signals[0]
    taken = np.arange(milliseconds - 1, len(signals), milliseconds)
    for begin in np.arange(0.9, 1.5, 0.05):
        estimator.initialize()
        frames = np.column_stack([signals[taken], np.zeros(taken.size)])
        time = record["time"][taken]
        frames[(time >= begin) & (time < begin + 0.5), :3] = np.nan
        found = columns(estimator, estimator.simulate(frames))
        after = time >= begin + 0.5
        wrong = after & (found["contact"] != true[taken]) & (found["trusted"] > 0.0)
        assert wrong.sum() * milliseconds <= 100
        assert found["trusted"][after][0] == 0.0 and found["trusted"][-1] == 1.0


def test_a_traversal_that_ends_in_a_gap_is_not_told():
    """Its end was predicted, up to 80 ms late, and stood there as that of the last traversal, trusted again."""
    record = tip_in(250)
    signals = np.column_stack([record[name] for name in ("crankshaft_torque", "engine_speed", "wheel_speed")])
    frames = np.column_stack([signals, np.zeros(len(signals))])[9::10]
    time, whole = record["time"][9::10], estimate(record)["traversal_end"][-1]
    for begin in np.arange(whole - 0.13, whole, 0.02):
        estimator = make()
        estimator.values[:3] = signals[0]
        estimator.initialize()
        lost = np.where(((time >= begin) & (time < begin + 0.3))[:, np.newaxis], np.nan, frames)
        lost[:, 3] = 0.0
        found = columns(estimator, estimator.simulate(lost))
        assert found["trusted"][-1] == 1.0
        end = found["traversal_end"][-1]
        assert end == 0.0 or (begin > whole - 0.06 and end == pytest.approx(whole, abs=0.0101))


def test_stiffness_wrong_on_purpose_moves_the_start():
    """Section 3.4.1: the start of the traversal is sensitive to the shaft's stiffness, its end is not."""
    record, right = tip_in(400), make()
    found = [estimate(record, shaft__stiffness=factor * right["shaft.stiffness"]) for factor in (1.0, 1.5)]
    first = [np.argmax(each["contact"] == 1.0) for each in found]
    ends = [each["traversal_end"][i] for each, i in zip(found, first, strict=True)]
    starts = [each["traversal_start"][i] for each, i in zip(found, first, strict=True)]
    assert starts[1] < starts[0] - 5e-3
    assert abs(ends[1] - ends[0]) < 0.0101


def test_rolling_resistance_resists_in_reverse_too():
    """Backwards it pushed until it had a sign, and what that left over was held against the engine."""
    full = plant("plant_fom", {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": -3.0}, gear=-1,
                 engine_torque=40.0)
    found = estimate(run(full, 3.0), gear=-1)
    without = estimate(run(full, 3.0), gear=-1, vehicle__rolling_resistance_force=0.0)
    assert np.mean(found["unexplained_torque"][100:]) < np.mean(without["unexplained_torque"][100:])


def test_in_reverse_drive_lies_on_the_other_flank():
    """It asks for no forward gear: torque and speed come with their signs. The others look for drive on flank 1.

    A lash is crossed as late as in first gear, whose ratio is alike.
    """
    late = {}
    for gear, drive in ((1, 1.0), (-1, -1.0)):
        full = plant("plant_fom", {"engine.air_lag": 0.0, "engine.air_delay": 0.0, "start.vehicle_speed": 4.0 * drive},
                     gear=gear, engine_torque=-30.0)
        record = run(full, 2.0, engine_torque=ramp(250))
        found = estimate(record, gear=gear)
        assert (found["contact"][20], found["contact"][-1]) == (-drive, drive)
        assert (record["final_drive_contact"][200], record["final_drive_contact"][-1]) == (-drive, drive)
        assert (found["trusted"] == 1.0).all()
        crossed = np.argmax((record["final_drive_contact"] == drive) & (record["transmission_contact"] != 0.0))
        late[gear] = found["traversal_end"][-1] - record["time"][crossed]
    assert late[-1] == pytest.approx(late[1], abs=0.0101) and 0.0 <= late[-1] <= 0.05
