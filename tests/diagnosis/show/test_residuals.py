"""What is wrong is told, and nothing else is: on made-up recordings with known answers, and on hidden ones."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.gain.extend import read_off
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import STEP, FullOrderCar, Nuisance, Run
from cosim.diagnosis.show.residuals import SIGNIFICANT, _judge, _Row, coloured, wrong
from cosim.measured import load

CLOCKS = {"propeller_shaft_torque": np.arange(0.3, 6.9, 0.01), "wheel_speed": np.arange(0.3, 6.9, 0.02)}
TIME = STEP * np.arange(1, 7001)
DRAWS = 30


def driveline(random, frequency=6.0, lag=0.0, scatter=0.01):
    """Channels of a made-up driveline: a torque that steps and rings, and the wheel speed it makes; with noise."""
    frequency = frequency * (1.0 + scatter * random.standard_normal())
    size, rate = 1.0 + scatter * random.standard_normal(2)
    damping = 0.05 * np.exp(0.1 * random.standard_normal())

    def torque(time):
        t = np.maximum(time - 1.0, 0.0)
        swing = np.exp(-damping * 2.0 * np.pi * frequency * t) * np.cos(2.0 * np.pi * frequency * t)
        return size * np.where(time < 1.0, -30.0, 300.0 - 150.0 * (t > 0.0) * swing)

    speed = 40.0 + rate * np.cumsum(torque(TIME)) * STEP / 150.0
    return np.concatenate([torque(CLOCKS["propeller_shaft_torque"]) + random.normal(0.0, 2.0, 660),
                           np.interp(CLOCKS["wheel_speed"] - lag, TIME, speed) + random.normal(0.0, 0.02, 330)])


def recording(stacked, name="a"):
    drive = np.where(TIME < 1.0, -20.0, 200.0)
    return Run(name, "tip_in", 5, 0.0, drive[:, None], 15.0, CLOCKS,
               {"propeller_shaft_torque": stacked[:660], "wheel_speed": stacked[660:]})


class Nothing:
    """Random numbers that are all zero: the car as its file has it, without noise."""

    def standard_normal(self, size=None):
        return 0.0 if size is None else np.zeros(size)

    def normal(self, mean, deviation, size):
        return np.full(size, mean)


NOMINAL = driveline(Nothing())


def told(seed, runs=2, **truth):
    random = np.random.default_rng(seed)
    healthy = [[driveline(random) for _ in range(DRAWS)] for _ in range(runs)]
    recordings = [recording(driveline(random, **truth), f"run {i}") for i in range(runs)]
    return wrong(recordings, [NOMINAL] * runs, healthy)


def test_where_nothing_is_wrong_nothing_is_told():
    """One in a hundred is promised; noise alone must not make features differ either."""
    assert sum(bool(told(seed, runs=1)) for seed in range(30)) <= 1


def test_a_shuffle_frequency_is_told_first_with_its_size_between_the_bounds():
    listed = told(1, frequency=5.0)
    first = listed[0]
    assert (first.signal, first.feature) == ("propeller_shaft_torque", "shuffle frequency")
    assert first.what in {f"shuffle frequency {percent} % high" for percent in range(17, 24)}
    assert first.unit == "Hz"
    assert first.low90 < first.size < first.high90
    assert first.low90 < 6.0 - 5.0 < first.high90
    assert first.p_value < SIGNIFICANT
    assert "gear 5" in first.where and "in 2 of 2 recordings" in first.where
    assert set(first.as_json()) >= {"signal", "where", "what", "size", "unit", "p_value"}
    assert not [entry for entry in listed if entry.feature in ("lag", "amplitude")]  # what rings slower is not late


def test_a_late_sensor_is_told_alone():
    listed = told(2, lag=0.03)
    assert [(entry.signal, entry.feature) for entry in listed] == [("wheel_speed", "lag")]
    assert listed[0].low90 < -0.03 < listed[0].high90
    assert listed[0].what == f"measured {listed[0].measured * 1e3:.0f} ms later than simulated"


def test_what_is_off_a_little_in_every_recording_is_told_by_all_together():
    alone, together = ([bool(told(seed, runs=runs, frequency=6.22)) for seed in range(4)] for runs in (1, 6))
    assert sum(together) > sum(alone)


def test_bounds_hold_the_true_difference_as_often_as_they_say():
    held = []
    for seed in range(15):
        for entry in told(seed, runs=1, frequency=5.2):
            if entry.feature == "shuffle frequency":
                held.append(entry.low90 <= 6.0 - 5.2 <= entry.high90)
    assert len(held) == 15
    assert 0.7 <= np.mean(held) <= 1.0


def test_repeats_that_scatter_more_than_healthy_draws_widen_the_bounds():
    """Tip-ins whose frequencies differ by 10 %: the draws, at 1 %, are not believed, and two tell nothing then."""
    random = np.random.default_rng(3)
    healthy = [[driveline(random) for _ in range(DRAWS)] for _ in range(6)]

    def widest(*frequencies):
        runs = [recording(driveline(random, frequency=f, scatter=0.0), str(f)) for f in frequencies]
        listed = wrong(runs, [NOMINAL] * len(runs), healthy[:len(runs)])
        return [(e.high90 - e.low90, e.noise_floor) for e in listed if e.feature == "shuffle frequency"]

    [(same, quiet)], [(other, loud)] = widest(4.0, 4.01), widest(3.8, 4.2, 3.85, 4.15, 3.75, 4.25)
    assert other > 3.0 * same
    assert loud > 10.0 * quiet
    assert widest(3.8, 4.2) == []


def test_a_scale_from_two_repeats_is_believed_as_far_as_two_go():
    """Nothing is wrong, but from run to run features scatter 20 times as much as the draws say."""
    random, chances = np.random.default_rng(8), []
    for _ in range(600):
        shown = 20.0 * random.standard_normal(2)
        row = _Row(0, ("engine_speed", "lag"), float(shown[0]), 0.0, random.standard_normal(DRAWS))
        _judge(row, float(np.std(shown, ddof=1)), 1)
        chances += [row.p] * (row.freedom == 1.0)
    assert len(chances) > 500 and np.mean(np.array(chances) < 0.01) < 0.02


@pytest.mark.parametrize(("kind", "back", "wrongly"), [
    ("tip_in", True, True), ("tip_in", False, False), ("", False, True), ("drive", False, True)])
def test_the_way_back_other_roads_and_what_nobody_named_are_no_repeats(kind, back, wrongly):
    """A slope, once uphill and once downhill, is scatter only of what was driven the same way twice."""
    random = np.random.default_rng(9)
    healthy = [[driveline(random) for _ in range(DRAWS)] for _ in range(2)]
    runs = []
    for slope, way in ((0.3, False), (-0.3, back)):
        shown = driveline(random, scatter=0.0)
        shown[660:] -= slope * CLOCKS["wheel_speed"]
        runs.append(replace(recording(shown), kind=kind, back=way))
    assert ("drift" in {entry.feature for entry in wrong(runs, [NOMINAL] * 2, healthy)}) is wrongly


def test_ripple_is_told_at_the_order_at_which_the_engine_fires():
    random, clock = np.random.default_rng(10), np.arange(0.3, 6.9, 0.002)
    key, clocks = ("engine_speed", "firing order content"), {"engine_speed": clock}

    def shown(amplitude):
        angle = 150.0 * clock + 2.0 * clock**2
        return 150.0 + 4.0 * clock + amplitude * np.sin(4.0 * angle) + random.normal(0.0, 0.1, clock.size)

    measured, nominal = shown(1.0), 150.0 + 4.0 * clock
    run = replace(recording(NOMINAL), clocks=clocks, measured={"engine_speed": measured})
    healthy = [[shown(0.0) for _ in range(DRAWS)]]
    for order, there in ((4.0, True), (3.0, False)):
        told = [(entry.signal, entry.feature) for entry in wrong([run], [nominal], healthy, order)]
        assert (key in told) is there
    [row] = read_off(run, nominal, measured, [key], 4.0)
    assert row["measured"] == row["after"] == pytest.approx(1.0, rel=0.05) and row["before"] < 0.01


def test_noise_floor_of_a_recording_without_repeats_is_its_noise():
    """Of a lag, from resampled noise: the scatter of the lag over many recordings of one car."""
    listed = told(4, runs=1, lag=0.03)
    random = np.random.default_rng(5)
    many = [told_lag(random) for _ in range(20)]
    assert listed[0].noise_floor == pytest.approx(np.std(many), rel=1.0)


def told_lag(random):
    from cosim.diagnosis.show.features import Reader

    stacked = driveline(random, lag=0.03, scatter=0.0)
    return Reader(recording(stacked), NOMINAL).read(stacked)[("wheel_speed", "lag")]


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.9])
def test_effective_samples_and_whiteness_of_coloured_noise(keep):
    """Of an autoregression of order one: n (1 - a) / (1 + a)."""
    noise = lfilter([1.0], [1.0, -keep], np.random.default_rng(6).standard_normal(40_000))
    whiteness, effective = coloured(noise)
    assert effective == pytest.approx(noise.size * (1.0 - keep) / (1.0 + keep), rel=0.15)
    assert (whiteness < 1e-6) == (keep > 0.0)


def test_features_read_in_several_processes_are_the_same():
    """However they come back: whoever does it keeps their order."""
    random = np.random.default_rng(1)
    healthy = [[driveline(random) for _ in range(DRAWS)]]
    told_by = [recording(driveline(random, frequency=5.0))], [NOMINAL], healthy
    with ProcessPoolExecutor(2, multiprocessing.get_context("fork")) as pool:
        assert wrong(*told_by, each=pool.map) == wrong(*told_by)


def test_whiteness_of_white_noise_is_a_p_value():
    random = np.random.default_rng(7)
    found = np.array([coloured(random.standard_normal(400))[0] for _ in range(300)])
    assert np.mean(found < 0.1) == pytest.approx(0.1, abs=0.06)
    assert np.median(found) == pytest.approx(0.5, abs=0.1)


MANOEUVRES = ("tip_in:5", "tip_out:5")


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """What is wrong with a measurement that has effects hidden in it: (effects, seed) -> list."""

    def run(effects, seed, structure="same"):
        folder = tmp_path_factory.mktemp("hidden")
        hide(effects, seed, folder / "m", structure=structure, manoeuvres=MANOEUVRES, truth=folder / "truth.json")
        measurement = load(folder / "m")
        car = FullOrderCar(measurement.vehicle, measurement.variant)
        runs = [run.free for run in car.runs(measurement)]
        starts = [start_speed(car, run) for run in runs]
        nominal = [car.predict(car.values, run, Nuisance(start)) for run, start in zip(runs, starts)]
        return wrong(runs, nominal, healthy(car, runs, starts, np.random.default_rng(seed)))

    return run


def start_speed(car, run):
    """What fits the measured speeds best; one step of a linear fit, as it is nearly linear."""
    off = 0.05
    speeds = np.concatenate([np.arange(place.start, place.stop) for name, place in run.slices.items()
                             if name.endswith("speed")])
    base, other = (car.predict(car.values, run, Nuisance(x))[speeds] for x in (0.0, off))
    slope = (other - base) / off / run.stacked[speeds]
    return float(slope @ (1.0 - base / run.stacked[speeds]) / (slope @ slope))


def healthy(car, runs, starts, random, count=20):
    """Cars whose numbers are off by a fifth of what can be noticed, with wandering torque and noise."""
    drawn = [[] for _ in runs]
    for _ in range(count):
        values = dict(car.values)
        for effect in CATALOGUE.values():
            sizes = {p.name: float(np.clip(p.size(0.2 * p.detection * random.standard_normal()), *p.limits))
                     for p in effect.parameters}
            if all(car.knows(name) for name in effect.changes(sizes, values)):
                values |= effect.changes(sizes, values)
        for name in ("damper.stiffness", "transmission.stiffness", "seat.stiffness", "differential_case.stiffness",
                     "engine.air_lag", "engine.friction_constant", "final_drive.loss_constant",
                     "tyre.relaxation_length", "differential_case.damping"):
            values[name] *= np.exp(0.04 * random.standard_normal())
        coast = "asymmetric_friction.coast_loss_fraction"
        values[coast] = max(values[coast], -values["final_drive.loss_fraction"])  # teeth that lose do not drive
        for run, start, found in zip(runs, starts, drawn):
            wander = lfilter([0.14], [1.0, -0.99], random.standard_normal(len(run.inputs)))
            nuisance = Nuisance(start + 0.02 * random.standard_normal(), 1e-3 * random.standard_normal(),
                                random.standard_normal())
            shown = car.instruments(car.raw(values, run, nuisance, wander), values, run)
            for name, place in run.slices.items():
                quick = np.diff(run.measured[name], 3) / np.sqrt(20.0)
                noise = 0.74 * float(np.subtract(*np.percentile(quick, [75.0, 25.0])))
                shown[place] += noise * random.standard_normal(place.stop - place.start)
            found.append(shown)
    return drawn


def test_softer_shafts_are_told_by_the_shuffle_frequency(diagnosed):
    listed = diagnosed(["shaft_stiffness=axle_shaft_stiffness:0.75"], 7)
    assert listed[0].feature == "shuffle frequency"
    assert listed[0].what.endswith("high")
    assert listed[0].low90 > 0.0
    assert not [entry for entry in listed if entry.feature == "lag"]


def test_a_late_wheel_speed_is_told_by_its_lag_alone(diagnosed):
    listed = diagnosed(["wheel_speed_delay=30 ms"], 8)
    assert [(entry.signal, entry.feature) for entry in listed] == [("wheel_speed", "lag")]
    assert listed[0].low90 < -0.030 < listed[0].high90


def test_a_healthy_car_is_told_nothing_though_its_structure_is_another(diagnosed):
    assert diagnosed([], 4, "other") == []
