"""The 10R80 against published ratios, and any gearbox against Willis, energy and equilibrium."""

import dataclasses

import numpy as np
import pytest

from driveline.elements.planetary import HOUSING, Gearbox, PlanetarySet, ShiftElement
from driveline.quantities import InputError
from driveline.vehicles import load

PUBLISHED = {-1: -4.866, 1: 4.696, 2: 2.985, 3: 2.146, 4: 1.769, 5: 1.520,
             6: 1.275, 7: 1.000, 8: 0.854, 9: 0.689, 10: 0.636}
GEARS = sorted(PUBLISHED)


@pytest.fixture(scope="module")
def gearbox():
    return load("pickup_10r80").gearbox


def single_set(**changes):
    """One set (sun 30, ring 60): the ring held in gear 1, locked in gear 2."""
    numbers = dict(
        shafts=("sun", "ring", "carrier"), input_shaft="sun", output_shaft="carrier",
        sets={"1": PlanetarySet("sun", "ring", "carrier", 30, 60)},
        shift_elements={"B": ShiftElement("ring"), "C": ShiftElement("sun", "ring")},
        clutch_table={1: ("B",), 2: ("C",)}, inertias=(0.01, 0.02, 0.05))
    return Gearbox(**(numbers | changes))


@pytest.mark.parametrize("gear", GEARS)
def test_ratio_is_the_published_one_to_its_printed_digits(gearbox, gear):
    assert gearbox.ratio(gear) == pytest.approx(PUBLISHED[gear], abs=0.0005 + 1e-9)


@pytest.mark.parametrize("gear", GEARS)
def test_every_set_obeys_willis_and_every_engaged_element_holds(gearbox, gear):
    speed = dict(zip(gearbox.shafts, gearbox.speeds(gear))) | {HOUSING: 0.0}
    for s in gearbox.sets.values():
        sun, ring = speed[s.sun] - speed[s.carrier], speed[s.ring] - speed[s.carrier]
        assert sun * s.sun_teeth == pytest.approx(-ring * s.ring_teeth, abs=1e-9)
    for name in gearbox.clutch_table[gear]:
        element = gearbox.shift_elements[name]
        assert speed[element.shaft] == pytest.approx(speed[element.to], abs=1e-12)


def test_each_gear_leaves_the_other_two_elements_slipping(gearbox):
    for gear in set(GEARS) - {7}:
        speed = dict(zip(gearbox.shafts, gearbox.speeds(gear))) | {HOUSING: 0.0}
        for name in set(gearbox.shift_elements) - set(gearbox.clutch_table[gear]):
            element = gearbox.shift_elements[name]
            assert abs(speed[element.shaft] - speed[element.to]) > 0.05, (gear, name)


def test_adjacent_gears_differ_by_one_exchange(gearbox):
    for gear in range(1, 10):
        released = set(gearbox.clutch_table[gear]) - set(gearbox.clutch_table[gear + 1])
        assert len(released) == 1


def test_direct_drive_turns_everything_as_one(gearbox):
    assert gearbox.speeds(7) == pytest.approx(np.ones(len(gearbox.shafts)), abs=1e-12)
    assert gearbox.inertia_at_input(7) == pytest.approx(sum(gearbox.inertias))


def test_ratios_follow_by_hand_from_the_lever_diagram(gearbox):
    """Superposition by hand: a = R1/S1 and so on, one line a gear."""
    a, b, c, d = (s.ring_teeth / s.sun_teeth for s in gearbox.sets.values())
    overdriven = 1 + 1 / b  # ring 2 with its sun held
    behind = 1 / (1 + a)  # carrier 1 per sun 1 with ring 1 held
    assert gearbox.ratio(1) == pytest.approx(1 + d)  # ring 4 held, sun 4 driven
    assert gearbox.ratio(2) == pytest.approx((1 + d) / overdriven)  # the same, sun 4 on ring 2
    assert gearbox.ratio(-1) == pytest.approx(-(1 + d) * c / overdriven)  # sun 4 on ring 3, carrier 3 held
    assert gearbox.ratio(3) == pytest.approx((1 + d) / (1 + d * behind))  # sun 4, set 2 with the input
    together = (1 + b) / (1 / behind + b)  # set 2: sun at x / behind and ring at x, carrier at 1
    assert gearbox.ratio(4) == pytest.approx(1 / together)  # sets 3 and 4 locked at carrier 1
    assert gearbox.ratio(5) == pytest.approx((1 + d) / (1 + d * together))
    held = (overdriven + c) / (1 + c + (1 + a) / b)  # carrier 3: ring 3 at 1, sun 3 from sets 1 and 2
    assert gearbox.ratio(6) == pytest.approx((1 + d) / (1 + d * held))
    assert gearbox.ratio(8) == pytest.approx((1 + d) / (1 + d * (overdriven + c) / (1 + c)))
    assert gearbox.ratio(9) == pytest.approx((1 + d) / (1 + d * overdriven))
    assert gearbox.ratio(10) == pytest.approx(1 / overdriven)


@pytest.mark.parametrize("gear", GEARS)
def test_torques_balance_on_every_shaft_and_power_is_kept(gearbox, gear):
    torques = gearbox.torques(gear, 100.0)
    on_shaft = dict.fromkeys(gearbox.shafts, 0.0) | {HOUSING: 0.0}
    on_shaft[gearbox.input_shaft] += 100.0
    on_shaft[gearbox.output_shaft] += torques.output
    for s, (sun, ring, carrier) in zip(gearbox.sets.values(), torques.members):
        on_shaft[s.sun] += sun
        on_shaft[s.ring] += ring
        on_shaft[s.carrier] += carrier
        assert ring * s.sun_teeth == pytest.approx(sun * s.ring_teeth)  # equal tooth forces
        assert sun + ring + carrier == pytest.approx(0.0, abs=1e-9)
    for name, torque in torques.shift_elements.items():
        on_shaft[gearbox.shift_elements[name].shaft] += torque
        on_shaft[gearbox.shift_elements[name].to] -= torque
    reaction = -on_shaft.pop(HOUSING)
    assert list(on_shaft.values()) == pytest.approx([0.0] * len(gearbox.shafts), abs=1e-9)
    assert 100.0 + torques.output + reaction == pytest.approx(0.0, abs=1e-9)
    assert 100.0 + torques.output / gearbox.ratio(gear) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("gear", GEARS)
def test_inertia_at_the_input_is_what_the_input_feels(gearbox, gear):
    """Newton on every shaft with its constraint torques, against the sum J (w / w_in)^2."""
    speeds = gearbox.speeds(gear)
    felt = 0.0
    for shaft, inertia, speed in zip(gearbox.shafts, gearbox.inertias, speeds):
        if speed:  # the shaft as the output: an inertia torque J w there is felt as J w * w at the input
            through = dataclasses.replace(gearbox, output_shaft=shaft).torques(gear, inertia * speed**2)
            assert through.output == pytest.approx(-inertia * speed)
            felt += inertia * speed**2
    assert gearbox.inertia_at_input(gear) == pytest.approx(felt)
    assert gearbox.inertia_at_input(gear) > gearbox.inertias[gearbox.shafts.index(gearbox.input_shaft)]


def test_neutral_turns_idle_shafts_but_not_the_output(gearbox):
    speeds = dict(zip(gearbox.shafts, gearbox.speeds(0)))
    assert speeds[gearbox.output_shaft] == 0.0
    assert speeds[gearbox.input_shaft] == 1.0
    assert gearbox.inertia_at_input(0) > 0.0
    with pytest.raises(InputError, match="neutral"):
        gearbox.ratio(0)
    with pytest.raises(InputError, match="neutral"):
        gearbox.torques(0, 1.0)


def test_one_set_by_hand():
    gearbox = single_set()
    assert gearbox.ratio(1) == pytest.approx(3.0)
    assert gearbox.inertia_at_input(1) == pytest.approx(0.01 + 0.05 / 9)
    torques = gearbox.torques(1, 10.0)
    assert torques.output == pytest.approx(-30.0)
    assert torques.members[0] == pytest.approx([-10.0, -20.0, 30.0])
    assert torques.shift_elements == pytest.approx({"B": 20.0})


@pytest.mark.parametrize("engaged, freedom", [((), 2), (("B", "C"), 0)])
def test_a_row_without_one_degree_of_freedom_names_gear_and_row(engaged, freedom):
    gearbox = single_set(clutch_table={4: engaged})
    row = " ".join(engaged)
    with pytest.raises(InputError, match=rf"gear 4 \(engaged: {row}\) leaves {freedom} degrees"):
        gearbox.speeds(4)


def test_a_row_that_stops_input_or_output_is_refused():
    brakes = {"S": ShiftElement("sun"), "K": ShiftElement("carrier")}
    gearbox = single_set(shift_elements=brakes, clutch_table={1: ("S",), 2: ("K",)})
    with pytest.raises(InputError, match="gear 1 .* input shaft still"):
        gearbox.speeds(1)
    with pytest.raises(InputError, match="gear 2 .* output shaft still"):
        gearbox.speeds(2)


@pytest.mark.parametrize("changes, message", [
    ({"input_shaft": "turbine"}, "input names the shaft 'turbine'"),
    ({"sets": {"1": PlanetarySet("sun", "ring", "web", 30, 60)}}, "planetary set 1 names the shaft 'web'"),
    ({"sets": {"1": PlanetarySet("sun", "ring", "carrier", 60, 30)}}, "set 1 has 60 sun and 30 ring"),
    ({"shift_elements": {"B": ShiftElement("rim")}}, "shift element B names the shaft 'rim'"),
    ({"clutch_table": {3: ("Z",)}}, "gear 3 engages 'Z'"),
    ({"inertias": (0.1, 0.1)}, "3 shafts need as many inertias"),
    ({"inertias": (0.1, -0.1, 0.1)}, "none negative"),
])
def test_nonsense_is_refused_by_name(changes, message):
    with pytest.raises(InputError, match=message):
        single_set(**changes)


def test_a_gear_that_is_not_in_the_table_is_refused():
    with pytest.raises(InputError, match="gear 11 is not in the clutch table; it has 1, 2"):
        single_set().ratio(11)
