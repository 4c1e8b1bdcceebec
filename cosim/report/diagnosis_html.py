"""The report of a diagnosis: one self-contained page that is understood in a minute."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
from markupsafe import Markup

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.judge.finding import (
    balances,
    believed,
    either,
    goes_with_words,
    in_doubt,
    joint_probability,
    missing,
)
from cosim.diagnosis.show.features import WITH_RINGING, WITHOUT_PLACE
from cosim.measured import CANONICAL
from cosim.report import svg

if TYPE_CHECKING:
    from cosim.diagnosis.diagnose import Diagnosis

_PICTURES, _LINES = 4, 12
_LIKELY = 0.1  # causes less probable are a bar, no more
_SQUARE = re.compile(r"(?<=[ms])2\b")
_PLACES = ("engine", "converter", "transmission", "propeller shaft", "axle", "wheel", "vehicle")
_SENSORS = {"engine_speed": "engine", "turbine_speed": "transmission", "vehicle_speed": "vehicle",
            "transmission_output_speed": "propeller shaft", "propeller_shaft_torque": "propeller shaft",
            "wheel_speed": "wheel", "seat_acceleration": "vehicle", "differential_acceleration": "axle",
            "engine_torque": "engine", "road_grade": "vehicle", "brake_torque": "wheel"}
_HEADS = {"cause": "Cause found", "ambiguous": "Several causes possible", "unknown": "Unknown cause",
          "none": "Nothing wrong"}
_OVER = 4  # pictures of what is missing
_SAME, _CLOSE = 2.0, 3.0  # sigma: below, causes cannot be told apart, or hardly
# Of what a missing torque may go with.
_UNITS = {"speed": "m/s", "shaft torque": "N.m", "engine torque": "N.m", "twist": "rad", "wheel angle": "rad",
          "time": "s", "distance": "m"}


def render(diagnosis: Diagnosis) -> str:
    """The page as HTML; it needs nothing else to be shown."""
    finding = dict.fromkeys(("next_manoeuvre", "unknown", "extension", "gain")) | diagnosis.finding
    traces = diagnosis.traces
    return _PAGE.render(
        title=f"Diagnosis of {diagnosis.measurement.name}", verdict=finding["verdict"],
        head=_head(finding), headline=_headline(finding), about=_about(finding),
        vehicle=diagnosis.car.source.name, variant=diagnosis.car.source.variant,
        recordings=[run.name for run in diagnosis.runs], reserved=[run.name for run in diagnosis.reserved],
        channels=sorted({_words(name) for run in diagnosis.runs for name in run.clocks}),
        wrong=[_row(entry) for entry in finding["wrong"][:_LINES]],
        more=max(0, len(finding["wrong"]) - _LINES), story=_story(finding["wrong"]),
        pictures=_pictures(finding["wrong"], traces), shares=_shares(finding, getattr(diagnosis, "suspects", [])),
        causes=[_cause(c, finding) for c in _told(finding)], doubt=in_doubt(finding),
        place=_place(diagnosis), rivals=_rivals(finding),
        next=finding["next_manoeuvre"], unknown=_unknown(finding["unknown"]),
        disturbances=_disturbances(finding["unknown"], getattr(diagnosis, "disturbance", {}),
                                   [run.name for run in diagnosis.runs]),
        gain=_gain(finding["gain"]), extension=finding["extension"], notices=diagnosis.notices,
        seconds=diagnosis.seconds, **_detectable(finding.get("would_show", ())))


def _unknown(unknown: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """What is missing, where, and what it goes with, in words."""
    if not unknown:
        return None
    what, unit = missing(unknown)
    return {"place": unknown.get("place", unknown["balance"]), "what": what, "unit": _unit(unit),
            "others": balances(unknown)[1:], "size": unknown["size"], "goes_with": goes_with_words(unknown)}


def _words(name: str) -> str:
    return name.replace("_", " ")


def _unit(unit: str) -> str:
    """A unit as it is printed, ``N·m/rad``; nothing for plain numbers."""
    return "" if unit == "1" else _SQUARE.sub("\N{SUPERSCRIPT TWO}", unit.replace(".", "\N{MIDDLE DOT}"))


def _with_unit(value: float, unit: str) -> str:
    return f"{svg.number(value)} {_unit(unit)}".strip()


def _change(parameter: Mapping[str, Any]) -> str:
    """``8061 N·m/rad instead of 10750 (-25 %)``."""
    nominal, value, unit = parameter["nominal"], parameter["value"], parameter["unit"]
    if not nominal:
        return _with_unit(value, unit)
    per_cent = 100.0 * (value / nominal - 1.0)
    if nominal == 1.0 and unit == "1":
        return f"{per_cent:+.1f} %"
    return f"{_with_unit(value, unit)} instead of {svg.number(nominal)} ({per_cent:+.1f} %)"


def _moved(cause: Mapping[str, Any]) -> str:
    """What of a cause differs from the file; all of it where nothing does for sure."""
    parameters = cause["parameters"]
    sure = {name: p for name, p in parameters.items() if not p["low90"] <= p["nominal"] <= p["high90"]}
    return ", ".join(f"{_words(name)} {_change(p)}" for name, p in (sure or parameters).items())


def _head(finding: Mapping[str, Any]) -> str:
    if finding["verdict"] == "unknown" and _named(finding):
        return "Cause found, and something unknown"
    if in_doubt(finding):
        return "Nothing proven wrong"
    return _HEADS[finding["verdict"]]


def _headline(finding: Mapping[str, Any]) -> str:
    causes, verdict = finding["causes"], finding["verdict"]
    if verdict == "cause" and causes:
        return "; ".join(f"{_words(c['effect']).capitalize()}: {_moved(c)}" for c in _named(finding))
    if verdict == "ambiguous":
        names = list(dict.fromkeys(
            [_words(c["effect"]) for c in causes]
            + [" with ".join(map(_words, rival["effects"])) for rival in finding["ambiguous_with"]]))
        return f"{either(names).capitalize()}: these recordings cannot tell which"
    if verdict == "unknown":
        unknown = finding["unknown"]
        if not unknown:
            return "The simulation is wrong, and no known effect explains it"
        also = (f"a {missing(unknown)[0]} at the {either(balances(unknown))} is missing that no known effect explains: "
                f"it goes with {goes_with_words(unknown)}")
        named = "; ".join(f"{_words(c['effect'])}: {_moved(c)}" for c in _named(finding))
        also = f"{named}; beside that {also}" if named else also
        return also[0].upper() + also[1:]
    if in_doubt(finding):
        effects = list(dict.fromkeys(e for rival in finding["ambiguous_with"] for e in rival["effects"]))
        share = sum(cause["probability"] for cause in causes)
        return (f"Nothing is significantly wrong, but {either([_words(e) for e in effects])} is not excluded "
                f"({100.0 * share:.0f} %)")
    return "Nothing is significantly wrong: what differs, tolerance and noise explain"


def _about(finding: Mapping[str, Any]) -> list[str]:
    """What the causes named are, in the catalogue's words."""
    return [_summary(c) for c in _named(finding)]


def _told(finding: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """The causes that are shown: all that are likely, or else the first; none where all are excluded."""
    if finding["verdict"] == "none" and not in_doubt(finding):
        return []
    return _likely(finding) or finding["causes"][:1]


def _likely(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes that explain it together, however they divide their probability, and all that are likely."""
    return [c for c in finding["causes"] if c["effect"] in finding["together"] or c["probability"] >= _LIKELY]


def _named(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes a verdict speaks of: those that explain it together; where it is ambiguous, all that are likely.

    Beside something unknown only those that are confirmed, which are more likely than not.
    """
    if finding["verdict"] == "ambiguous":
        return _likely(finding)
    return [c for c in finding["causes"] if c["effect"] in finding["together"]] if believed(finding) else []


def _summary(cause: Mapping[str, Any]) -> str:
    """What an effect is; where its numbers are those of a bench, what these are."""
    effect = CATALOGUE.get(cause["effect"])
    if effect is None:
        return ""
    bench = [p.meaning for p in effect.elsewhere if p.name in cause["parameters"]]
    return "; ".join(bench).capitalize() if bench else effect.summary


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    """A line of the table of what is wrong."""
    factor, unit = (1e3, "ms") if entry["unit"] == "s" else (1.0, _unit(entry["unit"]))
    keys = {"size": 3, "low90": 3, "high90": 3, "measured": 4, "simulated": 4, "noise_floor": 2}
    numbers = {key: _number(entry.get(key), factor, digits, abs(entry["size"])) for key, digits in keys.items()}
    return {**entry, **numbers, "signal": _words(entry["signal"]), "unit": unit, "what": _dotted(entry["what"]),
            "chance": _chance(entry["p_value"])}


def _number(value: float | None, factor: float, digits: int, size: float) -> str:
    if value is None:
        return ""
    return "0" if abs(value) < 1e-3 * size else svg.number(factor * value, digits)


def _dotted(words: str) -> str:
    """Units within a sentence as they are printed."""
    return _SQUARE.sub("\N{SUPERSCRIPT TWO}", words.replace("N.m", "N\N{MIDDLE DOT}m"))


def _chance(p: float) -> str | Markup:
    """How often tolerance and noise alone would show it."""
    if p > 1e-4:
        return f"1 in {float(f'{1.0 / p:.1e}'):,.0f}"
    exponent = math.floor(-math.log10(max(p, 1e-99)))
    return Markup(f"1 in 10<sup>{exponent}</sup>") if p > 1e-99 else "never"


def _story(wrong: Sequence[Mapping[str, Any]]) -> list[str]:
    """The first of each feature, three at most."""
    seen: dict[str, str] = {}
    for entry in wrong:
        seen.setdefault(entry.get("feature", entry["what"]), f"{_words(entry['signal'])}: {_dotted(entry['what'])}")
    return list(seen.values())[:3]


def _pictures(wrong: Sequence[Mapping[str, Any]],
              traces: Mapping[tuple[str, str], Sequence[np.ndarray]]) -> list[dict[str, Any]]:
    """What is wrong first, each where it shows; beside it what is not, the worst of that first."""
    chosen: dict[tuple[str, str], dict[str, Any]] = {}
    for entry in wrong:
        key = (entry.get("run", entry["where"].partition(",")[0]), entry["signal"].partition(" over ")[0])
        if key in traces and key[1] not in {channel for _, channel in chosen}:
            chosen[key] = dict(entry)
    named = {name for entry in wrong for name in entry["signal"].split(" over ")}
    count = min(len(chosen) + len(chosen) % 2, _PICTURES) if chosen else _PICTURES
    for key in sorted(traces, key=lambda key: -_misfit(traces[key])):
        if len(chosen) < count and key[1] not in named | {channel for _, channel in chosen}:
            chosen[key] = {"what": "no more off than tolerance and noise explain"}
    found = []
    for (run, channel), entry in list(chosen.items())[:_PICTURES]:
        clock, measured, before, after = traces[(run, channel)]
        values = {"measured": measured, "before": before}
        if after is not None and not np.array_equal(before, after):
            values["after"] = after
        title = f"{_words(channel)} in {run}"
        found.append({"signal": _words(channel), "unit": _unit(CANONICAL[channel].unit), "run": run,
                      "what": _dotted(entry["what"]), "after": "after" in values,
                      "svg": Markup(svg.over_time(clock, values, _window(entry, clock, measured, before), title))})
    return found


def _misfit(trace: Sequence[np.ndarray]) -> float:
    _, measured, before, _ = trace
    return float(np.sqrt(np.mean((measured - before) ** 2)) / (np.ptp(measured) or 1.0))


def _window(entry: Mapping[str, Any], clock: np.ndarray, measured: np.ndarray, before: np.ndarray) -> svg.Window:
    """The span that shows it: where it rings, where most changes, or all of it."""
    start, stop = float(clock[0]), float(clock[-1])
    feature = entry.get("feature")
    if feature in WITHOUT_PLACE:
        return start, stop
    if feature in WITH_RINGING:
        return max(start, entry["begin"] - 0.7), min(stop, entry["end"] + 0.3)
    late = feature in ("lag", "lag behind the others")
    length = 1.6 if late or feature == "reversal dead time" else 2.6
    if stop - start <= length:
        return start, stop
    liveliness = np.abs(np.gradient(before, clock)) if late else np.abs(measured - before)
    even = np.linspace(start, stop, 400)
    smooth = np.convolve(np.interp(even, clock, liveliness), np.ones(41), "same")
    middle = float(np.clip(even[int(np.argmax(smooth))], start + 0.5 * length, stop - 0.5 * length))
    return middle - 0.5 * length, middle + 0.5 * length


def _shares(finding: Mapping[str, Any], suspects: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Probabilities of causes and of whatever else was looked at; the rest on something else."""
    if not _told(finding):
        return []
    found = {c["effect"]: float(c["probability"]) for c in finding["causes"]}
    for suspect in suspects:
        if suspect["probability"] >= 0.01:
            found.setdefault(suspect["effect"], float(suspect["probability"]))
    rest = 1.0 - sum(found.values())  # below 0: several act at once
    rows = [{"name": _words(name), "share": share, "rest": False}
            for name, share in sorted(found.items(), key=lambda item: -item[1])[:8]]
    other = "nothing, or something else" if finding["verdict"] == "none" else "something else"
    return rows if rest < 0.0 else [*rows, {"name": other, "share": rest, "rest": True}]


def _cause(cause: Mapping[str, Any], finding: Mapping[str, Any]) -> dict[str, Any]:
    effect = CATALOGUE.get(cause["effect"])
    said, together = f"{100.0 * cause['probability']:.0f} %", finding["together"]
    if len(together) > 1 and cause["effect"] in together:  # they divide their probability
        others = "other" if len(together) == 2 else "others"
        said = f"{100.0 * joint_probability(finding, together):.0f} % together with the {others}"
    return {"name": _words(cause["effect"]), "said": said, "moved": _moved(cause),
            "summary": _summary(cause),
            "parameters": [_parameter(name, p, effect) for name, p in cause["parameters"].items()]}


def _parameter(name: str, p: Mapping[str, Any], effect: Any) -> dict[str, Any]:
    declared = next((d for d in (*effect.parameters, *effect.elsewhere) if d.name == name), None) if effect else None
    low, high = declared.limits if declared else (-np.inf, np.inf)
    if declared and declared.scale == "log":
        low, high = sorted((low * p["nominal"], high * p["nominal"]))
    elif declared:
        low, high = low + p["nominal"], high + p["nominal"]
    unit = _unit(p["unit"])
    drawn = svg.interval(p["nominal"], p["value"], p["low90"], p["high90"], (low, high), unit,
                         f"{_words(name)}: file, found and 90 % interval")
    return {"name": _words(name), "meaning": declared.meaning if declared else "", "unit": unit,
            "nominal": svg.number(p["nominal"]), "value": svg.number(p["value"]),
            "low": svg.number(p["low90"]), "high": svg.number(p["high90"]),
            "plausible": bool(low <= p["value"] <= high), "limits": f"{svg.number(low, 3)} to {svg.number(high, 3)}",
            "bounded": bool(np.isfinite(low) and np.isfinite(high)), "svg": Markup(drawn)}


def _place(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Where it is: sensor, input or plant, on a sketch of the driveline."""
    finding = diagnosis.finding
    marked: dict[str, list[str]] = {}
    kinds = []
    for cause in _likely(finding) if finding["verdict"] != "none" else ():
        effect = CATALOGUE.get(cause["effect"])
        if effect is None:
            continue
        kind, _, name = effect.acts_on.partition(" ")
        if kind in ("sensor", "input"):
            marked.setdefault(_SENSORS.get(name, name), []).append(f"{kind}: {_words(name)}")
        else:
            kind = "plant"
            marked.setdefault(effect.acts_on, []).append(_words(cause["effect"]))
        kinds.append(kind)
    if finding["verdict"] == "unknown" and finding.get("unknown"):
        for balance in balances(finding["unknown"]):
            marked.setdefault(balance, []).append(f"missing {missing(finding['unknown'])[0]}")
        kinds.append("plant")
    if not kinds:
        return None
    drawn = None
    if diagnosis.car.name == "plant_fom" and set(marked) <= set(_PLACES):
        drawn = Markup(svg.chain(_PLACES, {k: ", ".join(dict.fromkeys(v)) for k, v in marked.items()},
                                 "where it is: " + ", ".join(marked)))
    what = "car" if diagnosis.car.name == "plant_fom" else "bench"
    said = {"sensor": "in a sensor", "input": "in what drives the simulation", "plant": f"in the {what} itself"}
    places = [said[kind] for kind in dict.fromkeys(kinds)]
    if len(places) == 1:
        where = places[0] + ("" if kinds[0] == "plant" else f"; the {what} itself is as its file says")
    elif finding["verdict"] == "ambiguous":
        where = either(places)
    else:
        where = ", ".join(f"partly {place}" for place in places)
    return {"where": where, "places": ", ".join(marked), "svg": drawn}


def _rivals(finding: Mapping[str, Any]) -> list[dict[str, str]]:
    rows = []
    for rival in finding["ambiguous_with"] if finding["verdict"] != "none" else ():
        sigma = rival["separation_sigma"]
        said = ("cannot be told apart" if sigma < _SAME else "hardly told apart" if sigma < _CLOSE else "told apart")
        rows.append({"names": " with ".join(map(_words, rival["effects"])), "sigma": f"{sigma:.1f}", "said": said})
    return rows


def _detectable(would_show: Sequence[Mapping[str, Any]]) -> dict[str, list]:
    """What the recordings would have shown, and what not however large it is."""
    shown, hidden = [], []
    for row in would_show:
        if row["below"] is None and row["above"] is None:
            hidden.append(_words(row["parameter"]))
            continue
        ends = {end: "" if row[end] is None else svg.number(row[end]) for end in ("below", "above")}
        shown.append({"effect": _words(row["effect"]), "parameter": _words(row["parameter"]), **ends,
                      "nominal": svg.number(row["nominal"]), "unit": _unit(row["unit"])})
    return {"shown": shown, "hidden": hidden}


def _gain(gain: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if not gain or not gain["held_out"]:
        return None
    signals: dict[str, list[Mapping[str, Any]]] = {}
    for row in gain["held_out"]:
        signals.setdefault(row["signal"], []).append(row)

    def typical(rows: Sequence[Mapping[str, Any]], key: str) -> float:
        return 100.0 * float(np.median([row.get(key) or 0.0 for row in rows]))

    rows = [(_words(name), *(typical(found, key) for key in ("nrmse_before", "nrmse_after", "noise_floor")))
            for name, found in signals.items()]
    rows.sort(key=lambda row: row[2] - row[1])
    return {"before": f"{np.median([r[1] for r in rows]):.2g}", "after": f"{np.median([r[2] for r in rows]):.2g}",
            "svg": Markup(svg.dumbbells(rows, "error before and after, signal by signal")),
            "rows": [{**row, "signal": _words(row["signal"])} for row in gain["held_out"]],
            "fraction": gain.get("fraction_of_noise_floor"), "remains": gain.get("remains"),
            "features": [{**row, "signal": _words(row["signal"]), "unit": _unit(row["unit"]),
                          **{key: svg.number(row[key]) for key in ("measured", "before", "after")}}
                         for row in gain.get("features") or []],
            "estimators": gain.get("estimators") or []}


def _disturbances(unknown: Mapping[str, Any] | None, table: Mapping[str, Any],
                  runs: Sequence[str]) -> list[dict[str, Any]]:
    """What is missing over what it could go with; the variable it does go with first, run by run if each differs."""
    if not unknown or not table:
        return []
    torque = np.asarray(table["torque"])
    own = unknown["driving_variable"]
    variables = [name for name, values in table.items()
                 if name not in ("torque", "std", "run") and np.shape(values) == torque.shape and np.ptp(values) > 0.0]
    wanted = [(name, "") for name in sorted(variables, key=lambda name: name != own)]
    if unknown.get("each_its_own"):
        wanted = [(own, run) for run in runs] + wanted[1:]
    pictures = []
    for name, run in wanted[:max(_OVER, len(runs))]:
        inside = np.asarray(table["run"]) == runs.index(run) if run else np.ones(torque.size, dtype=bool)
        values = np.asarray(table[name])[inside]
        if name.endswith("angle"):
            values = values % (2.0 * np.pi)
        below = f"{_words(name)} [{_unit(_UNITS[name])}]" if name in _UNITS else _words(name)
        pictures.append({"name": _words(name), "run": run, "first": name == own, "svg": Markup(
            svg.scatter(values, torque[inside], below, f"what is missing over {_words(name)} {run}".strip()))})
    return pictures


_PAGE = jinja2.Environment(loader=jinja2.PackageLoader("cosim.report", ""), autoescape=True, trim_blocks=True,
                           lstrip_blocks=True, undefined=jinja2.StrictUndefined).get_template("diagnosis.html.jinja")
