"""What is said of what the search found: the verdict, its causes and their probabilities, and whether something is
missing beside them that no effect of the catalogue is."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.fit.evidence import Layout
from cosim.diagnosis.fit.fitting import Fit, Fitter
from cosim.diagnosis.fit.predict import Coordinate, Predictor, amplitude
from cosim.diagnosis.judge.finding import something_else
from cosim.diagnosis.judge.localise import disturbances
from cosim.diagnosis.judge.shafts import Bent
from cosim.diagnosis.search.detectable import would_show
from cosim.diagnosis.search.identification import APART, Identification

LIKELY = 0.05  # causes less probable are not listed
# Of all causes together, from which on a verdict of none says what is not excluded: one chance in five (a judgement).
_DOUBT = 0.2
# Of the logarithm of what is left over what should be, root mean square over the runs: more, and the catalogue does
# not explain it. A run of which something is missing weighs more than a little in each.
STRANGE = 0.08
# Nor does it where a torque is missing somewhere beside the causes, of so much log evidence (``counted``).
# Of 150 blind cases healthy cars and right causes left up to 23 of it, what imitates what is not in the catalogue
# mostly more than 30, twice 26 and 29; before shafts might be bent by more the more they carry.
MISSING = 25.0
_FEW = 2  # recordings that all count for that
# What is missing elsewhere shows at one of them.
WITNESSES = ("within the transmission", "propeller shaft", "within the axle shafts", "vehicle")
# Of a cause's probability is left where something else is there, that it may only imitate: of 32 blind cases that were
# called unknown two had what was named beside it.
_BESIDE_UNKNOWN = 0.1


def probabilities(declared: Sequence[Coordinate], found: Identification, effects: Sequence[str],
                  left: Mapping[str, Any]) -> dict[str, float]:
    """Probability that each effect is the cause: the suppositions' shares of all evidence.

    A supposition of several effects divides its share among them, so that all add up to at most 1. What is left counts
    as long as it is not called unknown: beside that other rules hold (``beside_unknown``).
    """
    shares, lacking = dict.fromkeys(effects, 0.0), 0.0 if is_strange(left) else left["log_evidence"]
    for fit, weight in zip(found.alternatives, found.shares()):
        parameters = {c.parameter.name for c in declared if c.cause in fit.causes}
        sure = 1.0 - something_else(len(fit.effects), lacking, parameters)
        for effect in fit.effects:
            shares[effect] += float(weight) * sure / len(fit.effects)
    return shares


def rivals_of(found: Identification) -> list[tuple[Fit, float]]:
    """Suppositions that the best cannot be told from, with an effect that it has not or without one that it has, and
    their distance in sigma."""
    rivals, named = [], set(found.best.effects)
    for fit in found.alternatives:
        distance, effects = found.apart(fit), set(fit.effects)
        other = effects - named and len(fit.causes) <= max(1, len(found.best.causes))
        lacking = effects and effects < named
        if other and distance < APART or lacking and distance < found.told_without(fit):
            rivals.append((fit, distance))
    return rivals


def not_excluded(rivals: Sequence[tuple[Fit, float]], shares: Mapping[str, float]) -> list[tuple[Fit, float]]:
    """Rivals of a healthy car that are likely enough to be told; none where all causes together are not."""
    if sum(shares.values()) < _DOUBT:
        return []
    return [(fit, distance) for fit, distance in rivals if all(shares[effect] > LIKELY for effect in fit.effects)]


def told_once(best: Fit, rivals: Sequence[tuple[Fit, float]]) -> list[dict[str, Any]]:
    """What the best supposition cannot be told from, as ``finding.json`` has it: the same other effects once, and of
    what lacks one of its own all that it has.

    ``in_place_of`` is all of the best that any of these suppositions has not: what of it is in none of them is in all
    that is open.
    """
    nearest: dict[tuple[str, ...], float] = {}
    gone: dict[tuple[str, ...], set[str]] = {}
    for fit, distance in rivals:
        others = tuple(sorted(set(fit.effects) - set(best.effects) or fit.effects))
        nearest[others] = min(distance, nearest.get(others, distance))
        gone.setdefault(others, set()).update(set(best.effects) - set(fit.effects))
    return [{"effects": list(others), "in_place_of": [effect for effect in best.effects if effect in gone[others]],
             "separation_sigma": distance} for others, distance in nearest.items()]


def directly(rivals: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """How the effects that are open are measured beside the driving, as ``finding.json`` has it.

    What can hardly be told by any manoeuvre, as dry drag from rolling resistance, a torque wrench tells.

    Args:
        rivals: As ``told_once`` has them; the nearest first.
    """
    effects = dict.fromkeys(effect for row in rivals for effect in (*row["in_place_of"], *row["effects"]))
    return [{"effect": effect, "how": CATALOGUE[effect].directly} for effect in effects]


def counted(evidence: float, told: Sequence[float]) -> float:
    """Log evidence of a missing torque that counts.

    Of many recordings the mean of what each says, but for the one that favours it most: in one a fit may be in a
    minimum where the lash is crossed at another moment. Of two both count: mostly the torque shows in one of them only.

    Args:
        evidence: Of all recordings together.
        told: Of each as if it were the only one.
    """
    return float(np.mean(np.sort(told)[:-1])) if len(told) > _FEW else evidence


def left_over(fitter: Fitter, found: Identification) -> dict[str, Any]:
    """What is left beside what was found, as ``finding.json`` has it."""
    excess = [np.mean(list(run.values())) for run in found.noise.excess(fitter.residuals(found.best.predicted))]
    first, *_ = disturbances(fitter.predictor, found.best, found.noise, WITNESSES, loaded=True)
    return {"excess": float(np.sqrt(np.mean(np.square(excess)))), "place": first.place,
            "log_evidence": counted(first.gain, first.alone), "recordings": first.alone.tolist()}


def beside(left: Mapping[str, Any], curve: Bent | None) -> dict[str, Any]:
    """What is left, with a curve within the axle shafts where that is more evident than any other torque."""
    if curve is None or curve.lead <= left["log_evidence"]:
        return dict(left)
    return {**left, "place": curve.disturbance.place, "log_evidence": curve.lead, "recordings": []}


def is_strange(left: Mapping[str, Any]) -> bool:
    """Whether something is there that no effect of the catalogue explains, by what is left."""
    return left["excess"] > STRANGE or left["log_evidence"] > MISSING


def finding_of(predictor: Predictor, found: Identification, left: dict[str, Any], shares: Mapping[str, float],
               confirmed: Collection[str]) -> dict[str, Any]:
    """The finding as ``finding.json`` has it, but for what is asked only once there is a verdict.

    Args:
        predictor: Of the runs.
        found: What the search ended with.
        left: What is left beside it, of ``left_over``.
        shares: ``probabilities`` of all effects.
        confirmed: Effects that stretches which were not fitted confirm.
    """
    best, rivals, causes = found.best, rivals_of(found), []
    for effect in sorted(best.effects, key=lambda e: -shares[e]):
        causes.append({"effect": effect, "probability": shares[effect],
                       "parameters": _parameters(predictor, best, effect)})
    for effect, share in sorted(shares.items(), key=lambda item: -item[1]):
        if effect not in best.effects and share > LIKELY:
            fit = next(f for f in found.alternatives if effect in f.effects)
            causes.append({"effect": effect, "probability": share,
                           "parameters": _parameters(predictor, fit, effect)})
    if is_strange(left):
        verdict = "unknown"
        beside_unknown(causes, confirmed)
    elif not best.causes:
        verdict = "none"
    else:
        verdict = "ambiguous" if rivals else "cause"
    open_to = told_once(best, {"ambiguous": rivals, "none": not_excluded(rivals, shares)}.get(verdict, []))
    return {
        "verdict": verdict, "wrong": [], "causes": causes, "together": [*best.effects],
        "ambiguous_with": open_to, "directly": directly(open_to),
        "next_manoeuvre": None, "unknown": None, "left_over": left, "extension": None, "gain": None,
        "would_show": would_show(found.detectable, predictor.coordinates, predictor.car.values)}


def beside_unknown(causes: Sequence[dict[str, Any]], confirmed: Collection[str]) -> None:
    """Lower the probabilities of causes beside which something nobody thought of is there; not of confirmed effects."""
    for cause in causes:
        if cause["effect"] not in confirmed:
            cause["probability"] *= _BESIDE_UNKNOWN


def _parameters(predictor: Predictor, fit: Fit, effect: str) -> dict[str, dict[str, Any]]:
    """The numbers of an effect as a fit has them, with 90 % intervals."""
    shared = {int(i): k for k, i in enumerate(Layout(predictor.coordinates, ()).shared)}
    deviations = np.sqrt(np.diag(fit.posterior.covariance))
    result: dict[str, dict[str, Any]] = {}
    for i, c in enumerate(predictor.coordinates):
        if c.effect != effect or c.cause not in fit.causes or c.parameter.name in result:
            continue
        p, x, deviation = c.parameter, float(fit.shared[i]), float(deviations[shared[i]])
        if c.run is not None:  # two components in every run, and noise in each
            all_of_it = [j for j in predictor.index(c.cause) if predictor.coordinates[j].parameter is p]
            spread = np.array([deviations[shared[j]] for j in all_of_it])
            x, deviation = amplitude(fit.shared[all_of_it], spread), amplitude(spread) / np.sqrt(len(all_of_it))
        low = c.low if c.run is None else 0.0  # an amplitude is never less than none
        ends = (p.size(float(np.clip(x + 1.645 * side * deviation, low, c.high))) for side in (0.0, -1.0, 1.0))
        result[p.name] = p.found(*ends, predictor.car.values)
    return result
