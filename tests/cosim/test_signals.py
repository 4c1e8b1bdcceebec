"""Profiles do what their parameters say at the instants where it matters."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim.signals import Constant, FirstOrder, PulseTrain, Ramp, Step, Table, from_table
from driveline.quantities import InputError


def test_step_has_its_new_value_at_its_time():
    step = Step(before=1.0, after=2.0, time=0.3)
    assert step.values(np.array([0.0, 0.3 - 1e-9, 0.3, 5.0])).tolist() == [1.0, 1.0, 2.0, 2.0]


def test_ramp_is_straight_between_its_ends():
    ramp = Ramp(before=-20.0, after=250.0, time=1.0, duration=0.5)
    assert ramp.values(np.array([0.0, 1.0, 1.25, 1.5, 9.0])).tolist() == [-20.0, -20.0, 115.0, 250.0, 250.0]


def test_first_order_solves_its_differential_equation():
    lag = FirstOrder(before=3.0, after=-1.0, time=0.5, time_constant=0.2)
    t, h = np.linspace(0.6, 2.0, 50), 1e-5
    slope = (lag.values(t + h) - lag.values(t - h)) / (2 * h)
    assert slope == pytest.approx((-1.0 - lag.values(t)) / 0.2, rel=1e-6, abs=1e-8)
    assert lag.values(np.array([0.0, 0.5])).tolist() == [3.0, 3.0]


def test_pulses_begin_at_multiples_of_the_period_although_floats_do_not():
    pulses = PulseTrain(low=0.0, high=1.0, time=0.1, period=0.1, width=0.05, count=30)
    ticks = np.arange(0, 5000) # ms
    on = pulses.values(ticks / 1000.0) > 0.5
    expected = (ticks >= 100) & (ticks < 3100) & ((ticks - 100) % 100 < 50)
    assert (on == expected).all()


def test_table_holds_or_interpolates_and_stays_beyond_its_ends():
    t = np.array([-1.0, 0.0, 0.5, 1.0, 3.0])
    assert Table(times=[0, 1], data=[2, 4]).values(t).tolist() == [2, 2, 3, 4, 4]
    assert Table(times=[0, 1], data=[2, 4], interpolation="hold").values(t).tolist() == [2, 2, 2, 4, 4]


@given(st.integers(1, 4_000_000_000))
def test_what_jumps_does_so_at_the_instant_of_the_clock_whatever_its_unit(tick):
    """Milliseconds times 0.001 are not always the clock's double of the same instant."""
    clock = np.array([tick - 1, tick, tick + 1]) / 1000.0
    step = from_table({"kind": "step", "before": 0, "after": 1, "time": f"{tick} ms"})
    held = from_table({"kind": "table", "times": [f"{tick - 1} ms", f"{tick} ms", f"{tick + 1} ms"],
                       "data": [1, 2, 3], "interpolation": "hold"})
    assert step.values(clock).tolist() == [0.0, 1.0, 1.0]
    assert held.values(clock).tolist() == [1.0, 2.0, 3.0]


def test_every_kind_is_read_from_its_table():
    assert from_table({"kind": "constant", "value": 3, "unit": "N.m"}) == Constant(value=3, unit="N.m")
    step = {"before": 0, "after": 1, "time": 2.0}
    assert from_table({"kind": "step", **step}) == Step(**step)


def test_text_carries_a_unit_of_its_own():
    table = from_table({"kind": "table", "times": ["0 s", "10 ms", 2], "data": [0, "1 kN.m", "3"], "unit": "N.m"})
    assert (table.times.tolist(), table.data.tolist()) == ([0.0, 0.01, 2.0], [0.0, 1000.0, 3.0])
    ramp = {"kind": "ramp", "time": "500 ms", "duration": "1 min", "before": 0, "after": "180 deg", "unit": "rad"}
    assert from_table(ramp) == Ramp(time=0.5, duration=60.0, before=0, after=np.pi, unit="rad")


@pytest.mark.parametrize(("table", "words"), [
    ({}, "kind is None"),
    ({"kind": "rampp"}, "did you mean 'ramp'"),
    ({"kind": "step", "before": 0, "after": 1}, "also needs time"),
    ({"kind": "step", "before": 0, "after": 1, "tme": 1}, "no 'tme'; did you mean 'time'"),
    ({"kind": "step", "before": "low", "after": 1, "time": 1}, "before is 'low': a number"),
    ({"kind": "step", "before": True, "after": 1, "time": 1}, "a number is needed"),
    ({"kind": "step", "before": 0, "after": 1, "time": np.nan}, "time is nan: a finite number"),
    ({"kind": "ramp", "before": 0, "after": 1, "time": 1, "duration": np.inf}, "duration is inf: a finite number"),
    ({"kind": "pulse_train", "low": 0, "high": 1, "time": 1, "period": 1, "width": 0.5, "count": -2}, "count is -2"),
    ({"kind": "pulse_train", "low": 0, "high": 1, "time": 1, "period": 1, "width": 0.5, "count": 1.5}, "a whole num"),
    ({"kind": "ramp", "before": 0, "after": 1, "time": 1, "duration": 0}, "duration is 0: a positive"),
    ({"kind": "first_order", "before": 0, "after": 1, "time": 1, "time_constant": -1}, "positive"),
    ({"kind": "pulse_train", "low": 0, "high": 1, "time": 0, "period": 1, "width": 1},
     "less than the period"),
    ({"kind": "table", "times": [0, 1, 1], "data": [0, 1, 2]}, "do not increase from entry 2"),
    ({"kind": "table", "times": [0, 1], "data": [0]}, "equally many"),
    ({"kind": "table", "times": [], "data": []}, "at least one"),
    ({"kind": "table", "times": [0, 1], "data": [1, float("nan")]}, "not finite"),
    ({"kind": "table", "times": [0, float("inf")], "data": [1, 2]}, "not finite"),
    ({"kind": "table", "times": [0], "data": [1], "interpolation": "cubic"}, "interpolation is 'cubic'"),
    ({"kind": "table", "times": "0 1", "data": [1]}, "a list of numbers"),
    ({"kind": "table", "times": ["0 s", "10 m"], "data": [0, 1]}, "entry 2 of times is '10 m': 'm' cannot be"),
    ({"kind": "table", "times": [[0], 1], "data": [0, 1]}, r"entry 1 of times is \[0\]: a number"),
    ({"kind": "step", "before": "0 N.m", "after": 1, "time": 1}, "before is '0 N.m', but its unit is not declared"),
    ({"kind": "constant", "value": 1, "unit": 3}, "unit is 3: text"),
])
def test_messages(table, words):
    with pytest.raises(InputError, match=words):
        from_table(table)
