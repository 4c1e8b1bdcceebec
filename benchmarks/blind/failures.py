"""What was not right, case by case."""

from __future__ import annotations

from collections.abc import Iterable

from benchmarks.blind.reading import CATALOGUED, Result, listed, right_first, true_effects, verdict
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.hidden import VEHICLE


def line(result: Result) -> str:
    """A case in a line: what was hidden, what was found."""
    if result["truth"]:
        hidden = [f"{name} ({', '.join(_strength(name, p, x) for p, x in sizes.items())})"
                  for name, sizes in result["truth"]["effects"].items()]
        hidden += [f"{name} {about['size']:.3g} {about['unit']} at {about['balance']}"
                   for name, about in result["truth"]["outside"].items()]
        if seen := result.get("visibility"):
            hidden[-1] += f" ({seen['healthy']:.0f} units of evidence, {seen['found']:.0f} beside what was found)"
    else:
        hidden = list(result["effects"])
    # once there was but one vehicle, and results did not say so
    drive = [result.get("vehicle", VEHICLE), " ".join(result["manoeuvres"] or ("usual manoeuvres",)),
             result["structure"]]
    text = (f"{result['name']} [{', '.join(drive)}, seed {result['seed']}] hidden: "
            f"{' + '.join(hidden) or 'nothing'}; {verdict(result)}")
    finding = result["finding"]
    if finding is None:
        return f"{text}: {(result['error'] or '').splitlines()[0]}"
    causes = [f"{c['effect']} {c['probability']:.2f}" for c in finding["causes"]]
    text += ": " + (", ".join(causes) or "-")
    if finding["ambiguous_with"]:
        text += "; or " + " or ".join("+".join(entry["effects"]) for entry in finding["ambiguous_with"])
    if left := finding.get("left_over"):
        text += f"; left over {left['log_evidence']:.0f} {left['place']}"
    if finding.get("unknown"):
        text += f"; {finding['unknown'].get('balance')} over {finding['unknown'].get('driving_variable')}"
    text += _unfound(result)
    if result["again"]:
        again = result["again"]
        after = again["error"] or f"{again['finding']['verdict']} {', '.join(listed(again['finding']))}"
        text += f"; with {again['manoeuvre']}: {after}{_unfound(again)}"
    return f"{text} ({result['seconds']:.0f} s)"


def _unfound(told: Result) -> str:
    """What a search missed, and of two how much shows beside the other, where that was asked."""
    text = ""
    if (more := told.get("missed")) is not None:
        text += f"; a fit that begins at the truth is {_evident(more)}"
    if (least := told.get("beside")) is not None:
        text += f"; both are {_evident(least)} than one of them alone"
    return text


def _evident(lead: float) -> str:
    """A lead in log evidence, in words."""
    return f"{abs(lead):.1f} {'more' if lead > 0.0 else 'less'} evident"


def _strength(effect: str, name: str, size: float) -> str:
    """A size, and how many detection limits that is."""
    parameter = next(p for p in CATALOGUE[effect].parameters if p.name == name)
    return f"{name} {size:.3g}, {abs(parameter.coordinate(size)) / parameter.detection:.1f} limits"


def confusions(results: Iterable[Result]) -> dict[str, int]:
    """How often what stands first is not what was hidden, by ``hidden -> found``, most frequent first."""
    counts: dict[str, int] = {}
    for r in results:
        if r["category"] in CATALOGUED and not right_first(r):
            found = "+".join(listed(r["finding"])[:len(true_effects(r))]) or verdict(r)
            key = f"{'+'.join(sorted(true_effects(r)))} -> {found}"
            counts[key] = counts.get(key, 0) + 1
    return dict(sorted(counts.items(), key=lambda item: -item[1]))
