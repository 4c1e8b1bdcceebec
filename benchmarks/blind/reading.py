"""How a finding is read beside the truth.

- *first*: the first of ``causes``; nothing is first where the verdict is ``none`` or ``unknown``, or where the
  diagnosis failed. A pair is right first if its two effects are the first two.
- *stated*: all of ``causes`` and of ``ambiguous_with``; where the verdict is ``none``, what is not excluded.
- *named*: what explains it together, as ``together`` says; the first, where a method does not say that. Such effects
  divide their probability.
- *confidently wrong*: ``cause`` as the verdict, what is named has 80 % or more together, and not all of it is there.
- *as large as the recordings show*: the hidden effect, of a pair both, is beyond what ``would_show`` of the finding
  says would have been named. Where that is not known (effects that do nothing while small) a case counts for neither.
  Of a pair that is not first both have to show beside each other as well: more evident than one alone (``beside``).
  One outside the catalogue takes as much evidence from a healthy car as names a cause (``visibility``).
- errors of parameters are those of hidden ones whose effect is among the named: |found/true - 1| of a factor,
  |found - true|/|true| of a shift. Intervals are asked of every parameter of such an effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.fit.fitting import EFFECT
from cosim.diagnosis.judge.finding import as_well, balances, in_doubt, is_shown, joint_probability, wrong_sensor

Result = Mapping[str, Any]
SURE = 0.8
INERTIAS = {"engine_inertia", "wheel_inertia", "vehicle_mass"}
STIFFNESSES = {"shaft_stiffness", "tyre_stiffness", "two_stage_stiffness", "suspension_mode"}
CATALOGUED, NOTHING = ("single", "pair"), ("null", "strange")
GAINED = 0.05  # share of the error that the true model must take away for its gain to be a measure


def verdict(result: Result) -> str:
    """The verdict, or that there is none."""
    return result["finding"]["verdict"] if result["finding"] else "failed"


def true_effects(result: Result) -> set[str]:
    """What was hidden, of the catalogue."""
    return set(result["truth"]["effects"]) if result["truth"] else {e.partition("=")[0] for e in result["effects"]}


def listed(finding: Mapping[str, Any] | None) -> list[str]:
    """The causes in their order; none where the verdict names none."""
    if not finding or finding["verdict"] not in ("cause", "ambiguous"):
        return []
    return [cause["effect"] for cause in finding["causes"]]


def stated(finding: Mapping[str, Any] | None) -> set[str]:
    """Everything that it may be, as the finding says; beside nothing what is not excluded."""
    if not finding or finding["verdict"] == "unknown":
        return set()
    return {*listed(finding), *as_well(finding)}


def named(finding: Mapping[str, Any] | None) -> list[str]:
    """What explains it together; none where the verdict names none."""
    return finding.get("together", listed(finding)[:1]) if listed(finding) else []


def found_sizes(finding: Mapping[str, Any]) -> dict[str, tuple[dict[str, float], ...]]:
    """Sizes as the catalogue counts them, and the ends of their 90 % intervals, of every cause by its effect."""
    found = {}
    for cause in finding["causes"]:
        rows: tuple[dict[str, float], ...] = ({}, {}, {})
        for parameter in CATALOGUE[cause["effect"]].parameters:
            told = cause["parameters"].get(parameter.name)
            if told is None:
                continue
            for row, key in zip(rows, ("value", "low90", "high90")):
                row[parameter.name] = (told[key] / told["nominal"] if parameter.scale == "log"
                                       else told[key] - told["nominal"])
        found[cause["effect"]] = rows
    return found


def right_first(result: Result) -> bool:
    """Whether what was hidden stands first."""
    truth = true_effects(result)
    return bool(truth) and set(listed(result["finding"])[:len(truth)]) == truth


def in_set(result: Result) -> bool:
    """Whether what was hidden is stated."""
    truth = true_effects(result)
    return bool(truth) and truth <= stated(result["finding"])


def visible(result: Result) -> bool | None:
    """Whether all that was hidden is as large as the recordings show; None where that is not known."""
    if result["category"] == "outside":
        return (result.get("visibility") or None) and result["visibility"]["healthy"] > -EFFECT
    shown = {(row["effect"], row["parameter"]): row for row in (result["finding"] or {}).get("would_show", ())}
    sizes = result["truth"]["effects"] if result["truth"] else {}
    beyond = []
    for effect, hidden in sizes.items():
        rows = [(shown[effect, p.name], p, hidden[p.name]) for p in CATALOGUE[effect].parameters
                if p.name in hidden and (effect, p.name) in shown]
        if not rows:
            return None
        beyond.append(any(is_shown(row, p.applied(size, row["nominal"])) for row, p, size in rows))
    if (least := result.get("beside")) is not None:
        beyond.append(least > 0.0)
    return all(beyond) if beyond else None


def confidently_wrong(result: Result) -> bool:
    """Whether a cause that is none is named without a doubt."""
    if verdict(result) != "cause":
        return False
    told = set(named(result["finding"]))
    return joint_probability(result["finding"], told) >= SURE and bool(told - true_effects(result))


def stiffness_for_inertia(result: Result) -> bool:
    """Whether a stiffness is named that is none, where an inertia is not what the file says."""
    return bool(true_effects(result) & INERTIAS and STIFFNESSES & set(named(result["finding"])) - true_effects(result))


def right_unknown(result: Result) -> bool:
    """Whether an effect outside the catalogue is called unknown and placed at its balance."""
    return bool(_places(result) & set(told_places(result)[:1]))


def unknown_in_set(result: Result) -> bool:
    """Whether it is called unknown and its balance is among those where it may be."""
    return bool(_places(result) & set(told_places(result)))


def told_places(result: Result) -> list[str]:
    """Balances at which something unknown may be, the likeliest first; none unless it is called so, or it is in a
    sensor."""
    unknown = result["finding"]["unknown"] if verdict(result) == "unknown" else None
    return balances(unknown) if unknown and not wrong_sensor(unknown) else []


def _places(result: Result) -> set[str]:
    return {about["balance"] for about in result["truth"]["outside"].values()} if result["truth"] else set()


def size_errors(result: Result) -> list[float]:
    """Relative errors of the hidden parameters whose effect is named."""
    errors = []
    for effect in set(named(result["finding"])) & true_effects(result):
        found = found_sizes(result["finding"])[effect][0]
        for name, true in result["truth"]["effects"][effect].items():
            if name in found:
                errors.append(abs(found[name] - true) / abs(true))
    return errors


def covered(result: Result) -> list[bool]:
    """Whether the 90 % intervals of the parameters of true, named effects hold the truth."""
    hits = []
    for effect in set(named(result["finding"])) & true_effects(result):
        _, low, high = found_sizes(result["finding"])[effect]
        true = CATALOGUE[effect].complete(result["truth"]["effects"][effect])
        hits += [min(low[name], high[name]) <= true[name] <= max(low[name], high[name]) for name in low]
    return hits


def gain_share(result: Result) -> float | None:
    """Held-out gain over that of the true model; None where the true model gains next to nothing."""
    ideal = result["gain"]
    if not ideal:
        return None
    before, best = (sum(row[i] for row in ideal.values()) for i in (0, 1))
    if before - best < GAINED * before:
        return None
    told = (result["finding"].get("gain") or {}).get("held_out") or []
    per_signal: dict[str, list[float]] = {}
    for row in told:
        if row["signal"] in ideal:
            per_signal.setdefault(row["signal"], []).append(row["nrmse_before"] - row["nrmse_after"])
    return float(sum(np.mean(rows) for rows in per_signal.values()) / (before - best))


def first_or_ambiguous(result: Result) -> bool:
    """Whether what was hidden stands first, or the finding says that it may be that as well."""
    return right_first(result) or verdict(result) == "ambiguous" and in_set(result)


def driven_right(result: Result) -> bool:
    """Whether what is missing is said to go with a variable that it does go with."""
    variables = {name for about in result["truth"]["outside"].values() for name in about["driving_variables"]}
    return (result["finding"]["unknown"] or {}).get("driving_variable") in variables


def resolved(result: Result) -> bool:
    """Whether what was hidden stands alone once the proposed manoeuvre was driven as well."""
    again = result["again"]
    return bool(again and again["finding"] and again["finding"]["verdict"] == "cause"
                and right_first({**result, "finding": again["finding"]}))


def doubt_ended(result: Result) -> bool:
    """Whether nothing is named, and all is excluded, once the proposed manoeuvre was driven as well."""
    again = result["again"]
    return bool(again and again["finding"] and again["finding"]["verdict"] == "none"
                and not in_doubt(again["finding"]))


def as_a_ratio(result: Result) -> bool:
    """Whether an ambiguity of the finding is between an inertia and a stiffness."""
    if not result["finding"]:
        return False
    others, causes = set(as_well(result["finding"])), set(listed(result["finding"]))
    return bool(others & INERTIAS and causes & STIFFNESSES or others & STIFFNESSES and causes & INERTIAS)


def forecasts(results: Iterable[Result]) -> np.ndarray:
    """Probability of every listed cause, and whether it was there: rows of two, grouped by case."""
    return np.array([(c["probability"], c["effect"] in true_effects(r)) for r in results if r["finding"]
                     for c in r["finding"]["causes"]], dtype=np.float64).reshape(-1, 2)


def is_right(result: Result) -> bool:
    """Whether there is nothing to complain of in a case."""
    category = result["category"]
    if category in NOTHING:
        return verdict(result) == "none"
    if category == "outside":
        return right_unknown(result)
    if category == "weak":
        return not result["error"] and not confidently_wrong(result)
    if category == "cocktail":
        return bool(result["finding"]) and true_effects(result) <= set(named(result["finding"]))
    return right_first(result) and not stiffness_for_inertia(result)
