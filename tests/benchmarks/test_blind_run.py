"""Blind cases: what is hidden, and that their results are the same however they were run."""

import json
import resource
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import fake_diagnosis
import numpy as np
import pytest
from floors import FLOORS, measured

from benchmarks.blind import __main__ as command
from benchmarks.blind import reading, visibility
from benchmarks.blind import run as blind
from benchmarks.blind.cases import ANY, CARS, CATEGORIES, THROUGH_LASH, BlindCase, cases, wanted
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.hidden import COCKTAIL, VEHICLE, hide, highest_gear, sizes_of, usual_variant
from cosim.diagnosis.hidden.recordings import KINDS, asked
from cosim.diagnosis.plants import plant_for
from cosim.measured import load
from cosim.studies import sweep
from driveline import vehicles
from driveline.quantities import InputError

FAKE = "fake_diagnosis:guess"
MATRIX, MATRICES = 1_000_000, 40  # 8 MB
ALL = dict.fromkeys(CATEGORIES, 1)


def short(counts, seed=0):
    return [replace(case, manoeuvres=("tip_in:5",)) for case in cases(counts, seed)]


def timeless(results):
    """Without what differs from run to run."""
    return [{key: value for key, value in r.items() if key != "seconds"} for r in results]


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """One case of each category, run in this process."""
    folder = tmp_path_factory.mktemp("here")
    return folder, short(ALL), blind.run(short(ALL), folder, method=FAKE)


def test_a_longer_run_begins_with_the_shorter_one():
    few, many = (cases(dict.fromkeys(CATEGORIES, n), 3) for n in (4, 9))
    assert few == many[:len(few)]
    assert len({case.seed for case in many}) == len({case.name for case in many}) == len(many) == 9 * len(CATEGORIES)
    assert not {case.seed for case in many} & {case.seed for case in cases(dict.fromkeys(CATEGORIES, 9), 4)}


def test_every_effect_comes_once_in_a_round_and_a_third_has_another_structure():
    count = len(CATALOGUE)
    for category in ("single", "weak", "pair"):
        chosen = cases({category: 2 * count})
        for part in (chosen[:count], chosen[count:]):
            assert sorted(case.effects[0].partition("=")[0] for case in part) == sorted(CATALOGUE)
        assert 3 * sum(case.structure == "other" for case in chosen) >= len(chosen)


@pytest.mark.parametrize("vehicle", CARS)
def test_weak_effects_change_something_less_than_the_detection_limit(vehicle):
    nominal = vehicles.load(vehicle, usual_variant(vehicle)).values
    for case in cases({"weak": 3 * len(CATALOGUE)}, vehicle=vehicle):
        name, _, text = case.effects[0].partition("=")
        sizes = sizes_of(CATALOGUE[name], text, nominal, np.random.default_rng(0))
        limits = {p.name: p.detection for p in CATALOGUE[name].parameters}
        strengths = [abs(p.coordinate(sizes[p.name])) / limits[p.name] for p in CATALOGUE[name].parameters
                     if p.name in sizes]
        assert strengths and 0.2 < max(strengths) <= 1.0 + 1e-9
        assert any(nominal.get(key) != value for key, value in CATALOGUE[name].changes(sizes, nominal).items())


def test_counts_may_differ_between_categories():
    assert wanted(["null:100", "pair"], 7) == {"null": 100, "pair": 7}
    assert wanted([], 3) == dict.fromkeys(CATEGORIES, 3)
    with pytest.raises(InputError, match="no category 'pears'; did you mean 'pair'"):
        wanted(["pears"], 1)
    with pytest.raises(InputError, match="null:100"):
        wanted(["null:many"], 1)


def test_other_manoeuvres_are_for_those_that_have_none_of_their_own():
    single, strange = cases({"single": 1, "strange": 1}, manoeuvres=("tip_in:5",))
    assert single.manoeuvres == ("tip_in:5",) and len(strange.manoeuvres) > 1
    assert single.seed == cases({"single": 1})[0].seed
    with pytest.raises(InputError, match="tipp_in:5.*did you mean"):
        cases({"single": 1}, manoeuvres=("tipp_in:5",))


def test_each_case_may_have_a_vehicle_and_a_drive_of_its_own():
    counts = dict.fromkeys(CATEGORIES, 40)
    varied, plain = cases(counts, 5, (ANY,), ANY), cases(counts, 5)
    assert varied[:70] == cases(dict.fromkeys(CATEGORIES, 10), 5, (ANY,), ANY)
    assert [(case.effects, case.seed) for case in varied if case.category != "weak"] == [
        (case.effects, case.seed) for case in plain if case.category != "weak"]  # a weak size goes by the vehicle
    assert {case.vehicle for case in varied} == set(CARS)
    assert {case.vehicle for case in varied if case.category == "cocktail"} == {VEHICLE}
    driven = []
    for case in varied:
        top = highest_gear(vehicles.load(case.vehicle, usual_variant(case.vehicle)).values)
        found = asked(case.manoeuvres, top)
        if case.category != "strange":
            assert 1 <= len(found) <= 3 and found[0][0] in THROUGH_LASH
            driven += found
    assert {kind for kind, _, _ in driven} == set(KINDS) and {gear for _, gear, _ in driven} == set(range(3, 9))


def test_a_vehicle_is_one_that_is_shipped_and_has_the_gears():
    assert {case.vehicle for case in cases({"single": 3}, vehicle="suv_6l80")} == {"suv_6l80"}
    with pytest.raises(InputError, match="suv_6l8"):
        cases({"single": 1}, vehicle="suv_6l8")
    with pytest.raises(InputError, match="gears 1 to 6"):
        cases({"single": 1}, manoeuvres=("tip_in:8",), vehicle="suv_6l80")


def test_the_truth_stands_beside_what_was_found(here):
    _, chosen, results = here
    assert [r["name"] for r in results] == [case.name for case in chosen]
    by = {r["category"]: r for r in results}
    assert set(by["pair"]["truth"]["effects"]) == {name for name in by["pair"]["effects"]}
    assert by["null"]["truth"]["effects"] == by["strange"]["truth"]["effects"] == {}
    assert by["outside"]["truth"]["outside"] and len(by["cocktail"]["truth"]["effects"]) == 6
    assert all(r["truth"]["structure"] == r["structure"] for r in results)


def test_a_case_that_raises_is_a_result(tmp_path):
    found = blind.run(short({"null": 6}), tmp_path, method=FAKE)
    failed = [r for r in found if r["error"]]
    assert failed and len(failed) < len(found)
    for r in failed:
        assert r["error"].startswith(fake_diagnosis.FAILS) and "in guess" in r["error"]
        assert r["finding"] is None
    [odd] = [blind.examined(case, "fake_diagnosis:endless") for case in short({"null": 6})
             if case.name == next(r["name"] for r in found if not r["error"])]
    assert "JSON" in odd["error"]


def test_two_workers_find_what_one_does(here, tmp_path):
    pytest.importorskip("distributed", reason="dask is not installed: extra `blind`")
    _, chosen, one = here
    two = blind.run(chosen, tmp_path, workers=2, method=FAKE)
    assert timeless(two) == timeless(one)
    assert blind.read(tmp_path / blind.LINES) == two


def mapped():
    """Pages that a process maps anew for matrices as a diagnosis has them, one after the other."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(MATRICES):
        np.ones(MATRIX).sum()
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def test_a_worker_keeps_the_memory_of_one_matrix_for_the_next():
    distributed = pytest.importorskip("distributed", reason="dask is not installed: extra `blind`")
    with blind.address_of(2, None, 2) as address, distributed.Client(address) as client:
        pages = client.run(mapped)
    assert len(pages) == 2
    assert max(pages.values()) < 3 * MATRIX * 8 / resource.getpagesize()  # of a few, until that is kept


def test_a_cluster_finds_what_one_process_does(here, tmp_path):
    distributed = pytest.importorskip("distributed", reason="dask is not installed: extra `blind`")
    _, chosen, one = here
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False,
                                  dashboard_address=":0") as cluster:
        found = blind.run(chosen[:2], tmp_path, cluster=cluster.scheduler_address, method=FAKE)
    assert timeless(found) == timeless(one[:2])


def test_a_stopped_run_goes_on_where_it_was(here, tmp_path):
    _, chosen, one = here
    blind.run(chosen[:3], tmp_path, method=FAKE)
    with (tmp_path / blind.LINES).open("a") as file:
        file.write('{"name": "half a li')
    assert [r["name"] for r in blind.read(tmp_path / blind.LINES)] == [case.name for case in chosen[:3]]
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cases").iterdir()}
    told = []
    found = blind.run(chosen, tmp_path, method=FAKE, progress=lambda share, r: told.append((share, r["name"])))
    assert timeless(found) == timeless(one)
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())
    assert sorted(name for _, name in told) == sorted(case.name for case in chosen)
    assert [share for share, _ in told] == [(i + 1) / len(chosen) for i in range(len(chosen))]


def test_what_other_code_found_is_done_again(here, tmp_path, monkeypatch, caplog):
    _, chosen, _ = here
    before = blind.run(chosen[:1], tmp_path, method=FAKE)
    monkeypatch.setattr(blind, "fingerprint", lambda: "of another version")
    told = []
    after = blind.run(chosen[:1], tmp_path, method=FAKE, progress=lambda _, r: told.append(r["code"]))
    assert told == ["of another version"] and before[0]["code"] != after[0]["code"]
    assert "1 results of another version of the code" in caplog.text
    assert len(blind.read(tmp_path / blind.LINES)) == 1


def test_what_judges_a_finding_is_code_a_result_stands_on(monkeypatch):
    """How much shows of what is hidden is kept with the finding."""
    def key():
        sweep._source.cache_clear()
        return sweep.Case("x", blind.examined, {}).key

    before, changed = key(), [visibility.__file__, reading.__file__]
    real = Path.read_bytes
    keys = {before}
    for file in changed:
        monkeypatch.setattr(Path, "read_bytes", lambda path, file=file: real(path) + b"#" * (str(path) == file))
        keys.add(key())
    monkeypatch.undo()
    assert len(keys) == 3 and key() == before


def test_the_proposed_manoeuvre_goes_with_the_usual_ones_of_the_vehicle(monkeypatch):
    """Whose highest gear may be lower than theirs."""
    driven = []
    monkeypatch.setattr(blind, "hide_case", lambda case, manoeuvres, path: driven.append(manoeuvres))
    monkeypatch.setattr(blind, "_diagnosed", lambda path, method: (None, {}, 0.0))
    [case] = cases({"single": 1}, vehicle="suv_6l80")
    assert blind._again(case, {"kind": "ramp", "gear": 3, "back": True}, FAKE)["error"] is None
    [entries] = driven
    assert len(asked(entries, 6)) == len(entries) and "coast_down:6" in entries and entries[-1] == "ramp:3:back"


def test_a_manoeuvre_is_driven_as_often_as_was_proposed(monkeypatch):
    driven = []
    monkeypatch.setattr(blind, "hide_case", lambda case, manoeuvres, path: driven.append(manoeuvres))
    monkeypatch.setattr(blind, "_diagnosed", lambda path, method: (None, {}, 0.0))
    [case] = cases({"single": 1}, manoeuvres=("tip_in:5",))
    assert blind._again(case, {"kind": "ramp", "gear": 3, "times": 3}, FAKE)["manoeuvre"] == "ramp:3,ramp:3,ramp:3"
    assert driven == [["tip_in:5", "ramp:3", "ramp:3", "ramp:3"]]


@pytest.mark.parametrize(("name", "asked"), [("single", ["missed"]), ("pair", ["beside", "missed"]), ("null", [])])
@pytest.mark.parametrize("driven_again", [False, True])
def test_what_was_not_found_is_fitted_from_the_truth_also_where_it_was_driven_again(monkeypatch, name, asked,
                                                                                    driven_again):
    [case] = cases({name: 1}, manoeuvres=("tip_in:5",))
    hidden = {effect.partition("=")[0]: {} for effect in case.effects}
    nothing = {"verdict": "none", "causes": [], "ambiguous_with": []}
    monkeypatch.setattr(blind, "hide_case", lambda *_: SimpleNamespace(effects=hidden))
    monkeypatch.setattr(blind, "truth", lambda hidden: {"effects": hidden.effects})
    monkeypatch.setattr(blind, "_diagnosed", lambda *_: (SimpleNamespace(identification=1), {**nothing}, 0.0))
    monkeypatch.setattr(blind, "_ideal", lambda *_: None)
    monkeypatch.setattr(blind, "evident", lambda *_: 1.0)
    monkeypatch.setattr(blind, "missed", lambda *_: 2.0)
    monkeypatch.setattr(blind, "beside", lambda *_: 3.0)
    told = (blind._again(case, {"kind": "ramp", "gear": 3}, FAKE, shows=True) if driven_again
            else blind.examined(case, FAKE))
    assert told["error"] is None
    assert sorted(key for key in ("missed", "beside") if told.get(key)) == asked


def test_what_the_true_model_gains_is_measured_in_phase_with_the_recording(tmp_path):
    """As of a finding: what swings has a phase of its own in every recording, which no vehicle file knows."""
    hide([], 3, tmp_path, structure="same", drift="none", manoeuvres=["tip_in:3"])
    measurement = load(tmp_path)
    car = plant_for(measurement)
    [run] = car.runs(measurement)
    size, [phase] = {"torque_ripple.amplitude": 40.0}, CATALOGUE["torque_ripple"].nuisances
    run = measured(car, run, car.raw({**car.values, **size, phase: 2.0}, run.free))
    hidden = SimpleNamespace(effects={"torque_ripple": {}}, changed={name: (0.0, x) for name, x in size.items()})
    noise = SimpleNamespace(floors=FLOORS)
    told = blind._ideal(SimpleNamespace(car=car, reserved=[run], identification=SimpleNamespace(noise=noise)), hidden)
    for name in ("engine_speed", "turbine_speed", "transmission_output_speed"):
        floor, (before, after) = FLOORS[name] / np.ptp(run.measured[name]), told[name]
        assert before > 2.0 * after and after == pytest.approx(floor, rel=0.2)


def test_a_worker_with_other_code_is_refused():
    with pytest.raises(InputError, match="another version on the cluster"):
        blind.examined(short(ALL)[0], FAKE, "other code")


def test_what_is_printed_is_kept(here, monkeypatch, capsys):
    folder, chosen, results = here
    assert command.main(["--print", "--out", str(folder)]) == 0
    printed = capsys.readouterr().out
    told = json.loads((folder / "blind.json").read_text())
    assert told["results"] == results and printed.strip() == (folder / "blind.md").read_text().strip()
    assert f"{len(chosen)} cases: 1 single, 1 weak" in printed
    for row in told["rows"]:
        assert f"| {row['cases']} | {row['quantity']} |" in printed


def test_a_wrong_category_ends_with_one_message(capsys):
    assert command.main(["--categories", "singel"]) == 2
    assert capsys.readouterr().err.startswith("error: there is no category 'singel'; did you mean 'single'")


def test_no_workers_and_no_results_are_refused(tmp_path):
    with pytest.raises(InputError, match="at least 1"):
        blind.run([BlindCase("null-0", "null", (), 1, "same")], tmp_path, workers=0, method=FAKE)
    with pytest.raises(InputError, match="run the cases first"):
        blind.read(tmp_path / "nothing.jsonl")


def test_of_the_own_case_of_the_thesis_the_shuffle_is_that_of_the_file_as_found_and_the_true_one(tmp_path):
    hidden = hide([COCKTAIL], 3, tmp_path / "m", structure="same", drift="none", manoeuvres=["tip_in:5"])
    car = plant_for(load(tmp_path / "m"))
    sizes = {"verdict": "cause", "together": ["vehicle_mass"], "causes": [{"effect": "vehicle_mass", "parameters": {
        "vehicle_mass": {"nominal": 2200.0, "value": 2534.0, "low90": 2500.0, "high90": 2570.0}}}]}
    file, found, true = blind.shuffle(car, hidden, sizes)
    assert (file, true) == pytest.approx((7.14, 5.88), rel=0.01)
    assert true < found < file
