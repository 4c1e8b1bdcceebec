"""The report of a diagnosis: all it has to say is there, and a browser shows it as it is meant."""

import html
import itertools
import json
import re
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.judge.verdict import directly
from cosim.diagnosis.plants import FullOrderCar, Nuisance
from cosim.diagnosis.plants.led import PLACES
from cosim.diagnosis.show.residuals import wrong
from cosim.measured import load
from cosim.report import svg
from cosim.report.diagnosis.page import _PLACES, _SENSORS, render
from cosim.report.diagnosis.text import dotted, shown_unit
from cosim.report.diagnosis.verdict import headline, moved

VERDICTS = ("cause", "ambiguous", "unknown", "none")
WIDTHS = (1200, 800, 400)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FACTOR = 0.75
# What a browser is asked of a page: what is outside its box or over something else.
CHECK = """
function check(d) {
  const found = [], near = 1.0;
  if (d.documentElement.scrollWidth > d.documentElement.clientWidth + near) found.push('wider than the window');
  for (const picture of d.querySelectorAll('svg')) {
    const frame = picture.getBoundingClientRect(), boxes = [];
    if (!(frame.width > 50 && frame.height > 20)) found.push('no room: ' + picture.getAttribute('aria-label'));
    for (const words of picture.querySelectorAll('text')) {
      const b = words.getBoundingClientRect();
      if (b.left < frame.left - near || b.right > frame.right + near || b.top < frame.top - near
          || b.bottom > frame.bottom + near) found.push('outside its picture: ' + words.textContent);
      for (const [other, o] of boxes)
        if (Math.min(b.right, o.right) - Math.max(b.left, o.left) > near
            && Math.min(b.bottom, o.bottom) - Math.max(b.top, o.top) > 3)
          found.push('over each other: ' + other + ' and ' + words.textContent);
      boxes.push([words.textContent, b]);
    }
  }
  for (const e of d.querySelectorAll('p, li, h1, h2, h3, figcaption, .share, .share span, td')) {
    const card = e.closest('.card, figure, .verdict') || d.body, b = e.getBoundingClientRect();
    const scrolls = card.classList.contains('tablebox') && d.documentElement.clientWidth < 600;
    const c = card.getBoundingClientRect();
    if (!scrolls && (b.right > c.right + near || b.left < c.left - near || e.scrollWidth > e.clientWidth + 1
        && e.clientWidth > 0)) found.push('outside its box: ' + e.textContent.trim().slice(0, 60));
  }
  return found;
}
addEventListener('load', () => {
  const all = {};
  for (const frame of document.querySelectorAll('iframe')) {
    const d = frame.contentDocument;
    frame.style.height = d.documentElement.scrollHeight + 'px';
    all[frame.id] = {problems: check(d), verdict: d.querySelector('#verdict').innerText,
      pictures: [...d.querySelectorAll('svg')].map(p => { const b = p.getBoundingClientRect();
        return [p.getAttribute('aria-label'), b.left, b.top, b.width, b.height]; })};
  }
  document.querySelector('#result').textContent = JSON.stringify(all);
});
"""


def drawn(car, runs, count, random):
    """Recordings of the file's car with noise, slope and torque of their own: enough to be compared with."""
    found = []
    for run in runs:
        noise = np.concatenate([np.full(values.size, np.std(np.diff(values, 3)) / np.sqrt(20.0))
                                for values in run.measured.values()])
        nuisances = [Nuisance(*(np.array([0.02, 1e-3, 1.0]) * random.standard_normal(3))) for _ in range(count)]
        found.append([car.predict(car.values, run, nuisance) + noise * random.standard_normal(noise.size)
                      for nuisance in nuisances])
    return found


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A measurement of a car with softer axle shafts, what is wrong with it, before and after."""
    folder = tmp_path_factory.mktemp("measurement") / "soft <axle>"
    hide([f"shaft_stiffness=axle_shaft_stiffness:{FACTOR}"], 7, folder, structure="same",
         manoeuvres=("tip_in:5", "tip_out:5", "coast_down:7"), truth=folder.with_suffix(".json"))
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    runs = [run.free for run in car.runs(measurement)]
    softer = car.values | {"axle_shaft.stiffness": FACTOR * car.values["axle_shaft.stiffness"]}
    nominal = [car.predict(car.values, run) for run in runs]
    after = [car.predict(softer, run) for run in runs]
    listed = wrong(runs, nominal, drawn(car, runs, 12, np.random.default_rng(1)))
    traces = {(run.name, name): (run.clocks[name], run.measured[name], nominal[r][place], after[r][place])
              for r, run in enumerate(runs) for name, place in run.slices.items()}
    return SimpleNamespace(measurement=measurement, car=car, runs=runs, wrong=listed, traces=traces)


def diagnosis(base, verdict):
    """As the pipeline hands it over, for every verdict; finding put together by hand."""
    stiffness = base.car.values["axle_shaft.stiffness"]
    finding = {"verdict": verdict, "wrong": [entry.as_json() for entry in base.wrong], "causes": [], "together": [],
               "ambiguous_with": [], "next_manoeuvre": None, "unknown": None, "extension": None, "gain": None,
               "would_show": [
                   {"effect": "vehicle_mass", "parameter": "vehicle_mass", "nominal": 2200.0, "below": 2090.0,
                    "above": 2310.0, "unit": "kg"},
                   {"effect": "coulomb_drag", "parameter": "coulomb_drag_torque", "nominal": 0.0, "below": None,
                    "above": 9.5, "unit": "N.m"},
                   {"effect": "road_grade", "parameter": "road_grade_offset", "nominal": 0.0, "below": None,
                    "above": None, "unit": "rad"}]}
    disturbance, traces, notices = {}, base.traces, ["no <turbine> speed: engine & converter are told together"]
    if verdict in ("cause", "ambiguous"):
        finding["together"] = ["shaft_stiffness"]
        finding["causes"] = [{"effect": "shaft_stiffness", "probability": 0.93, "parameters": {
            "propeller_shaft_stiffness": {"nominal": 11250.0, "value": 9900.0, "low90": 7800.0, "high90": 12500.0,
                                          "unit": "N.m/rad"},
            "axle_shaft_stiffness": {"nominal": stiffness, "value": FACTOR * stiffness, "unit": "N.m/rad",
                                     "low90": 0.735 * stiffness, "high90": 0.767 * stiffness}}}]
        finding["extension"] = {"vehicle": "extended.toml", "fmu": "plant_fom_extended.fmu"}
        last = [name for run, name in traces if run == base.runs[-1].name]
        finding["gain"] = {"fraction_of_noise_floor": 1.1, "remains": {
            "share": 0.221, "low": 0.104, "high": 0.467, "blocks": 15, "alone": 9.1}, "held_out": [
            {"manoeuvre": base.runs[-1].name, "signal": name, "nrmse_before": 0.1 / (i + 1), "nrmse_after": 0.011,
             "noise_floor": 0.01} for i, name in enumerate(last)], "features": [
            {"manoeuvre": base.runs[-1].name, "signal": "engine_speed", "feature": "shuffle frequency", "unit": "Hz",
             "measured": 5.902, "before": 7.189, "after": 5.897}]}
    if verdict == "ambiguous":
        finding["causes"][0]["probability"] = 0.55
        finding["causes"].append({"effect": "wheel_speed_delay", "probability": 0.38, "parameters": {
            "wheel_speed_delay": {"nominal": 0.0, "value": 0.031, "low90": 0.02, "high90": 0.9, "unit": "s"}}})
        finding["ambiguous_with"] = [{"effects": ["wheel_speed_delay"], "separation_sigma": 0.6},
                                     {"effects": ["engine_inertia", "vehicle_mass"], "separation_sigma": 2.4}]
        finding["next_manoeuvre"] = {"kind": "tip_in", "gear": 3, "back": False, "separation_sigma": 6.1,
                                     "why": "in a lower gear shafts and sensor differ by more"}
    if verdict == "unknown":
        time = np.arange(0.0, 7.0, 0.01)
        speed = 60.0 + 20.0 * np.sin(time)
        disturbance = {"time": time, "torque": 0.01 * (speed - 40.0) ** 2, "speed": speed,
                       "std": np.ones(time.size), "twist": 1e-3 * np.cos(9.0 * time),
                       "wheel angle": 30.0 * time, "run": np.zeros(time.size)}
        finding["unknown"] = {"balance": "propeller shaft", "driving_variable": "speed", "size": 16.0,
                              "unit": "N.m", "shape": "growing with its square"}
    if verdict == "none":
        finding["wrong"], notices = [], []
        traces = {key: (clock, measured, before, before) for key, (clock, measured, before, _) in traces.items()}
    return SimpleNamespace(
        finding=json.loads(json.dumps(finding, allow_nan=False)), measurement=base.measurement, car=base.car,
        runs=base.runs[:-1], reserved=base.runs[-1:], wrong=base.wrong, traces=traces, notices=notices,
        seconds=48.2, disturbance=disturbance, suspects=[{"effect": "tyre_stiffness", "probability": 0.03}])


def bench(verdict, stretches=2, **said):
    """The same of a bench: ``r1``, ``r2``, ..., each with a force simulated worse than in the one before."""
    time, names = np.arange(0.0, 10.0, 0.01), [f"r{i + 1}" for i in range(stretches)]
    drag = {"nominal": 0.0, "value": 20.0, "low90": 19.0, "high90": 21.0, "unit": "N"}
    finding = {"verdict": verdict, "wrong": [], "causes": [
        {"effect": "coulomb_drag", "probability": 0.6, "parameters": {"guide_friction": drag}}],
        "together": ["coulomb_drag"], "ambiguous_with": [], "next_manoeuvre": None, "unknown": None, "gain": None}
    traces = {(name, "force"): (time, np.sin(time), (1.1 + 0.1 * i) * np.sin(time), np.sin(time))
              for i, name in enumerate(names)}
    carriage = SimpleNamespace(source=SimpleNamespace(name="emps", variant=None), name="plant_single_mass", values={})
    return SimpleNamespace(
        finding=finding | said, measurement=SimpleNamespace(name="bench"), car=carriage, traces=traces, reserved=[],
        notices=[], seconds=1.0,
        runs=[SimpleNamespace(name=name, clocks={"force": time}) for name in names])


@pytest.fixture(scope="module")
def pages(base):
    return {verdict: render(diagnosis(base, verdict)) for verdict in VERDICTS}


def words(page):
    """What of a page is read: no tags, no styles."""
    return html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", " ", page, flags=re.S)))


def test_the_page_needs_nothing_else(pages):
    for page in pages.values():
        assert not re.search(r"""(src|href)\s*=|url\(|@import|<script|<link""", page)
        assert len(page.encode()) < 400_000


def test_causes_that_act_together_share_their_probability(base):
    given = diagnosis(base, "cause")
    mass = {"nominal": 2200.0, "value": 2530.0, "low90": 2500.0, "high90": 2560.0, "unit": "kg"}
    given.finding["causes"] = [{**given.finding["causes"][0], "probability": 0.05},
                               {"effect": "vehicle_mass", "probability": 0.05, "parameters": {"vehicle_mass": mass}}]
    given.finding["together"] = ["shaft_stiffness", "vehicle_mass"]
    page = render(given)
    assert "shaft stiffness, 10 % together with the other" in page
    assert "vehicle mass, 10 % together with the other" in page and "Vehicle mass: vehicle mass 2530" in page


def test_names_from_outside_are_text_not_markup(pages):
    for page in pages.values():
        assert "<axle>" not in page and "<turbine>" not in page
    assert "soft <axle>" in words(pages["cause"])
    assert "no <turbine> speed: engine & converter are told together" in words(pages["cause"])


def test_the_finding_is_told(pages, base):
    cause = " ".join(words(pages["cause"]).split())
    assert "Cause found" in cause and "-25.0 %" in cause and "93 %" in cause
    assert "propeller shaft stiffness 9900" not in cause.partition("What is wrong")[0]  # its interval holds the file's
    assert "shuffle frequency" in base.wrong[0].what and base.wrong[0].what in cause
    assert "plant_fom_extended.fmu" in cause
    assert "the noise floor" in cause
    assert "shuffle frequency engine speed 5.902 7.189 5.897 Hz" in cause
    assert "in the car itself" in cause
    ambiguous = " ".join(words(pages["ambiguous"]).split())
    assert "these recordings cannot tell which" in ambiguous
    assert "engine inertia with vehicle mass" in ambiguous and "0.6 sigma" in ambiguous
    assert "tip-in in gear 3" in ambiguous and "sensor: wheel speed" in ambiguous
    unknown = " ".join(words(pages["unknown"]).split())
    assert "propeller shaft" in unknown and "growing with its square" in unknown
    assert "Nothing is significantly wrong" in words(pages["none"])
    assert "Why" not in words(pages["none"]) and "None" not in words(pages["none"])


def test_beside_nothing_what_is_not_excluded_is_told_and_nowhere_else(base):
    given, doubted = diagnosis(base, "none"), diagnosis(base, "ambiguous").finding
    given.finding |= {"causes": doubted["causes"][1:]}
    assert "not excluded" not in render(given) and "38 %" not in render(given)  # one in three alone is no doubt
    given.finding |= {"ambiguous_with": doubted["ambiguous_with"][:1], "next_manoeuvre": doubted["next_manoeuvre"]}
    said = " ".join(words(render(given)).split())
    assert "Nothing proven wrong Nothing is significantly wrong, but wheel speed delay is not excluded (38 %)" in said
    assert "What is not excluded wheel speed delay, 38 %" in said and "tip-in in gear 3" in said
    assert "nothing, or something else 59 %" in said and "It is in" not in said and "Why" not in said
    assert "hat to measure" not in said
    given.finding |= {"directly": directly([{"effects": ["coulomb_drag"], "in_place_of": ["rolling_resistance"]}])}
    said = " ".join(words(render(given)).split())
    assert "Or what to measure rolling resistance: the car towed" in said and "coulomb drag: the lifted driven" in said
    given.finding["next_manoeuvre"] |= {"times": 3}
    assert " ".join(words(render(given)).split()).count("What to drive next tip-in in gear 3, 3 times") == 2


@pytest.mark.parametrize("below, above, said", [
    (None, 0.04, "Smaller than would show in these recordings alone: from 0.04 s on."),
    (None, None, "No plausible size of it alone would show in these recordings."), (-0.04, 0.03, "")])
def test_a_cause_that_is_smaller_than_would_show_is_told_from_where_it_would(base, below, above, said):
    given, doubted = diagnosis(base, "none"), diagnosis(base, "ambiguous").finding
    row = {"effect": "wheel_speed_delay", "parameter": "wheel_speed_delay", "nominal": 0.0, "unit": "s"}
    given.finding |= {"causes": doubted["causes"][1:], "ambiguous_with": doubted["ambiguous_with"][:1],
                      "would_show": [*given.finding["would_show"], {**row, "below": below, "above": above}]}
    page = " ".join(words(render(given)).split())
    assert said in page and ("would show in" in page) is bool(said)


def test_a_confirmed_cause_beside_something_unknown_is_named(base):
    given = diagnosis(base, "unknown")
    given.finding |= {key: diagnosis(base, "cause").finding[key] for key in ("together", "causes")}
    said = " ".join(words(render(given)).split())
    assert "Cause found, and something unknown Shaft stiffness: axle shaft stiffness" in said
    assert "; beside that a torque at the propeller shaft is missing that no known effect explains" in said
    given.finding["causes"][0]["probability"] = 0.28
    said = " ".join(words(render(given)).split())
    assert "Unknown cause A torque at the propeller shaft is missing" in said


def test_what_only_imitates_something_unknown_is_not_what_explains_it(base):
    given = diagnosis(base, "unknown")
    given.finding |= {"together": ["wheel_speed_delay"], "causes": [
        {**diagnosis(base, "ambiguous").finding["causes"][1], "probability": 0.05}]}
    said = " ".join(words(render(given)).split())
    assert said.count("What only imitates it") == 2 and "What only imitates it wheel speed delay, 5 %" in said
    assert "Why" not in said and "sensor" not in said  # neither on the sketch nor in words
    assert "It is in the car itself: propeller shaft." in said
    given.finding["causes"][0]["probability"] = 0.9
    said = " ".join(words(render(given)).split())
    assert "Why: what explains it" in said and "imitates" not in said
    assert "It is partly in a sensor, partly in the car itself." in said and "sensor: wheel speed" in said


def test_a_further_cause_that_may_not_be_there_is_no_choice_between_two(base):
    given = diagnosis(base, "ambiguous")
    given.finding |= {"together": ["shaft_stiffness", "wheel_speed_delay"], "ambiguous_with": [
        {"effects": ["shaft_stiffness"], "separation_sigma": 1.2}]}
    said = " ".join(words(render(given)).split())
    assert "Shaft stiffness; whether wheel speed delay too, these recordings cannot tell" in said
    assert "shaft stiffness alone" in said


def test_what_is_to_be_driven_next_is_told_of_a_bench_without_a_gear():
    following = {"kind": "coast_down", "gear": 0, "separation_sigma": 5.0, "why": "the two differ in inline_torque"}
    rival = {"effects": ["driveline_damping"], "separation_sigma": 1.0}
    said = " ".join(words(render(bench("ambiguous", ambiguous_with=[rival], next_manoeuvre=following))).split())
    assert said.count("What to drive next coast-down") == 2 and "coast-down : the two differ in inline torque" in said
    assert "gear" not in said and "the other way" not in said


def test_what_is_wrong_in_many_stretches_of_a_bench_is_shown_in_the_worst():
    entry = {"signal": "force", "what": "zero is off by 3 N", "size": 3.0, "unit": "N", "p_value": 1e-9}
    page = render(bench("cause", 7, wrong=[{**entry, "where": "r1 to r7, 7 stretches"}]))
    assert re.findall(r"<figcaption>(.*?)</figcaption>", page, re.S) == ["<b>force</b> [N] in r7:\nzero is off by 3 N"]
    assert "in r2:" in render(bench("cause", 3, wrong=[{**entry, "where": "r2, r3"}]))


def test_the_gain_is_told_without_exponents():
    row = {"manoeuvre": "r2", "signal": "force", "nrmse_before": 1.35, "nrmse_after": 0.02, "noise_floor": None}
    remains = {"share": 12.34, "low": 10.4, "high": 14.7, "blocks": 15, "alone": 9.1}
    estimators = [{"estimator": "DSKSE", "quantity": "torque", "before": 5.79, "after": 3.75, "unit": "N.m"}]
    gain = {"held_out": [row], "fraction_of_noise_floor": 150.0, "remains": remains, "estimators": estimators}
    said = " ".join(words(render(bench("cause", gain=gain))).split())
    assert "error 135 % of the range before, 2 % after" in said and "150 times the noise floor" in said
    assert "15 of them, which count as 9.1, as neighbours are alike), 1234 % of it remain" in said
    assert "95 %: 1040 to 1470 %." in said
    assert "DSKSE torque 5.79 3.75 N\N{MIDDLE DOT}m" in said


def test_a_cause_that_no_single_feature_shows_is_told_with_what_it_rests_on(base, pages):
    given, rests = diagnosis(base, "cause"), "what is said here rests on all samples together"
    given.finding["wrong"] = []
    assert f"tolerance and noise explain; {rests}." in " ".join(words(render(given)).split())
    assert not any(rests in words(page) for page in pages.values())


def test_what_the_recordings_would_have_shown_is_told(pages):
    for page in pages.values():
        said = " ".join(words(page).split())
        assert "vehicle mass vehicle mass 2200 2090 2310 kg" in said
        assert "coulomb drag coulomb drag torque 0 9.5 N\N{MIDDLE DOT}m" in said
        assert "1 would not, however large" in said and "Not at any plausible size: road grade offset." in said


def test_what_is_missing_is_shown_over_what_it_could_go_with(base, pages):
    titles = re.findall(r'aria-label="what is missing over ([^"]*)"', pages["unknown"])
    assert titles == ["speed", "time", "twist", "wheel angle"]  # no run: that is no variable
    given = diagnosis(base, "unknown")
    given.finding["unknown"] |= {"balance": "vehicle", "unit": "N"}
    text = " ".join(words(render(given)).split())
    assert "A force at the vehicle is missing" in text and "size: 16 N;" in text
    given.finding["unknown"] |= {"balances": ["vehicle", "wheel", "axle"]}
    page = render(given)
    text = " ".join(words(page).split())
    assert "A force at the vehicle, wheel or axle is missing" in text
    assert "(or wheel, axle: these recordings cannot tell which)" in text and page.count(">missing force<") == 3
    given.finding["unknown"] |= {"balance": "transmission", "balances": ["transmission"], "unit": "rad", "size": 0.01}
    text = " ".join(words(render(given)).split())
    assert "A twist at the transmission is missing" in text and "size: 0.01 rad;" in text


@pytest.mark.parametrize(("kind", "size", "unit", "said"), [
    ("delay", 0.0489, "s", "as if it were some 49 ms late"), ("delay", -0.02, "s", "as if it were some 20 ms early"),
    ("factor", -1.28, "1", "as if its sign were wrong"), ("factor", 2.04, "1", "as if it showed some 2 times what is"),
    ("lasting", 1.5, "m/s", "by some 1.5 m/s")])
def test_where_a_sensor_is_wrong_no_torque_is_said_to_be_missing(base, kind, size, unit, said):
    given = diagnosis(base, "unknown")
    given.finding["unknown"]["sensor"] = {"channel": "vehicle_speed", "kind": kind, "size": size, "unit": unit,
                                          "log_evidence": 500.0}
    text = " ".join(words(render(given)).split())
    assert f"Vehicle speed contradicts all else, {said}" in text and "It is in a sensor: vehicle speed." in text
    assert "sensor: vehicle speed" in text and "missing" not in text and "in the car itself" not in text


def test_a_wheel_speed_that_is_a_ratio_off_may_be_the_final_drive_of_the_vehicle_file(base):
    """With 3.41 in the file for 3.31 the sensor alone was said to err, by "some 1 times what is there"."""
    given = diagnosis(base, "unknown")
    given.finding["unknown"]["sensor"] = {"channel": "wheel_speed", "kind": "factor", "size": 3.4093 / 3.31,
                                          "unit": "1", "log_evidence": 500.0}
    text = " ".join(words(render(given)).split())
    assert ("Wheel speed contradicts all else, as if it showed some 1.03 times what is there, or as if the ratio of "
            "the final drive were some 0.971 times the vehicle file's") in text
    assert "It is in a sensor, or in the car itself: wheel speed." in text
    given.finding["unknown"]["sensor"] |= {"kind": "delay", "size": 0.1, "unit": "s"}
    assert "final drive" not in render(given).partition("<svg")[0] and "It is in a sensor: wheel" in " ".join(
        words(render(given)).split())


def test_what_drives_the_simulation_is_no_sensor_in_the_car_that_is_simulated(base):
    given = diagnosis(base, "unknown")
    given.finding["unknown"]["sensor"] = {"channel": "engine_torque", "kind": "delay", "size": 0.1, "unit": "s",
                                          "log_evidence": 500.0}
    text = " ".join(words(render(given)).split())
    assert "Engine torque contradicts all else, as if it were some 100 ms late" in text
    assert "It is in what drives the simulation: engine torque." in text


def test_a_torque_missing_at_the_engine_may_be_an_error_of_what_drives_the_simulation(base):
    given = diagnosis(base, "unknown")
    given.finding["unknown"] |= {"balance": "engine", "balances": ["engine", "transmission"]}
    text = " ".join(words(render(given)).split())
    assert "It is in the car itself, or in what drives the simulation: engine, transmission." in text
    given.finding["unknown"] |= {"balance": "axle", "balances": ["axle"]}
    assert "It is in the car itself: axle." in " ".join(words(render(given)).split())
    given.finding["unknown"] |= {"balance": "engine", "balances": ["engine"]}
    given.finding |= {key: diagnosis(base, "cause").finding[key] for key in ("together", "causes")}
    text = " ".join(words(render(given)).split())
    assert "It is in the car itself, and perhaps in what drives the simulation too." in text


def test_where_nothing_is_named_but_something_differs_the_page_does_not_say_that_tolerance_explains_it(base):
    """As of a recording that begins while the driveline rings, where the simulation begins at rest."""
    given = diagnosis(base, "none")
    assert "what differs, tolerance and noise explain" in headline(given.finding)
    given.finding["wrong"] = diagnosis(base, "cause").finding["wrong"]
    text = " ".join(words(render(given)).split())
    assert "Nothing proven wrong No cause is significant, though more differs" in text
    assert "what differs, tolerance and noise explain" not in text


def test_what_goes_its_own_way_in_each_recording_is_shown_recording_by_recording(base):
    given = diagnosis(base, "unknown")
    given.finding["unknown"]["each_its_own"] = True
    given.disturbance["run"] = np.repeat(np.arange(len(given.runs)), 350)[:700].astype(float)
    page = render(given)
    titles = re.findall(r'aria-label="what is missing over ([^"]*)"', page)
    assert titles == [*(f"speed {run.name}" for run in given.runs), "time", "twist"]
    assert f"with which it goes, in {given.runs[0].name}" in " ".join(words(page).split())


def test_a_value_beyond_what_is_plausible_is_marked(base):
    given = diagnosis(base, "cause")
    parameter = given.finding["causes"][0]["parameters"]["axle_shaft_stiffness"]
    assert "Not plausible" not in render(given)
    parameter["value"] = 50.0 * parameter["nominal"]
    assert "Not plausible" in render(given)


@pytest.mark.parametrize(("effect", "name"), [("tyre_stiffness", "tyre_stiffness"),
                                              ("shaft_stiffness", "axle_shaft_stiffness")])
def test_a_value_at_the_limit_of_what_is_plausible_is_plausible(base, effect, name):
    given = diagnosis(base, "cause")
    declared = next(p for p in CATALOGUE[effect].parameters if p.name == name)
    for limit in declared.limits:
        size = declared.size(declared.coordinate(limit))  # as the search has it
        found = declared.found(size, size, size, base.car.values)
        given.finding["causes"][0] |= {"effect": effect, "parameters": {name: found}}
        assert "Not plausible" not in render(given)
        found["value"] *= 1.001 if limit > 1.0 else 0.999
        assert "Not plausible" in render(given)


def test_what_is_plausible_is_what_the_vehicle_can_have(base):
    given = diagnosis(base, "cause")
    given.finding["causes"][0] |= {"effect": "suspension_mode", "parameters": {"suspension_compliance": {
        "nominal": 0.0, "value": 8e-7, "low90": 6e-7, "high90": 1e-6, "unit": "m/N"}}}
    assert "0 to 1e-05" in " ".join(words(render(given)).split())  # the axle is rigid


def test_a_picture_shows_where_it_is_wrong(pages, base):
    """The shuffle's picture spans the ringing and little more, and after lies nearer than before."""
    picture = re.search(r'<svg[^>]*aria-label="[^"]* in ' + re.escape(base.wrong[0].run) + r'".*?</svg>',
                        pages["cause"], re.S).group()
    lines = {css: np.array([[float(v) for v in point.split(",")] for point in points.split()])
             for css, points in re.findall(r'<polyline class="(\w+)" points="([^"]*)"', picture)[:3]}
    assert list(lines) == ["measured", "before", "after"]
    apart = {css: np.abs(lines[css][:, 1] - lines["measured"][:, 1]).mean() for css in ("before", "after")}
    assert apart["after"] < 0.5 * apart["before"]
    assert base.wrong[0].end - base.wrong[0].begin < 2.0


@pytest.mark.parametrize(("value", "shown"), [
    (10747.5, "10748"), (0.031, "0.031"), (-25.04, "-25.04"), (5.2266, "5.227"), (0.0, "0"), (1.2e-9, "1.2e-09"),
    (1e9, "1e+09"), (1.0, "1"), (12.3456, "12.35"),
    (9999.6, "10000"), (999.96, "1000"), (1.4321e-6, "1.432e-06"), (-12345678.0, "-1.235e+07")])
def test_numbers_are_printed_as_people_write_them(value, shown):
    assert svg.number(value) == shown


@pytest.mark.parametrize(("value", "shown"), [(9.5, "9.5"), (9.96, "10"), (0.96, "0.96"), (99.6, "100"), (94.2, "94"),
                                             (1.43e-6, "1.4e-06"), (9.96e-5, "0.0001")])
def test_few_digits_are_as_many_as_were_asked_for(value, shown):
    assert svg.number(value, 2) == shown


@pytest.mark.parametrize(("nominal", "value", "unit", "said"), [
    (10.0, 12.0, "N.m", "12 N·m instead of 10 (+20.0 %)"), (1.0, 1.08, "1", "+8.0 %"), (0.0, -3.0, "N.m", "-3 N·m"),
    (-5.0, -8.0, "N.m", "-8 N·m instead of -5"), (-5.0, 3.0, "N.m", "3 N·m instead of -5"),
    (5.0, -3.0, "N.m", "-3 N·m instead of 5"), (1.0, -0.2, "1", "-0.2 instead of 1"),
    (5.0, 0.0, "N.m", "0 N·m instead of 5 (-100.0 %)")])
def test_a_change_is_a_share_only_of_what_is_more_than_nothing_and_stays_so(nominal, value, unit, said):
    parameter = {"nominal": nominal, "value": value, "low90": value, "high90": value, "unit": unit}
    assert moved({"parameters": {"size": parameter}}) == f"size {said}"


def open_to(together, *rivals, causes=()):
    """A finding of causes that cannot be told from others: what these are, and what they stand in place of."""
    return {"verdict": "ambiguous", "together": together.split(), "ambiguous_with": [
        {"effects": effects.split(), "separation_sigma": 1.0} | ({} if gone is None else {"in_place_of": gone.split()})
        for effects, gone in rivals], "causes": [
        {"effect": effect, "probability": 0.2, "parameters": {}} for effect in (*together.split(), *causes)]}


@pytest.mark.parametrize(("together", "rivals", "said"), [
    # of a meter's gain of 1.08 beside twice the rolling resistance: both stand in place of the slope, beside the gain
    ("road_grade torque_meter_gain", [("rolling_resistance", "road_grade"), ("coulomb_drag", "road_grade")],
     "Torque meter gain; beside it road grade, rolling resistance or coulomb drag: these recordings cannot tell which"),
    ("vehicle_mass", [("engine_inertia", "vehicle_mass"), ("coulomb_drag mesh_loss", "vehicle_mass")],
     "Vehicle mass, engine inertia or coulomb drag with mesh loss: these recordings cannot tell which"),
    ("vehicle_mass shaft_stiffness", [("vehicle_mass", "shaft_stiffness")],
     "Vehicle mass; whether shaft stiffness too, these recordings cannot tell"),
    ("vehicle_mass shaft_stiffness", [("vehicle_mass", "shaft_stiffness"), ("tyre_stiffness", "shaft_stiffness")],
     "Vehicle mass; whether shaft stiffness or tyre stiffness too, these recordings cannot tell"),
    ("shaft_stiffness", [("tyre_stiffness", "")],
     "Shaft stiffness; whether tyre stiffness too, these recordings cannot tell"),
    ("vehicle_mass shaft_stiffness", [("vehicle_mass", "shaft_stiffness"), ("shaft_stiffness", "vehicle_mass")],
     "Vehicle mass with shaft stiffness, vehicle mass alone or shaft stiffness alone: these recordings cannot tell "
     "which"),
    ("vehicle_mass shaft_stiffness", [("tyre_stiffness", "shaft_stiffness"), ("mesh_loss", "vehicle_mass")],
     "Vehicle mass with shaft stiffness, vehicle mass with tyre stiffness or shaft stiffness with mesh loss: these "
     "recordings cannot tell which"),
    ("vehicle_mass shaft_stiffness", [("tyre_stiffness", "vehicle_mass shaft_stiffness")],
     "Vehicle mass with shaft stiffness or tyre stiffness: these recordings cannot tell which"),
    ("vehicle_mass road_grade mesh_loss", [("tyre_slip", "mesh_loss")],
     "Vehicle mass and road grade; beside them mesh loss or tyre slip: these recordings cannot tell which"),
    # findings that do not say what a rival stands in place of
    ("vehicle_mass", [("engine_inertia", None)], "Vehicle mass or engine inertia: these recordings cannot tell which"),
    ("vehicle_mass shaft_stiffness", [("vehicle_mass", None)],
     "Vehicle mass; whether shaft stiffness too, these recordings cannot tell"),
    ("vehicle_mass shaft_stiffness", [("tyre_stiffness", None), ("mesh_loss", None)],
     "Vehicle mass with shaft stiffness or, in place of some of that, tyre stiffness or mesh loss: these recordings "
     "cannot tell which"),
    ("vehicle_mass", [], "Vehicle mass or mesh loss: these recordings cannot tell which")])
def test_of_what_cannot_be_told_apart_what_is_there_for_sure_is_told_apart_from_the_alternatives(
        together, rivals, said):
    assert headline(open_to(together, *rivals, causes=["mesh_loss"] * (not rivals))) == said


def test_what_a_rival_stands_in_place_of_is_told_beside_it(base):
    given = diagnosis(base, "ambiguous")
    given.finding |= {key: value for key, value in open_to(
        "shaft_stiffness torque_meter_gain", ("rolling_resistance", "shaft_stiffness"),
        ("torque_meter_gain", "shaft_stiffness"), ("mesh_loss", None)).items() if key != "causes"}
    said = " ".join(words(render(given)).split())
    assert "rolling resistance in place of shaft stiffness 1.0 sigma" in said
    assert "torque meter gain alone 1.0 sigma" in said and "mesh loss 1.0 sigma" in said


@pytest.mark.parametrize(("together", "rivals", "said"), [
    ("shaft_stiffness", [("wheel_speed_delay", "shaft_stiffness")], "in the car itself or in a sensor."),
    ("road_grade torque_meter_gain", [("rolling_resistance", "road_grade"), ("coulomb_drag", "road_grade")],
     "in a sensor, and beside that in what drives the simulation or in the car itself."),
    ("shaft_stiffness", [("vehicle_mass", "shaft_stiffness")], "in the car itself."),
    ("torque_meter_gain", [("torque_meter_filter", "torque_meter_gain")],
     "in a sensor; the car itself is as its file says."),
    ("shaft_stiffness wheel_speed_delay", [("shaft_stiffness", "wheel_speed_delay")],
     "in the car itself, and perhaps in a sensor too."),
    ("shaft_stiffness wheel_speed_delay", [("mesh_loss", "wheel_speed_delay")],
     "in the car itself, and perhaps in a sensor too."),
    ("vehicle_mass wheel_speed_delay", [("road_grade", "vehicle_mass wheel_speed_delay")],
     "in the car itself and in a sensor, or in what drives the simulation."),
    ("shaft_stiffness wheel_speed_delay", [("mesh_loss", None)], "in the car itself, and perhaps in a sensor too.")])
def test_where_it_is_counts_all_that_it_could_be_as_well(base, together, rivals, said):
    """However unlikely: what is open is no less where it is."""
    given = diagnosis(base, "ambiguous")
    given.finding |= {key: value for key, value in open_to(together, *rivals).items() if key != "causes"}
    page = render(given)
    assert f"It is {said}" in " ".join(words(page).split())
    sketch = re.search(r'aria-label="where it is.*?</svg>', page, re.S).group()
    for effect in (*together.split(), *(name for effects, _ in rivals for name in effects.split())):
        known = CATALOGUE[effect]
        told = effect if known.kind == "plant" else f"{known.kind}: {known.acts_on.split()[1]}"
        assert told.replace("_", " ") in sketch


@pytest.mark.parametrize(("together", "extension", "said"), [
    ("shaft_stiffness", ["shaft_stiffness"], "extended.toml: the vehicle file with shaft stiffness in it "),
    ("road_grade mesh_loss", ["mesh_loss"],
     "extended.toml: the vehicle file with mesh loss in it; road grade is no value of a vehicle "),
    ("road_grade torque_meter_gain", [],
     "extended.toml: the vehicle file with no cause in it; road grade and torque meter gain are no values of a "),
    ("shaft_stiffness", None, "for programs Channels"),
    ("shaft_stiffness", "old", "the vehicle file with shaft stiffness in it ")])
def test_which_causes_are_in_the_extended_file_is_told(base, together, extension, said):
    given = diagnosis(base, "cause")
    old = {"vehicle": "extended.toml", "fmu": "plant_fom_extended.fmu"}
    given.finding |= {"together": together.split(), "extension": extension and old}
    if isinstance(extension, list):
        given.finding["extension"] = old | {"effects": extension}
    page = " ".join(words(render(given)).split())
    assert said in page and ("plant_fom_extended.fmu: the plant of that file" in page) is (extension is not None)
    assert ("After: the same vehicle" in page) is (extension == [])


def captions(page):
    """What stands above the pictures over time, by channel and recording."""
    listed = [" ".join(words(c).split()) for c in re.findall(r"<figcaption>(.*?)</figcaption>", page, re.S)]
    return dict(caption.partition(": ")[::2] for caption in listed if " in " in caption)


def test_a_channel_is_called_right_only_where_it_was_examined_and_nothing_is_wrong(base, pages):
    """Not beside a cause, where it may be off by what was not looked at; nor in a recording that was kept back."""
    right = "no more off than tolerance and noise explain"
    assert right in pages["none"] and not any(right in pages[verdict] for verdict in VERDICTS[:3])
    given = diagnosis(base, "cause")
    given.finding["wrong"] = []  # all samples together show it
    told = captions(render(given))
    assert len(told) == 4 and not any(told.values())
    given = diagnosis(base, "none")
    given.runs, given.reserved = [], base.runs
    assert right not in render(given)


def test_of_another_speed_the_drift_is_told_that_is_looked_for_in_one(base):
    given, run = diagnosis(base, "cause"), base.runs[0].name
    given.traces = {key: trace for key, trace in given.traces.items()
                    if key[0] == run and key[1] in ("vehicle_speed", "turbine_speed")}
    drift = {**base.wrong[0].as_json(), "signal": "vehicle_speed", "feature": "drift", "what": "drift 23 % high",
             "run": run, "runs": [run]}
    given.finding["wrong"] = [drift]
    vehicle, turbine = captions(render(given)).values()
    assert vehicle == "drift 23 % high"
    assert turbine == "goes with vehicle speed, of which it is said: drift 23 % high"
    given.finding["wrong"] = [drift | {"runs": ["another"]}]
    assert list(captions(render(given)).values()) == ["drift 23 % high", ""]


def test_units_are_printed_with_dots_and_squares_alone_and_in_sentences():
    assert [shown_unit(unit) for unit in ("N2.m2", "m/s2", "kg.m2", "N.m.s2/rad2", "1")] == [
        "N²·m²", "m/s²", "kg·m²", "N·m·s²/rad²", ""]
    assert dotted("loop area 3 N2.m2 high") == "loop area 3 N²·m² high"
    assert dotted("level off by 2 N.m.") == "level off by 2 N·m." and dotted("off by 2 m/s2") == "off by 2 m/s²"


@pytest.mark.parametrize("peak", (0, 23_456, -2, -1))
def test_a_thinned_line_keeps_its_peaks(peak):
    panel = svg.Panel((0.0, 1.0), (0.0, 1.0), 0.0, 100.0)
    x = np.linspace(0.0, 1.0, 50_000)
    y = np.zeros(x.size)
    y[peak] = 1.0
    points = re.search('points="([^"]*)"', panel.curve(x, y, "measured")).group(1).split()
    assert len(points) < 2000
    assert min(float(point.split(",")[1]) for point in points) == pytest.approx(panel.place(0.0, 1.0)[1], abs=0.1)


def labels():
    """All that may stand below a box of the driveline's sketch, by box: every effect, and what may be missing."""
    found = {place: [] for place in _PLACES}
    for effect in CATALOGUE.values():
        _, _, signal = effect.acts_on.partition(" ")
        plant = effect.kind == "plant"
        found[effect.acts_on if plant else _SENSORS[signal]].append(
            (effect.name if plant else f"{effect.kind}: {signal}").replace("_", " "))
    for place in {about.balance for about in PLACES.values()} & set(_PLACES):
        found[place].append("missing torque")
    return {place: list(dict.fromkeys(names)) for place, names in found.items()}


def sketches():
    """Sketches with every single label, every two, each box full, all full, and many at random."""
    single = [(place, name) for place, names in labels().items() for name in names]
    chosen = [*itertools.combinations(single, 1), *itertools.combinations(single, 2), single]
    chosen += [[s for s in single if s[0] in places] for places in itertools.combinations(_PLACES, 2)]
    random = np.random.default_rng(4)
    chosen += [[single[i] for i in random.permutation(len(single))[:3 + k % 9]] for k in range(200)]
    for pairs in chosen:
        marked = {}
        for place, name in pairs:
            marked.setdefault(place, []).append(name)
        yield svg.chain(_PLACES, marked, "where it is: " + ", ".join(marked))


def test_on_the_sketch_no_label_is_over_another_nor_a_line_through_one():
    count = 0
    for sketch in sketches():
        width, height = map(float, re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', sketch).groups())
        lines = {}
        for x, y, name in re.findall(r'<text x="([\d.]+)" y="([\d.]+)"[^>]*>([^<]*)', sketch):
            half = 0.5 * 6.8 * len(name)  # as wide as bold letters are on average, generously
            lines.setdefault(float(y), []).append((float(x) - half, float(x) + half, name))
        for y, spans in lines.items():
            spans = sorted(spans)
            assert spans[0][0] >= -0.1 and max(end for _, end, _ in spans) <= width + 0.1 and y < height
            assert all(begin > end for (_, end, _), (begin, _, _) in itertools.pairwise(spans)), spans
        for x, bottom in re.findall(r'<line x1="([\d.]+)" y1="38.0" x2="[\d.]+" y2="([\d.]+)"', sketch):
            assert not any(begin < float(x) < end for y, spans in lines.items() if 40.0 < y < float(bottom)
                           for begin, end, _ in spans)
        count += len(lines) > 2
    assert count > 100  # that need more than one line of labels


def in_chromium(folder, name, content, *options):
    """What a browser makes of a page, and what it complains of."""
    if CHROMIUM is None:
        pytest.skip("no Chromium here: the report was not looked at in a browser")
    (folder / name).write_text(f'<!DOCTYPE html><meta charset="utf-8"><body style="margin:0">{content}')
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr",
         f"--user-data-dir={folder / 'profile'}", *options, (folder / name).as_uri()],
        capture_output=True, text=True, timeout=240, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if ":CONSOLE" in line]


def checked(folder, frames):
    """What ``CHECK`` finds in frames, and what the browser complains of."""
    dom, said = in_chromium(folder, "check.html", f'{frames}<pre id="result"></pre><script>{CHECK}</script>',
                            "--dump-dom", "--window-size=1250,4000")
    return json.loads(html.unescape(re.search(r'<pre id="result">(.*?)</pre>', dom, re.S).group(1))), said


def test_in_a_browser_no_sketch_has_a_label_over_another(pages, tmp_path):
    style = re.search(r"<style>.*?</style>", pages["none"], re.S).group()
    cards = "".join(f'<div class="card">{sketch}</div>' for sketch in sketches())
    page = html.escape(f'<!DOCTYPE html>{style}<p id="verdict"></p>{cards}', quote=True)
    result, _ = checked(tmp_path, f'<iframe id="all" width="1200" srcdoc="{page}"></iframe>')
    assert len(result["all"]["pictures"]) > 500 and result["all"]["problems"] == []


@pytest.fixture(scope="module")
def browsed(pages, tmp_path_factory):
    """Every page at every width in one browser: what it finds, and a picture of all."""
    folder = tmp_path_factory.mktemp("browser")

    def frame(verdict, width, style):
        return (f'<iframe id="{verdict} {width}" width="{width}" style="border:0;{style}" '
                f'srcdoc="{html.escape(pages[verdict], quote=True)}"></iframe>')

    result, said = checked(folder, "".join(
        frame(verdict, width, "display:block") for verdict in VERDICTS for width in WIDTHS))
    lowest = int(max(top + high for page in result.values() for _, _, top, across, high in page["pictures"]
                     if across > 0.3 * WIDTHS[0])) + 20
    across = len(VERDICTS) * WIDTHS[0]
    frames = "".join(frame(verdict, WIDTHS[0], f"height:{lowest}px") for verdict in VERDICTS)
    in_chromium(folder, "look.html", f'<div style="display:flex;width:{across}px">{frames}</div>',
                f"--screenshot={folder / 'look.png'}", f"--window-size={across},{lowest}")
    return SimpleNamespace(result=result, said=said, image=imread(folder / "look.png"))


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("verdict", VERDICTS)
def test_in_a_browser_nothing_is_outside_its_box(browsed, verdict, width):
    seen = browsed.result[f"{verdict} {width}"]
    assert seen["problems"] == []
    assert not browsed.said
    assert len(seen["verdict"].split()) >= 8


@pytest.mark.parametrize("verdict", VERDICTS)
def test_in_a_browser_every_picture_has_ink(browsed, verdict):
    pictures = browsed.result[f"{verdict} {WIDTHS[0]}"]["pictures"]
    begin = VERDICTS.index(verdict) * WIDTHS[0]
    assert len(pictures) >= 4
    for name, left, top, across, down in pictures:
        pixels = browsed.image[round(top):round(top + down), round(begin + left):round(begin + left + across), :3]
        assert np.mean(pixels.min(axis=2) < 0.8) > 0.004, name
