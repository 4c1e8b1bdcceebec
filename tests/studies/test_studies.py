"""What every study promises: the JSON of the contract, its pictures, and rows that agree with themselves."""

import importlib
import json

import pytest

from cosim import studies
from cosim.studies.findings import Row
from cosim.studies.manoeuvre import TipIn
from driveline.quantities import InputError

pytestmark = pytest.mark.usefixtures("no_fmus")

SMALL = {
    "fom-validation": {"tip_in": TipIn(stop=3.0)},
    "torque-meter-filter": {"seconds": 1.5},
    "model-reduction": {"tip_in": TipIn(stop=3.0), "repeats": 1},
    "gears": {"gears": (3, 5), "tip_in": TipIn(stop=2.5)},
    "observability": {"pieces": 40},
}


@pytest.mark.parametrize("name", SMALL)
def test_result_is_what_the_contract_says(ran, name):
    out, result, shares = ran(name)
    assert list(result) == ["study", "source", "rows", "figures", "run_seconds"]
    assert json.loads((out / f"{name}.json").read_text(encoding="utf-8")) == result
    assert result["study"] == name and result["source"].startswith("000_04412de56ba07ac9.txt, ")
    assert result["rows"] and len({row["quantity"] for row in result["rows"]}) == len(result["rows"])
    for row in result["rows"]:
        assert list(row) == ["quantity", "unit", "paper", "here", "deviation_percent", "note"]
        if row["paper"] and row["here"] is not None:
            assert row["deviation_percent"] == pytest.approx(
                100.0 * (row["here"] - row["paper"]) / abs(row["paper"]))
        else:
            assert row["deviation_percent"] is None
        if row["here"] is None:
            assert row["note"]  # what is missing is explained
    assert shares[0] == 0.0 and shares[-1] == 1.0 and shares == sorted(shares)


@pytest.mark.parametrize("name", SMALL)
def test_pictures_are_there_and_nothing_half_written(ran, name):
    out, result, _ = ran(name)
    assert result["figures"]
    for figure in result["figures"]:
        assert (out / figure).read_bytes().startswith(b"\x89PNG")
    assert {path.name for path in out.iterdir()} == {*result["figures"], f"{name}.json"}


@pytest.mark.parametrize("name", studies.STUDIES)
def test_summary_is_one_line_of_the_module(name):
    line = studies.summary(name)
    module = importlib.import_module(f"cosim.studies.{studies.STUDIES[name]}")
    assert line and line == module.__doc__.partition("\n")[0]


def test_unknown_study_is_named(tmp_path):
    with pytest.raises(InputError, match="'gear'.*did you mean 'gears'"):
        studies.run("gear", tmp_path)


def test_a_paper_value_of_zero_has_no_deviation():
    assert Row("x", "1", 0.0, 1.0).deviation_percent is None
    assert Row("x", "1", -2.0, -1.0).deviation_percent == 50.0  # larger is positive, whatever the sign


def row(result, quantity):
    return next(r for r in result["rows"] if r["quantity"] == quantity)


def test_errors_follow_from_the_frequencies(ran):
    _, result, _ = ran("fom-validation")
    for variant in ("baseline", "modified"):
        frequency = row(result, f"shuffle frequency, {variant}")["here"]
        assert row(result, f"error in shuffle frequency, {variant}")["here"] == pytest.approx(
            100.0 * abs(frequency - 5.84) / 5.84)


def test_table_2_3_is_implemented(ran):
    _, result, _ = ran("fom-validation")
    for entry in result["rows"]:
        if entry["quantity"].endswith(", factor"):
            assert entry["here"] == pytest.approx(entry["paper"], rel=1e-12)


def test_the_unfiltered_torque_leads_by_the_filters_delay(ran):
    _, validation, _ = ran("fom-validation")
    _, meter, _ = ran("torque-meter-filter")
    lag = "lag of the measured behind the simulated, {} torque"
    unfiltered, filtered = (row(validation, lag.format(w))["here"] for w in ("unfiltered", "filtered"))
    delay = row(meter, "delay at 5.88 Hz (eq. 2.3)")["here"]
    assert unfiltered - filtered == pytest.approx(delay, abs=0.5)


def test_delay_by_phase_and_by_a_running_sine_agree(ran):
    _, result, _ = ran("torque-meter-filter")
    assert row(result, "delay of a 5.88 Hz sine through the running filter")["here"] == pytest.approx(
        row(result, "delay at 5.88 Hz (eq. 2.3)")["here"], rel=1e-3)
    assert row(result, "attenuation at 27 Hz")["here"] <= 1.0
    assert row(result, "attenuation at 30 Hz")["here"] >= 80.0 - 1e-9
    assert row(result, "largest difference of the gain from SciPy's, 0 to 60 Hz")["here"] < 1e-9


def test_models_have_the_states_their_inertias_and_shafts_ask_for(ran):
    _, result, _ = ran("model-reduction")
    for label, nodes, shafts, lashes in (("2DOF", 2, 0, 1), ("3DOF", 3, 1, 1), ("3DOF, split lash", 4, 1, 2)):
        moving = (row(result, f"continuous states, {label}")["here"]
                  - row(result, f"of these without effect on the motion, {label}")["here"])
        assert moving == nodes + shafts + 2 * lashes


def test_no_mistake_gives_the_two_mass_model_itself(ran):
    _, result, _ = ran("model-reduction")
    assert row(result, "2DOF shuffle frequency, mistake: none: as reduced here")["here"] == pytest.approx(
        row(result, "shuffle frequency, 2DOF")["here"], rel=1e-6)


def test_singular_values_and_exact_arithmetic_give_the_same_ranks(ran):
    _, result, _ = ran("observability")
    for entry in result["rows"]:
        if entry["quantity"].startswith("rank of the observability matrix, "):
            other = entry["quantity"].replace("rank of the observability matrix", "rank by singular values")
            assert entry["here"] == row(result, other)["here"]


def test_fifth_gear_is_the_validation_tip_in(ran):
    _, gears, _ = ran("gears")
    _, reduction, _ = ran("model-reduction")
    for gear_row, reduction_row, tolerance in (
            ("lash crossing time, FOM, gear 5", "lash crossing time, FOM, both lashes lumped", 1e-6),
            # its lumps are made for another torque
            ("lash crossing time, 3DOF, gear 5", "lash crossing time, 3DOF", 5e-3)):
        assert row(gears, gear_row)["here"] == pytest.approx(
            row(reduction, reduction_row)["here"], rel=tolerance)
