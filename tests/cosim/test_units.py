"""Units convert as physics says, and only where the two measure the same thing."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim import units
from driveline.quantities import InputError


@pytest.mark.parametrize(("source", "target", "factor"), [
    ("rpm", "rad/s", math.pi / 30), ("deg", "rad", math.pi / 180), ("km/h", "m/s", 1 / 3.6),
    ("mph", "m/s", 0.44704), ("N.m/deg", "N.m/rad", 180 / math.pi), ("Nm", "N.m", 1.0),
    ("kg.m2", "kg*m^2", 1.0),
    ("%", "1", 0.01), ("s-1", "Hz", 1.0), ("g_0", "m/s2", 9.80665), ("N.m.s/rad", "N.m/(rad/s)", 1.0),
    ("mrad", "rad", 1e-3), ("rad/s2", "rad/s2", 1.0), ("rev", "rad", 2 * math.pi), ("rev/min", "rpm", 1.0),
    ("r/min", "rad/s", math.pi / 30), ("U/min", "rad/s", math.pi / 30),
    ("N.m/rev", "N.m/rad", 0.5 / math.pi), ("urad", "rad", 1e-6)])
def test_factor(source, target, factor):
    assert units.conversion(source, target) == (pytest.approx(factor, rel=1e-15), 0.0)


def test_an_offset_is_an_offset():
    assert units.conversion("degC", "K") == (pytest.approx(1.0), pytest.approx(273.15))


@pytest.mark.parametrize(("source", "target"), [
    ("Hz", "rad/s"), ("1/min", "rad/s"), ("N.m", "N.m/rad"), ("rad", "1"), ("m/s", "m/s2"), ("N", "N.m")])
def test_what_measures_something_else_is_refused(source, target):
    with pytest.raises(InputError, match="cannot be converted"):
        units.conversion(source, target)


@pytest.mark.parametrize(("source", "target"), [("dB", "1"), ("1", "dB"), ("dBm", "W"), ("Np", "1")])
def test_a_level_is_no_multiple_of_anything(source, target):
    with pytest.raises(InputError, match="cannot be converted to .*: one is the logarithm of the other"):
        units.conversion(source, target)
    assert units.conversion(source, source) == (1.0, 0.0)


@pytest.mark.parametrize("text", ["rpn", "N..m", "furlong per", "(", "5", "9**9**9**9", "m2^9^9^9"])
def test_an_unknown_unit_is_named(text):
    with pytest.raises(InputError, match=r"unknown unit|cannot be converted"):
        units.conversion(text, "m")


@pytest.mark.parametrize("text", ["Grad/s", "krad", "1/Mrad"])
def test_multiples_of_the_radian_that_nobody_measures_in_are_refused(text):
    with pytest.raises(InputError, match=f"unit '{text}' has a .*radian in it; angles are written rad, mrad, deg"):
        units.parse(text)


@given(st.floats(-1e6, 1e6, allow_subnormal=False))
def test_there_and_back(value):
    factor, offset = units.conversion("degF", "K")
    back, back_offset = units.conversion("K", "degF")
    assert (value * factor + offset) * back + back_offset == pytest.approx(value, rel=1e-9, abs=1e-9)


def test_a_value_carries_its_unit_or_is_in_the_one_wanted():
    assert units.in_unit("50 km/h", "m/s", "v") == pytest.approx(50 / 3.6)
    assert units.in_unit("-1.5e2", "N.m", "T") == units.in_unit(-150, "N.m", "T") == -150.0
    assert units.in_unit(np.int64(-150), "N.m", "T") == units.in_unit(np.float32(-150), "N.m", "T") == -150.0


@pytest.mark.parametrize(("value", "words"), [("fast", "a number is needed, in m/s"), ("3 kg", "cannot be"),
                                              (None, "a number"), ("3 parsecc", "unknown unit"),
                                              ([1], "a number"), (True, "True: a number")])
def test_the_message_names_what_is_wrong(value, words):
    with pytest.raises(InputError, match=f"^speed is .*{words}"):
        units.in_unit(value, "m/s", "speed")


def test_what_an_fmu_defines_is_known_where_nobody_else_knows_the_name():
    units.define("crankTurn/", {"rad": 1, "s": -1}, 2.5)
    assert units.conversion("crankTurn/", "rad/s") == (pytest.approx(2.5, rel=1e-15), 0.0)
    assert units.conversion("rpm", "crankTurn/") == (pytest.approx(math.pi / 75, rel=1e-15), 0.0)
    units.define("Réaumur", {"K": 1}, 1.25, 273.15)
    assert units.conversion("Réaumur", "degC") == (pytest.approx(1.25), pytest.approx(0.0, abs=1e-9))
    assert units.in_unit("80 Réaumur", "K", "T") == pytest.approx(373.15)
    units.define("Nothing%%", {})
    assert units.conversion("Nothing%%", "%")[0] == pytest.approx(100.0)
    with pytest.raises(InputError, match="cannot be converted"):
        units.conversion("crankTurn/", "Hz")


def test_what_is_known_is_not_defined_anew():
    for factor in (7.0, 8.0):
        units.define("rpm", {"rad": 1, "s": -1}, factor)
    assert units.conversion("rpm", "rpm") == (1.0, 0.0)
    assert units.conversion("rpm", "rad/s")[0] == pytest.approx(math.pi / 30)


def test_a_name_that_two_fmus_define_otherwise_is_refused_where_it_is_used():
    """Also from one to the other, where it looks like the same unit."""
    for factor in (2.0, 2.0, 3.0):
        assert factor == 3.0 or units.conversion("step*", "step*") == (1.0, 0.0)
        units.define("step*", {"rad": 1}, factor)
    for pair in (("step*", "rad"), ("step*", "step*")):
        with pytest.raises(InputError, match=r"'step\*' is defined by two FMUs"):
            units.conversion(*pair)
