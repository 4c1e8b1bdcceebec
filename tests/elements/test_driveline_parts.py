"""The gearbox's tables belong together."""

import pytest

from driveline.elements.driveline_parts import Transmission
from driveline.quantities import InputError, from_values
from driveline.vehicles import load


@pytest.mark.parametrize("table", ["inertia", "loss_constant", "loss_viscous", "loss_fraction"])
def test_a_gear_table_of_another_length_is_refused_by_name(table):
    values = dict(load("pickup_10r80").values)
    from_values(Transmission, values, "transmission.")
    del values[f"transmission.{table}[12]"]
    with pytest.raises(InputError, match=rf"transmission\.{table} has 11 entries.*ratio has 12"):
        from_values(Transmission, values, "transmission.")
