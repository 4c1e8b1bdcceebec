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


@pytest.mark.parametrize("count", [7, 13])
def test_gear_tables_are_of_one_length_however_many_gears_there_are(count):
    """Of the shipped FMU the other entries stayed: a car of five gears drove in seventh, with the pickup's ratio."""
    values = load("suv_6l80").values
    tables = {f"transmission.{table}[{i}]": values[f"transmission.{table}[{min(i, 12)}]"] for i in range(1, count + 1)
              for table in ("ratio", "inertia", "loss_constant", "loss_viscous", "loss_fraction")}
    rest = {name: value for name, value in values.items() if not name.endswith("]")}
    with pytest.raises(InputError, match=f"ratio has {count} entries: 12 are needed"):
        from_values(Transmission, rest | tables, "transmission.")


@pytest.mark.parametrize(("entry", "ratio", "message"), [
    (1, 3.064, r"ratio\[1\] is 3.064: gear -1 needs a negative ratio"),
    (7, -1.52, r"ratio\[7\] is -1.52: gear 5 needs a positive ratio")])
def test_a_ratio_that_would_drive_the_wrong_way_is_refused(entry, ratio, message):
    values = dict(load("suv_6l80").values)
    with pytest.raises(InputError, match=message):
        from_values(Transmission, values | {f"transmission.ratio[{entry}]": ratio}, "transmission.")
    from_values(Transmission, values | {f"transmission.ratio[{entry}]": 0.0}, "transmission.")
