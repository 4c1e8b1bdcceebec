"""What a finding says, in words: the verdict in a line, and the causes that it speaks of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.judge.finding import (
    as_well,
    balances,
    believed,
    either,
    errs,
    goes_with_words,
    in_doubt,
    lacking,
    missing,
    wrong_sensor,
)
from cosim.report import svg
from cosim.report.diagnosis.text import dotted, with_unit, words

_LIKELY = 0.1  # causes less probable are a bar, no more
_HEADS = {"cause": "Cause found", "ambiguous": "Several causes possible", "unknown": "Unknown cause",
          "none": "Nothing wrong"}


def tag(finding: Mapping[str, Any]) -> str:
    """The verdict in two or three words."""
    if finding["verdict"] == "unknown" and named_causes(finding):
        return "Cause found, and something unknown"
    if in_doubt(finding) or finding["verdict"] == "none" and finding.get("wrong"):
        return "Nothing proven wrong"
    return _HEADS[finding["verdict"]]


def headline(finding: Mapping[str, Any]) -> str:
    """The verdict in a sentence: causes and sizes, what cannot be told, or what is missing."""
    causes, verdict = finding["causes"], finding["verdict"]
    if verdict == "cause" and causes:
        return "; ".join(f"{words(c['effect']).capitalize()}: {moved(c)}" for c in named_causes(finding))
    if verdict == "ambiguous":
        return _which(finding)
    if verdict == "unknown":
        unknown = finding["unknown"]
        if not unknown:
            return "The simulation is wrong, and no known effect explains it"
        if sensor := wrong_sensor(unknown):
            also = (f"{words(sensor['channel'])} contradicts all else, {dotted(errs(sensor))}, and no known effect "
                    "explains that")
        else:
            also = (f"a {missing(unknown)[0]} at the {either(balances(unknown))} is missing that no known effect "
                    f"explains: it goes with {goes_with_words(unknown)}")
        named = "; ".join(f"{words(c['effect'])}: {moved(c)}" for c in named_causes(finding))
        also = f"{named}; beside that {also}" if named else also
        return also[0].upper() + also[1:]
    if in_doubt(finding):
        share = sum(cause["probability"] for cause in causes)
        return (f"Nothing is significantly wrong, but {either([words(e) for e in as_well(finding)])} is not excluded "
                f"({100.0 * share:.0f} %)")
    if finding.get("wrong"):
        return "No cause is significant, though more differs than tolerance and noise explain"
    return "Nothing is significantly wrong: what differs, tolerance and noise explain"


def _which(finding: Mapping[str, Any]) -> str:
    """What is there for sure, and what these recordings cannot tell."""
    sure, choices = suppositions(finding)
    too, known = [] in choices, " and ".join(map(words, sure)).capitalize()
    names = [" with ".join(map(words, choice)) + " alone" * (not too and any(set(choice) < set(c) for c in choices))
             for choice in choices if choice]
    if any(instead_of(finding, rival) is None for rival in finding["ambiguous_with"]):
        return (f"{names[0].capitalize()} or, in place of some of that, {either(names[1:])}: "
                "these recordings cannot tell which")
    if not known:
        return f"{either(names).capitalize()}: these recordings cannot tell which"
    if too:
        return f"{known}; whether {either(names)} too, these recordings cannot tell"
    return f"{known}; beside {'it' if len(sure) == 1 else 'them'} {either(names)}: these recordings cannot tell which"


def suppositions(finding: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """The effects that are in all that is open, and what each supposition has beside them; that of the best first.

    Where a finding does not say what a rival stands in place of, that is taken for all.
    """
    together, rivals = finding["together"], finding["ambiguous_with"]
    if not rivals:
        return [], [[cause["effect"]] for cause in likely_causes(finding)]
    gone = [together if (replaced := instead_of(finding, rival)) is None else replaced for rival in rivals]
    sure = [effect for effect in together if not any(effect in replaced for replaced in gone)]
    choices = [[effect for effect in together if effect not in sure]]
    for rival, replaced in zip(rivals, gone):
        others = [effect for effect in rival["effects"] if effect not in together]
        choices.append([effect for effect in choices[0] if effect not in replaced] + others)
    return sure, [list(choice) for choice in dict.fromkeys(map(tuple, choices))]


def instead_of(finding: Mapping[str, Any], rival: Mapping[str, Any]) -> list[str] | None:
    """What of the causes that explain it together a rival has not; None where a finding of several does not say."""
    together = finding["together"]
    if "in_place_of" in rival:
        return rival["in_place_of"]
    if lacking(finding, rival["effects"]):
        return [effect for effect in together if effect not in rival["effects"]]
    return together if len(together) == 1 else None


def extended(finding: Mapping[str, Any]) -> str:
    """What is in the extended vehicle file, and which causes are no values of a vehicle; empty where there is none."""
    extension, together = finding["extension"], finding["together"]
    if not extension:
        return ""
    inside = extension.get("effects", together)
    outside = [effect for effect in together if effect not in inside]
    said = f"the vehicle file with {' and '.join(map(words, inside)) or 'no cause'} in it"
    if not outside:
        return said
    are = "is no value" if len(outside) == 1 else "are no values"
    return f"{said}; {' and '.join(map(words, outside))} {are} of a vehicle"


def about(finding: Mapping[str, Any]) -> list[str]:
    """What the causes named are, in the catalogue's words."""
    return [summary(c) for c in named_causes(finding)]


def story(wrong: Sequence[Mapping[str, Any]]) -> list[str]:
    """The first of each feature, three at most."""
    seen: dict[str, str] = {}
    for entry in wrong:
        seen.setdefault(entry.get("feature", entry["what"]), f"{words(entry['signal'])}: {dotted(entry['what'])}")
    return list(seen.values())[:3]


def why(finding: Mapping[str, Any]) -> str:
    """What the causes that are shown are to what was measured, as a heading."""
    if in_doubt(finding):
        return "What is not excluded"
    return "Why: what explains it" if believed(finding) else "What only imitates it"


def shown_causes(finding: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """The causes that are shown: all that are likely, or else the first; none where all are excluded."""
    if finding["verdict"] == "none" and not in_doubt(finding):
        return []
    return likely_causes(finding) or finding["causes"][:1]


def likely_causes(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes that explain it together, however they divide their probability, and all that are likely."""
    return [c for c in finding["causes"] if c["effect"] in finding["together"] or c["probability"] >= _LIKELY]


def named_causes(finding: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The causes a verdict speaks of: those that explain it together; where it is ambiguous, all that are likely.

    Beside something unknown only those that are confirmed, which are more likely than not.
    """
    if finding["verdict"] == "ambiguous":
        return likely_causes(finding)
    return [c for c in finding["causes"] if c["effect"] in finding["together"]] if believed(finding) else []


def summary(cause: Mapping[str, Any]) -> str:
    """What an effect is; where its numbers are those of a bench, what these are."""
    effect = CATALOGUE.get(cause["effect"])
    if effect is None:
        return ""
    bench = [p.meaning for p in effect.elsewhere if p.name in cause["parameters"]]
    return "; ".join(bench).capitalize() if bench else effect.summary


def moved(cause: Mapping[str, Any]) -> str:
    """What of a cause differs from the file; all of it where nothing does for sure."""
    parameters = cause["parameters"]
    sure = {name: p for name, p in parameters.items() if not p["low90"] <= p["nominal"] <= p["high90"]}
    return ", ".join(f"{words(name)} {_change(p)}" for name, p in (sure or parameters).items())


def _change(parameter: Mapping[str, Any]) -> str:
    """``8061 N·m/rad instead of 10750 (-25 %)``."""
    nominal, value, unit = parameter["nominal"], parameter["value"], parameter["unit"]
    if not nominal:
        return with_unit(value, unit)
    if nominal < 0.0 or value < 0.0:  # of which a share says nothing
        return f"{with_unit(value, unit)} instead of {svg.number(nominal)}"
    per_cent = 100.0 * (value / nominal - 1.0)
    if nominal == 1.0 and unit == "1":
        return f"{per_cent:+.1f} %"
    return f"{with_unit(value, unit)} instead of {svg.number(nominal)} ({per_cent:+.1f} %)"
