"""Vehicle files: units, variants, gear tables, and one clear message for everything that is wrong."""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

from driveline import vehicles
from driveline.plants.full_order import FullOrderParameters
from driveline.quantities import InputError, Variable
from driveline.vehicles import GEARS, load, names, variants

GOOD = """\
[vehicle]
mass = { value = 2.5, unit = "t", source = "scales" }

[final_drive]
half_gap = { value = 90, unit = "deg", source = "protractor" }
loss_fraction = { value = 3, unit = "%", source = "dynamometer" }

[transmission]
loss_constant = { values = [1, 2, 3], unit = "N.m", source = "dynamometer" }
stiffness = { value = 2, unit = "kN.m/rad", source = "bench" }

[suspension]
enabled = { value = true, unit = "1", source = "looked" }

[torque_meter]
passband_ripple = { value = 1, unit = "dB", source = "data sheet" }
stopband_frequency = { value = 0.03, unit = "kHz", source = "data sheet" }

[variant.heavy]
"vehicle.mass" = { add = 500, unit = "kg", source = "sand" }
"transmission.loss_constant" = { times = 2, source = "cold oil" }
"transmission.loss_constant[2]" = { set = 7, unit = "N.m", source = "one gear" }
"suspension.enabled" = { set = false, unit = "1", source = "welded" }
"""


def parameter(name, unit, **range_):
    return Variable(name, unit, "", **range_)


DECLARED = [
    parameter("vehicle.mass", "kg", minimum=100.0),
    parameter("final_drive.half_gap", "rad"),
    parameter("final_drive.loss_fraction", "1"),
    *(parameter(f"transmission.loss_constant[{i}]", "N.m") for i in (1, 2, 3)),
    parameter("transmission.stiffness", "N.m/rad"),
    parameter("suspension.enabled", "1", kind="boolean", maximum=1.0),
    parameter("torque_meter.passband_ripple", "dB"),
    parameter("torque_meter.stopband_frequency", "Hz"),
]


CARS = [name for name in names() if any(n.startswith("transmission.") for n in load(name).values)]  # no benches


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "car.toml"
        path.write_text(text, encoding="utf-8")
        return path
    return write


def test_numbers_become_si_and_keep_unit_source_and_line(write):
    vehicle = load(write(GOOD))
    assert (vehicle.name, vehicle.variant, vehicle.gearbox) == ("car", "baseline", None)
    assert vehicle.values == pytest.approx({
        "vehicle.mass": 2500.0, "final_drive.half_gap": math.pi / 2, "final_drive.loss_fraction": 0.03,
        "transmission.loss_constant[1]": 1.0, "transmission.loss_constant[2]": 2.0,
        "transmission.loss_constant[3]": 3.0, "transmission.stiffness": 2000.0, "suspension.enabled": 1.0,
        "torque_meter.passband_ripple": 1.0, "torque_meter.stopband_frequency": 30.0})
    assert vehicle.sources["final_drive.half_gap"] == "protractor"
    assert vehicle.units["transmission.loss_constant[3]"] == "N.m"
    assert vehicle.places["transmission.stiffness"].endswith("car.toml, line 10")
    vehicle.check(DECLARED)


def test_a_variant_changes_what_it_names_in_order_and_nothing_else(write):
    path = write(GOOD)
    before, after = load(path), load(path, "heavy")
    assert variants(path) == ["baseline", "heavy"]
    assert after.variant == "heavy"
    changed = {n: v for n, v in after.values.items() if v != before.values[n]}
    assert changed == pytest.approx({
        "vehicle.mass": 3000.0, "transmission.loss_constant[1]": 2.0, "transmission.loss_constant[2]": 7.0,
        "transmission.loss_constant[3]": 6.0, "suspension.enabled": 0.0})
    assert "sand" in after.sources["vehicle.mass"] and "scales" in after.sources["vehicle.mass"]
    assert after.places["vehicle.mass"].endswith("line 20")
    after.check(DECLARED)


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path):
    """As editors on Windows begin one; lines are counted as they show them."""
    path = tmp_path / "car.toml"
    path.write_text('[a]\nb = { value = 2.0, unit = "t", source = "s" }\n', encoding="utf-8-sig")
    assert load(path).values == {"a.b": 2000.0} and load(path).places["a.b"].endswith("line 2")


@pytest.mark.parametrize("unit, si", [
    ("rpm", math.pi / 30), ("km/h", 1 / 3.6), ("lbf.ft", 1.3558179483314), ("N.m.s2/rad2", 1.0), ("mm", 1e-3),
    ("g.cm2", 1e-7), ("m/s^2", 1.0), ("1/min", 1 / 60), ("N.m/deg", 180 / math.pi), ("s-1", 1.0), ("1", 1.0),
    ("N·m/°", 180 / math.pi), ("U/min", math.pi / 30), (" kg.m2 ", 1.0),
])
def test_unit_spellings(write, unit, si):
    path = write(f'[a]\nb = {{ value = 2.0, unit = "{unit}", source = "s" }}\n')
    assert load(path).values["a.b"] == pytest.approx(2.0 * si)


@pytest.mark.parametrize("old, new, message", [
    ('unit = "t", ', "", r"line 2: \[vehicle\] mass: unit = .* is missing"),
    (', source = "scales"', "", r"line 2: \[vehicle\] mass: source = .* is missing"),
    ('"scales"', '" "', r"line 2: \[vehicle\] mass: source = .* is missing"),
    ("2.5", '"2.5"', r"line 2: \[vehicle\] mass: '2.5' is not a finite number"),
    ("2.5", "nan", r"line 2: \[vehicle\] mass: nan is not a finite number"),
    ("2.5", "true", r"line 2: \[vehicle\] mass: True is a switch"),
    ('"t"', '"stone2x"', r"line 2: \[vehicle\] mass: unit 'stone2x' is not understood"),
    ("value = 2.5", "vaule = 2.5", r"line 2: \[vehicle\] mass: 'vaule' is not known here"),
    ("value = 2.5, ", "", r"line 2: \[vehicle\] mass: exactly one of value and values"),
    ('{ value = 2.5, unit = "t", source = "scales" }', "2500", r"line 2: \[vehicle\] mass: write \{ value"),
    ("values = [1, 2, 3]", "values = 1", r"line 9: \[transmission\] loss_constant: values needs a list"),
    ("values = [1, 2, 3]", "values = [1, [2], 3]", r"line 9: .*: \[2\] is not a finite number"),
    ("[vehicle]", "mass = 3\n[vehicle]", r"line 1: mass stands alone"),
    ("mass = {", "mass = = {", r"car.toml: this is not TOML: .*line 2"),
    ('"vehicle.mass"', '"vehicle.mas"', r"line 20: .*vehicle.mas is not in this file; did you mean vehicle.mass\?"),
    ("loss_constant[2]", "loss_constant[4]", r"line 22: .*loss_constant has 3 entries"),
    ("add = 500", "plus = 500", r"line 20: .*write one of add, times, set"),
    ('add = 500, unit = "kg"', 'add = 500, unit = "N"', r"line 20: .*'N' is not a unit of its dimension"),
    (', source = "cold oil"', "", r"line 21: .*source = .* is missing"),
    ("times = 2", 'times = 200, unit = "%"', r"line 21: .*unit \(not with times\)"),
    ("[variant.heavy]", "[variant]\nheavy = 3\n[other]", "variants are tables such as"),
])
def test_what_is_wrong_is_named_with_file_line_table_and_entry(write, old, new, message):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as error:
        load(path, "heavy")
    assert "car.toml" in str(error.value)


@pytest.mark.parametrize("old, new, message", [
    ("mass =", "wheelbase =", r"line 2: vehicle.wheelbase is not known; there are vehicle.mass"),
    ("[vehicle]", "[vehicel]", r"line 2: vehicel.mass is not known; did you mean vehicle.mass\?"),
    ('"t"', '"m"', r"line 2: vehicle.mass is given in 'm': 'kg' or a unit of its dimension"),
    ('"t"', '"kg"', r"line 2: vehicle.mass is 2.5 kg: at least 100"),
    ("[1, 2, 3]", "[1, 2, 3, 4]", r"line 9: transmission.loss_constant\[4\] is not known: .* has 3 entries"),
    ('"kHz"', '"rpm"', r"line 17: torque_meter.stopband_frequency is given in 'rpm': 'Hz'"),
    ('"kHz"', '"rad/s"', r"line 17: torque_meter.stopband_frequency is given in 'rad/s': 'Hz'"),
    ('"dB"', '"1"', r"line 16: torque_meter.passband_ripple is given in '1': 'dB'"),
    ("value = true", "value = 2", r"line 13: suspension.enabled is 2: at most 1"),
])
def test_check_compares_with_what_the_plant_declares(write, old, new, message):
    vehicle = load(write(GOOD.replace(old, new, 1).split("[variant")[0]))
    with pytest.raises(InputError, match=message):
        vehicle.check(DECLARED)


@pytest.mark.parametrize("old, new, message", [
    (r"\[axle_shaft\]", "[axle_shafts]", ", line 86: axle_shafts.stiffness is not known; did you mean "
                                         "axle_shaft.stiffness?"),
    (r"\[hub\]", "[hubb]", ", line 97: hubb.inertia is not known; did you mean hub.inertia?"),
    (r"(\[axle_shaft\]\n)stiffness", r"\1stifness",
     ", line 86: axle_shaft.stifness is not known; did you mean axle_shaft.stiffness?"),
    (r"(\[hub\]\n)", r'\1loss = { value = 1, unit = "1", source = "s" }\n',
     ", line 97: hub.loss is not known; there are hub.inertia"),
    (r"(\[hub\]\ninertia = \{) value = 1.0", r"\1 values = [1.0]", ", line 97: hub.inertia is one number: write value"),
    (r"(loss_constant = \{) values = \[[^]]*\]", r"\1 value = 5",
     ", line 57: transmission.loss_constant is a table: write values"),
    (r"\[hub\]\n.*\n", "", ": hub.inertia [kg.m2] is missing: hub, brake disc and rim of one wheel"),
])
def test_a_slip_in_a_name_is_named_before_what_it_leaves_missing(write, old, new, message):
    """Or somebody who wrote [axle_shafts] reads that axle_shaft.stiffness is missing, and nothing else."""
    text = (Path(vehicles.__file__).parent / "suv_6l80.toml").read_text(encoding="utf-8")
    assert re.search(old, text)
    vehicle = load(write(re.sub(old, new, text, count=1)))
    with pytest.raises(InputError, match=f"car.toml{re.escape(message)}"):
        vehicle.parameters(FullOrderParameters)


@pytest.mark.parametrize("unit, right", [("rad/s", True), ("rpm", True), ("deg/s", True), ("Hz", False),
                                         ("1/min", False), ("1/s", False), ("s-1", False)])
def test_what_turns_is_given_in_units_of_turning(write, unit, right):
    """650 1/min are 650 rpm to whoever writes it, and would be 11 rad/s."""
    vehicle = load(write(f'[engine]\nidle_speed = {{ value = 650, unit = "{unit}", source = "s" }}\n'))
    if right:
        vehicle.check([parameter("engine.idle_speed", "rad/s")])
    else:
        with pytest.raises(InputError, match="'rad/s' or a unit of its dimension"):
            vehicle.check([parameter("engine.idle_speed", "rad/s")])


@pytest.mark.parametrize(("unit", "declared", "right"), [
    ("N.m/deg", "N.m/rad", True), ("N.m", "N.m/rad", True), ("1", "rad", True), ("N.m/rpm2", "N.m.s2/rad2", True),
    ("N.m/deg", "N.m", False), ("deg", "1", False), ("%", "1", True)])
def test_an_angle_more_than_declared_is_another_dimension(write, unit, declared, right):
    """What a degree's 57 would be multiplied by."""
    vehicle = load(write(f'[a]\nb = {{ value = 5, unit = "{unit}", source = "s" }}\n'))
    if right:
        vehicle.check([parameter("a.b", declared)])
    else:
        with pytest.raises(InputError, match=f"line 2: a.b is given in '{unit}': '{declared}' or a unit of its"):
            vehicle.check([parameter("a.b", declared)])


@pytest.mark.parametrize("unit", ["9**9**9**9", "m**9**9**9", "m2^9^9^9"])
def test_a_unit_that_pint_would_compute_for_ever_is_not_understood(write, unit):
    with pytest.raises(InputError, match="line 2: .* is not understood: a number is raised to a power"):
        load(write(f'[a]\nb = {{ value = 5, unit = "{unit}", source = "s" }}\n'))


def test_an_unknown_vehicle_or_variant_names_those_there_are(write, tmp_path):
    with pytest.raises(InputError, match="no vehicle 'tractor': .*pickup_10r80, suv_6l80"):
        load("tractor")
    with pytest.raises(InputError, match="no variant 'light'; there are baseline, heavy"):
        load(write(GOOD), "light")


@pytest.mark.parametrize("old, new, message", [
    ('1 = ["A", "B", "D", "E"]', '1 = ["A", "B", "D"]', r"line \d+: gear 1 .* leaves 2 degrees of freedom"),
    ('1 = ["A", "B", "D", "E"]\n', "", r"clutch_table: gear 1 is missing"),
    ('1 = ["A", "B", "D", "E"]', '1 = "ABDE"', r"clutch_table\] 1: needs a list"),
    ("\n10 = [", "\n11 = [", r"clutch_table\] 11: gears are -1, 0 and 1 to 10"),
    ("ring_teeth = 95", "ring_teeth = 9.5", r"gearbox.sets\] 1: needs exactly .*ring_teeth \(int\)"),
    ('A = { shaft = "ring_1"', 'A = { shaft = "ring_9"', "shift element A names the shaft 'ring_9'"),
    ('input_shaft = "input"', "", r"\[gearbox\] input_shaft: is missing"),
    ("input = { value = 0.0060", "input = { value = -1.0", "none negative"),
    ('value = 0.0060, unit = "kg.m2"', 'value = 0.0060, unit = "kg"', "inertia such as kg.m2 is needed"),
    ("[transmission]\n", '[transmission]\nratio = { values = [1], unit = "1", source = "s" }\n',
     "gives it already"),
])
def test_a_wrong_gearbox_is_named(write, old, new, message):
    text = (Path(vehicles.__file__).parent / "pickup_10r80.toml").read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(InputError, match=message) as error:
        load(write(text.replace(old, new, 1)))
    assert str(error.value).count("car.toml") == 1


@pytest.mark.parametrize(("line", "wrong"), [
    ("transmission.ratio[7]", 1e300), ("transmission.ratio[7]", -1e3), ("tyre.relaxation_length", 1e300),
    ("torque_meter.sampling_frequency", 1e9)])
def test_numbers_far_beyond_what_a_car_can_have_are_refused_before_anything_is_computed_of_them(line, wrong):
    """They overflowed in what is derived from them, or had the sensors' clock tick for hours."""
    vehicle = load("suv_6l80")
    with pytest.raises(InputError, match=re.escape(line)):
        replace(vehicle, values=vehicle.values | {line: wrong}).parameters(FullOrderParameters)


@pytest.mark.parametrize("name", CARS)
def test_shipped_files_have_twelve_gears_and_say_where_every_number_comes_from(name):
    vehicle = load(name)
    for table in ("ratio", "inertia", "loss_constant", "loss_viscous", "loss_fraction"):
        assert [n for n in vehicle.values if n.startswith(f"transmission.{table}[")] == [
            f"transmission.{table}[{i}]" for i in range(1, len(GEARS) + 1)]
    assert vehicle.sources.keys() == vehicle.values.keys()
    assert vehicle.values["transmission.ratio[1]"] < 0 < vehicle.values["transmission.ratio[3]"]


def test_both_shipped_vehicles_fill_the_same_plant():
    assert load("pickup_10r80").values.keys() == load("suv_6l80").values.keys()


def test_modified_pickup_is_table_2_3_of_the_thesis():
    before, after = load("pickup_10r80").values, load("pickup_10r80", "modified").values
    changed = {n for n in after if after[n] != before[n]}
    quarter_more = {
        "engine.inertia", "converter.impeller_inertia", "converter.turbine_inertia",
        "lockup_clutch.plate_inertia", "transmission.input_inertia", "transmission.output_inertia",
        *(f"transmission.inertia[{i}]" for i in range(1, 13))}
    softer = {"axle_shaft.stiffness", "propeller_shaft.stiffness"}
    assert changed == quarter_more | softer | {
        "vehicle.mass", "tyre.rolling_resistance", "suspension.enabled", "torque_meter.enabled"}
    assert all(after[n] == pytest.approx(1.25 * before[n]) for n in quarter_more)
    assert all(after[n] == pytest.approx(0.75 * before[n]) for n in softer)
    assert after["vehicle.mass"] - before["vehicle.mass"] == pytest.approx(334.0)
    assert (before["tyre.rolling_resistance"], after["tyre.rolling_resistance"]) == (0.02, 0.01)
    assert (before["suspension.enabled"], after["suspension.enabled"]) == (1.0, 0.0)
    assert (before["torque_meter.enabled"], after["torque_meter.enabled"]) == (0.0, 1.0)


@pytest.mark.parametrize("name", CARS)
def test_hypoid_lash_is_the_largest_in_every_gear(name):
    values = load(name).values
    for i in range(3, 13):
        if ratio := values[f"transmission.ratio[{i}]"]:
            assert values["transmission.half_gap"] / ratio < values["final_drive.half_gap"]
