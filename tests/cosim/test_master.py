"""The master's laws: what a step sees, where time ends, FMU equals twin, and what is refused."""

import functools
import logging
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest
import toys
from hypothesis import given
from hypothesis import strategies as st

from cosim.master import (
    Constant,
    FmuParticipant,
    Interrupted,
    Master,
    Ramp,
    Result,
    SimulationError,
    Step,
    Table,
)
from cosim.master.participants import ModelParticipant
from driveline.model import LATEST, Model
from driveline.quantities import InputError, Variable

RAMP = Ramp(before=0.0, after=1.0, time=0.1, duration=0.1, unit="rad")


def lag(**values):
    return toys.Lag(values)


def counter():
    return toys.Counter({})


class Chain(Model):
    """x' = u, in steps: y(k+1) = y(k) + u(k); shows exactly which u it saw."""

    name = "chain"

    def __init__(self, start: float = 0.0, through: bool = False) -> None:
        self._start = start
        self.variables = (
            Variable("u", "1", "input", "input", "continuous"),
            Variable("y", "1", "sum of inputs", "output", "continuous", depends_on=("u",) if through else ()),
        )
        super().__init__()

    def _prepare(self) -> None:
        self.state = np.zeros(1)

    def _initialize(self, start_time: float) -> None:
        self.state[0] = self.values[1] = self._start

    def _step(self, time: float, dt: float) -> None:
        self.state[0] += self.values[0]
        self.values[1] = self.state[0]


# ---- time ----

@pytest.mark.parametrize(("step", "stop"), [(0.1, 1.0), (0.3, 3.0), (0.0007, 0.07), (1e-3, 1.0),
                                           (0.007, 0.1)])
def test_the_run_ends_exactly_at_its_stop(step, stop):
    result = Master(step=step).add("a", counter()).run(stop=stop)
    assert result.time[-1] == stop
    assert result["a.ended"][-1] == pytest.approx(stop, rel=1e-15)
    assert result["a.steps"][-1] == math.ceil(round(stop / step, 9))
    assert (result.time[:-1] == [round(k * step, 12) for k in range(result.time.size - 1)]).all()


def test_a_run_may_start_anywhere():
    result = Master(step=0.01).add("a", counter()).run(start=799.95, stop=800.0)
    assert (result.time == np.round(np.arange(79995, 80001) / 100, 2)).all()


@pytest.mark.parametrize("step", [1e-3, 7e-4])
def test_a_run_that_starts_as_late_as_is_possible_is_that_from_zero(step):
    """Delays, sensors and their ticks among it; later it is refused, before anything runs."""
    def run(start):
        torque = Step(before=-20.0, after=250.0, time=start + 0.05, unit="N.m")
        return (Master(step=step).add("p", "plant_fom", twin=True, parameters={"start.vehicle_speed": 15.0})
                .connect(torque, "p.engine_torque").run(stop=start + 0.5, start=start))

    reference, late = run(0.0), run(LATEST - 1.0)
    assert late.time - (LATEST - 1.0) == pytest.approx(reference.time, abs=1e-9)
    for name in reference.names:
        assert late[name] == pytest.approx(reference[name], rel=0, abs=1e-4 * np.ptp(reference[name]) + 1e-9), name
    for start in (LATEST - 0.1, 8.9e6):
        with pytest.raises(InputError, match="^(start|stop) is .* at most 4194304 s is needed"):
            run(start)


def test_a_lag_of_several_rates_follows_its_exact_solution():
    result = (Master(step=1e-3).add("a", lag(time_constant=0.05), step=7e-3)
              .connect(Step(before=0.0, after=1.0, time=0.07), "a.u").record("a.y", step=7e-3).run(stop=0.7))
    expected = 1.0 - np.exp(-np.maximum(result.time - 0.07, 0.0) / 0.05)
    assert result["a.y"] == pytest.approx(expected, abs=1e-12)


def test_times_may_be_text_with_a_unit():
    plain, told = (Master(step=step).add("a", counter(), step=own).record("a.steps", step=every).run(stop, start)
                   for step, own, every, stop, start in ((2e-3, 4e-3, 8e-3, 0.04, 0.008),
                                                         ("2 ms", "4 ms", "8 ms", "40 ms", "8 ms")))
    assert told.time.tolist() == plain.time.tolist() and told["a.steps"].tolist() == plain["a.steps"].tolist()
    for wrong in (lambda: Master(step="2 mm"), lambda: Master().add("a", counter()).run("soon")):
        with pytest.raises(InputError, match="^(step|stop) is '(2 mm|soon)'"):
            wrong()


# ---- what a step sees ----

def test_a_slow_participant_samples_at_the_start_of_its_step_and_holds_its_outputs():
    ticks = np.arange(0, 41)
    table = Table(times=ticks / 1000, data=ticks, interpolation="hold", unit="deg")
    result = (Master(step=1e-3).add("slow", counter(), step=1e-2).connect(table, "slow.u")
              .record("slow.u", "slow.seen", "slow.steps", step=1e-3).run(stop=0.04))
    assert result["slow.steps"].tolist() == (ticks // 10).tolist()
    assert result["slow.u"].tolist() == (ticks // 10 * 10).tolist()
    assert result["slow.seen"].tolist() == np.maximum(ticks // 10 * 10 - 10, 0).tolist()


def test_a_fast_participant_sees_the_held_output_of_a_slow_one():
    ramp = Ramp(before=0.0, after=100.0, time=0.0, duration=0.1, unit="deg")
    result = (Master(step=1e-3).add("slow", counter(), step=1e-2).add("fast", counter())
              .connect(ramp, "slow.u").connect("slow.seen", "fast.u").run(stop=0.05))
    assert (result["fast.seen"][1:] == result["slow.seen"][:-1]).all()
    assert np.flatnonzero(np.diff(result["slow.seen"])).tolist() == [19, 29, 39, 49]


@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
def test_two_in_a_loop_differ_by_order_as_derived_by_hand(order):
    """a adds b, b adds a. Jacobi: both see the old value. Gauss-Seidel: b sees the new a."""
    result = (Master(step=0.1, order=order).add("a", Chain(1.0)).add("b", Chain(1.0))
              .connect("a.y", "b.u").connect("b.y", "a.u").run(stop=1.0))
    a, b, expected = 1.0, 1.0, [(1.0, 1.0)]
    for _ in range(10):
        if order == "jacobi":
            a, b = a + b, b + a
        else:
            a = a + b
            b = b + a
        expected.append((a, b))
    assert list(zip(result["a.y"], result["b.y"])) == expected


class Mixer(Model):
    """y(k+1) = y(k) / 2 + one(k) - two(k) / 4 + dt, in kelvin, of inputs in units of their own."""

    name = "mixer"

    def __init__(self, start: float, units: tuple[str, str]) -> None:
        self.variables = (Variable("one", units[0], "input", "input", "continuous", start=3.0),
                          Variable("two", units[1], "input", "input", "continuous", start=-2.0),
                          Variable("y", "K", "output", "output", "continuous", start=start))
        super().__init__()

    def _prepare(self) -> None:
        self.state = np.zeros(1)

    def _initialize(self, start_time: float) -> None:
        self.state[0] = self.values[2]

    def _step(self, time: float, dt: float) -> None:
        self.values[2] = self.state[0] = 0.5 * self.state[0] + self.values[0] - 0.25 * self.values[1] + dt


# of the participants of the law below: start value, units of both inputs; and of these factor and offset from kelvin
MIXED = {"a": (1.0, ("degC", "degF")), "b": (20.0, ("kK", "K")), "c": (300.0, ("K", "degC"))}
OF_KELVIN = {"K": (1.0, 0.0), "kK": (1e-3, 0.0), "degC": (1.0, -273.15), "degF": (1.8, 32.0 - 1.8 * 273.15)}


@given(gauss_seidel=st.booleans(), periods=st.lists(st.integers(1, 6), min_size=3, max_size=3), stop=st.integers(1, 20),
       every=st.integers(1, 4),
       sources=st.lists(st.sampled_from(["", "signal", "a.y", "b.y", "c.y"]), min_size=6, max_size=6))
def test_every_step_sees_its_beginning_and_in_gauss_seidel_the_end_of_those_before_it(
        gauss_seidel, periods, stop, every, sources):
    """Whoever is connected to whom, at whatever rates [ms], with whatever conversion."""
    master = Master(step=1e-3, order="gauss-seidel" if gauss_seidel else "jacobi")
    period = dict(zip(MIXED, periods))
    for name, (start, units) in MIXED.items():
        master.add(name, Mixer(start, units), step=period[name] * 1e-3)
    wires = dict(zip([(name, entry) for name in MIXED for entry in ("one", "two")], sources))
    ramp = Ramp(before=-5.0, after=50.0, time=0.0, duration=0.02, unit="K")
    master.signal("signal", ramp).record("*", step=every * 1e-3)
    for (name, entry), source in wires.items():
        if source:
            master.connect(source, f"{name}.{entry}")
    result = master.run(stop=stop * 1e-3)

    def begun(name, tick):  # beginning of the last step that began at or before it
        return tick if tick == stop else tick // period[name] * period[name]

    @functools.cache
    def output(name, tick):
        end = begun(name, tick)
        if end == 0:
            return MIXED[name][0]
        begin = begun(name, end - 1)
        one, two = (seen(name, entry, begin, end) for entry in ("one", "two"))
        return 0.5 * output(name, begin) + one - 0.25 * two + 1e-3 * (end - begin)

    def seen(name, entry, begin, end):
        source = wires[name, entry]
        if not source:
            return {"one": 3.0, "two": -2.0}[entry]
        if source == "signal":
            kelvin = float(ramp.values(np.array(1e-3 * begin)))
        else:
            kelvin = output(source[0], end if gauss_seidel and source[0] < name else begin)
        factor, offset = OF_KELVIN[MIXED[name][1][entry == "two"]]
        return factor * kelvin + offset

    ticks = [*range(0, stop, every), stop]
    for name in MIXED:
        expected = [output(name, tick) for tick in ticks]
        assert result[f"{name}.y"] == pytest.approx(expected, rel=1e-10, abs=1e-9)
        for entry in ("one", "two"):  # as sampled where the present step began
            expected = [seen(name, entry, begun(name, tick), begun(name, tick)) for tick in ticks]
            assert result[f"{name}.{entry}"] == pytest.approx(expected, rel=1e-10, abs=1e-9)


def test_jacobi_does_not_depend_on_who_was_added_first():
    def run(names):
        master = Master(step=1e-3)
        for name in names:
            master.add(name, lag(time_constant=0.1 if name == "a" else 0.03, start_angle=1.0))
        return master.connect("a.y", "b.u").connect("b.y", "a.u").run(stop=0.3)

    one, other = run("ab"), run("ba")
    assert (one["a.y"] == other["a.y"]).all()
    assert (one["b.y"] == other["b.y"]).all()


def test_what_is_recorded_and_how_often_changes_nothing():
    def run(record_step, *what):
        master = Master(step=1e-3).add("a", lag()).add("b", counter(), step=5e-3)
        return (master.connect(RAMP, "a.u").connect("a.y", "b.u")
                .record("a.y", "b.seen", *what, step=record_step).run(stop=0.5))

    fine, coarse, more = run(1e-3), run(1e-2), run(7e-3, "a.*", "b.*", "a.time_constant")
    assert (fine["b.seen"][::10] == coarse["b.seen"]).all()
    assert (fine["a.y"][::10] == coarse["a.y"]).all()
    assert (fine["a.y"][::7] == more["a.y"][:-1]).all()
    assert more["a.time_constant"].tolist() == [0.1] * more.time.size


@pytest.mark.parametrize("step", [1e-3, "1 ns"])
def test_a_record_larger_than_any_memory_is_refused_before_signals_are_looked_at(step):
    master = Master(step).add("plant", "plant_rom_3dof", twin=True)
    master.connect(Ramp(before=0.0, after=100.0, time=1.0, duration=1.0), "plant.engine_torque")
    with pytest.raises(InputError, match=r"10 values at 4\d+1 instants are more than there is memory for"):
        master.run(4e6)


@pytest.mark.parametrize("step", [2e-3, 3e-3, 5e-3])
def test_outputs_are_held_in_the_record_though_they_feed_nobody(step):
    """A record that has instants between the ends of steps shows what the last of them gave."""
    result = Master(step=step).add("a", counter()).record("a.ended", step=3e-3).run(stop=0.031)
    ticks, length = np.round(result.time * 1000), round(step * 1000)
    held = ticks // length * length
    held[-1] = 31  # the last step is as short as it has to be
    assert result["a.ended"] * 1000 == pytest.approx(held)


def test_outputs_nobody_sees_are_not_read():
    class Reads(ModelParticipant):
        count = 0

        def read(self):
            self.count += 1
            super().read()

    participant = Reads("a", counter())
    Master(step=1e-3).add("a", participant).record("a.ended", step=1e-2).run(stop=0.1)
    assert participant.count == 1 + 10


def test_a_connection_converts_units_and_says_so():
    master = Master(step=1e-2).add("a", lag(start_angle=1.0)).add("b", counter()).connect("a.y", "b.u")
    result = master.run(stop=0.1)
    assert result["b.seen"][1:] == pytest.approx(np.degrees(result["a.y"][:-1]), rel=1e-15)
    assert any("a.y [rad] -> b.u [deg]" in notice and "57.29" in notice for notice in master.notices)


class Holder(Model):
    """y is u, a step later."""

    name = "holder"

    def __init__(self, unit: str, kind: str = "real", **limits: float) -> None:
        self.variables = (Variable("u", unit, "input", "input", "discrete", kind, **limits),
                          Variable("y", unit, "the same", "output", "discrete", kind))
        super().__init__()

    def _prepare(self) -> None:
        self.state = np.zeros(1)

    def _initialize(self, start_time: float) -> None:
        self.state[0] = self.values[1] = self.values[0]

    def _step(self, time: float, dt: float) -> None:
        self.values[1] = self.state[0] = self.values[0]


@pytest.mark.parametrize(("source", "target", "notice"), [
    ("", "", "a.y -> b.u: neither declares a unit, nothing was checked"),
    ("rad", "", "a.y -> b.u: b.u declares no unit, taken as 'rad'"),
    ("", "rad", "a.y -> b.u: a.y declares no unit, taken as 'rad'")])
def test_a_value_whose_unit_nobody_declares_passes_as_it_is_and_that_is_said(source, target, notice):
    master = Master(step=0.1).add("a", Holder(source)).add("b", Holder(target)).connect(3.0, "a.u")
    result = master.connect("a.y", "b.u").run(stop=0.3)
    assert result["b.y"].tolist() == [3.0] * 4 and notice in master.notices


@pytest.mark.parametrize(("value", "given", "unit", "arrives"), [
    (90.0, "deg", "rad", np.pi / 2.0), (300.0, "K", "degC", 26.85), (3.0, "", "rad", 3.0)])
def test_a_constant_arrives_in_the_unit_of_the_input(value, given, unit, arrives):
    master = Master(step=0.1).add("a", Holder(unit)).connect(Constant(value=value, unit=given), "a.u")
    result = master.record("a.*").run(stop=0.2)
    assert result["a.u"] == pytest.approx([arrives] * 3) and result["a.y"] == pytest.approx([arrives] * 3)


def test_what_counts_may_drive_what_measures_and_is_a_number_of_its_own_unit():
    def connected(unit, kind):
        master = Master(step=0.1).add("a", Holder("km", "integer")).add("b", Holder(unit, kind)).connect(3, "a.u")
        return master.connect("a.y", "b.u").run(stop=0.3)["b.y"].tolist()

    assert connected("m", "real") == [3000.0] * 4 and connected("km", "integer") == [3.0] * 4
    with pytest.raises(InputError, match="'a.y' is in 'km', but 'b.u' in 'm': a value of type integer is not conv"):
        connected("m", "integer")


@pytest.mark.parametrize(("given", "shown", "last"), [("deg", "deg", 90.0), ("", "rad", 90.0)])
def test_a_signal_is_recorded_in_its_own_unit_or_where_it_has_none_in_that_of_its_input(given, shown, last):
    master = Master(step=0.1).add("a", Holder("rad"))
    master.signal("turned", Ramp(before=0.0, after=90.0, time=0.0, duration=0.2, unit=given))
    master.signal("nowhere", Ramp(before=0.0, after=90.0, time=0.0, duration=0.2))
    result = master.connect("turned", "a.u").run(stop=0.2)
    assert (master.recorded()["turned"], result["turned"][-1]) == (shown, last)
    assert (master.recorded()["nowhere"], result["nowhere"][-1]) == ("", 90.0)
    assert result["a.y"][-1] == pytest.approx(np.radians(45.0) if given else 45.0)


def test_the_range_of_an_input_is_in_its_own_unit():
    """A signal in degrees at an input of at most one radian is refused where it gets there, and not before."""
    master = Master(step=0.1).add("a", Holder("rad", minimum=-1.0, maximum=1.0))
    master.connect(Ramp(before=0.0, after=90.0, time=0.0, duration=9.0, unit="deg"), "a.u")
    assert master.run(stop=5.7)["a.y"][-1] == pytest.approx(np.radians(56.0))
    with pytest.raises(InputError, match=r"^signal 'a.u' at t = 5.8 s: a.u is 1.01\d* rad: at most 1 is possible"):
        master.run(stop=9.0)


def test_start_values_travel_along_connections_whatever_the_order():
    """A participant is initialized with what its source starts with, even if it was added first."""
    result = (Master(step=1e-2).add("b", lag(time_constant=1.0)).add("a", lag(start_angle=2.0))
              .connect("a.y", "b.u").run(stop=0.1))
    assert result["b.y_speed"][0] == 2.0


@pytest.mark.parametrize("names", ["abcd", "bcda", "dcba", "cadb"])
def test_start_values_travel_out_of_a_loop_whatever_the_order(names):
    """b and c are in one, a and d are led by it."""
    master = Master(step=0.1)
    for name in names:
        master.add(name, lag(start_angle={"b": 1.0, "c": 1.0}.get(name, 0.0)))
    for source, target in (("b", "c"), ("c", "b"), ("c", "a"), ("a", "d")):
        master.connect(f"{source}.y", f"{target}.u")
    result = master.run(stop=0.1)
    assert result["a.y_speed"][0] == pytest.approx(10.0)  # of 1 rad in 0.1 s
    assert result["d.y_speed"][0] == 0.0


def test_unconnected_inputs_and_loops_are_said_aloud(caplog):
    caplog.set_level(logging.INFO, "cosim")
    master = Master(step=0.1).add("a", Chain(through=True)).add("b", Chain(through=True)).add("c", lag())
    master.connect("a.y", "b.u").connect("b.y", "a.u").run(stop=0.1)
    assert {"c.u is not connected: it stays at its start value, 0 rad",
            "c.gear is not connected: it stays at its start value, 1"} <= set(master.notices)
    loop = next(n for n in master.notices if n.startswith("algebraic loop"))
    assert all(name in loop for name in ("a.u", "a.y", "b.u", "b.y"))
    assert "algebraic loop" in caplog.text


def test_a_loop_with_a_state_in_it_is_no_algebraic_loop():
    master = Master(step=0.1).add("a", Chain(through=True)).add("b", Chain(through=False))
    master.connect("a.y", "b.u").connect("b.y", "a.u").run(stop=0.1)
    assert not any("loop" in notice for notice in master.notices)


# ---- FMUs and their twins ----

@pytest.mark.parametrize("order", ["jacobi", "gauss-seidel"])
def test_fmus_and_twins_give_the_same_bits_in_any_mixture(fmus, order):
    def run(a, b):
        return (Master(step=1e-3, order=order)
                .add("a", a, parameters={"time_constant": 0.03, "start_angle": "10 deg"})
                .add("b", b, step=3e-3).connect(RAMP, "a.u")
                .connect(Step(before=1, after=5, time=0.2), "a.gear").connect("a.y", "b.u").run(stop=0.5))

    reference = run(lag(), counter())
    assert reference["a.gear_out"][-1] == 5.0
    assert np.ptp(reference["b.seen"]) > 40.0
    for a, b in ((fmus / "lag.fmu", fmus / "counter.fmu"), (lag(), fmus / "counter.fmu"),
                 (fmus / "lag.fmu", counter())):
        mixed = run(a, b)
        assert mixed.units == reference.units
        assert all((mixed[name] == reference[name]).all() for name in reference.names)


def test_two_instances_of_one_fmu_are_two(fmus):
    result = (Master(step=1e-2).add("a", fmus / "lag.fmu", parameters={"start_angle": 1.0})
              .add("b", fmus / "lag.fmu", parameters={"start_angle": -1.0}).run(stop=0.1))
    assert (result["a.y"] == -result["b.y"]).all()
    assert result["a.y"][0] == 1.0


def test_a_master_runs_again_from_the_start(fmus):
    master = Master(step=1e-2).add("a", fmus / "lag.fmu", parameters={"start_angle": 1.0})
    master.add("b", lag()).connect("a.y", "b.u")
    first = master.run(stop=0.3)
    master.set("a.start_angle", 2.0).set("b.start_angle", 0.5)
    second = master.run(stop=0.3)
    master.set("a.start_angle", 1.0).set("b.start_angle", 0.0)
    third = master.run(stop=0.3)
    assert second["a.y"][0] == 2.0
    assert all((first[name] == third[name]).all() for name in first.names)


def test_somebody_elses_fmu_takes_part(foreign_fmu):
    """No units, no dependencies, locals and strings: taken as they are, and said."""
    master = (Master(step=0.1).add("a", lag(start_angle=1.0)).add("f", foreign_fmu, parameters={"label": "x"})
              .connect("a.y", "f.level").record("f.*", "f.inner"))
    result = master.run(stop=0.5)
    assert (result["f.doubled"][1:] == 2.0 * result["f.level"][:-1]).all()
    assert result["f.inner"][-1] == 5.0
    assert result.units["f.doubled"] == ""
    assert any("f.level declares no unit, taken as 'rad'" in notice for notice in master.notices)


def test_an_fmu_with_a_string_input_and_a_switch_takes_part(foreign_fmus):
    """A string cannot be connected, but set; true and false may be written out."""
    master = Master(step=0.1).add("f", foreign_fmus / "worded.fmu", parameters={"on": "true"})
    assert master.run(stop=0.2)["f.shown"].tolist() == [0.0, 2.0, 2.0]
    assert any("f.words is not connected: it stays at its start value, 'hi'" in notice for notice in master.notices)
    master.set("f.words", "hello").set("f.on", "False")
    assert master.run(stop=0.2)["f.shown"].tolist() == [0.0, -5.0, -5.0]
    for source in (5, RAMP, "f.said"):
        with pytest.raises(InputError, match="'f.words' is a string: strings can be set, but not connected"):
            master.connect(source, "f.words")


def test_an_fmu_without_outputs_takes_part(foreign_fmus):
    result = Master(step=0.1).add("f", foreign_fmus / "silent.fmu").run(stop=0.2)
    assert result.names == [] and result.time.size == 3


def test_numpys_numbers_are_numbers():
    master = Master(step=0.1).add("a", lag(), parameters={"time_constant": np.float32(0.5)})
    result = master.connect(np.int64(5), "a.gear").connect(np.float32(0.25), "a.u").record("a.*").run(stop=0.2)
    assert result["a.gear"].tolist() == [5.0] * 3 and result["a.u"].tolist() == [0.25] * 3
    assert result.provenance["participants"]["a"]["parameters"] == {"time_constant": 0.5}


def test_a_failing_fmu_is_named_with_time_and_its_own_words(fmus, capfd):
    master = Master(step=0.1).add("a", fmus / "lag.fmu")
    master.connect(Step(before=0.0, after=1e9, time=0.35), "a.u")
    with pytest.raises(SimulationError, match=r"a \(lag.fmu\) at t = 0.4 s.*left the finite") as caught:
        master.run(stop=1.0)
    assert caught.value.result.time.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert not caught.value.result.complete


def test_a_failing_twin_says_the_same():
    master = Master(step=0.1).add("a", lag()).connect(Step(before=0.0, after=1e9, time=0.35), "a.u")
    with pytest.raises(SimulationError, match=r"a at t = 0.4 s: y has left the finite numbers"):
        master.run(stop=1.0)


class Unsettled(toys.Lag):
    """Possible parameters that together give no start, as a stiffness of 1e308 in the full-order plant."""

    def _initialize(self, start_time):
        raise ArithmeticError("lag at the start: y is no longer finite")


def test_a_twin_that_cannot_compute_its_start_was_given_wrong_input_as_its_fmu_says():
    with pytest.raises(InputError, match=r"^a: lag at the start: y is no longer finite"):
        Master(step=0.1).add("a", Unsettled({})).run(stop=0.1)


def test_a_value_that_is_not_finite_is_named(foreign_fmu):
    master = Master(step=0.1).add("f", foreign_fmu)
    master.connect(Step(before=0.0, after=-1.0, time=0.25), "f.level")
    with pytest.raises(SimulationError, match=r"f.root is not finite at t = 0.4 s") as caught:
        master.run(stop=1.0)
    assert caught.value.result.time[-1] == pytest.approx(0.3)


def test_the_source_of_what_is_not_finite_is_named_not_whoever_refuses_it(foreign_fmu):
    """Within one block of instants, before what was recorded in it is looked at."""
    master = Master(step=0.1).add("f", foreign_fmu).add("a", lag())
    master.connect(Step(before=0.0, after=-1.0, time=0.25), "f.level").connect("f.root", "a.u")
    with pytest.raises(SimulationError, match=r"^f.root is not finite at t = 0.4 s$") as caught:
        master.run(stop=1.0)
    assert np.isfinite(caught.value.result["f.root"]).all()
    assert caught.value.result.time.tolist() == [0.0, 0.1, 0.2, 0.3]
    master.record("a.y")
    with pytest.raises(SimulationError, match=r"^a at t = 0.4 s: u is nan"):
        master.run(stop=1.0)


# ---- what an FMU says ----

@pytest.mark.parametrize(("parameters", "u", "words"), [
    ({}, 0.0, None),
    ({"k": -1.0}, 0.0, "s does not initialize: k must not be negative"),
    ({"k": 2000.0}, 0.0, "s: k = 2000.0 is refused: k is above 1000"),
    ({}, 950.0, "s (strict.fmu) at t = 0 s: fmi2DoStep reports error: u is above 900"),
])
@pytest.mark.parametrize("beside", [False, True])
def test_only_what_runs_is_terminated_and_an_error_is_told_once(strict_fmu, caplog, parameters, u, words, beside):
    """The FMU refuses every call that the standard forbids in its state, and says so: also one beside that failed."""
    caplog.set_level(logging.WARNING, "cosim")
    master = Master(step=0.1).add("s", strict_fmu, parameters=parameters).connect(u, "s.u")
    if beside:
        master.add("b", strict_fmu)
    if words is None:
        assert master.run(stop=0.3).complete
    else:
        with pytest.raises((InputError, SimulationError)) as caught:
            master.run(stop=0.3)
        assert str(caught.value) == words
    assert not caplog.messages


def test_what_one_of_our_fmus_refuses_is_told_once(fmus, tmp_path, caplog, capfd):
    caplog.set_level(logging.WARNING, "cosim")
    loose = repacked(fmus / "lag.fmu", tmp_path / "loose.fmu",
                     lambda name, data: (name, data.replace(b'min="1e-06"', b'')))
    with pytest.raises(InputError) as caught:
        Master(step=0.1).add("a", loose, parameters={"time_constant": 0.0}).run(stop=1.0)
    assert str(caught.value) == "a does not initialize: time_constant is 0 s: at least 1e-06 is needed"
    assert not caplog.records and not "".join(capfd.readouterr())


def test_an_error_that_an_fmu_logs_but_survives_is_told(strict_fmu, caplog):
    caplog.set_level(logging.WARNING, "cosim")
    participant = FmuParticipant("s", strict_fmu)

    def complain(now):
        participant.hear(3, "not so well")

    assert Master(step=0.1).add("s", participant).run(stop=0.1, progress=complain).complete
    assert [record.getMessage() for record in caplog.records] == ["s: not so well"]


# ---- what an FMU declares ----

def test_an_fmu_that_was_built_from_another_source_is_named_once(fmus, foreign_fmu, tmp_path, caplog):
    """A constant that changed since is in no parameter: nothing else would show it."""
    caplog.set_level(logging.WARNING, "cosim")
    def older(name, data):
        return name, data + b"# as it was\n" if name.endswith("/quantities.py") else data

    old = repacked(fmus / "lag.fmu", tmp_path / "old.fmu", older)
    for fmu in (old, fmus / "lag.fmu", foreign_fmu, old):
        Master(step=0.1).add("a", fmu).run(stop=0.1)
    said, = caplog.messages
    assert f"{old} was built from another source than this (driveline/quantities.py is not the same)" in said
    assert "driveline build" in said



def test_a_unit_that_an_fmu_defines_itself_is_converted_and_kept(strict_fmu):
    """Reading, driving and setting: engineRev is 0.1 rad/s, as its UnitDefinitions say."""
    master = Master(step=0.1).add("s", strict_fmu, parameters={"k": 3.0}).add("t", strict_fmu)
    result = (master.connect(Constant(value=20.0, unit="rad/s"), "s.u").connect("s.y", "t.u")
              .record("s.u", "s.y", "t.y").run(stop=0.5))
    assert (result["s.u"] == pytest.approx(200.0)) and result["s.y"][-1] == pytest.approx(600.0)
    assert result["t.y"][-1] == pytest.approx(600.0) and result.units["t.y"] == "engineRev"
    with pytest.raises(InputError, match="'engineRev' cannot be converted to 's'|'s'.*'engineRev'"):
        Master().add("s", strict_fmu).connect(Constant(value=1.0, unit="s"), "s.u")


def test_a_variable_has_the_unit_and_range_of_its_type_where_it_has_none_itself(strict_fmu):
    variables = FmuParticipant("s", strict_fmu).variables
    assert (variables["u"].unit, variables["u"].range) == ("engineRev", (-9000.0, 9000.0))
    assert (variables["y"].unit, variables["y"].range) == ("engineRev", (-9000.0, 5000.0))
    assert variables["mode"].range == (1, 2)
    for value, name, words in ((9001.0, "u", "u is 9001 engineRev: at most 9000"), (3, "mode", "mode is 3: at most 2")):
        with pytest.raises(InputError, match=words):
            Master(step=0.1).add("s", strict_fmu).connect(value, f"s.{name}").run(stop=0.1)


# ---- integers ----

class Far(Chain):
    """Its sum is an integer, of as many bits as it takes."""

    def __init__(self, start: float) -> None:
        super().__init__(start)
        whole = {"variability": "discrete", "kind": "integer"}
        self.variables = tuple(Variable(**{**vars(v), **whole}) for v in self.variables)
        Model.__init__(self)


@pytest.mark.parametrize("put_together", [
    lambda master, value: master.set("s.n", value),
    lambda master, value: master.connect(value, "s.mode"),
    lambda master, value: master.connect(value, "s.count"),
    lambda master, value: master.connect(Step(before=1, after=value, time=0.1), "s.count"),
    lambda master, value: master.add("a", Far(value)).connect("a.y", "s.count"),
    lambda master, value: master.add("a", Far(value - 1)).connect(1, "a.u").connect("a.y", "s.count"),
])
@pytest.mark.parametrize("value", [2**31, 2**32 + 2, -2**31 - 1])
def test_an_integer_beyond_32_bits_is_refused_by_name(strict_fmu, put_together, value):
    """It would arrive as another one, and the result would say what was meant."""
    with pytest.raises((InputError, SimulationError), match=r"(n|mode|count) is -?\d{10}: at (least|most) -?\d+ is"):
        put_together(Master(step=0.1).add("s", strict_fmu), value).run(stop=0.5)


@pytest.mark.parametrize("value", [2**31 - 1, -2**31])
def test_all_integers_of_32_bits_arrive(strict_fmu, value):
    result = (Master(step=0.1).add("s", strict_fmu, parameters={"n": value}).add("a", Far(value))
              .connect("a.y", "s.count").record("s.n", "s.count").run(stop=0.3))
    assert (result["s.n"] == value).all() and (result["s.count"] == value).all()


@pytest.mark.parametrize(("value", "words"), [(2, "on is 2: at most 1"), ("-1", "on is -1: at least 0")])
def test_what_is_no_truth_value_is_refused_by_name(foreign_fmus, value, words):
    """It would have counted as true, as -1 and 2 do in C, and the result would have said 2."""
    with pytest.raises(InputError, match=words):
        Master(step=0.1).add("f", foreign_fmus / "worded.fmu", parameters={"on": value})


# ---- Ctrl-C ----

def test_ctrl_c_leaves_a_partial_result_that_can_be_read(tmp_path):
    master = Master(step=1e-3).add("a", counter())
    before = signal.getsignal(signal.SIGINT)

    def press(now):
        if now > 2.0:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted, match="interrupted at t = ") as caught:
        master.run(stop=1e3, progress=press)
    assert signal.getsignal(signal.SIGINT) is before
    partial = caught.value.result
    assert not partial.complete
    assert 2.0 < partial.time[-1] < 10.0
    assert (partial["a.steps"] == np.arange(partial.time.size)).all()
    partial.to_parquet(tmp_path / "partial.parquet")
    assert not Result.read(tmp_path / "partial.parquet").complete


def test_handlers_of_a_host_that_embeds_python_are_left_to_it(monkeypatch):
    """Python tells None of them, and takes none back."""
    changed = []
    monkeypatch.setattr(signal, "getsignal", lambda number: None)
    monkeypatch.setattr(signal, "signal", lambda number, handler: changed.append(number))
    assert Master(step=1e-2).add("a", counter()).run(stop=0.1).complete
    assert not changed


def test_runs_outside_the_main_thread():
    results = []
    master = Master(step=1e-2).add("a", counter())
    thread = threading.Thread(target=lambda: results.append(master.run(stop=0.1)))
    thread.start()
    thread.join()
    assert results[0]["a.steps"][-1] == 10


# ---- what is refused ----

def pair():
    return Master(step=1e-2).add("a", lag()).add("b", counter())


@pytest.mark.parametrize(("put_together", "words"), [
    (lambda: Master(order="jakobi"), "did you mean 'jacobi'"),
    (lambda: Master(step=0), "positive length"),
    (lambda: Master(step=1 / 3), "whole number of nanoseconds"),
    (lambda: Master().run(stop=1.0), "add a participant"),
    (lambda: pair().run(stop=0.0), "later stop"),
    (lambda: pair().add("a", lag()), "not taken"),
    (lambda: pair().add("a.b", lag()), "without a dot"),
    (lambda: pair().add("c", ModelParticipant("d", lag())), "participant 'c' was made as 'd': one name"),
    (lambda: pair().add("c", "no_such_fmu"), "no_such_fmu"),
    (lambda: pair().add("c", "gone.fmu"), "there is no FMU gone.fmu"),
    (lambda: pair().add("c", lag(), parameters={"time_konstant": 1}), "did you mean 'time_constant'"),
    (lambda: pair().add("c", lag(), parameters={"time_constant": -1}), "c: time_constant is -1 s: at least"),
    (lambda: pair().add("c", lag(), parameters={"time_constant": "1 m"}), "cannot be converted to 's'"),
    (lambda: pair().add("c", lag(), parameters={"u": 1}), "causality input: a parameter is needed"),
    (lambda: pair().connect("a.y", "b.v"), "b has no variable 'v'"),
    (lambda: pair().connect("a.z", "b.u"), "a has no variable 'z'"),
    (lambda: pair().connect("c.y", "b.u"), "there is no participant 'c'"),
    (lambda: pair().connect("nothing", "b.u"), "there is no signal 'nothing'"),
    (lambda: pair().connect("a.y", "u"), "like 'participant.variable'"),
    (lambda: pair().connect("a.u", "b.u"), "'a.u' is of causality input: only an output"),
    (lambda: pair().connect("a.y", "b.seen"), "'b.seen' is of causality output: only an input"),
    (lambda: pair().connect("a.y_speed", "b.u"), "'rad/s' cannot be converted to 'deg'"),
    (lambda: pair().connect("a.y", "a.gear"), "real, but 'a.gear' is integer"),
    (lambda: pair().connect("a.y", "b.u").connect("a.y", "b.u"), "one source for each input"),
    (lambda: pair().connect(Constant(value=1, unit="kg"), "b.u").run(stop=1), "'kg' cannot be converted"),
    (lambda: pair().connect(7, "a.gear").run(stop=1), "a.gear is 7: at most 6"),
    (lambda: pair().connect(1.5, "a.gear").run(stop=1), "whole number"),
    (lambda: pair().connect(Step(before=1, after=9, time=0.5), "a.gear").run(stop=1),
     "at t = 0.5 s: a.gear is 9"),
    (lambda: pair().connect(Table(times=[0, 0.5], data=[1, 1.5], interpolation="hold"), "a.gear").run(stop=1),
     "^signal 'a.gear' at t = 0.5 s: a.gear is 1.5: a whole number"),
    (lambda: pair().connect(float("nan"), "a.u").run(stop=1), "finite"),
    (lambda: pair().record("a.x").run(stop=1), "nothing to record is called 'a.x'"),
    (lambda: pair().signal("a", RAMP), "not taken"),
    (lambda: pair().signal("time", RAMP), "a signal cannot be called 'time'"),
    (lambda: pair().record(1), "what to record is 1"),
    (lambda: (lambda model: pair().add("c", model).add("d", model))(lag()), "'d' is 'c' already"),
    (lambda: (lambda one: pair().add("c", one).add("d", ModelParticipant("d", one)))(lag()), "'d' is 'c' already"),
])
def test_wrong_input_gets_one_clear_message(put_together, words):
    with pytest.raises(InputError, match=words) as caught:
        put_together()
    assert "\n" not in str(caught.value)


def test_a_participant_that_was_refused_can_be_added_again():
    master = Master(step=0.1)
    with pytest.raises(InputError, match="did you mean 'time_constant'"):
        master.add("a", lag(), parameters={"start_angle": 2.0, "time_konstant": 1.0})
    result = master.add("a", lag(), parameters={"time_constant": 1.0}).run(stop=0.1)
    assert result["a.y"].tolist() == [0.0, 0.0]


def repacked(fmu, target, change):
    """A copy of an FMU with its model description (or the names of its files) changed."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            changed = change(name, old.read(name))
            if changed is not None:
                new.writestr(*changed)
    return target


@pytest.mark.parametrize(("change", "words"), [
    (lambda name, data: (name, data.replace(b'fmiVersion="2.0"', b'fmiVersion="3.0"')), "FMI 3.0|not an FMU"),
    (lambda name, data: (name, data.replace(b"<CoSimulation", b"<Odd").replace(b"</CoSimulation", b"</Odd")),
     "not an FMU|model exchange"),
    (lambda name, data: None if name.startswith("binaries") else (name, data), "has binaries for nothing"),
    (lambda name, data: None if name.endswith("Description.xml") else (name, data), "not an FMU"),
    (lambda name, data: (name.replace("/", "\\"), data), "not an FMU.*forward slashes"),
    (lambda name, data: None if name.startswith("resources") else (name, data), "not whole: .*slavemodule.txt"),
    (lambda name, data: None if name.endswith("slavemodule.txt") else (name, data), "not whole: .*slavemodule.txt"),
    (lambda name, data: (name, b"" if name.endswith("slavemodule.txt") else data), "not whole: .*names is not there"),
    (lambda name, data: (name, b"gone" if name.endswith("slavemodule.txt") else data), "not whole: .*is not there"),
    (lambda name, data: (name, data[:40] if name.endswith("Description.xml") else data), "not an FMU"),
    (lambda name, data: (name, data.replace(b' start="', b' start="x')), "not an FMU: could not convert .*'x.*start"),
])
def test_what_is_no_usable_fmu_is_refused_by_name(fmus, tmp_path, change, words):
    path = repacked(fmus / "lag.fmu", tmp_path / "odd.fmu", change)
    with pytest.raises(InputError, match=f"a: .*odd.fmu.*({words})"):
        FmuParticipant("a", path)


def test_an_fmu_that_allows_one_instance_a_process_takes_part_once(fmus, tmp_path):
    """Two would share their memory, and each show numbers of the other."""
    path = repacked(fmus / "lag.fmu", tmp_path / "single.fmu", lambda name, data: (
        name, data.replace(b"<CoSimulation", b'<CoSimulation canBeInstantiatedOnlyOncePerProcess="true"')))
    master = Master(step=0.1).add("a", path).add("b", fmus / "lag.fmu")
    with pytest.raises(InputError, match=r"'c' is 'a' already: single.fmu allows one instance a process"):
        master.add("c", path)
    assert master.run(stop=0.2).complete


@pytest.mark.parametrize(("at", "change"), [
    (30 + len("modelDescription.xml"), lambda byte: byte | 7),  # where its data begin: a block of no kind
    (6, lambda byte: byte | 1),  # the flag of an encrypted file
])
def test_a_damaged_or_encrypted_archive_is_refused_by_name(tmp_path, at, change):
    path = tmp_path / "odd.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", b"0123456789" * 100)
    data = bytearray(path.read_bytes())
    data[at] = change(data[at])
    if at == 6:
        data[data.index(b"PK\1\2") + 8] |= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a: .*odd.fmu is not an FMU, or a damaged one: .*(decompress|encrypted)"):
        FmuParticipant("a", path)


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    (tmp_path / "x.fmu").write_text("no zip")
    with pytest.raises(InputError, match=r"x.fmu is not an FMU"):
        Master().add("a", tmp_path / "x.fmu")


def test_a_parameter_the_fmu_itself_refuses_is_wrong_input(fmus, tmp_path, capfd):
    loose = repacked(fmus / "lag.fmu", tmp_path / "loose.fmu",
                     lambda name, data: (name, data.replace(b'min="1e-06"', b'')))
    master = Master(step=0.1).add("a", loose, parameters={"time_constant": 0.0})
    with pytest.raises(InputError, match=r"a does not initialize: .*time_constant is 0 s"):
        master.run(stop=1.0)


def test_a_folder_with_a_blank_and_a_plus_is_no_obstacle(fmus, tmp_path):
    folder = tmp_path / "a folder + more"
    folder.mkdir()
    shutil.copy(fmus / "lag.fmu", folder)
    assert Master(step=0.1).add("a", folder / "lag.fmu").run(stop=0.1).complete


def in_temporary_folder(name, tmp_path, monkeypatch):
    """Extract FMUs below a folder of that name."""
    (tmp_path / name).mkdir()
    monkeypatch.setattr("cosim.master.fmu._extracted", {})
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / name))


@pytest.mark.parametrize("name", ["a + b", "100%", "mäh"])
@pytest.mark.skipif(sys.platform != "linux", reason="of the FMUs' library for Linux")
def test_a_temporary_folder_of_any_name_is_no_obstacle(fmus, tmp_path, monkeypatch, name):
    in_temporary_folder(name, tmp_path, monkeypatch)
    assert Master(step=0.1).add("a", fmus / "lag.fmu").run(stop=0.1).complete


_COPIES = """
import atexit, gc, os, sys
from pathlib import Path
from cosim.master.fmu import extracted

folder = extracted(Path(sys.argv[1]))[0]
for forgets in (True, False):
    copy = os.fork()
    if copy == 0 and forgets:  # as multiprocessing's copies do from Python 3.13 on
        atexit._clear()
        gc.collect()
        os._exit(0)
    if copy == 0:
        sys.exit()
    os.waitpid(copy, 0)
    assert folder.is_dir()
print(folder)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there are no copies of a process")
def test_a_copy_of_the_process_that_ends_leaves_what_is_extracted(fmus):
    done = subprocess.run([sys.executable, "-c", _COPIES, fmus / "lag.fmu"], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
    assert not done.stderr
    assert not Path(done.stdout.strip()).exists()


@pytest.mark.parametrize("name", ["a + b", "100%", "mäh"])
def test_one_that_would_end_the_process_is_refused(fmus, tmp_path, monkeypatch, name):
    """For an FMU as PythonFMU itself writes it."""
    with zipfile.ZipFile(fmus / "lag.fmu") as ours, zipfile.ZipFile(tmp_path / "lag.fmu", "w") as plain:
        for path in ours.namelist():
            if path != "binaries/linux64/libpythonfmu-export.so":
                plain.writestr(path, ours.read(path))
    in_temporary_folder(name, tmp_path, monkeypatch)
    with pytest.raises(InputError, match="set TMPDIR"):
        Master(step=0.1).add("a", tmp_path / "lag.fmu").run(stop=0.1)


def test_one_that_is_taken_for_another_is_refused(fmus, tmp_path, monkeypatch):
    """An escape in the name itself."""
    in_temporary_folder("a%20b", tmp_path, monkeypatch)
    with pytest.raises(InputError, match="set TMPDIR"):
        Master(step=0.1).add("a", fmus / "lag.fmu").run(stop=0.1)
