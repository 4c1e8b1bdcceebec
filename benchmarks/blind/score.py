"""Findings against the truth: rates with Wilson intervals beside their targets."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.blind.figures import Row, calibration, coverage, mean, median, rate
from benchmarks.blind.reading import (
    CATALOGUED,
    INERTIAS,
    NOTHING,
    STIFFNESSES,
    Result,
    as_a_ratio,
    confidently_wrong,
    covered,
    doubt_ended,
    driven_right,
    first_or_ambiguous,
    forecasts,
    gain_share,
    in_set,
    listed,
    named,
    resolved,
    right_first,
    right_unknown,
    size_errors,
    stated,
    stiffness_for_inertia,
    told_places,
    true_effects,
    unknown_in_set,
    verdict,
    visible,
)
from cosim.diagnosis.judge.finding import in_doubt


def score(results: Sequence[Result]) -> list[Row]:
    """All rows."""
    of = {name: [r for r in results if r["category"] == name] for name in {r["category"] for r in results}}
    single, pair, weak, outside = (of.get(name, []) for name in ("single", "pair", "weak", "outside"))
    nulls = [r for name in NOTHING for r in of.get(name, [])]
    both = single + pair
    inertia = [r for r in both if true_effects(r) & INERTIAS and not true_effects(r) & STIFFNESSES]
    ambiguous = [r for r in both if verdict(r) == "ambiguous"]
    doubted = [r for r in both if r["finding"] and in_doubt(r["finding"])]
    told_alone = [r for r in results if r["category"] not in ("pair", "cocktail")]
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
        rate("single", "right first, or ambiguous with what stands first", map(first_or_ambiguous, single)),
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
        rate("single and pair, not first", "fits that begin at the truth more evident",
             (r["missed"] > 0.0 for r in both if r.get("missed") is not None)),
        rate("weak", "right cause first", map(right_first, weak)),
        rate("weak", "called none", (verdict(r) == "none" for r in weak)),
        rate("weak", "confidently wrong", map(confidently_wrong, weak)),
        *(rate(name, "false alarms", (verdict(r) != "none" for r in of.get(name, []))) for name in NOTHING),
        rate("null and strange", "false alarms", (verdict(r) != "none" for r in nulls), at_most(0.01)),
        rate("null and strange", "something not excluded",
             (in_doubt(r["finding"]) for r in nulls if r["finding"])),
        rate("null and strange, something not excluded", "ended by the proposed manoeuvre",
             (doubt_ended(r) for r in nulls if r["finding"] and in_doubt(r["finding"]))),
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
        rate("outside", "right driving variable too", (right_unknown(r) and driven_right(r) for r in outside)),
        rate("outside", "confidently wrong", map(confidently_wrong, outside), at_most(0.05)),
        rate("single and pair", "confidently wrong", map(confidently_wrong, both), at_most(0.05)),
        *(median(name, "error of parameters", (e for r in of.get(name, []) for e in size_errors(r)),
                 at_most(0.05)) for name in CATALOGUED),
        *(coverage(name, [hit for r in of.get(name, []) for hit in covered(r)]) for name in CATALOGUED),
        *calibration("all but pairs and cocktails", [forecasts([r]) for r in told_alone]),
        *calibration("pair", [forecasts([r]) for r in pair], None),
        median("single and pair", "held-out gain over the true model's",
               (g for r in both if (g := gain_share(r)) is not None), at_least(0.9), percent=False),
        rate("single and pair", "called ambiguous", (verdict(r) == "ambiguous" for r in both)),
        rate("ambiguous", "resolved by the proposed manoeuvre", map(resolved, ambiguous), at_least(0.9)),
        mean("ambiguous", "the same, as it was said to be likely",
             (proposed["chance"] for r in ambiguous
              if "chance" in (proposed := r["finding"].get("next_manoeuvre") or {}))),
        rate("single and pair, something not excluded", "resolved by the proposed manoeuvre", map(resolved, doubted)),
        *_cocktail(of.get("cocktail", [])),
        rate("all", "probabilities that sum to more than 1",
             (sum(c["probability"] for c in r["finding"]["causes"]) > 1.0 + 1e-6 for r in results if r["finding"]),
             at_most(0.0)),
        rate("all", "failed", (bool(r["error"]) for r in results)),
        median("all", "time of a diagnosis on one core [s]",
               (r["seconds"] for r in results if r["seconds"] is not None), percent=False),
    ]
    return [row for row in rows if row.n]


def _cocktail(results: Sequence[Result]) -> list[Row]:
    off = [[abs(f / r["shuffle"][2] - 1.0) for f in r["shuffle"][:2]] for r in results if r["shuffle"]]
    effects = [(set(named(r["finding"])), true_effects(r)) for r in results]
    return [
        median("cocktail", "error of the shuffle frequency before", (before for before, _ in off)),
        median("cocktail", "error of the shuffle frequency after", (after for _, after in off), ("<=", 0.01)),
        rate("cocktail", "torque meter's filter named", ("torque_meter_filter" in found for found, _ in effects),
             (">=", 1.0)),
        rate("cocktail", "inertia and stiffness told as alternatives", map(as_a_ratio, results)),
        rate("cocktail", "hidden effects that are named", (e in found for found, true in effects for e in true)),
        rate("cocktail", "named effects that are hidden", (e in true for found, true in effects for e in found)),
    ]
