"""Benches under diagnosis: inverse dynamics against equations written down, made-up recordings, and measured ones."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.benches.bench import _wrong, diagnose_bench
from cosim.diagnosis.benches.inverse import Inverse
from cosim.diagnosis.catalogue import CATALOGUE, effect, shown_by
from cosim.diagnosis.diagnose import diagnose
from cosim.diagnosis.fit.regression import block_sums, dependence, least_squares, paired, relative_error
from cosim.diagnosis.judge.finding import joint_probability
from cosim.diagnosis.plants import STEP, Bench, FullOrderCar, SingleMass, plant_for
from cosim.diagnosis.plants.band import Band
from cosim.measured import Channel, Manoeuvre, Measurement, load
from driveline.quantities import InputError

MEASURED = Path(__file__).parents[4] / "shared" / "measured"
needs_data = pytest.mark.skipif(not MEASURED.is_dir(), reason="no ../shared/measured beside the checkout")

DYNO = """vehicle = "dyno_5nm"
[channels.time]
column = "time_s"
[channels.motor_torque]
column = "motor_torque_nm"
unit = "N.m"
[channels.motor_speed]
column = "motor_speed_rad_s"
unit = "rad/s"
[channels.motor_position]
column = "motor_position_rad"
unit = "rad"
[channels.inline_torque]
column = "inline_torque_nm"
unit = "N.m"
"""
EMPS = """vehicle = "emps"
[channels.time]
column = "time_s"
[channels.position]
column = "position_m"
unit = "m"
[channels.force]
column = "drive_voltage_v"
unit = "N"
factor = 35.150651882485
"""
TAHOE = """vehicle = "suv_6l80"
[channels.time]
column = "time_s"
[channels.engine_torque]
column = "engine_torque_nm"
unit = "N.m"
[channels.turbine_speed]
column = "turbine_speed_rpm"
unit = "rpm"
[channels.engine_speed]                 # turbine speed and slip, twice their mean
column = ["turbine_speed_rpm", "converter_slip_rpm"]
unit = "rpm"
factor = 2
[channels.vehicle_speed]
column = "vehicle_speed_mph"
unit = "mph"
[channels.gear]
column = "gear"
unit = "1"
[channels.brake_torque]                 # how much is not known; that they brake is
column = "brake_pressure_kpa"
unit = "N.m"
"""


def measurement(folder, text, *files, kind="bench"):
    """A user's folder that points at measured data."""
    for file in files:
        text += f"[[manoeuvre]]\nfile = '{MEASURED / file}.csv.gz'\nkind = '{kind}'\n"
    (folder / "measurement.toml").write_text(text, encoding="utf-8")
    return load(folder)


def named(finding):
    """What explains it together, if that is probable; all probabilities add up to no more than 1."""
    assert sum(cause["probability"] for cause in finding["causes"]) <= 1.0
    return finding["together"] if joint_probability(finding, finding["together"]) > 0.5 else []


def parameter(finding, name):
    return next(c["parameters"][name] for c in finding["causes"] if name in c["parameters"])


# -- which plant, which effects --------------------------------------------------------------------------


def test_the_vehicle_file_says_which_plant(tmp_path):
    for vehicle, kind in (("pickup_10r80", FullOrderCar), ("dyno_5nm", Bench), ("emps", SingleMass)):
        (tmp_path / "a.csv").write_text("time,gear\n0,1\n1,1\n", encoding="utf-8")
        (tmp_path / "measurement.toml").write_text(f'vehicle = "{vehicle}"\n[[manoeuvre]]\nfile = "a.csv"\n',
                                                   encoding="utf-8")
        assert type(plant_for(load(tmp_path))) is kind
    (tmp_path / "nothing.toml").write_text('[seat]\nmass = { value = 80, unit = "kg", source = "scales" }\n',
                                           encoding="utf-8")
    (tmp_path / "measurement.toml").write_text('vehicle = "nothing.toml"\n[[manoeuvre]]\nfile = "a.csv"\n',
                                               encoding="utf-8")
    with pytest.raises(InputError, match=r"has the tables seat.*\[motor_bearing\]"):
        plant_for(load(tmp_path))


def test_a_car_shows_the_whole_catalogue_as_it_is_and_a_bench_what_it_has():
    assert {name: one.parameters for name, one in shown_by(FullOrderCar("pickup_10r80").knows).items()} == {
        name: one.parameters for name, one in CATALOGUE.items()}
    bench = shown_by(Bench("dyno_5nm").knows)
    assert {"wheel_inertia", "engine_inertia", "torque_meter_offset", "shaft_stiffness"} <= set(bench)
    assert not {"vehicle_mass", "backlash_size", "tyre_slip", "wheel_speed_delay", "road_grade"} & set(bench)
    assert [p.targets for p in bench["wheel_inertia"].parameters] == [("hub.inertia",)]
    assert [p.name for p in bench["torque_meter_offset"].parameters] == ["inline_torque_offset"]
    carriage = shown_by(SingleMass("emps").knows)
    assert {"vehicle_mass", "asymmetric_friction", "coulomb_drag", "driveline_damping"} <= set(carriage)
    assert not {"wheel_inertia", "torque_meter_gain"} & set(carriage)


def test_elsewhere_an_effect_names_values_that_some_bench_has_and_no_car():
    car, benches = FullOrderCar("pickup_10r80"), (Bench("dyno_5nm"), SingleMass("emps"))
    for one in CATALOGUE.values():
        for p in one.elsewhere:
            for target in p.targets:
                assert any(bench.knows(target) for bench in benches), target
                assert target not in car.values
            assert p.limits[0] <= p.neutral <= p.limits[1]
            (plant,) = (bench for bench in benches if bench.knows(p.targets[0]))
            changed = shown_by(plant.knows)[one.name].changes({p.name: p.limits[1]}, plant.values)
            assert {name: changed[name] for name in p.targets} == {
                name: p.applied(p.limits[1], plant.values.get(name, p.neutral)) for name in p.targets}


def test_what_a_bench_cannot_do_without_is_said(tmp_path, made_up):
    plant, _ = made_up(tmp_path, seconds=12.0)
    text = (tmp_path / "measurement.toml").read_text(encoding="utf-8")
    for channel, message in (("motor_torque", "no channel 'motor_torque'"), ("motor_position", "shows no motion")):
        (tmp_path / "measurement.toml").write_text(
            text.replace(f'[channels.{channel}]\ncolumn = "{channel}"\n', ""), encoding="utf-8")
        with pytest.raises(InputError, match=message):
            plant.runs(load(tmp_path))


def test_what_was_repaired_as_it_was_read_is_among_the_notices(tmp_path, made_up):
    made_up(tmp_path, seconds=12.0)
    rows = (tmp_path / "bench.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "bench.csv").write_text("".join([*rows[:100], rows[99], *rows[100:]]), encoding="utf-8")
    said = []
    notices = diagnose(tmp_path, say=said.append).finding["notices"]
    assert "bench.csv: column 'inline_torque': 1 repeated instants, the first value was kept" in notices
    assert not any("repeated" in text for text in said)  # a warning was it when it was read


# -- inverse dynamics ------------------------------------------------------------------------------------


def test_the_needed_torques_are_those_of_the_equations_of_motion(tmp_path, made_up):
    """Two ways: through the assembled plant, and written down."""
    plant, runs = made_up(tmp_path, seconds=12.0)
    values = plant.values | {"engine.torque_gain": 0.8, "engine.torque_offset": 0.02, "engine.air_delay": 0.0,
                             "load_bearing.damping": 1e-4, "observe.inline_torque.gain": 1.3,
                             "observe.inline_torque.offset": -0.05}
    motion = plant.motion(runs[0], values)
    needed = plant.torques(values, runs[0], motion)
    v, a = motion.speed, motion.acceleration
    inline = 2.82e-5 * a + 7e-4 * np.sign(v) + 1e-4 * v
    motor = (inline + 8.26e-5 * a + 0.0227 * np.sign(v) + 5.2e-4 * v - 0.02) / 0.8
    assert needed["inline_torque"] == pytest.approx(1.3 * inline - 0.05, rel=1e-6, abs=1e-9)
    assert needed["motor_torque"] == pytest.approx(motor, rel=1e-6, abs=1e-9)
    late = plant.torques(values | {"engine.air_delay": 0.05}, runs[0], motion)["motor_torque"]
    assert late[:-50] == pytest.approx(needed["motor_torque"][50:], rel=1e-9)  # asked for before it acts


def test_simulated_with_the_needed_torque_the_bench_moves_as_measured(tmp_path, made_up):
    plant, runs = made_up(tmp_path, seconds=12.0)
    run = plant.runs(load(tmp_path), longest=3.0)[1]
    motion = plant.motion(run, plant.values)
    driven = dataclasses.replace(run, inputs=plant.torques(plant.values, run, motion)["motor_torque"][:, None])
    raw = plant.raw(plant.values, driven)
    assert np.std(raw["motor_speed"][:-1] - motion.speed[1:]) < 0.01 * np.std(motion.speed)
    stacked = plant.predict(plant.values, driven)
    assert stacked.shape == run.stacked.shape
    assert stacked[run.slices["motor_position"]] == pytest.approx(run.measured["motor_position"], abs=0.5)


def test_a_band_keeps_phase_and_size_below_its_edge_and_nothing_above():
    time = np.arange(0.0, 20.0, 1e-3)
    band = Band()
    kept = band.thinned(time, 1e-3, 0.5)
    for frequency in (0.5, 5.0):
        wave = np.sin(2.0 * np.pi * frequency * time)
        assert band.of(wave, 1e-3, 0.5) == pytest.approx(np.sin(2.0 * np.pi * frequency * kept), abs=0.22)
        phase = np.angle(np.sum(band.of(wave, 1e-3, 0.5) * np.exp(-2j * np.pi * frequency * kept)))
        assert phase == pytest.approx(-0.5 * np.pi, abs=0.02)
    assert np.abs(band.of(np.sin(2.0 * np.pi * 40.0 * time), 1e-3, 0.5)).max() < 1e-3
    assert band.of(np.full(time.size, 3.0), 1e-3, 0.5) == pytest.approx(3.0, abs=1e-6)
    assert Band.sampled(1e-3).edge == 20.0 and Band.sampled(0.01).edge == pytest.approx(10.0)


def test_blocks_decide_by_how_often_not_by_how_much():
    random = np.random.default_rng(1)
    before = random.uniform(1.0, 100.0, 24)
    assert paired(before, 0.9 * before * random.uniform(0.97, 1.03, 24)) < 1e-6
    assert paired(before, before * random.lognormal(0.0, 0.1, 24)) > 0.01
    assert paired(before, 1.1 * before * random.uniform(0.97, 1.03, 24)) > 0.99
    assert block_sums(np.ones(50), 8).tolist() == [6.0] * 7 + [8.0]
    white = random.standard_normal(4000)
    assert dependence(white) < 1.3
    assert dependence(np.convolve(white, np.ones(4) / 2.0, "same")) == pytest.approx(4.0, rel=0.25)


# -- made-up recordings ----------------------------------------------------------------------------------


def test_nothing_wrong_is_none(tmp_path, made_up):
    plant, runs = made_up(tmp_path)
    found = diagnose_bench(plant, runs[:-1], runs[-1:])
    assert found.finding["verdict"] == "none" and not found.finding["causes"] and not found.finding["wrong"]


def test_heavier_load_and_a_zero_are_named_with_their_sizes_and_the_gain_is_there(tmp_path, made_up):
    plant, runs = made_up(tmp_path, inertia=4.0e-5, zero=0.02)
    found = diagnose_bench(plant, runs[:-1], runs[-1:])
    assert found.finding["verdict"] == "cause"
    assert set(named(found.finding)) == {"wheel_inertia", "torque_meter_offset"}
    for name, true in (("wheel_inertia", 4.0e-5), ("inline_torque_offset", 0.02)):
        p = parameter(found.finding, name)
        assert p["value"] == pytest.approx(true, rel=0.05)
        assert p["low90"] - 0.01 * true < true < p["high90"] + 0.01 * true
    assert found.values["hub.inertia"] == pytest.approx(4.0e-5, rel=0.05)
    assert {row["signal"] for row in found.finding["wrong"]} == {"motor_torque", "inline_torque"}
    for row in found.finding["gain"]["held_out"]:
        assert row["nrmse_after"] < 0.6 * row["nrmse_before"]
    assert found.finding["gain"]["fraction_of_noise_floor"] < 1.2


def test_a_bench_is_not_judged_where_frames_were_lost(tmp_path, made_up):
    """Every few seconds a tenth of one: nothing is asked of a motion that was bent through such gaps."""
    lost = [(begin, begin + 0.1) for begin in (3.0, 6.5, 7.5, 11.0, 16.1, 20.3, 24.0, 29.5, 33.0, 36.6)]
    plant, runs = made_up(tmp_path, inertia=4.0e-5, zero=0.02, lost=lost)
    spans = [(run.start, run.start + STEP * len(run.inputs)) for run in runs]
    assert len(runs) == 10 and all(end <= b + 0.01 or begin >= e - 0.01 for begin, end in spans for b, e in lost)
    found = diagnose_bench(plant, runs[:-1], runs[-1:])
    assert set(named(found.finding)) == {"wheel_inertia", "torque_meter_offset"}
    assert parameter(found.finding, "wheel_inertia")["value"] == pytest.approx(4.0e-5, rel=0.05)
    assert found.finding["gain"]["fraction_of_noise_floor"] < 1.2


def test_a_bench_that_is_never_whole_for_long_is_refused(tmp_path, made_up):
    with pytest.raises(InputError, match="'bench': 2 s without lost frames are needed where samples are 10 ms"):
        made_up(tmp_path, lost=[(begin, begin + 0.1) for begin in np.arange(1.0, 40.0, 1.5)])


def slow_carriage(interval, lost=(), seconds=40.0):
    """A carriage as its file has it, whose force reads 6 N too much, sampled every ``interval`` [s]."""
    time = np.arange(0.0, seconds, interval)
    for begin, end in lost:
        time = time[(time < begin) | (time > end)]
    rate, random = 1.5, np.random.default_rng(0)
    angle, speed = rate * time, 0.1 * rate * np.cos(rate * time)
    force = 95.1 * -0.1 * rate**2 * np.sin(angle) + 203.5 * speed + 20.4 * np.sign(speed) - 3.16 + 6.0
    force += 0.3 * random.standard_normal(time.size)
    position = 0.1 * np.sin(angle) + 1e-6 * random.standard_normal(time.size)
    channels = {name: Channel(name, unit, time, values, name)
                for name, unit, values in (("force", "N", force), ("position", "m", position))}
    return Measurement("slow", "emps", None, (Manoeuvre("a", "bench", None, channels),))


@pytest.mark.parametrize(("interval", "lost"), [
    (0.02, [(2.25, 2.45)]), (0.05, [(5.05, 5.35)]), (0.1, [])])
def test_a_bench_that_is_sampled_slowly_is_judged_on_long_pieces(interval, lost):
    """What a filter leaves of a piece at either end grows with the interval; once nothing was left."""
    found = slow_carriage(interval, lost)
    plant = plant_for(found)
    runs = plant.runs(found)
    assert all(STEP * len(run.inputs) > 2.5 * Inverse(plant, runs).trim for run in runs)
    finding = diagnose_bench(plant, runs[:-1], runs[-1:]).finding
    assert "engine_torque_offset" in finding["together"]


def test_a_slow_bench_that_is_never_whole_for_long_is_refused():
    found = slow_carriage(0.02, [(begin, begin + 0.3) for begin in np.arange(2.2, 40.0, 2.5)])
    with pytest.raises(InputError, match="'a': 3.6 s without lost frames are needed where samples are 20 ms apart; "
                                         "there are no more than 2.18 s"):
        plant_for(found).runs(found)


@pytest.mark.parametrize("order", ["with, without", "without, with"])
def test_recordings_of_a_bench_may_have_different_channels(tmp_path, order, made_up):
    """One without the inline sensor takes nothing from what the other shows of it, and says what it can."""
    runs = []
    for i, inline in enumerate((True, False) if order == "with, without" else (False, True)):
        (tmp_path / str(i)).mkdir()
        plant, cut = made_up(tmp_path / str(i), inertia=4.0e-5, zero=0.02, inline=inline, seed=i)
        runs += [dataclasses.replace(run, name=f"{i} {run.name}") for run in cut]
    found = diagnose_bench(plant, runs[:-1], runs[-1:])
    assert set(named(found.finding)) == {"wheel_inertia", "torque_meter_offset"}
    assert parameter(found.finding, "wheel_inertia")["value"] == pytest.approx(4.0e-5, rel=0.05)
    assert {row["signal"]: row["where"][0] for row in found.finding["wrong"]}["inline_torque"] == (
        "0" if order == "with, without" else "1")
    assert {run for run, channel in found.traces if channel == "inline_torque"} == {
        run.name for run in runs if "inline_torque" in run.clocks}


def test_the_gain_is_measured_on_channels_that_were_diagnosed(tmp_path, made_up):
    plant, runs = made_up(tmp_path, inertia=4.0e-5)
    without = [dataclasses.replace(run, clocks={n: c for n, c in run.clocks.items() if n != "inline_torque"})
               for run in runs[:-1]]
    finding = diagnose_bench(plant, without, runs[-1:]).finding
    assert {row["signal"] for row in finding["gain"]["held_out"]} == {"motor_torque"}


def test_an_error_that_is_smaller_than_it_has_to_be_is_not_wrong(tmp_path, monkeypatch, made_up):
    """Most blocks are predicted better with everything, one is very much worse."""
    plant, runs = made_up(tmp_path)
    inverse = Inverse(plant, runs)
    file = np.random.default_rng(0).uniform(1.0, 1.1, (400, 2))
    everything = 0.8 * file
    everything[0] = 200.0
    monkeypatch.setattr(inverse, "predicted_errors", lambda effects, exact=(): everything if effects else file)
    assert paired(file[:, 0], everything[:, 0]) < 1e-6 and np.mean(everything) > 1.2 * np.mean(file)
    assert not [row for row in _wrong(inverse) if "larger" in row["what"]]


def test_a_rotor_is_told_from_a_load_by_the_inline_sensor_and_by_nothing_else(tmp_path, made_up):
    plant, runs = made_up(tmp_path, rotor=10.5e-5)
    assert named(diagnose_bench(plant, runs).finding) == ["engine_inertia"]
    (tmp_path / "b").mkdir()
    plant, runs = made_up(tmp_path / "b", rotor=10.5e-5, inline=False)
    finding = diagnose_bench(plant, runs).finding
    assert finding["verdict"] == "ambiguous"
    one = {finding["causes"][0]["effect"]} | {e for rival in finding["ambiguous_with"] for e in rival["effects"]}
    assert {"engine_inertia", "wheel_inertia"} <= one
    assert all(rival["separation_sigma"] < 3.0 for rival in finding["ambiguous_with"])
    assert all(set(rival["in_place_of"]) <= set(finding["together"]) for rival in finding["ambiguous_with"])
    assert sum(c["probability"] for c in finding["causes"]) <= 1.0


def test_a_torque_over_the_angle_that_no_effect_makes_is_unknown_and_placed(tmp_path, made_up):
    plant, runs = made_up(tmp_path, extra=lambda time, angle, speed: 0.08 * np.sin(angle / np.abs(angle).max() * 4.0))
    finding = diagnose_bench(plant, runs).finding
    assert finding["verdict"] == "unknown" and not named(finding)
    assert finding["unknown"]["balance"] == "motor" and finding["unknown"]["driving_variable"] == "position"
    assert finding["unknown"]["size"] == pytest.approx(0.16, rel=0.3)


# -- measured --------------------------------------------------------------------------------------------


@needs_data
def test_dyno_run_a_has_nothing_wrong_but_the_inline_zero(tmp_path):
    found = measurement(tmp_path, DYNO, "dyno_run_a")
    plant = plant_for(found)
    finding = diagnose_bench(plant, plant.runs(found)).finding
    assert finding["verdict"] == "cause" and named(finding) == ["torque_meter_offset"]
    assert parameter(finding, "inline_torque_offset")["value"] == pytest.approx(-0.04, abs=0.004)


@needs_data
def test_dyno_run_b_has_a_heavier_load_by_either_channel(tmp_path):
    found = measurement(tmp_path, DYNO, "dyno_run_b")
    plant = plant_for(found)
    runs = plant.runs(found)
    result = diagnose_bench(plant, runs[:-1], runs[-1:])
    assert result.finding["verdict"] == "cause"
    assert set(named(result.finding)) == {"wheel_inertia", "torque_meter_offset"}
    assert parameter(result.finding, "inline_torque_offset")["value"] == pytest.approx(-0.04, abs=0.004)
    heavier = parameter(result.finding, "wheel_inertia")
    assert heavier["value"] - heavier["nominal"] == pytest.approx(2.9e-5, rel=0.1)
    assert result.finding["gain"]["fraction_of_noise_floor"] < 1.2
    # by the motor torque alone, if it is known that it is the load
    without = [dataclasses.replace(run, clocks={n: c for n, c in run.clocks.items() if n != "inline_torque"},
                                   measured={n: c for n, c in run.measured.items() if n != "inline_torque"})
               for run in runs]
    finding = diagnose_bench(plant, without).finding
    assert finding["verdict"] == "ambiguous"
    alone = parameter(finding, "wheel_inertia")
    assert alone["value"] - alone["nominal"] == pytest.approx(2.9e-5, rel=0.1)


def added_inertia(plant, found, channel):
    """Plain least squares of one torque channel over the motion: inertia behind that section."""
    rows, torques, band = [], [], Band(edge=10.0, rate=20.0)
    for run in plant.runs(found):
        motion = plant.motion(run, plant.values)
        clock, values = plant.shown(run)[channel]
        regressors = np.array([motion.acceleration, motion.speed, np.sign(motion.speed), np.ones(motion.speed.size),
                               np.gradient(motion.acceleration, 1e-3)])
        rows.append(band.of(regressors, 1e-3, 0.25))
        torques.append(band.of(np.interp(motion.time, clock, values), 1e-3, 0.25))
    return least_squares(np.hstack(rows).T, np.concatenate(torques))[0]


@needs_data
@pytest.mark.parametrize("channel", ["motor_torque", "inline_torque"])
def test_plain_least_squares_of_each_channel_alone_says_the_same(tmp_path, channel):
    inertia = []
    for name in ("dyno_run_a", "dyno_run_b"):
        found = measurement(tmp_path, DYNO, name)
        inertia.append(added_inertia(plant_for(found), found, channel))
    assert inertia[1] - inertia[0] == pytest.approx(2.9e-5, rel=0.1)


@pytest.fixture
def emps(tmp_path):
    """Regressors of the nominal model, what may join them, and the force, of both files."""
    found = measurement(tmp_path, EMPS, "emps_reference", "emps_pulses")
    plant, tables = plant_for(found), []
    for run in plant.runs(found, longest=60.0):
        motion = plant.motion(run, plant.values)
        v, a = motion.speed, motion.acceleration
        rows = {"acceleration": a, "speed": v, "friction": np.sign(v), "offset": np.ones(v.size),
                "backward": v * (v < 0.0), "gain": run.inputs[:, 0] * (v < 0.0), "position": motion.position,
                "cubic": v**3, "falling": np.sign(v) * np.exp(-((v / 0.02) ** 2)), "force": run.inputs[:, 0]}
        tables.append({name: Band().of(row, 1e-3) for name, row in rows.items()})
    return tables


NOMINAL = ("acceleration", "speed", "friction", "offset")


def judged(emps, *more):
    """Relative errors on the first and the second file, and the second's errors."""
    first, second = (np.column_stack([table[name] for name in (*NOMINAL, *more)]) for table in emps)
    fitted = least_squares(first, emps[0]["force"])
    return (relative_error(emps[0]["force"], first @ fitted), relative_error(emps[1]["force"], second @ fitted),
            emps[1]["force"] - second @ fitted)


@needs_data
def test_emps_yardstick_and_the_cause_that_lowers_it(emps):
    first, second, before = judged(emps)
    assert (first, second) == (pytest.approx(0.0486, abs=5e-5), pytest.approx(0.0550, abs=5e-5))
    _, lowered, after = judged(emps, "backward")
    assert lowered == pytest.approx(0.0475, abs=5e-5)
    blocks = block_sums(before, 24), block_sums(after, 24)
    assert np.sum(blocks[1] < blocks[0]) >= 23 and paired(*blocks) < 1e-6
    others = {name: judged(emps, name)[1] for name in ("gain", "position", "cubic", "falling")}
    assert min(others.values()) > 0.053


@needs_data
def test_emps_diagnosed_on_the_reference_gains_on_the_pulses(tmp_path):
    found = measurement(tmp_path, EMPS, "emps_reference", "emps_pulses")
    plant = plant_for(found)
    runs = plant.runs(found)
    reference, pulses = ([run for run in runs if word in run.name] for word in ("reference", "pulses"))
    finding = diagnose_bench(plant, reference, pulses).finding
    assert finding["verdict"] == "cause"
    assert "asymmetric_friction" in named(finding)
    assert set(named(finding)) <= {"asymmetric_friction", "engine_torque_offset"}  # which had stood in for it
    assert parameter(finding, "backward_damping")["value"] == pytest.approx(75.0, rel=0.15)
    assert abs(parameter(finding, "drive_force_offset")["value"]) < 1.0
    assert all(row["separation_sigma"] > 5.0 for row in finding["ruled_out"]) and not finding["ambiguous_with"]
    for row in finding["gain"]["held_out"]:
        assert row["nrmse_after"] < row["nrmse_before"]


@needs_data
def test_emps_pulses_are_in_the_recorded_voltage_already(emps):
    pulse = np.genfromtxt(MEASURED / "emps_pulses.csv.gz", delimiter=",", names=True)["force_pulse_n"]
    table = emps[1]
    joined = np.column_stack([*(table[name] for name in (*NOMINAL, "backward")),
                              Band().of(pulse, 1e-3)[:table["force"].size]])
    fitted = least_squares(joined, table["force"])
    assert abs(fitted[-1]) < 0.1  # 1 or -1 if they were to be added
    without = relative_error(table["force"], joined @ fitted)
    for side in (1.0, -1.0):
        added = table["force"] + side * joined[:, -1]
        assert relative_error(added, joined[:, :-1] @ least_squares(joined[:, :-1], added)) > 1.4 * without


@needs_data
def test_of_a_drive_only_locked_up_stretches_without_brakes_are_taken_and_compare_sensibly(tmp_path):
    found = measurement(tmp_path, TAHOE, "tahoe_6l80_drive", kind="drive")
    car, manoeuvre = plant_for(found), found.manoeuvres[0]
    runs = car.runs(found)
    assert len(runs) >= 4
    for run in runs:
        assert np.ptp(run.inputs[:, car.columns["gear"]]) == 0.0 and run.gear >= 1
        slip = manoeuvre["engine_speed"].at(run.time) - manoeuvre["turbine_speed"].at(run.time)
        assert np.percentile(np.abs(slip), 99) < 9.0
        assert manoeuvre["brake_torque"].at(run.time).max() < 1.0
    run = max(runs, key=lambda one: np.ptp(one.measured["vehicle_speed"]))
    predicted = car.predict(car.values, run)
    for channel, place in run.slices.items():
        error = np.sqrt(np.mean((run.measured[channel] - predicted[place]) ** 2))
        assert error < 0.05 * np.mean(run.measured[channel]), channel


@needs_data
def test_the_converter_clutch_of_a_drive_is_held_at_a_slip(tmp_path):
    """Engine less turbine speed, of all stretches: a slip that a control holds explains most of it."""
    found = measurement(tmp_path, TAHOE, "tahoe_6l80_drive", kind="drive")
    car = plant_for(found)
    left = {}
    for target in (0.0, 2.2):
        errors = []
        for run in car.runs(found):
            raw = car.raw({**car.values, "slip_control.target": target}, run)
            clock, engine = run.clocks["engine_speed"], run.measured["engine_speed"]
            turbine = np.interp(clock, run.clocks["turbine_speed"], run.measured["turbine_speed"])
            slip = np.interp(clock, run.time, raw["engine_speed"] - raw["turbine_speed"])
            errors.append(engine - turbine - slip)
        left[target] = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    print(f"converter slip left over: {left[0.0]:.2f} rad/s of a closed clutch, {left[2.2]:.2f} of one that is held")
    assert left[2.2] < 0.6 * left[0.0]


def test_the_force_of_a_carriage_has_its_own_units():
    assert {p.unit for p in effect("engine_torque_offset").elsewhere} == {"N"}
    assert SingleMass("emps").units["drive.force_offset"] == "N"
