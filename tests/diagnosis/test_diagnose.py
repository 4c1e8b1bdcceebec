"""What a diagnosis makes of what was found."""

from types import SimpleNamespace

import numpy as np
import pytest

from cosim.diagnosis import diagnose
from cosim.diagnosis.diagnose import _reserve
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.judge.verdict import beside_unknown
from cosim.diagnosis.plants import FullOrderCar, Run
from cosim.diagnosis.search.identification import Identification
from cosim.measured import load
from driveline import vehicles
from driveline.quantities import InputError


def recorded(name, kind, torques, back=False):
    """A recording in fifth."""
    return Run(name, kind, 5, 0.0, np.array([torques]).T, 0.0, {}, {}, back=back)


@pytest.mark.parametrize(("kinds", "kept"), [
    ("tip_in tip_out", None), ("tip_in tip_in cruise", 0), ("tip_in cruise tip_in", 0), ("tip_in tip_out cruise", 0),
    ("tip_out cruise tip_in", 1), ("tip_in tip_in_back cruise", 0), ("bench bench bench", 1),
    ("tip_in ramp ramp ramp", 2), ("drive cruise drive", 1), ("? cruise ?", 1)])
def test_one_of_three_recordings_is_kept_back_never_the_last(kinds, kept):
    """One that is repeated; of drives, and where nobody said what was driven, nothing is."""
    torques = {"cruise": [1.0, 1.1], "tip_in": [0.0, 2.0], "tip_out": [3.0, 0.0]}
    runs = [recorded(str(i), kind.removesuffix("_back").strip("?"),
                     torques.get(kind.removesuffix("_back"), [0.0, 1.0]), kind.endswith("_back"))
            for i, kind in enumerate(kinds.split())]
    used, reserved = _reserve(runs)
    assert reserved == ([] if kept is None else [runs[kept]])
    assert used == [run for run in runs if run not in reserved]


@pytest.mark.parametrize("recordings", [1, 2, 3, 5])
def test_of_what_is_driven_again_as_many_are_fitted_as_was_promised(recordings):
    """And all recordings that were fitted before."""
    before = [recorded(str(i), kind, [0.0, 1.0 + i])
              for i, kind in enumerate(["tip_in", "tip_out", "ramp", "step", "tip_in"])]
    used, _ = _reserve(before[:recordings])
    for times, fitted in diagnose._drives(recordings).items():
        again, _ = _reserve([*before[:recordings], *(recorded("again", "sweep", [0.0, 9.0]) for _ in range(times))])
        assert sum(r.kind == "sweep" for r in again) == fitted
        assert {r.name for r in used} <= {r.name for r in again}


def test_where_the_torque_does_not_change_it_is_told_that_nothing_excites():
    """Two recordings with 50 N.m throughout, of a signal that hung, were "unknown" without a word of it."""
    car = FullOrderCar("pickup_10r80")
    assert car.columns[car.driver] == 0
    still, cruise, tip_in = (recorded("x", "", torques) for torques in ([50.0] * 3, [50.0, 52.0, 48.0], [0.0, 90.0]))
    told = [diagnose._excitation(car, runs) for runs in ([still, still], [still, cruise], [still, tip_in])]
    assert "does not change in any recording" in told[0][0] and "its signal hangs" in told[0][0]
    assert "changes by no more than 4 N.m" in told[1][0] and all("nothing excites" in text[0] for text in told[:2])
    assert not told[2]


def test_what_an_accelerometer_shows_at_rest_is_told_where_it_is_much():
    """As of one that stands upright."""
    zeros = [SimpleNamespace(name=f"{channel}_acceleration.zero") for channel in ("seat", "differential")]
    fit = SimpleNamespace(points=[np.array([9.7, 0.1]), np.array([9.9, -0.1])])
    assert diagnose._zeros(zeros, fit) == [
        "seat_acceleration shows some 9.8 m/s2 at rest, as of a sensor that is not level or was not set to zero: that "
        "is taken off"]
    assert diagnose._zeros([], fit) == []


def test_where_nothing_is_wrong_the_likeliest_that_is_not_excluded_is_looked_for(monkeypatch):
    """As if it were there: what it would have to be told from is nothing wrong, too."""
    def fit(score, *causes):
        return SimpleNamespace(causes=causes, effects=causes, score=score, hope=score, near=True)

    healthy, drag, slope = fit(0.0), fit(-0.5, "coulomb_drag"), fit(-4.0, "road_grade")
    found = Identification(healthy, [healthy, drag, slope], healthy, None, [], [], {})
    asked = {}

    def propose(fitter, found, rivals, drives):
        asked.update(best=found.best, rivals=rivals, lead=found.lead(healthy))

    monkeypatch.setattr(diagnose.proposal, "propose", propose)
    given = SimpleNamespace(finding={"next_manoeuvre": None}, runs=[], reserved=[])
    diagnose._propose(given, SimpleNamespace(fitter=None), found)
    assert asked["best"] is drag and asked["rivals"] == [slope, healthy] and asked["lead"] == -0.5


def test_a_data_file_is_that_of_the_vehicle_it_is_said_to_be(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time [s],engine_torque [N.m],engine_speed [rpm]\n0,1,1500\n0.5,1,1510\n1,1,1520\n")
    with pytest.raises(InputError, match="which vehicle.*--vehicle"):
        diagnose.diagnose(path)
    with pytest.raises(InputError, match="at least 2 s are needed"):  # it is a car's, and too short
        diagnose.diagnose(path, vehicle="pickup_10r80", variant="modified")


def test_what_swings_in_a_vehicle_file_is_taken_out_and_looked_for():
    """Beside it nothing could be less, and a swing of nothing turned all of it into another phase."""
    car = FullOrderCar("pickup_10r80", "modified", {"torque_ripple.amplitude": 30.0})
    others = {name: value for name, value in car.values.items() if name != "torque_ripple.amplitude"}
    assert diagnose._without_swings(car) == {"torque_ripple.amplitude": 30.0}
    assert car.values == others | {"torque_ripple.amplitude": 0.0}
    assert not diagnose._without_swings(car)


@pytest.mark.parametrize(("lead", "confirmed", "beside"), [
    (787.0, False, "best"), (500.0, False, "healthy"), (3.0, False, "healthy"), (3.0, True, "best")])
def test_a_missing_torque_is_looked_for_beside_causes_where_these_explain_far_more_than_it(
        monkeypatch, lead, confirmed, beside):
    best, healthy = SimpleNamespace(score=lead), SimpleNamespace(score=0.0)
    torques = {id(best): [SimpleNamespace(place="axle", gain=62.0)],
               id(healthy): [SimpleNamespace(place="engine", gain=293.0)]}
    monkeypatch.setattr(diagnose, "Supposed", lambda predictor, fit, noise: SimpleNamespace(
        listed=lambda: torques[id(fit)]))
    found = SimpleNamespace(best=best, healthy=healthy, noise=None)
    assert diagnose._missing(None, found, confirmed).listed() == torques[id(best if beside == "best" else healthy)]


def found(together, taken_out=()):
    """A finding of a car, so far."""
    return SimpleNamespace(car=FullOrderCar("pickup_10r80", "modified"), taken_out=dict(taken_out), reserved=[],
                           finding={"together": list(together), "extension": None, "wrong": [], "causes": []},
                           measurement=SimpleNamespace(name="m"), traces={})


def test_an_extended_file_names_what_was_written_into_it_and_swings_no_more_than_was_found(tmp_path):
    """Not what is less likely, nor what a sensor errs by, which were not written."""
    given = found(["vehicle_mass", "mesh_loss", "wheel_speed_delay"], {"torque_ripple.amplitude": 30.0})
    given.finding["causes"] = [{"effect": name} for name in (*given.finding["together"], "driveline_damping")]
    diagnose._write_vehicle(given, given.car.values | {
        "vehicle.mass": 2000.0, "transmission.loss_constant[5]": 9.0, "observe.wheel_speed.delay": 0.01}, tmp_path)
    read = vehicles.load(tmp_path / "extended.toml")
    assert read.values["torque_ripple.amplitude"] == 0.0
    assert read.sources["vehicle.mass"] == "diagnosis of m: vehicle mass, mesh loss"
    assert given.finding["extension"] == {"vehicle": "extended.toml", "fmu": None,
                                          "effects": ["vehicle_mass", "mesh_loss"]}


def test_what_is_no_value_of_a_vehicle_is_not_in_the_extended_file_which_says_so(tmp_path):
    sensed = {"observe.propeller_shaft_torque.gain": 1.08, "input.road_grade.offset": 0.01}
    given = found(["torque_meter_gain", "road_grade"])
    diagnose._write_vehicle(given, given.car.values | sensed, tmp_path)
    assert given.finding["extension"]["effects"] == []
    assert vehicles.load(tmp_path / "extended.toml").values == given.car.source.values
    said = (tmp_path / "extended.toml").read_text().splitlines()[0]
    assert "diagnosis of m: no value of the vehicle is another one" in said
    given = found(["torque_meter_gain"], {"torque_ripple.amplitude": 30.0})
    diagnose._write_vehicle(given, given.car.values | sensed, tmp_path)
    assert given.finding["extension"]["effects"] == []
    source = vehicles.load(tmp_path / "extended.toml").sources["torque_ripple.amplitude"]
    assert source == "diagnosis of m: what swings was not found"


def test_where_only_a_sensor_errs_the_gain_is_what_is_known_of_it(tmp_path, monkeypatch):
    hide(["torque_meter_gain=1.1"], 3, tmp_path / "m", structure="same", drift="none", manoeuvres=["tip_in:5"])
    measurement = load(tmp_path / "m")
    given = found(["torque_meter_gain"])
    given.reserved = given.car.runs(measurement)
    (tmp_path / "out").mkdir()

    monkeypatch.setattr(diagnose, "_values", lambda predictor, fit, told: given.car.values | {
        "observe.propeller_shaft_torque.gain": 1.1})
    floors = {name: float(np.std(np.diff(values))) for run in given.reserved for name, values in run.measured.items()}
    search = SimpleNamespace(best=SimpleNamespace(effects=("torque_meter_gain",)), noise=SimpleNamespace(floors=floors))
    diagnose._extend(given, None, search, tmp_path / "out", None, str)
    assert given.finding["extension"]["effects"] == []
    gain = {row["signal"]: row["nrmse_after"] / row["nrmse_before"] for row in given.finding["gain"]["held_out"]}
    assert gain.pop("propeller_shaft_torque") < 0.3
    assert gain and all(ratio == pytest.approx(1.0) for ratio in gain.values())
    assert given.finding["gain"]["estimators"] == []


def test_beside_something_unknown_suspects_are_as_much_less_probable_as_causes():
    shares = {"vehicle_mass": 0.3, "tyre_slip": 0.04, "mesh_loss": 0.2}
    assert [s["probability"] for s in diagnose._suspects(shares, False, ())] == [0.3, 0.04, 0.2]
    lowered = {s["effect"]: s["probability"] for s in diagnose._suspects(shares, True, {"mesh_loss"})}
    causes = [{"effect": name, "probability": share} for name, share in shares.items()]
    beside_unknown(causes, {"mesh_loss"})
    assert lowered == {c["effect"]: c["probability"] for c in causes} and lowered["tyre_slip"] < 0.01
