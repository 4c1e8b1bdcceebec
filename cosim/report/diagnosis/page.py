"""The page: what a finding says, as its template has it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
from markupsafe import Markup

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import Effect, Values
from cosim.diagnosis.judge.finding import (
    as_a_ratio,
    balances,
    believed,
    driven,
    either,
    goes_with_words,
    in_doubt,
    is_shown,
    joint_probability,
    lacking,
    missing,
    shown_from,
    wrong_sensor,
)
from cosim.report import svg
from cosim.report.diagnosis.pictures import over_time, what_is_missing
from cosim.report.diagnosis.text import chance, dotted, rounded, shown_unit, with_unit, words
from cosim.report.diagnosis.verdict import (
    about,
    extended,
    headline,
    instead_of,
    moved,
    named_causes,
    shown_causes,
    story,
    summary,
    suppositions,
    tag,
    why,
)

if TYPE_CHECKING:
    from cosim.diagnosis.diagnose import Diagnosis

_LINES = 12  # of the table of what is wrong
_PLACES = ("engine", "converter", "transmission", "propeller shaft", "axle", "wheel", "vehicle")
_SENSORS = {"engine_speed": "engine", "turbine_speed": "transmission", "vehicle_speed": "vehicle",
            "transmission_output_speed": "propeller shaft", "propeller_shaft_torque": "propeller shaft",
            "wheel_speed": "wheel", "seat_acceleration": "vehicle", "differential_acceleration": "axle",
            "engine_torque": "engine", "road_grade": "vehicle", "brake_torque": "wheel"}
_KINDS = {"sensor": "in a sensor", "input": "in what drives the simulation"}
_SAME, _CLOSE = 2.0, 3.0  # sigma: below, causes cannot be told apart, or hardly


def render(diagnosis: Diagnosis) -> str:
    """The page as HTML; it needs nothing else to be shown."""
    finding = dict.fromkeys(("next_manoeuvre", "unknown", "extension", "gain")) | diagnosis.finding
    traces, names = diagnosis.traces, [run.name for run in diagnosis.runs]
    right = names if finding["verdict"] == "none" else []
    unknown = finding["unknown"]
    if unknown and wrong_sensor(unknown):  # then no torque is
        unknown = None
    return _PAGE.render(
        title=f"Diagnosis of {diagnosis.measurement.name}", verdict=finding["verdict"],
        head=tag(finding), headline=headline(finding), about=about(finding),
        vehicle=diagnosis.car.source.name, variant=diagnosis.car.source.variant,
        recordings=names, reserved=[run.name for run in diagnosis.reserved],
        channels=sorted({words(name) for run in diagnosis.runs for name in run.clocks}),
        wrong=[_row(entry) for entry in finding["wrong"][:_LINES]],
        more=max(0, len(finding["wrong"]) - _LINES), story=story(finding["wrong"]),
        pictures=over_time(finding["wrong"], traces, right),
        shares=_shares(finding, getattr(diagnosis, "suspects", [])),
        causes=[_cause(c, finding, diagnosis.car.values) for c in shown_causes(finding)], doubt=in_doubt(finding),
        why=why(finding), explained=believed(finding), place=_place(diagnosis), rivals=_rivals(finding),
        next=_next(finding["next_manoeuvre"]), directly=_directly(finding), unknown=_unknown(unknown),
        disturbances=what_is_missing(unknown, getattr(diagnosis, "disturbance", {}), names),
        gain=_gain(finding["gain"]), extension=finding["extension"], extended=extended(finding),
        notices=diagnosis.notices, seconds=diagnosis.seconds, **_detectable(finding.get("would_show", ())))


def _unknown(unknown: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """What is missing, where, and what it goes with, in words."""
    if not unknown:
        return None
    what, unit = missing(unknown)
    return {"place": unknown.get("place", unknown["balance"]), "what": what, "unit": shown_unit(unit),
            "others": balances(unknown)[1:], "size": unknown["size"], "goes_with": goes_with_words(unknown)}


def _next(proposed: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """What to drive next, in words."""
    if not proposed:
        return None
    return {"what": driven(proposed).replace("_", "-"), "back": proposed.get("back", False),
            "why": words(proposed["why"])}


def _directly(finding: Mapping[str, Any]) -> list[dict[str, str]]:
    """How what is open is measured beside the driving."""
    return [{"name": words(row["effect"]), "how": row["how"]} for row in finding.get("directly", ())]


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    """A line of the table of what is wrong."""
    factor, unit = (1e3, "ms") if entry["unit"] == "s" else (1.0, shown_unit(entry["unit"]))
    keys = {"size": 3, "low90": 3, "high90": 3, "measured": 4, "simulated": 4, "noise_floor": 2}
    numbers = {key: rounded(entry.get(key), factor, digits, abs(entry["size"])) for key, digits in keys.items()}
    return {**entry, **numbers, "signal": words(entry["signal"]), "unit": unit, "what": dotted(entry["what"]),
            "chance": chance(entry["p_value"])}


def _shares(finding: Mapping[str, Any], suspects: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Probabilities of causes and of whatever else was looked at; the rest on something else."""
    if not shown_causes(finding):
        return []
    found = {c["effect"]: float(c["probability"]) for c in finding["causes"]}
    for suspect in suspects:
        if suspect["probability"] >= 0.01:
            found.setdefault(suspect["effect"], float(suspect["probability"]))
    rest = 1.0 - sum(found.values())  # below 0: several act at once
    rows = [{"name": words(name), "share": share, "rest": False}
            for name, share in sorted(found.items(), key=lambda item: -item[1])[:8]]
    other = "nothing, or something else" if finding["verdict"] == "none" else "something else"
    return rows if rest < 0.0 else [*rows, {"name": other, "share": rest, "rest": True}]


def _cause(cause: Mapping[str, Any], finding: Mapping[str, Any], values: Values) -> dict[str, Any]:
    effect = CATALOGUE.get(cause["effect"])
    said, together = f"{100.0 * cause['probability']:.0f} %", finding["together"]
    if len(together) > 1 and cause["effect"] in together:  # they divide their probability
        others = "other" if len(together) == 2 else "others"
        said = f"{100.0 * joint_probability(finding, together):.0f} % together with the {others}"
    return {"name": words(cause["effect"]), "said": said, "moved": moved(cause),
            "summary": summary(cause),
            "parameters": [{**_parameter(name, p, effect, values), "too_small": _too_small(finding, cause, name)}
                           for name, p in cause["parameters"].items()]}


def _too_small(finding: Mapping[str, Any], cause: Mapping[str, Any], name: str) -> str:
    """That the recordings would show a parameter only from a larger size on than it was found, in words; or nothing."""
    value = cause["parameters"][name]["value"]
    for row in finding.get("would_show", ()):
        if (row["effect"], row["parameter"]) == (cause["effect"], name) and not is_shown(row, value):
            limit = shown_from(row, value)
            if limit is None:
                return "No plausible size of it alone would show in these recordings."
            return f"Smaller than would show in these recordings alone: from {with_unit(limit, row['unit'])} on."
    return ""


def _parameter(name: str, p: Mapping[str, Any], effect: Effect | None, values: Values) -> dict[str, Any]:
    declared = next((d for d in (*effect.parameters, *effect.elsewhere) if d.name == name), None) if effect else None
    low, high = declared.range(values) if declared else (-np.inf, np.inf)
    if declared and declared.scale == "log":
        low, high = sorted((low * p["nominal"], high * p["nominal"]))
    elif declared:
        low, high = low + p["nominal"], high + p["nominal"]
    unit = shown_unit(p["unit"])
    # A size is searched as its logarithm: one that stopped at a limit comes back beside it, by rounding.
    plausible = low <= p["value"] <= high or any(math.isclose(p["value"], limit) for limit in (low, high))
    drawn = svg.interval(p["nominal"], p["value"], p["low90"], p["high90"], (low, high), unit,
                         f"{words(name)}: file, found and 90 % interval")
    return {"name": words(name), "meaning": declared.meaning if declared else "", "unit": unit,
            "nominal": svg.number(p["nominal"]), "value": svg.number(p["value"]),
            "low": svg.number(p["low90"]), "high": svg.number(p["high90"]),
            "plausible": plausible, "limits": f"{svg.number(low, 3)} to {svg.number(high, 3)}",
            "bounded": bool(np.isfinite(low) and np.isfinite(high)), "svg": Markup(drawn)}


def _place(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Where it is: sensor, input or plant, on a sketch of the driveline."""
    finding = diagnosis.finding
    what = "car" if diagnosis.car.name == "plant_fom" else "bench"
    itself = f"in the {what} itself"
    open_to = suppositions(finding) if finding["verdict"] == "ambiguous" else None
    named = [cause["effect"] for cause in named_causes(finding)] if finding["verdict"] != "none" else []
    if open_to:
        sure, choices = open_to
        named = list(dict.fromkeys([*sure, *(effect for choice in choices for effect in choice)]))
    marked: dict[str, list[str]] = {}
    for name in named:
        if effect := CATALOGUE.get(name):
            _, _, signal = effect.acts_on.partition(" ")
            of_it = effect.kind == "plant"
            marked.setdefault(effect.acts_on if of_it else _SENSORS.get(signal, signal), []).append(
                words(name) if of_it else f"{effect.kind}: {words(signal)}")
    places = _kinds(named, itself)
    unknown = finding["verdict"] == "unknown" and finding.get("unknown")
    sensor = unknown and wrong_sensor(unknown)
    either_of: list[str] = []  # where what is unknown may be
    if sensor:
        kind = "input" if sensor["channel"] == diagnosis.car.driver else "sensor"
        marked.setdefault(_SENSORS[sensor["channel"]], []).append(f"{kind}: {words(sensor['channel'])}")
        either_of = [_KINDS[kind], itself] if as_a_ratio(sensor) else [_KINDS[kind]]
    elif unknown:
        for balance in balances(unknown):
            marked.setdefault(balance, []).append(f"missing {missing(unknown)[0]}")
        # what is missing there is the same as an error of the torque that it is driven by
        either_of = [itself, _KINDS["input"]] if _SENSORS["engine_torque"] in balances(unknown) else [itself]
    perhaps = [place for place in either_of if place not in places]
    if len(perhaps) == len(either_of) > 0:
        places, perhaps = [*places, ", or ".join(either_of)], []
    if not places:
        return None
    drawn = None
    if diagnosis.car.name == "plant_fom" and set(marked) <= set(_PLACES):
        drawn = Markup(svg.chain(_PLACES, {k: list(dict.fromkeys(v)) for k, v in marked.items()},
                                 "where it is: " + ", ".join(marked)))
    if perhaps:
        where = _open_places([places, [*places, *perhaps]])
    elif len(places) == 1:
        where = places[0] + ("" if places[0] == itself or unknown else f"; the {what} itself is as its file says")
    elif open_to:
        where = _open_places([_kinds([*sure, *choice], itself) for choice in choices])
    else:
        where = ", ".join(f"partly {place}" for place in places)
    told = ", ".join(words(sensor["channel"]) if sensor and _SENSORS[sensor["channel"]] == place else place
                     for place in marked)
    return {"where": where, "places": told, "svg": drawn}


def _kinds(effects: Iterable[str], itself: str) -> list[str]:
    """Of which kinds effects are, in words, each once."""
    said = _KINDS | {"plant": itself}
    return list(dict.fromkeys(said[CATALOGUE[effect].kind] for effect in effects if effect in CATALOGUE))


def _open_places(choices: Sequence[Sequence[str]]) -> str:
    """Where it is by all of what cannot be told apart, and where by each of it."""
    sure = [place for place in choices[0] if all(place in choice for choice in choices)]
    further = list(dict.fromkeys(tuple(place for place in choice if place not in sure) for choice in choices))
    several = any(len(places) > 1 for places in further)
    names = [" and ".join(places) for places in further if places]
    which = ", or ".join(names) if several else either(names)
    if not sure:
        return which
    known = " and ".join(sure)
    return f"{known}, and perhaps {which} too" if () in further else f"{known}, and beside that {which}"


def _rivals(finding: Mapping[str, Any]) -> list[dict[str, str]]:
    rows = []
    for rival in finding["ambiguous_with"] if finding["verdict"] != "none" else ():
        sigma = rival["separation_sigma"]
        said = ("cannot be told apart" if sigma < _SAME else "hardly told apart" if sigma < _CLOSE else "told apart")
        names, replaced = " with ".join(map(words, rival["effects"])), instead_of(finding, rival)
        if lacking(finding, rival["effects"]):
            names += " alone"
        elif replaced and len(finding["together"]) > 1:
            names += f" in place of {' and '.join(map(words, replaced))}"
        rows.append({"names": names, "sigma": f"{sigma:.1f}", "said": said})
    return rows


def _detectable(would_show: Sequence[Mapping[str, Any]]) -> dict[str, list]:
    """What the recordings would have shown, and what not however large it is."""
    shown, hidden = [], []
    for row in would_show:
        if row["below"] is None and row["above"] is None:
            hidden.append(words(row["parameter"]))
            continue
        ends = {end: "" if row[end] is None else svg.number(row[end]) for end in ("below", "above")}
        shown.append({"effect": words(row["effect"]), "parameter": words(row["parameter"]), **ends,
                      "nominal": svg.number(row["nominal"]), "unit": shown_unit(row["unit"])})
    return {"shown": shown, "hidden": hidden}


def _gain(gain: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if not gain or not gain["held_out"]:
        return None
    signals: dict[str, list[Mapping[str, Any]]] = {}
    for row in gain["held_out"]:
        signals.setdefault(row["signal"], []).append(row)

    def typical(rows: Sequence[Mapping[str, Any]], key: str) -> float:
        return 100.0 * float(np.median([row.get(key) or 0.0 for row in rows]))

    rows = [(words(name), *(typical(found, key) for key in ("nrmse_before", "nrmse_after", "noise_floor")))
            for name, found in signals.items()]
    rows.sort(key=lambda row: row[2] - row[1])
    before, after = (svg.number(float(np.median([row[place] for row in rows])), 2) for place in (1, 2))
    return {"before": before, "after": after,
            "svg": Markup(svg.dumbbells(rows, "error before and after, signal by signal")),
            "rows": [{**row, "signal": words(row["signal"])} for row in gain["held_out"]],
            "fraction": gain.get("fraction_of_noise_floor"), "remains": gain.get("remains"),
            "features": [{**row, "signal": words(row["signal"]), "unit": shown_unit(row["unit"]),
                          **{key: svg.number(row[key]) for key in ("measured", "before", "after")}}
                         for row in gain.get("features") or []],
            "estimators": [{**row, "unit": shown_unit(row["unit"])} for row in gain.get("estimators") or []]}


_TEMPLATES = jinja2.Environment(loader=jinja2.PackageLoader("cosim.report.diagnosis", ""), autoescape=True,
                                trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined)
_TEMPLATES.filters["number"] = svg.number
_PAGE = _TEMPLATES.get_template("page.html.jinja")
