"""The base units of the FMUs' unit definitions."""

import pint
import pytest

from driveline.quantities import InputError
from fmus.units import base_unit

UNITS = pint.UnitRegistry()
# pint has other names for a few, and other base units (radian is none of its dimensions)
BASE = {"kg": "kilogram", "m": "meter", "s": "second", "A": "ampere", "K": "kelvin", "rad": "radian"}
SPELT = {"rpm": "pi / 30 * rad / s", "rev": "2 * pi * rad", "t": "1000 * kg", "%": "0.01", "Hz": "1 / s"}


@pytest.mark.parametrize("unit", [
    "N.m", "N.m/rad", "N.m.s/rad", "N.m.s2/rad2", "kg.m2", "rad/s", "m/s2", "1", "kW", "km/h", "rpm", "deg",
    "N.s2/m2", "1/s", "bar", "N.m/(rad.s)", "V.A", "g", "ms", "rev", "t", "%", "Hz", "kPa", "mm", "kN",
])
def test_base_unit_is_the_same_quantity(unit):
    above, _, below = unit.partition("/")

    def quantity(factors):
        product = UNITS.Quantity(1.0)
        for factor in factors.strip("()").split("."):
            symbol = factor.rstrip("0123456789") or "1"
            power = int(factor[len(symbol):] or 1) if symbol != "1" else 1
            product = product * UNITS.Quantity(1.0, "") * UNITS(SPELT.get(symbol, symbol)) ** power
        return product

    expected = quantity(above) / quantity(below or "1")
    attributes = base_unit(unit)
    product = UNITS.Quantity(attributes.pop("factor", 1.0))
    for name, exponent in attributes.items():
        product = product * UNITS.Quantity(1.0, BASE[name]) ** exponent
    ratio = (expected / product).to_base_units()
    # radians are what the turning units must agree on too, so nothing may be left over
    assert ratio.magnitude == pytest.approx(1.0, rel=1e-14)
    assert str(ratio.units) in ("dimensionless", "")


def test_only_a_temperature_alone_has_an_offset():
    assert base_unit("degC") == {"K": 1, "offset": 273.15}
    assert base_unit("W/degC") == {"kg": 1, "m": 2, "s": -3, "K": -1}


def test_a_level_has_no_base_unit():
    assert base_unit("dB") is None


@pytest.mark.parametrize("unit", ["Nm", "N.m/rad/s", "", "m^2", "furlong"])
def test_an_unknown_spelling_is_named(unit):
    with pytest.raises(InputError, match="unit"):
        base_unit(unit)
