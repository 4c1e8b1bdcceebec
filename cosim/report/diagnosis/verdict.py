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
    goes_with_words,
    in_doubt,
    lacking,
    missing,
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
    if in_doubt(finding):
        return "Nothing proven wrong"
    return _HEADS[finding["verdict"]]


def headline(finding: Mapping[str, Any]) -> str:
    """The verdict in a sentence: causes and sizes, what cannot be told, or what is missing."""
    causes, verdict = finding["causes"], finding["verdict"]
    if verdict == "cause" and causes:
        return "; ".join(f"{words(c['effect']).capitalize()}: {moved(c)}" for c in named_causes(finding))
    if verdict == "ambiguous":
        together = finding["together"]
        sure = set(together).intersection(*(rival["effects"] for rival in finding["ambiguous_with"]))
        if sure and all(lacking(finding, rival["effects"]) for rival in finding["ambiguous_with"]):
            known, perhaps = ([words(e) for e in together if (e in sure) is yes] for yes in (True, False))
            return f"{' and '.join(known).capitalize()}; whether {either(perhaps)} too, these recordings cannot tell"
        names = list(dict.fromkeys(
            [words(c["effect"]) for c in causes]
            + [" with ".join(map(words, rival["effects"])) for rival in finding["ambiguous_with"]]))
        return f"{either(names).capitalize()}: these recordings cannot tell which"
    if verdict == "unknown":
        unknown = finding["unknown"]
        if not unknown:
            return "The simulation is wrong, and no known effect explains it"
        also = (f"a {missing(unknown)[0]} at the {either(balances(unknown))} is missing that no known effect explains: "
                f"it goes with {goes_with_words(unknown)}")
        named = "; ".join(f"{words(c['effect'])}: {moved(c)}" for c in named_causes(finding))
        also = f"{named}; beside that {also}" if named else also
        return also[0].upper() + also[1:]
    if in_doubt(finding):
        share = sum(cause["probability"] for cause in causes)
        return (f"Nothing is significantly wrong, but {either([words(e) for e in as_well(finding)])} is not excluded "
                f"({100.0 * share:.0f} %)")
    return "Nothing is significantly wrong: what differs, tolerance and noise explain"


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
