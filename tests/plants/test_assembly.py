"""From elements to arrays: what is refused, and that names find what they name."""

import numpy as np
import pytest
from runs import PLANTS, Bench, plant

from driveline.elements.torque_ripple import TorqueRipple
from driveline.kernels import layout as k
from driveline.plants.assembly import GROUND, Assembly, ByGear
from driveline.quantities import InputError


@pytest.mark.parametrize("inertia", [0.0, -0.1, np.nan, ByGear((0.1, 0.0))])
def test_a_node_without_inertia_is_refused_by_name(inertia):
    with pytest.raises(InputError, match="inertia of pinion"):
        Assembly(inputs=(), gears=2).node("pinion", inertia, "rad/s", "pinion")


def test_a_gear_table_of_the_wrong_length_is_refused():
    net = Assembly(inputs=(), gears=3)
    net.node("pinion", ByGear((0.1, 0.2)), "rad/s", "pinion")
    with pytest.raises(InputError, match="2 entries: 3 are needed"):
        net.build()


@pytest.mark.parametrize("name", PLANTS)
def test_states_branches_and_outputs_are_found_under_their_names(name):
    model = plant(name, {"start.vehicle_speed": 12.0}, engine_torque=80.0)
    net = model.network
    entries = [entry.name for entry in net.entries]
    assert len(set(entries)) == len(entries) == net.plan[k.CONTINUOUS]
    assert entries[-2:] == ["energy_supplied", "energy_dissipated"]
    assert [f"{node}_speed" for node in net.nodes] == entries[:len(net.nodes)]
    for branch, place in net.twists.items():
        if place:
            assert entries[place] in (f"{branch}_twist", f"{branch}_deflection", "air_torque")
    for level, place in net.levels.items():
        assert entries[place] == level
    assert net.outputs == tuple(variable.name for variable in model.output_variables)
    state = dict(zip(entries, model.state))
    crank = "crankshaft_speed" if name == "plant_fom" else "engine_speed"
    assert model["engine_speed"] == state[crank]


def test_what_only_drives_is_told_from_what_others_look_at():
    """A step between contacts relies on it: who else hears a signal, or looks at a torque, is asked again."""
    def network(*extra):
        net = Assembly(inputs=("pushed", "pressed", "ahead", "share"))
        node, other = (net.node(name, 1.0, "rad/s", name) for name in ("node", "other"))
        push = net.source("push", node, 1.0, net.signal("pushed"))
        net.friction("brake", other, GROUND, 5.0, signal=net.signal("pressed"))
        net.leading("lead", node, 2.0, net.signal("ahead"), net.signal("share"))
        swing = net.ripple("swing", node, TorqueRipple(4.0, 3.0, 0.0), net.integral(node, "angle", "rad", "angle"))
        for add in extra:
            add(net, other, {"push": push, "swing": swing})
        made = net.build().plan
        drivers, heard = (list(made[made[table]:][:made[count]])
                          for table, count in ((k.DRIVER_TABLE, k.DRIVERS), (k.HEARD_TABLE, k.HEARD)))
        return [net.inputs[signal - k.SIGNALS_HEAD] for signal in heard if signal >= k.SIGNALS_HEAD], drivers

    assert network() == (["pressed"], [0, 2, 3])
    assert network(lambda net, node, of: net.reaction("mount", node, of["push"], 0.1)) == (
        ["pushed", "pressed"], [2, 3])
    assert network(lambda net, node, of: net.reaction("mount", node, of["swing"], 0.1)) == (["pressed"], [0, 2])
    assert network(lambda net, node, of: net.friction("clutch", 0, node, 3.0, signal=net.signal("ahead"))) == (
        ["pressed", "ahead"], [0, 2, 3])


def test_every_branch_acts_on_its_two_nodes_as_its_ratios_say():
    """-ratio_a T on a, +ratio_b T on b: the rates of a network of one of each kind, node by node."""
    def build(net):
        a, b, c = (net.node(name, inertia, "rad/s", name)
                   for name, inertia in (("a", 0.5), ("b", 2.0), ("c", 3.0)))
        net.shaft("shaft", a, b, 100.0, 4.0, ratio_a=2.0, ratio_b=3.0)
        net.friction("clutch", b, c, 7.0, drag=0.1, ratio_b=-0.5)
        net.friction("brake", c, GROUND, 5.0)
        net.source("motor", a, 11.0, k.ONE)
        net.aerodynamic("air", c, 0.25, ratio=0.4)
        net.loss("loss", a, 0, 1.5, 0.2, 0.1)

    model = Bench(build, {"a": 6.0, "b": 1.0, "c": -8.0})
    model.state[model.network.twists["shaft"]] = 0.03
    rates, torques = model.rates()
    shaft = 100.0 * 0.03 + 4.0 * (2.0 * 6.0 - 3.0 * 1.0)
    slip = 1.0 - (-0.5) * -8.0
    clutch = np.sign(slip) * 7.0 + 0.1 * slip
    air = 0.25 * (0.4 * -8.0) * abs(0.4 * -8.0)
    loss = (1.5 + 0.1 * shaft) * np.tanh(6.0) + 0.2 * 6.0
    assert torques[:6] == pytest.approx([shaft, clutch, -5.0, -11.0, air, loss])
    assert rates[:3] == pytest.approx([(-2.0 * shaft + 11.0 - loss) / 0.5, (3.0 * shaft - clutch) / 2.0,
                                       (-0.5 * clutch + 5.0 - 0.4 * air) / 3.0])
    names = [entry.name for entry in model.network.entries]
    heat = 4.0 * 9.0**2 + clutch * slip + -5.0 * -8.0 + air * 0.4 * -8.0 + loss * 6.0
    assert rates[names.index("energy_dissipated")] == pytest.approx(heat)
    assert rates[names.index("energy_supplied")] == pytest.approx(11.0 * 6.0)


def test_what_leads_a_node_pulls_it_towards_its_signal_as_far_as_another_says():
    def build(net):
        a, b = (net.node(name, 0.5, "rad/s", name) for name in ("a", "b"))
        net.leading("led", a, 6.0, signal=k.ONE, share=k.ONE)
        net.leading("not led", b, 6.0, signal=k.ONE, share=k.NOISE)  # no noise here

    model = Bench(build, {"a": 3.0, "b": 3.0})
    rates, torques = model.rates()
    assert torques[:2] == pytest.approx([12.0, 0.0]) and rates[:2] == pytest.approx([-24.0, 0.0])
    assert rates[[entry.name for entry in model.network.entries].index("energy_supplied")] == pytest.approx(-36.0)


def test_a_read_out_follows_its_branch_and_does_not_act_back():
    def build(net):
        a = net.node("a", 1.0, "rad/s", "turning")
        case = net.node("case", 2.0, "rad/s", "case")
        shaft = net.shaft("shaft", a, GROUND, 50.0, 0.0)
        net.reaction("reaction", case, shaft, -3.0)

    model = Bench(build, {"a": 0.0, "case": 0.0})
    model.state[model.network.twists["shaft"]] = 0.1
    rates, _ = model.rates()
    assert rates[:2] == pytest.approx([-5.0, -3.0 * 5.0 / 2.0])
