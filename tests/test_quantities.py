"""A quantity is declared once; its name, unit and range serve everywhere."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from driveline.quantities import InputError, Variable, from_values, parameter_variables, quantity


@dataclasses.dataclass(frozen=True)
class Part:
    stiffness: float = quantity("N.m/rad", "stiffness of the part", minimum=0.5, nominal=1e3)
    teeth: int = quantity("1", "teeth", start=7, kind="integer", minimum=1, maximum=99)
    fitted: bool = quantity("1", "whether it is there", start=True, kind="boolean", minimum=0, maximum=1)


@dataclasses.dataclass(frozen=True)
class Machine:
    first: Part
    table: tuple[float, ...] = quantity("s", "times", tunable=True)
    gain: float = quantity("1", "gain", start=2.5)


VALUES = {"first.stiffness": 3.0, "table[1]": 10.0, "table[2]": -20.0}
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


def test_every_scalar_has_its_structured_name_unit_meaning_and_range():
    variables = {v.name: v for v in parameter_variables(from_values(Machine, VALUES))}
    assert list(variables) == [
        "first.stiffness", "first.teeth", "first.fitted", "table[1]", "table[2]", "gain"]
    stiffness = variables["first.stiffness"]
    assert (stiffness.unit, stiffness.meaning, stiffness.minimum, stiffness.maximum, stiffness.nominal) == (
        "N.m/rad", "stiffness of the part", 0.5, None, 1e3)
    assert [v.start for v in variables.values()] == [3.0, 7.0, 1.0, 10.0, -20.0, 2.5]
    assert [v.kind for v in variables.values()] == ["real", "integer", "boolean", "real", "real", "real"]
    assert variables["table[2]"].variability == "tunable"
    assert stiffness.variability == "fixed"
    assert {v.causality for v in variables.values()} == {"parameter"}


@given(st.floats(0.5, 1e6), st.integers(1, 99), st.booleans(),
       st.lists(NUMBERS, min_size=1, max_size=9), NUMBERS)
def test_to_variables_and_back_is_the_same_object(stiffness, teeth, fitted, table, gain):
    machine = Machine(Part(stiffness, teeth, fitted), tuple(table), gain)
    again = from_values(Machine, {v.name: v.start for v in parameter_variables(machine)})
    assert again == machine
    assert type(again.first.teeth) is int
    assert type(again.first.fitted) is bool


@pytest.mark.parametrize("missing, said", [
    ("first.stiffness", r"first\.stiffness \[N\.m/rad\] is missing: stiffness of the part"),
    ("table[1]", r"table\[1\] is missing: a table of times")])
def test_what_is_missing_is_named_with_its_unit_or_meaning(missing, said):
    with pytest.raises(InputError, match=said):
        from_values(Machine, {name: value for name, value in VALUES.items() if name != missing})


def test_names_that_are_no_field_do_no_harm():
    assert from_values(Machine, {**VALUES, "elsewhere": 1.0}) == from_values(Machine, VALUES)


@given(st.floats())
def test_check_lets_pass_what_is_finite_and_in_range_and_nothing_else(value):
    variable = Variable("shaft.length", "m", "length", minimum=-2.0, maximum=3.0)
    if math.isfinite(value) and -2.0 <= value <= 3.0:
        variable.check(value)
    else:
        with pytest.raises(InputError, match=r"^shaft\.length is "):
            variable.check(value)


@pytest.mark.parametrize("value, said", [
    (math.nan, "finite number in m is needed"), (-math.inf, "finite number in m is needed"),
    (-2.5, "-2.5 m: at least -2 is needed"), (3.5, "3.5 m: at most 3 is possible")])
def test_the_message_says_what_would_be_right(value, said):
    with pytest.raises(InputError, match=said):
        Variable("shaft.length", "m", "length", minimum=-2.0, maximum=3.0).check(value)


@pytest.mark.parametrize("unit", ["1", ""])  # of what counts, and of what an FMU says nothing of
@pytest.mark.parametrize(("value", "said"), [(math.nan, "share is nan: a finite number is needed"),
                                             (2.0, "share is 2: at most 1 is possible")])
def test_where_there_is_no_unit_the_message_has_none(unit, value, said):
    with pytest.raises(InputError, match=f"^{said}$"):
        Variable("share", unit, "part", minimum=0.0, maximum=1.0).check(value)


@pytest.mark.parametrize("kind", ["integer", "boolean"])
def test_a_count_must_be_whole(kind):
    variable = Variable("gear", "1", "engaged gear", kind=kind)
    variable.check(1.0)
    with pytest.raises(InputError, match="gear is 0.5.*whole number"):
        variable.check(0.5)


def test_a_truth_value_is_0_or_1_whatever_is_declared():
    free, declared = Variable("on", "1", "", kind="boolean"), Variable("on", "1", "", kind="boolean", minimum=1)
    assert free.range == (0, 1) and declared.range == (1, 1)
    for value, said in ((2.0, "2: at most 1"), (-1.0, "-1: at least 0")):
        with pytest.raises(InputError, match=f"on is {said}"):
            free.check(value)


def test_a_wrong_input_is_a_value_error():
    assert issubclass(InputError, ValueError)


def test_an_integer_has_the_32_bits_of_fmi_whatever_is_declared():
    free, declared = Variable("n", "1", "", kind="integer"), Variable("n", "1", "", kind="integer", minimum=0)
    assert free.range == (-2**31, 2**31 - 1) and declared.range == (0, 2**31 - 1)
    free.check(2**31 - 1)
    with pytest.raises(InputError, match="n is 2147483648: at most 2147483647 is possible"):
        free.check(2**31)
    with pytest.raises(InputError, match="n is -2147483649: at least -2147483648 is needed"):
        free.check(-2**31 - 1)
    assert Variable("x", "1", "").range == (-math.inf, math.inf)


def test_what_is_no_number_is_told_the_unit_that_it_needs_if_it_has_one():
    for unit, needed in (("m", "a finite number in m is needed"), ("1", "a finite number is needed")):
        with pytest.raises(InputError, match=f"^x is nan: {needed}$"):
            Variable("x", unit, "").check(math.nan)
