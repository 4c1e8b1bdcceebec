"""Hidden measurements: readable, reproducible, honest about nothing, and not made by the model they are to test."""

import ast
import json
import pathlib
import re
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from runs import plant, run, start_values

from cosim import cli
from cosim.diagnosis import hidden as package
from cosim.diagnosis.catalogue import CATALOGUE, apply_all, effect
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.hidden import COCKTAIL, drawn, hide, sizes_of
from cosim.diagnosis.hidden.model import simulate
from cosim.diagnosis.hidden.outside import OUTSIDE
from cosim.diagnosis.plants import plant_for
from cosim.diagnosis.show.features import order_content
from cosim.measured import load
from driveline.quantities import InputError
from driveline.vehicles import load as load_vehicle

SHORT = ("tip_in:5",)
TIMES, TORQUE = np.array([-10.0, 0.8, 0.9, 10.0]), np.array([-20.0, -20.0, 200.0, 200.0])


def nominal():
    return dict(start_values("plant_fom", "pickup_10r80", "modified", 5))


def contents(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def nothing(tmp_path_factory):
    """A measurement of the nominal plant, drift and all."""
    folder = tmp_path_factory.mktemp("nothing")
    return folder, hide([], 3, folder / "m", structure="same", manoeuvres=("tip_in:5", "coast_down:7"),
                        truth=folder / "truth.json")


def test_the_hidden_plant_shares_no_code_with_the_plants_a_diagnosis_runs():
    for path in pathlib.Path(package.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith(("driveline", "cosim")):
                if [name.name for name in node.names] == ["FullOrderParameters"]:
                    continue  # what a vehicle file may say: names, units and ranges, no law
                assert node.module in (
                    "driveline", "driveline.quantities", "cosim", "cosim.files", "cosim.messages", "cosim.measured",
                    "cosim.diagnosis.catalogue", "cosim.diagnosis.effect", "cosim.diagnosis.hidden.model",
                    "cosim.diagnosis.hidden.outside", "cosim.diagnosis.hidden.recordings"), (path.name, node.module)


@pytest.mark.parametrize("more", [{}, {"slip_control.target": 2.0}, {"slip_control.target": 8.0}],
                         ids=["closed", "controlled slip", "open while the torque is small"])
def test_two_ways_to_write_the_same_driveline_down_agree(more):
    """Same structure, nothing drifts: the hidden plant and the full-order one differ by their contacts only."""
    record = simulate(nominal() | more, 5, 12.0, TIMES, TORQUE, 3.0)
    start = float(np.interp(0.0, record.time, record.signals["vehicle_speed"]))
    model = plant("plant_fom", {"start.vehicle_speed": start} | more, engine_torque=-20.0)
    other = run(model, 3.0, engine_torque=lambda t: np.interp(t + 5e-4, TIMES, TORQUE))
    for name, share in (("engine_speed", 5e-3), ("wheel_speed", 2e-3), ("vehicle_speed", 5e-4),
                        ("propeller_shaft_torque", 1e-2), ("seat_acceleration", 1e-2)):
        mine = np.interp(other["time"], record.time, record.signals[name])
        assert np.abs(mine - other[name]).max() < share * np.ptp(mine), name


def test_another_structure_is_another_but_not_another_vehicle():
    same, other = (simulate(nominal(), 5, 12.0, TIMES, TORQUE, 3.0, other=o) for o in (False, True))
    for name, low, high in (("propeller_shaft_torque", 0.003, 0.15), ("engine_speed", 0.002, 0.1)):
        apart = np.abs(same.signals[name] - other.signals[name])[same.time > 0.0].max()
        assert low < apart / np.ptp(same.signals[name]) < high


@pytest.mark.parametrize("ratio", [0.6, 1.45])
def test_a_first_stage_that_is_never_left_is_the_stiffness_of_the_whole_shaft_in_either_structure(ratio):
    shaft = nominal()["axle_shaft.stiffness"]
    for other in (False, True):
        staged, whole = (simulate(nominal() | more, 5, 12.0, TIMES, TORQUE, 2.0, other=other) for more in (
            {"axle_first_stage.stiffness_ratio": ratio, "axle_first_stage.twist": 1.0},
            {"axle_shaft.stiffness": ratio * shaft}))
        for name, signal in whole.signals.items():
            assert np.abs(staged.signals[name] - signal).max() < 1e-4 * np.ptp(signal), (name, other)


def test_energy_of_the_hidden_plant_is_what_the_engine_gives_and_the_road_takes():
    """Steady state without slip of anything: power at the propeller shaft less losses moves the mass."""
    v = nominal() | {"tyre.rolling_resistance": 0.0, "vehicle.drag_coefficient": 0.0, "final_drive.loss_constant": 0.0,
                     "final_drive.loss_fraction": 0.0, "tyre.slip_stiffness": 1e8}
    record = simulate(v, 5, 12.0, np.array([-10.0, 10.0]), np.array([100.0, 100.0]), 4.0)
    late = record.time > 3.0
    slope = np.polyfit(record.time[late], record.signals["vehicle_speed"][late], 1)[0]
    turning = (4.0 * (v["hub.inertia"] + v["tyre.belt_inertia"]) + v["final_drive.ring_inertia"]
               + 2.0 * v["axle_shaft.inertia"] + v["final_drive.ratio"]**2 * (
                   0.75 * v["propeller_shaft.inertia"] + v["final_drive.pinion_inertia"])) / v["tyre.radius"]**2
    force = record.signals["propeller_shaft_torque"][late].mean() * v["final_drive.ratio"] / v["tyre.radius"]
    assert force == pytest.approx((v["vehicle.mass"] + turning) * slope, rel=2e-3)


def test_a_measurement_can_be_read_and_tells_nothing(nothing):
    folder, truth = nothing
    measurement = load(folder / "m")
    assert [m.kind for m in measurement.manoeuvres] == ["tip_in", "coast_down"]
    assert measurement.vehicle == "pickup_10r80" and measurement.variant == "modified"
    for manoeuvre in measurement.manoeuvres:
        assert not manoeuvre.notices
        assert {"engine_torque", "engine_speed", "wheel_speed", "propeller_shaft_torque"} <= set(manoeuvre.channels)
        rates = {round(1.0 / np.median(np.diff(c.time))) for c in manoeuvre.channels.values()}
        assert len(rates) > 3
        assert any(c.gaps(3.0) for c in manoeuvre.channels.values())
    assert sorted(p.name for p in folder.iterdir()) == ["m", "truth.json"]
    text = b"".join(contents(folder / "m").values()).decode()
    for word in (*CATALOGUE, *OUTSIDE, "seed", "truth", "drift", "structure", "hid"):
        assert word not in text
    assert truth.effects == {} and truth.changed == {}


def test_the_size_of_the_files_does_not_tell_the_effect(nothing, tmp_path):
    folder, _ = nothing
    hide(["torque_ripple=40"], 3, tmp_path / "m", structure="same", manoeuvres=("tip_in:5", "coast_down:7"))
    mine, other = contents(tmp_path / "m"), contents(folder / "m")
    assert mine.keys() == other.keys()
    assert mine["measurement.toml"] == other["measurement.toml"]


def test_every_nuisance_drifts_by_three_to_five_percent_and_no_cause_does(nothing):
    _, truth = nothing
    assert len(truth.drift) > 30
    sizes = np.abs(list(truth.drift.values()))
    assert sizes.min() >= 0.03 and sizes.max() <= 0.05
    targets = {t.removesuffix("[*]") for e in CATALOGUE.values() for p in e.parameters for t in p.targets}
    assert not targets & {name.partition("[")[0] for name in truth.drift}
    written = json.loads((nothing[0] / "truth.json").read_text())
    assert written["drift"] == truth.drift and written["effects"] == {} and written["structure"] == "same"


def test_ripple_is_of_the_order_of_the_engine_which_never_drifts():
    """Four of a V8; nor does it take a draw, so that what a seed made of a vehicle before stays as it was."""
    suv = dict(load_vehicle("suv_6l80").values)
    assert suv["torque_ripple.order"] == 4.0
    without = {name: value for name, value in suv.items() if name != "torque_ripple.order"}
    drifted = [package._drift(values, {}, "all", np.random.default_rng(1)) for values in (suv, without)]
    assert drifted[0] == drifted[1] and len(drifted[0]) > 30
    record = simulate(suv | {"torque_ripple.amplitude": 60.0}, 4, 12.0, TIMES, TORQUE, 3.0)
    speed = record.signals["engine_speed"]
    third, fourth = (order_content(record.time, speed, record.time, speed, order) for order in (3.0, 4.0))
    assert fourth > 10.0 * third


@pytest.mark.parametrize("name", ["suspension_mode", "torque_meter_filter"])
def test_what_is_drawn_is_there(name, tmp_path, monkeypatch):
    """On a rigid axle, or without a filter, only one direction is an effect."""
    monkeypatch.setattr(package, "_recorded", lambda *_: {})
    monkeypatch.setattr(package, "write", lambda *_: None)
    for seed in range(12):
        variant = "baseline" if name == "torque_meter_filter" else None
        assert hide([name], seed, tmp_path / "m", variant=variant, manoeuvres=SHORT).changed


def test_the_same_seed_gives_the_same_files_and_another_other_ones(tmp_path):
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        hide(["wheel_speed_delay"], seed, tmp_path / name, manoeuvres=SHORT)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert contents(tmp_path / "a") != contents(tmp_path / "c")


def test_about_a_third_of_all_seeds_has_the_other_structure():
    others = [np.random.default_rng([seed, 7]).uniform() < 1 / 3 for seed in range(600)]
    assert 0.27 < np.mean(others) < 0.40


@pytest.mark.parametrize(("entry", "channel", "what"), [
    ("torque_meter_offset=12", "propeller_shaft_torque",
     lambda a, b: np.mean(a - b) == pytest.approx(12.0, abs=0.5)),
    ("torque_meter_gain=1.2", "propeller_shaft_torque",
     lambda a, b: np.ptp(a) == pytest.approx(1.2 * np.ptp(b), rel=0.02)),
    ("engine_speed_delay=30 ms", "engine_speed", lambda a, b: np.mean(b - a) > 0.1),
])
def test_an_error_of_a_sensor_shows_in_its_channel_and_in_no_other(entry, channel, what, nothing, tmp_path):
    folder, _ = nothing
    hide([entry], 3, tmp_path / "m", structure="same", manoeuvres=("tip_in:5", "coast_down:7"))
    mine, other = (load(f).manoeuvres[0] for f in (tmp_path / "m", folder / "m"))
    for name in mine.channels:
        if name != channel:
            assert (mine[name].values == other[name].values).all(), name
    assert what(mine[channel].values, other[channel].values)


@pytest.mark.parametrize("name", OUTSIDE)
def test_an_effect_outside_the_catalogue_shows_alike_in_both_structures(name, tmp_path):
    shown = []
    for structure in ("same", "other"):
        folder = tmp_path / structure
        given = {"structure": structure, "manoeuvres": ("tip_in:4",), "drift": "none"}
        hide([f"outside:{name}={OUTSIDE[name].sizes[0]}"], 4, folder / "m", truth=folder / "t.json", **given)
        hide([], 4, folder / "n", **given)
        mine, other = (load(folder / f).manoeuvres[0] for f in "mn")
        shown.append(max(np.sqrt(np.mean((mine[c].values - other[c].values) ** 2)) / noise for c, noise in (
            ("engine_speed", 0.6 * np.pi / 30), ("propeller_shaft_torque", 1.5), ("seat_acceleration", 0.02),
            ("wheel_speed", 0.12 * np.pi / 30))))
        told = json.loads((folder / "t.json").read_text())["outside"][name]
        assert told["balance"] and told["driving_variables"] and told["size"] == OUTSIDE[name].sizes[0]
    assert min(shown) > 1.0  # in every sample, and there are hundreds
    assert shown[0] == pytest.approx(shown[1], rel=0.3)


def test_the_cocktail_takes_no_size(tmp_path):
    with pytest.raises(InputError, match=f"^{COCKTAIL}=5: {COCKTAIL} is what its table says, and takes no size$"):
        hide([f"{COCKTAIL}=5"], 2, tmp_path / "m", manoeuvres=SHORT)


def test_the_cocktail_of_table_2_3_is_the_modified_variant_on_the_baseline(tmp_path):
    truth = hide([COCKTAIL], 2, tmp_path / "m", manoeuvres=SHORT)
    base, true = load_vehicle("pickup_10r80").values, load_vehicle("pickup_10r80", "modified").values
    assert load(tmp_path / "m").variant is None
    for name, (_, value) in truth.changed.items():
        if not name.startswith("observe."):
            assert value == true[name]
    assert {n for n in true if true[n] != base[n] and not n.startswith("torque_meter.")} < set(truth.changed)
    assert truth.effects["vehicle_mass"]["vehicle_mass"] == pytest.approx((2200 + 334) / 2200)
    assert truth.effects["shaft_stiffness"] == {"propeller_shaft_stiffness": 0.75, "axle_shaft_stiffness": 0.75}
    assert truth.effects["torque_meter_filter"]["torque_meter_filter_period"] == pytest.approx(1 / 30)


@pytest.mark.parametrize(("name", "text", "expected"), [
    ("vehicle_mass", "1.1", {"vehicle_mass": 1.1}),
    ("vehicle_mass", "+15 %", {"vehicle_mass": 1.15}),
    ("vehicle_mass", "-15%", {"vehicle_mass": 0.85}),
    ("vehicle_mass", "+253.4 kg", {"vehicle_mass": 1.1}),
    ("vehicle_mass", "2787.4 kg", {"vehicle_mass": 1.1}),
    ("wheel_speed_delay", "30 ms", {"wheel_speed_delay": 0.03}),
    ("torque_meter_offset", "-12", {"torque_meter_offset": -12.0}),
    ("shaft_stiffness", "0.75", {"propeller_shaft_stiffness": 0.75, "axle_shaft_stiffness": 0.75}),
    ("shaft_stiffness", "axle_shaft_stiffness:0.8", {"axle_shaft_stiffness": 0.8}),
    ("shaft_stiffness", " propeller_shaft_stiffness:0.8, axle_shaft_stiffness: 90 % ",
     {"propeller_shaft_stiffness": 0.8, "axle_shaft_stiffness": 0.9}),
    ("two_stage_stiffness", "0.3", {"first_stage_stiffness": 0.3, "first_stage_twist": 0.015}),
])
def test_sizes_as_users_write_them(name, text, expected):
    assert sizes_of(effect(name), text, nominal(), np.random.default_rng(0)) == pytest.approx(expected)


@pytest.mark.parametrize("name", CATALOGUE)
def test_drawn_sizes_are_worth_finding_and_plausible(name):
    random = np.random.default_rng(1)
    for _ in range(30):
        sizes = drawn(effect(name), random)
        assert sizes
        for p in effect(name).parameters:
            if p.name in sizes:
                assert p.limits[0] <= sizes[p.name] <= p.limits[1]
                assert 0.999 * p.detection <= abs(p.coordinate(sizes[p.name])) <= 5.001 * p.detection


@pytest.mark.parametrize("name", ["backlash_location", "suspension_mode"])
def test_no_more_is_said_to_be_hidden_than_a_vehicle_can_have(name):
    [parameter] = effect(name).parameters
    low, high = parameter.range(nominal())
    sizes = [sizes_of(effect(name), "", nominal(), np.random.default_rng(k))[parameter.name] for k in range(60)]
    free = [drawn(effect(name), np.random.default_rng(k))[parameter.name] for k in range(60)]
    assert min(sizes) == low > min(free) and max(sizes) <= high
    assert all(size == more for size, more in zip(sizes, free) if low < more < high)


def test_what_no_size_of_shows_in_a_vehicle_is_not_said_to_be_hidden(tmp_path, monkeypatch):
    monkeypatch.setattr(package, "drawn", lambda found, random: {p.name: p.neutral for p in found.parameters})
    with pytest.raises(InputError, match="vehicle_mass changes nothing of suv_6l80"):
        hide(["vehicle_mass"], 1, tmp_path / "m", vehicle="suv_6l80", manoeuvres=SHORT)
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(("arguments", "said"), [
    (["vehicle_mas"], "did you mean 'vehicle_mass'"),
    (["vehicle_mass=9"], "from 0.7 to 1.6 is plausible"),
    (["suspension_mode=-1e-6"], "from 0 to 1e-05 is plausible"),
    (["backlash_location=0.05"], "from -0.0160745 to 0.0439823 is plausible"),
    (["clock_drift=1"], "from -0.02 to 0.02 is plausible, a pure number\n"),
    (["outside:engine_mount_coupling=500"], "from 0 to 400 is possible"),
    (["--vehicle", "emps"], "has no gears"),
    (["torque_meter_filter=0", "--variant", "baseline"], "changes nothing"),
    (["torque_meter_filter=-0.01", "--variant", "baseline"], "from 0 to 0.2 is plausible"),
    (["vehicle_mass=much"], "a number is needed"),
    (["backlash_size=1.2.3"], "a number is needed"),
    (["shaft_stiffness=axle_shaft_stiffness:."], "a number is needed"),
    (["wheel_speed_delay=30 kg"], "cannot be converted"),
    (["wheel_inertia=3 kg.m2"], "a factor is needed"),
    (["outside:wavy_raod"], "did you mean 'wavy_road'"),
    (["vehicle_mass", "--manoeuvres", "tip_inn:5"], "did you mean 'tip_in'"),
    (["vehicle_mass", "--manoeuvres", "tip_in:12"], "gears 1 to 10"),
    (["vehicle_mass", "--truth", "m/t.json"], "inside the measurement"),
    (["vehicle_mass", "--vehicle", "tractor"], "tractor"),
])
def test_wrong_usage_is_said_in_one_line_and_leaves_nothing_behind(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["hide", *arguments, "--seed", "1", "--out", "m"]) == 2
    message = capsys.readouterr().err
    assert said in message and message.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("truth", "said"), [("there", "a file is needed"), ("file/t.json", "can be written to")])
def test_a_truth_that_cannot_be_written_is_said_before_a_measurement_is(truth, said, tmp_path, monkeypatch, capsys):
    """A measurement without its truth is worth nothing: nothing is simulated for one, and nothing stays behind."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("cosim.diagnosis.hidden._recording", None)
    assert cli.main(["hide", "vehicle_mass", "--seed", "1", "--out", "m", "--truth", truth]) == 2
    message = capsys.readouterr().err
    assert f"--truth {truth.removesuffix('/t.json')}: " in message and said in message and message.count("\n") == 1
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["file", "there"]


def test_a_measurement_that_cannot_be_written_leaves_no_truth(tmp_path, monkeypatch):
    def fail(*arguments):
        raise OSError("the disk is full")

    monkeypatch.setattr("cosim.diagnosis.hidden.write", fail)
    with pytest.raises(OSError, match="full"):
        hide([], 1, tmp_path / "m", manoeuvres=["step:5"], truth=tmp_path / "t.json")
    assert not list(tmp_path.iterdir())


def test_the_command_writes_folder_and_truth_side_by_side(tmp_path, capsys):
    out = tmp_path / "case"
    assert cli.main(["hide", "engine_inertia=1.3", "--seed", "1", "--manoeuvres", "step:5", "--out", str(out),
                     "--json"]) == 0
    truth = tmp_path / "case.truth.json"
    assert json.loads(truth.read_text())["effects"] == {"engine_inertia": {"engine_inertia": 1.3}}
    assert load(out).manoeuvres[0].kind == "step"


@pytest.mark.parametrize(("entry", "written", "said"), [
    ("mass = { value = 2700", "mass = { value = -2700", "vehicle.mass is -2700 kg: at least 1 is needed"),
    ('2700, unit = "kg"', '2700, unit = "N"', "vehicle.mass is given in 'N'"),
    ("frontal_area", "front_area", "vehicle.front_area is not known; did you mean vehicle.frontal_area?"),
    ("[seat]\nmass", "[seat]\n#mass", "seat.mass [kg] is missing"),
    ("0.667, 0.0, 0.0, 0.0, 0.0]", "0.667]", "transmission.inertia has 12 entries: transmission.ratio has 8"),
])
def test_a_vehicle_file_that_the_plant_refuses_is_refused_as_there(entry, written, said, tmp_path, monkeypatch, capsys):
    """What it says that means nothing was hidden in, or was a KeyError."""
    monkeypatch.chdir(tmp_path)
    shipped = resources.files("driveline.vehicles").joinpath("suv_6l80.toml").read_text()
    assert shipped.count(entry) == 1
    pathlib.Path("mine.toml").write_text(shipped.replace(entry, written))
    assert cli.main(["hide", "vehicle_mass=1.1", "--seed", "1", "--vehicle", "mine.toml", "--out", "m"]) == 2
    message = capsys.readouterr().err
    assert "mine.toml" in message and said in message and message.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


def test_a_vehicle_file_without_a_torque_meter_is_as_good(tmp_path, monkeypatch):
    """It was a KeyError: then the meter filters as the plant's does, which is as the thesis's does."""
    monkeypatch.chdir(tmp_path)
    shipped = resources.files("driveline.vehicles").joinpath("suv_6l80.toml").read_text()
    shipped = re.sub(r"(\[torque_meter\]\nenabled = { value = )false", r"\1true", shipped)
    bare = re.sub(r"(?ms)^\[torque_meter\]\n.*?(?=^\[|\Z)", "", shipped)
    assert shipped.count("\n[") == bare.count("\n[") + 1
    for name, text in (("whole", shipped), ("bare", bare)):
        pathlib.Path("car.toml").write_text(text)
        hide(["vehicle_mass=1.1"], 1, tmp_path / name, vehicle="car.toml", manoeuvres=SHORT)
    whole, bare = contents(tmp_path / "whole"), contents(tmp_path / "bare")
    assert [name for name in whole if whole[name] != bare[name]] == ["car.toml"]


def test_a_vehicle_file_of_ones_own_goes_with_the_measurement(tmp_path):
    from driveline import vehicles

    mine = tmp_path / "mine.toml"
    mine.write_text((pathlib.Path(vehicles.__path__[0]) / "suv_6l80.toml").read_text())
    hide(["vehicle_mass=1.2"], 1, tmp_path / "m", vehicle=str(mine), manoeuvres=("tip_in:4",))
    mine.unlink()
    measurement = load(tmp_path / "m")
    assert load_vehicle(measurement.vehicle).name == "mine" and measurement.variant is None
    assert measurement.manoeuvres[0].gear == 4


def test_what_it_cannot_do_is_refused():
    with pytest.raises(InputError, match="gear 0"):
        simulate(nominal(), 0, 12.0, TIMES, TORQUE, 1.0)


def test_a_road_that_climbs_falls_on_the_way_back(tmp_path):
    speeds = {}
    for slope, way in ((0.02, ""), (0.02, ":back"), (-0.02, "")):
        folder = tmp_path / f"{slope}{way.strip(':')}"
        hide([f"road_grade={slope}"], 3, folder, structure="same", manoeuvres=(f"cruise:5{way}",))
        [manoeuvre] = load(folder).manoeuvres
        assert manoeuvre.back == bool(way)
        speeds[slope, way] = manoeuvre["vehicle_speed"].values
    assert np.array_equal(speeds[0.02, ":back"], speeds[-0.02, ""])
    assert speeds[0.02, ":back"][-1] > speeds[0.02, ""][-1] + 1.0


def test_only_forward_or_back(tmp_path):
    with pytest.raises(InputError, match="tip_in:5:up.*tip_in:5:back"):
        hide([], 3, tmp_path / "m", manoeuvres=("tip_in:5:up",))


@pytest.mark.parametrize("entry", ["vehicle_mass=", "vehicle_mass= ", "outside:hardening_axle_shafts="])
def test_an_empty_size_is_not_a_wish_for_any(tmp_path, entry):
    with pytest.raises(InputError, match=f"^{entry}: a size is needed behind =, or {entry.rstrip('= ')} alone"):
        hide([entry], 1, tmp_path / "m", manoeuvres=["tip_in:5"])
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(("effects", "message"), [
    (["vehicle_mass=1.1", "vehicle_mass=1.2"], "vehicle_mass is there twice"),
    (["mesh_loss=final_drive_loss:2,final_drive_loss:3"], "one size for each of its numbers")])
def test_what_is_hidden_twice_is_refused(tmp_path, effects, message):
    """The truth could say one of it only."""
    with pytest.raises(InputError, match=message):
        hide(effects, 1, tmp_path / "m", manoeuvres=["tip_in:5"])


@pytest.mark.parametrize("effects", [["backlash_size=0.7", "backlash_location=0.02"],
                                     ["backlash_size=0.5", "backlash_location=0.04"],
                                     ["vehicle_mass=1.1", "rolling_resistance=2"]])
def test_what_is_hidden_is_the_same_in_any_order_and_what_a_diagnosis_takes_it_for(tmp_path, effects):
    one, other = (hide(given, 5, tmp_path / "m", manoeuvres=SHORT) for given in (effects, effects[::-1]))
    assert one.changed == other.changed
    true = apply_all(one.effects, load_vehicle("pickup_10r80", "modified").values)
    assert {name: value for name, (_, value) in one.changed.items()} == {name: true[name] for name in one.changed}
    car = plant_for(load(tmp_path / "m"))
    runs = car.runs(load(tmp_path / "m"))
    declared = coordinates(car, runs)
    point = [c.parameter.coordinate(one.effects[c.effect][c.name]) if c.effect in one.effects else 0.0
             for c in declared]
    with Predictor(car, runs, declared, 1) as predictor:
        values, _ = predictor.values(np.array(point), 0)
    assert [values[name] for name in one.changed] == pytest.approx([true[name] for name in one.changed])


def test_sensors_that_the_file_says_are_late_are_late(tmp_path):
    file = resources.files("driveline.vehicles").joinpath("pickup_10r80.toml").read_text()
    late = re.sub(r"(\[wheel_speed_sensor\]\n(?:.*\n)*?delay = \{ value = )[0-9.]+, unit = \"[a-z]+\"",
                  r'\g<1>30, unit = "ms"', file)
    assert late != file
    (tmp_path / "late.toml").write_text(late)
    shown = []
    for number, vehicle in enumerate(("pickup_10r80", str(tmp_path / "late.toml"))):
        hide([], 3, tmp_path / f"{number}", vehicle=vehicle, variant="modified", structure="same", manoeuvres=SHORT)
        [manoeuvre] = load(tmp_path / f"{number}").manoeuvres
        shown.append(manoeuvre["wheel_speed"])
    early, late = shown
    inside = (late.time > 0.1) & (late.time < 6.8)
    moved, still = (np.interp(late.time[inside] - shift, early.time, early.values) - late.values[inside]
                    for shift in (0.03, 0.0))
    assert np.sqrt(np.mean(moved**2)) < 0.5 * np.sqrt(np.mean(still**2))


def test_an_effect_that_the_hidden_plant_does_not_have_is_refused(tmp_path, monkeypatch):
    """As one is that was added to the plant of the diagnosis only: the truth would be of nothing."""
    new = replace(effect("coulomb_drag"), name="pinion_drag", change=lambda sizes, values: {"pinion_drag.torque": 30.0})
    monkeypatch.setitem(CATALOGUE, "pinion_drag", new)
    with pytest.raises(InputError, match="pinion_drag: the hidden plant knows nothing of pinion_drag.torque"):
        hide(["pinion_drag=30"], 1, tmp_path / "m", manoeuvres=SHORT)
    assert not (tmp_path / "m").exists()


@pytest.mark.parametrize(("text", "factor"), [("-100 kg", -100.0), ("+100 kg", 100.0)])
def test_so_much_less_is_as_good_as_so_much_more(text, factor):
    values = load_vehicle("pickup_10r80", "modified").values
    sizes = sizes_of(effect("vehicle_mass"), text, values, np.random.default_rng(1))
    assert sizes["vehicle_mass"] == pytest.approx(1.0 + factor / values["vehicle.mass"])


@pytest.mark.parametrize("text", ["first_stage_twist:2 deg", "first_stage_stiffness:0.5"])
def test_what_means_nothing_alone_gets_a_usual_partner(text):
    found = effect("two_stage_stiffness")
    sizes = sizes_of(found, text, load_vehicle("pickup_10r80", "modified").values, np.random.default_rng(1))
    assert set(sizes) == {p.name for p in found.parameters}
    assert all(sizes[p.name] != p.neutral for p in found.parameters)
