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


@pytest.mark.parametrize(("entry", "ratio", "message"), [
    (1, 3.064, r"ratio\[1\] is 3.064: gear -1 needs a negative ratio"),
    (7, -1.52, r"ratio\[7\] is -1.52: gear 5 needs a positive ratio")])
def test_a_ratio_that_would_drive_the_wrong_way_is_refused(entry, ratio, message):
    values = dict(load("suv_6l80").values)
    with pytest.raises(InputError, match=message):
        from_values(Transmission, values | {f"transmission.ratio[{entry}]": ratio}, "transmission.")
    from_values(Transmission, values | {f"transmission.ratio[{entry}]": 0.0}, "transmission.")
