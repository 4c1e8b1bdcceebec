"""Findings against the truth: rates with Wilson intervals beside their targets, failures case by case.

How a finding is read:

- *first*: the first of ``causes``; nothing is first where the verdict is ``none`` or ``unknown``, or where the
  diagnosis failed. A pair is right first if its two effects are the first two.
- *stated*: all of ``causes`` and of ``ambiguous_with``; where the verdict is ``none``, what is not excluded.
- *named*: what explains it together, as ``together`` says; the first, where a method does not say that. Such effects
  divide their probability.
- *confidently wrong*: ``cause`` as the verdict, what is named has 80 % or more together, and not all of it is there.
- *as large as the recordings show*: the hidden effect, of a pair both, is beyond what ``would_show`` of the finding
  says would have been named. Where that is not known (effects that do nothing while small) a case counts for neither.
  One outside the catalogue takes as much evidence from a healthy car as names a cause (``visibility``).
- errors of parameters are those of hidden ones whose effect is among the named: |found/true - 1| of a factor,
  |found - true|/|true| of a shift. Intervals are asked of every parameter of such an effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest, quantile_test

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import EffectParameter
from cosim.diagnosis.fit.fitting import EFFECT
from cosim.diagnosis.hidden import VEHICLE
from cosim.diagnosis.judge.finding import balances, in_doubt, joint_probability

Result = Mapping[str, Any]
SURE = 0.8
INERTIAS = {"engine_inertia", "wheel_inertia", "vehicle_mass"}
STIFFNESSES = {"shaft_stiffness", "tyre_stiffness", "two_stage_stiffness", "suspension_mode"}
CATALOGUED, NOTHING = ("single", "pair"), ("null", "strange")
BINS = 10  # of probabilities, in the reliability table
GAINED = 0.05  # share of the error that the true model must take away for its gain to be a measure


# -- reading a finding ----------------------------------------------------------------------------

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
    return set(listed(finding)) | {e for entry in finding["ambiguous_with"] for e in entry["effects"]}


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
        beyond.append(any(_beyond(row, p, size) for row, p, size in rows))
    return all(beyond) if beyond else None


def _beyond(row: Mapping[str, Any], parameter: EffectParameter, size: float) -> bool:
    value = parameter.applied(size, row["nominal"])
    return (row["below"] is not None and value <= row["below"]) or (row["above"] is not None and value >= row["above"])


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
    """Balances at which something unknown may be, the likeliest first; none unless it is called so."""
    unknown = result["finding"]["unknown"] if verdict(result) == "unknown" else None
    return balances(unknown) if unknown else []


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


# -- rows -----------------------------------------------------------------------------------------

@dataclass(frozen=True)
class Row:
    """One figure beside its target.

    Attributes:
        cases: Which cases it is taken over.
        quantity: What it is.
        target: In words; empty where there is none.
        here, low, high: Figure and its 95 % interval; None where there is nothing to take it from.
        n: Of how many.
        met: Whether the figure itself meets the target; None without one.
        shown: Whether the whole interval does, so that it is no luck of a few cases.
        percent: Whether it is a share.
    """

    cases: str
    quantity: str
    target: str
    here: float | None
    low: float | None
    high: float | None
    n: int
    met: bool | None
    shown: bool | None = None
    percent: bool = True

    def cells(self) -> list[str]:
        """The row of a table, as text."""
        def told(x: float | None) -> str:
            if x is None or not math.isfinite(x):
                return ""
            return f"{100.0 * x:.3g} %" if self.percent else f"{x:.3g}"

        interval = f"{told(self.low)} to {told(self.high)}" if told(self.low) and told(self.high) else ""
        met = {True: "yes" if self.shown else "not shown", False: "**no**", None: ""}[self.met]
        return [self.cases, self.quantity, self.target, told(self.here), interval, str(self.n), met]


HEADS = ("cases", "quantity", "target", "here", "95 % interval", "n", "met")


def rate(cases: str, quantity: str, hits: Iterable[bool], target: tuple[str, float] | None = None) -> Row:
    """A share with its Wilson interval; the target is ``(">=", 0.8)`` or ``("<=", 0.01)``."""
    hits = list(hits)
    if not hits:
        return Row(cases, quantity, _words(target), None, None, None, 0, None)
    here = sum(hits) / len(hits)
    interval = binomtest(sum(hits), len(hits)).proportion_ci(method="wilson")
    return Row(cases, quantity, _words(target), here, interval.low, interval.high, len(hits), _meets(here, target),
               _shown(interval.low, interval.high, target))


def median(cases: str, quantity: str, values: Iterable[float], target: tuple[str, float] | None = None,
           percent: bool = True) -> Row:
    """A median with the interval of its order statistics."""
    values = np.array(list(values), dtype=np.float64)
    if values.size == 0:
        return Row(cases, quantity, _words(target, percent), None, None, None, 0, None, percent=percent)
    here, interval = float(np.median(values)), quantile_test(values, p=0.5).confidence_interval()
    low, high = _number(interval.low), _number(interval.high)
    return Row(cases, quantity, _words(target, percent), here, low, high, values.size, _meets(here, target),
               _shown(low, high, target), percent)


def mean(cases: str, quantity: str, values: Iterable[float], target: tuple[str, float] | None = None) -> Row:
    """A mean with its bootstrapped interval."""
    values = np.array(list(values), dtype=np.float64)
    if values.size == 0:
        return Row(cases, quantity, _words(target, False), None, None, None, 0, None, percent=False)
    here, low, high = _bootstrapped(values, lambda some: float(np.mean(some)))
    return Row(cases, quantity, _words(target, False), here, low, high, values.size, _meets(here, target),
               _shown(low, high, target), False)


def _bootstrapped(items: np.ndarray, figure: Callable[[np.ndarray], float]) -> tuple[float, float, float]:
    random = np.random.default_rng(0)
    drawn = [figure(items[random.integers(len(items), size=len(items))]) for _ in range(1000)]
    return figure(items), *(float(x) for x in np.quantile(drawn, [0.025, 0.975]))


def _number(x: float) -> float | None:
    return float(x) if math.isfinite(x) else None


def _words(target: tuple[str, float] | None, percent: bool = True) -> str:
    if target is None:
        return ""
    return f"{target[0]} {100.0 * target[1]:g} %" if percent else f"{target[0]} {target[1]:g}"


def _meets(here: float, target: tuple[str, float] | None) -> bool | None:
    if target is None:
        return None
    return bool(here >= target[1] if target[0] == ">=" else here <= target[1])


def _shown(low: float | None, high: float | None, target: tuple[str, float] | None) -> bool | None:
    if target is None or low is None or high is None:
        return None
    return _meets(low, target) and _meets(high, target)


# -- the whole ------------------------------------------------------------------------------------

def forecasts(results: Iterable[Result]) -> np.ndarray:
    """Probability of every listed cause, and whether it was there: rows of two, grouped by case."""
    return np.array([(c["probability"], c["effect"] in true_effects(r)) for r in results if r["finding"]
                     for c in r["finding"]["causes"]], dtype=np.float64).reshape(-1, 2)


def reliability(pairs: np.ndarray) -> list[dict[str, float]]:
    """What was said against how often it was so, by bins of probability."""
    places = np.minimum((pairs[:, 0] * BINS).astype(int), BINS - 1)
    return [{"low": i / BINS, "high": (i + 1) / BINS, "said": float(pairs[places == i, 0].mean()),
             "was": float(pairs[places == i, 1].mean()), "n": int(np.sum(places == i))}
            for i in range(BINS) if np.any(places == i)]


def calibration_error(pairs: np.ndarray) -> float:
    """Expected calibration error: mean distance of said and was, weighted by how often it was said."""
    return sum(row["n"] * abs(row["said"] - row["was"]) for row in reliability(pairs)) / max(len(pairs), 1)


def exact_calibration_errors(said: np.ndarray) -> np.ndarray:
    """Calibration errors that probabilities which are exactly right would show by chance: few cases fill no bin."""
    random = np.random.default_rng(0)
    return np.array([calibration_error(np.column_stack([said, random.random(said.size) < said]))
                     for _ in range(1000)])


def score(results: Sequence[Result]) -> list[Row]:
    """All rows."""
    of = {name: [r for r in results if r["category"] == name] for name in {r["category"] for r in results}}
    single, pair, weak, outside = (of.get(name, []) for name in ("single", "pair", "weak", "outside"))
    nulls = [r for name in NOTHING for r in of.get(name, [])]
    both = single + pair
    inertia = [r for r in both if true_effects(r) & INERTIAS and not true_effects(r) & STIFFNESSES]
    ambiguous = [r for r in both if verdict(r) == "ambiguous"]
    doubted = [r for r in both if r["finding"] and in_doubt(r["finding"])]
    at_least, at_most = (lambda x: (">=", x)), (lambda x: ("<=", x))
    rows = [
        rate("single", "right cause first", map(right_first, single), at_least(0.8)),
        rate("single, as large as the recordings show", "right cause first",
             (right_first(r) for r in single if visible(r)), at_least(0.8)),
        rate("single, as large as the recordings show", "right cause in the stated set",
             (in_set(r) for r in single if visible(r)), at_least(0.95)),
        rate("single, smaller than the recordings show", "called none",
             (verdict(r) == "none" for r in single if visible(r) is False)),
        rate("single, called none", "right cause not excluded", (in_set(r) for r in single if verdict(r) == "none")),
        rate("single", "right first, or ambiguous with what stands first", map(_first_or_ambiguous, single)),
        rate("single", "right cause in the stated set", map(in_set, single), at_least(0.95)),
        mean("single", "stated set, where there is one", (n for r in single if (n := len(stated(r["finding"])))),
             at_most(1.8)),
        rate("single, same structure", "right cause first", (right_first(r) for r in single
                                                             if r["structure"] == "same")),
        rate("single, other structure", "right cause first", (right_first(r) for r in single
                                                              if r["structure"] == "other")),
        rate("pair", "both first", map(right_first, pair), at_least(0.8)),
        rate("pair, both as large as the recordings show", "both first",
             (right_first(r) for r in pair if visible(r)), at_least(0.8)),
        rate("pair", "one of them first", (bool(set(listed(r["finding"])[:1]) & true_effects(r)) for r in pair)),
        rate("pair", "both in the stated set", map(in_set, pair), at_least(0.95)),
        mean("pair", "stated set, where there is one", (n for r in pair if (n := len(stated(r["finding"]))))),
        rate("weak", "right cause first", map(right_first, weak)),
        rate("weak", "called none", (verdict(r) == "none" for r in weak)),
        rate("weak", "confidently wrong", map(confidently_wrong, weak)),
        *(rate(name, "false alarms", (verdict(r) != "none" for r in of.get(name, []))) for name in NOTHING),
        rate("null and strange", "false alarms", (verdict(r) != "none" for r in nulls), at_most(0.01)),
        rate("null and strange", "something not excluded",
             (in_doubt(r["finding"]) for r in nulls if r["finding"])),
        rate("null and strange, something not excluded", "ended by the proposed manoeuvre",
             (_ended(r) for r in nulls if r["finding"] and in_doubt(r["finding"]))),
        rate("an inertia is wrong", "stiffness named", map(stiffness_for_inertia, inertia), at_most(0.0)),
        rate("outside", "called unknown", (verdict(r) == "unknown" for r in outside)),
        rate("outside", "called unknown, at the right balance", map(right_unknown, outside), at_least(0.8)),
        rate("outside", "called unknown, its balance among those stated", map(unknown_in_set, outside)),
        mean("outside", "balances stated, where it is called unknown",
             (n for r in outside if (n := len(told_places(r))))),
        rate("outside, as large as the recordings show", "called unknown, at the right balance",
             (right_unknown(r) for r in outside if visible(r)), at_least(0.8)),
        rate("outside, smaller than the recordings show", "called none",
             (verdict(r) == "none" for r in outside if visible(r) is False)),
        rate("outside", "right driving variable too", (right_unknown(r) and _driven_right(r) for r in outside)),
        rate("outside", "confidently wrong", map(confidently_wrong, outside), at_most(0.05)),
        rate("single and pair", "confidently wrong", map(confidently_wrong, both), at_most(0.05)),
        *(median(name, "error of parameters", (e for r in of.get(name, []) for e in size_errors(r)),
                 at_most(0.05)) for name in CATALOGUED),
        *(_coverage(name, [hit for r in of.get(name, []) for hit in covered(r)]) for name in CATALOGUED),
        *_calibration("all but pairs and cocktails", [r for r in results if r["category"] not in ("pair", "cocktail")]),
        *_calibration("pair", pair, None),
        median("single and pair", "held-out gain over the true model's",
               (g for r in both if (g := gain_share(r)) is not None), at_least(0.9), percent=False),
        rate("single and pair", "called ambiguous", (verdict(r) == "ambiguous" for r in both)),
        rate("ambiguous", "resolved by the proposed manoeuvre", map(_resolved, ambiguous), at_least(0.9)),
        mean("ambiguous", "the same, as it was said to be likely",
             (proposed["chance"] for r in ambiguous
              if "chance" in (proposed := r["finding"].get("next_manoeuvre") or {}))),
        rate("single and pair, something not excluded", "resolved by the proposed manoeuvre", map(_resolved, doubted)),
        *_cocktail(of.get("cocktail", [])),
        rate("all", "probabilities that sum to more than 1",
             (sum(c["probability"] for c in r["finding"]["causes"]) > 1.0 + 1e-6 for r in results if r["finding"]),
             at_most(0.0)),
        rate("all", "failed", (bool(r["error"]) for r in results)),
        median("all", "time of a diagnosis on one core [s]",
               (r["seconds"] for r in results if r["seconds"] is not None), percent=False),
    ]
    return [row for row in rows if row.n]


def _first_or_ambiguous(result: Result) -> bool:
    return right_first(result) or verdict(result) == "ambiguous" and in_set(result)


def _driven_right(result: Result) -> bool:
    variables = {name for about in result["truth"]["outside"].values() for name in about["driving_variables"]}
    return (result["finding"]["unknown"] or {}).get("driving_variable") in variables


def _resolved(result: Result) -> bool:
    again = result["again"]
    return bool(again and again["finding"] and again["finding"]["verdict"] == "cause"
                and right_first({**result, "finding": again["finding"]}))


def _ended(result: Result) -> bool:
    again = result["again"]
    return bool(again and again["finding"] and again["finding"]["verdict"] == "none"
                and not in_doubt(again["finding"]))


def _coverage(cases: str, hits: list[bool]) -> Row:
    row = rate(cases, "90 % intervals that hold the truth", hits)
    return Row(row.cases, row.quantity, "85 to 95 %", row.here, row.low, row.high, row.n,
               0.85 <= row.here <= 0.95 if row.n else None, row.n > 0 and bool(0.85 <= row.low and row.high <= 0.95))


def _calibration(cases: str, results: Sequence[Result], target: float | None = 0.05) -> list[Row]:
    some = [pairs for r in results if len(pairs := forecasts([r]))]
    name, aim = "expected calibration error", None if target is None else ("<=", target)
    if not some:
        return [Row(cases, name, _words(aim, False), None, None, None, 0, None, percent=False)]
    drawn = np.empty(len(some), dtype=object)
    drawn[:] = some
    here, low, high = _bootstrapped(drawn, lambda few: calibration_error(np.concatenate(list(few))))
    pairs = np.concatenate(some)
    exact = exact_calibration_errors(pairs[:, 0])
    return [Row(cases, name, _words(aim, False), here, low, high, len(pairs), _meets(here, aim),
                _shown(low, high, aim), False),
            Row(cases, "the same, if what was said were exact", "", float(np.mean(exact)),
                *(float(x) for x in np.quantile(exact, [0.025, 0.975])), len(pairs), None, percent=False)]


def _cocktail(results: Sequence[Result]) -> list[Row]:
    off = [[abs(f / r["shuffle"][2] - 1.0) for f in r["shuffle"][:2]] for r in results if r["shuffle"]]
    effects = [(set(named(r["finding"])), true_effects(r)) for r in results]
    return [
        median("cocktail", "error of the shuffle frequency before", (before for before, _ in off)),
        median("cocktail", "error of the shuffle frequency after", (after for _, after in off), ("<=", 0.01)),
        rate("cocktail", "torque meter's filter named", ("torque_meter_filter" in found for found, _ in effects),
             (">=", 1.0)),
        rate("cocktail", "inertia and stiffness told as alternatives", map(_as_a_ratio, results)),
        rate("cocktail", "hidden effects that are named", (e in found for found, true in effects for e in true)),
        rate("cocktail", "named effects that are hidden", (e in true for found, true in effects for e in found)),
    ]


def _as_a_ratio(result: Result) -> bool:
    """Whether an ambiguity of the finding is between an inertia and a stiffness."""
    if not result["finding"]:
        return False
    others = {e for entry in result["finding"]["ambiguous_with"] for e in entry["effects"]}
    causes = set(listed(result["finding"]))
    return bool(others & INERTIAS and causes & STIFFNESSES or others & STIFFNESSES and causes & INERTIAS)


# -- failures -------------------------------------------------------------------------------------

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
    if result["again"]:
        again = result["again"]
        after = again["error"] or f"{again['finding']['verdict']} {', '.join(listed(again['finding']))}"
        text += f"; with {again['manoeuvre']}: {after}"
    return f"{text} ({result['seconds']:.0f} s)"


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
