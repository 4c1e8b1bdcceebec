"""Every effect is one file, neutral where its sizes are, and moves the plant where they are not."""

import json
import pathlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import plant, run, start_values, steps

from cosim import cli
from cosim.diagnosis import effects
from cosim.diagnosis.catalogue import CATALOGUE, apply, apply_all, effect, push_alike
from cosim.diagnosis.hidden import drawn
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.plants.observation import DEFAULTS, Errors
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.reduced import reduce, three_mass_at_hub
from driveline.quantities import InputError, from_values

PROMISED = """vehicle_mass rolling_resistance aerodynamic_drag road_grade engine_inertia wheel_inertia shaft_stiffness
tyre_stiffness driveline_damping coulomb_drag mesh_loss backlash_size backlash_location two_stage_stiffness
suspension_mode tyre_slip effective_radius converter_slip engine_torque_gain engine_torque_offset
engine_torque_delay torque_ripple torque_meter_filter torque_meter_gain torque_meter_offset engine_speed_delay
wheel_speed_delay speed_sensor_eccentricity clock_drift asymmetric_friction""".split()
LOST = {"asymmetric_friction", "converter_slip", "suspension_mode", "torque_ripple", "two_stage_stiffness"}
PARAMETERS = [(e, p) for e in CATALOGUE.values() for p in e.parameters]
IDS = [f"{e.name}-{p.name}" for e, p in PARAMETERS]


def nominal(variant="modified"):
    return dict(start_values("plant_fom", "pickup_10r80", variant, 5))


def own(values):
    """The values a plant declares, without errors of inputs and sensors."""
    return {name: value for name, value in values.items() if not name.startswith(("observe.", "input."))}


def test_the_catalogue_holds_the_promised_effects_one_file_each():
    files = {path.stem for path in pathlib.Path(effects.__path__[0]).glob("[!_]*.py")}
    assert set(CATALOGUE) == files >= set(PROMISED)
    for name, found in CATALOGUE.items():
        assert found.name == name
        assert 1 <= len(found.parameters) <= 3
        assert len(found.summary) < 110 and len(found.physics) > 80, name
        assert 20 < len(found.directly) < 110 and found.directly[0].islower() and found.directly[-1] != ".", name
        assert found.acts_on.split()[0] in ("sensor", "input", "engine", "transmission", "propeller", "axle",
                                            "wheel", "vehicle")
        assert bool(found.channels) == (found.kind == "sensor")
    names = [p.name for _, p in PARAMETERS]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(("one", "parameter"), PARAMETERS, ids=IDS)
def test_a_parameter_is_neutral_inside_its_limits_and_names_what_there_is(one, parameter):
    low, high = parameter.limits
    assert low <= parameter.neutral <= high
    assert parameter.size(0.0) == parameter.neutral
    assert parameter.spread > 0.0 and parameter.detection > 0.0
    for size in (parameter.neutral, *parameter.probes):
        parameter.check(size, nominal())
    assert any(low <= parameter.size(side * parameter.detection) <= high for side in (1.0, -1.0))
    with pytest.raises(InputError, match=parameter.name):
        parameter.check(high * 1.1 + 1.0, nominal())
    declared = {v.name for v in plant("plant_fom", initialize=False).variables if v.causality == "parameter"}
    for target in parameter.targets:
        if target.endswith("[*]"):
            assert target.removesuffix("[*]") + "[1]" in declared
        else:
            assert target in declared or target in DEFAULTS
    unit = {v.name: v.unit for v in plant("plant_fom", initialize=False).variables}
    first = parameter.targets[0].replace("[*]", "[1]")
    if first in unit and parameter.nominal is None and parameter.physical(1.0, nominal())[2] != "1":
        assert parameter.unit == unit[first]


@pytest.mark.parametrize("variant", ["modified", None])
@pytest.mark.parametrize(("one", "parameter"), PARAMETERS, ids=IDS)
def test_every_size_that_a_vehicle_can_have_changes_something_else(one, parameter, variant):
    """Sizes beyond its end would all be the same to a simulation, but not to derivatives: found were less than none."""
    values = nominal(variant) | DEFAULTS
    ends = parameter.range(values)
    assert parameter.limits[0] <= ends[0] <= parameter.neutral <= ends[1] <= parameter.limits[1]
    others = {p.name: p.probes[0] for p in one.parameters if p.probes}  # what has two sizes is nothing with one

    def changed(size):
        after = apply(one, {**others, parameter.name: float(size)}, values)
        return {name: after[name] for name in after if after[name] != values.get(name)}

    sizes = np.linspace(*ends, 9)
    assert all(changed(size) != changed(next_) for size, next_ in zip(sizes, sizes[1:]))
    for end, limit in zip(ends, parameter.limits):
        assert end == limit or changed(end) == changed(limit) == changed(0.5 * (end + limit))


@pytest.mark.parametrize("parameter", CATALOGUE["two_stage_stiffness"].parameters, ids=lambda p: p.name)
def test_a_stage_is_looked_for_on_either_side_that_it_is_hidden_on(parameter):
    """Derivatives say nothing of it while it is small, so only what is probed is found."""
    hidden = {np.sign(parameter.coordinate(drawn(CATALOGUE["two_stage_stiffness"], np.random.default_rng(k))[
        parameter.name])) for k in range(40)}
    assert hidden <= {np.sign(parameter.coordinate(probe)) for probe in parameter.probes}


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("variant", ["modified", None])
def test_neutral_sizes_change_nothing(name, variant):
    values = nominal(variant) | DEFAULTS
    for sizes in ({}, {p.name: p.neutral for p in CATALOGUE[name].parameters}):
        after = apply(CATALOGUE[name], sizes, values)
        assert {key: after[key] for key in values} == pytest.approx(values, rel=1e-15)
        assert all(after[key] == (1.0 if key.endswith("ratio") else 0.0) for key in set(after) - set(values))


@pytest.mark.parametrize("name", [n for n, one in CATALOGUE.items()
                                  if one.kind == "plant" or n.startswith("engine_torque")])
def test_a_size_worth_finding_is_possible_and_moves_the_plant(name):
    one = CATALOGUE[name]
    moved = []
    for side in (1.0, -1.0):
        sizes = {}
        for p in one.parameters:
            size = p.probes[0] if p.probes else p.size(side * 2.0 * p.detection)
            sizes[p.name] = float(np.clip(size, *p.limits))
        records = [run(plant("plant_fom", {"start.vehicle_speed": 12.0, **own(v)}, engine_torque=-20.0), 1.5,
                       engine_torque=steps((0.0, -20.0), (0.2, 230.0)))
                   for v in (nominal(), apply(one, sizes, nominal()))]
        moved.append(max(np.abs(records[1][n] - records[0][n]).max() / np.ptp(records[0][n]) for n in (
            "engine_speed", "wheel_speed", "vehicle_speed", "propeller_shaft_torque", "seat_acceleration")))
    one_sided = any(p.neutral in p.limits for p in one.parameters) or name == "suspension_mode"  # here rigid
    assert (max if one_sided else min)(moved) > 1e-3


@pytest.mark.parametrize("name", [n for n, one in CATALOGUE.items() if one.kind == "plant"])
def test_reduced_plants_and_estimators_have_it_or_are_said_to_have_lost_it(name):
    """An estimator of an extended vehicle would gain nothing by what was added to the full-order plant alone."""
    one, values = CATALOGUE[name], nominal()
    extended = values | apply(one, {p.name: p.probes[0] if p.probes else p.size(p.detection) for p in one.parameters},
                              values)

    def lumped(v):
        p = from_values(FullOrderParameters, own(v))
        return reduce(p), three_mass_at_hub(p)

    assert (lumped(extended) == lumped(values)) == (name in LOST), \
        "driveline/plants/reduced.py lumps it, or docs/plants/plant_rom.md says that it is lost, and LOST here"


def test_whatever_is_plausible_of_each_the_plant_takes_all_together():
    """Two causes the plant refused together shut a region a fit had to cross; it stayed before it, at a wrong cause."""
    car, random = FullOrderCar("pickup_10r80", "modified"), np.random.default_rng(1)
    for _ in range(40):
        ends = {e.name: {p.name: float(random.choice(p.limits)) for p in e.parameters} for e in CATALOGUE.values()}
        values = own(apply_all(ends, car.values)) | {"start.vehicle_speed": 12.0}
        for finer in (1.0, 5.0, 25.0):  # stiff and damped plants take shorter steps
            try:
                plant("plant_fom", values | {"solver.maximum_substep": values["solver.maximum_substep"] / finer})
                break
            except InputError as error:
                assert "maximum_substep" in str(error) and finer < 25.0


@given(st.sampled_from(PARAMETERS), st.floats(-1.0, 1.0))
def test_size_and_coordinate_are_inverse(pair, x):
    _, parameter = pair
    assert parameter.coordinate(parameter.size(x)) == pytest.approx(x, abs=1e-12)


def test_conventions_of_sizes_with_unequal_values():
    values = nominal()
    soft = apply(effect("shaft_stiffness"), {"axle_shaft_stiffness": 0.75}, values)
    assert soft["axle_shaft.stiffness"] == 0.75 * values["axle_shaft.stiffness"]
    assert soft["propeller_shaft.stiffness"] == values["propeller_shaft.stiffness"]
    late = apply(effect("engine_torque_delay"), {"engine_torque_delay": 0.013}, values)
    assert late["engine.air_delay"] == pytest.approx(values["engine.air_delay"] + 0.013)
    wheels = apply(effect("wheel_inertia"), {"wheel_inertia": 1.2}, values)
    for name in ("hub.inertia", "tyre.belt_inertia"):
        assert wheels[name] == 1.2 * values[name]
    lossy = apply(effect("mesh_loss"), {"transmission_loss": 3.0}, values)
    for i in (1, 7, 12):
        assert lossy[f"transmission.loss_fraction[{i}]"] == 3.0 * values[f"transmission.loss_fraction[{i}]"]
    both = apply_all({"vehicle_mass": {"vehicle_mass": 1.1}, "wheel_speed_delay": {"wheel_speed_delay": 0.02}}, values)
    assert both["vehicle.mass"] == 1.1 * values["vehicle.mass"]
    assert Errors.of("wheel_speed", both).delay == 0.02 and Errors.of("engine_speed", both).delay == 0.0


def test_physical_values_as_an_engineer_reads_them():
    values = nominal()
    mass, = effect("vehicle_mass").parameters
    assert mass.physical(1.1, values) == (values["vehicle.mass"], 1.1 * values["vehicle.mass"], "kg")
    assert effect("wheel_inertia").parameters[0].physical(1.2, values) == (1.0, 1.2, "1")
    assert effect("torque_meter_offset").parameters[0].physical(7.0, values) == (0.0, 7.0, "N.m")


def test_the_lash_moves_at_constant_sum_in_fifth_gear():
    values = nominal()
    ratio = values["transmission.ratio[7]"]

    def total(v):
        return v["transmission.half_gap"] / ratio + v["final_drive.half_gap"]

    for moved in (-1.0, -0.01, 0.01, 1.0):  # more than there is: all of it
        after = apply(effect("backlash_location"), {"backlash_shift": moved}, values)
        assert total(after) == pytest.approx(total(values), rel=1e-12)
        assert after["transmission.half_gap"] >= 0.0 and after["final_drive.half_gap"] >= 0.0


def test_the_lash_of_a_car_with_four_gears_moves_at_constant_sum_in_fourth():
    values = nominal() | {f"transmission.ratio[{entry}]": 0.0 for entry in range(7, 13)}
    ratio = values["transmission.ratio[6]"]
    after = apply(effect("backlash_location"), {"backlash_shift": 0.01}, values)
    assert after["final_drive.half_gap"] == pytest.approx(values["final_drive.half_gap"] - 0.01)
    assert after["transmission.half_gap"] == pytest.approx(values["transmission.half_gap"] + 0.01 * ratio)
    [shift] = effect("backlash_location").parameters
    assert shift.range(values)[0] == pytest.approx(-values["transmission.half_gap"] / ratio)


def test_a_suspension_comes_and_goes_with_its_compliance():
    rigid, sprung = nominal("modified"), nominal(None)
    change = effect("suspension_mode")
    made = apply(change, {"suspension_compliance": 1e-6}, rigid)
    assert made["suspension.enabled"] and made["suspension.stiffness"] == pytest.approx(1e6)
    gone = apply(change, {"suspension_compliance": -1.0 / sprung["suspension.stiffness"]}, sprung)
    assert not gone["suspension.enabled"]
    assert change.parameters[0].physical(1e-6, rigid) == (0.0, 1e-6, "m/N")
    there = 1.0 / sprung["suspension.stiffness"]
    assert change.parameters[0].physical(1e-6, sprung) == (there, there + 1e-6, "m/N")
    softer = apply(change, {"suspension_compliance": 1.0 / sprung["suspension.stiffness"]}, sprung)
    assert softer["suspension.stiffness"] == pytest.approx(0.5 * sprung["suspension.stiffness"])


@pytest.mark.parametrize(("one", "other", "same"), [
    (("coulomb_drag",), ("road_grade",), True),
    (("backlash_size", "coulomb_drag"), ("backlash_size", "rolling_resistance"), True),
    (("coulomb_drag",), ("coulomb_drag", "road_grade"), False),  # one more, not one for another
    (("rolling_resistance",), ("road_grade",), False),  # where they differ at all, on the way back, they do so surely
    (("coulomb_drag",), ("aerodynamic_drag",), False), (("coulomb_drag",), (), False),
    (("vehicle_mass",), ("engine_inertia",), False), (("coulomb_drag",), ("coulomb_drag",), False)])
def test_what_pushes_like_another(one, other, same):
    assert push_alike(one, other) is same and push_alike(other, one) is same


def test_unknown_names_are_refused_with_those_that_come_close():
    with pytest.raises(InputError, match="did you mean 'vehicle_mass'"):
        effect("vehicle_mas")
    with pytest.raises(InputError, match="it has propeller_shaft_stiffness, axle_shaft_stiffness"):
        effect("shaft_stiffness").complete({"stiffness": 1.0})


def test_the_command_lists_them(capfd):
    assert cli.main(["list", "effects", "--json"]) == 0
    listed = json.loads(capfd.readouterr().out)
    assert listed == {name: one.summary for name, one in CATALOGUE.items()}
