"""Diagnosis of a bench whose motion was measured: from recordings to a finding, by its inverse dynamics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import ttest_1samp

from cosim.diagnosis.benches import plausible
from cosim.diagnosis.benches.inverse import SKEW, SLIGHT, Inverse, Supposition, Torques
from cosim.diagnosis.fit.regression import paired
from cosim.diagnosis.judge.finding import Gain, gained, something_else
from cosim.diagnosis.plants.rigid import RigidPlant
from cosim.diagnosis.plants.run import STEP, Run
from cosim.measured import CANONICAL

SIGNIFICANT = 0.01  # after correction for the number of effects
APART = 3.0  # sigma: causes that are closer cannot be told apart
LISTED = 0.02  # less probable causes are not listed
STRUCTURE = 0.2  # share of what is left that goes with one variable, from which on it is no noise
MOSTLY = 0.5  # from which share on no effect is a cause beside it
RIVALS = 4  # other explanations that are listed
FEW = 6  # stretches that are listed one by one


@dataclass
class BenchDiagnosis:
    """What was found.

    Attributes:
        finding: As the contract has it, without extension.
        values: The plant's and the sensors' with the causes in them.
        traces: ``{(run, channel): (clock, measured, before, after)}``, filtered as they were compared.
        probabilities: Of every effect that the plant can show.
        notices: What limits the diagnosis, in words.
    """

    finding: dict[str, Any]
    values: dict[str, float]
    traces: dict[tuple[str, str], tuple[np.ndarray, ...]]
    probabilities: dict[str, float]
    notices: list[str] = field(default_factory=list)


def diagnose_bench(plant: RigidPlant, runs: Sequence[Run], reserved: Sequence[Run] = (),
                   say: Callable[[str], None] = lambda text: None) -> BenchDiagnosis:
    """Diagnose a bench.

    Args:
        plant: As its vehicle file has it.
        runs: What the diagnosis may use.
        reserved: What it may not; the gain is measured on these.
        say: Told what happens.

    Raises:
        InputError: A unit or a sign is not right.
    """
    say("what the measured motion needs, and how every effect moves that")
    inverse = Inverse(plant, runs)
    plausible.check(inverse)
    listed = _wrong(inverse)
    say("comparing sets of effects")
    tried = inverse.search()
    if tried[0].effects:
        inverse.relinearise(tried[0])
        tried = inverse.search()
    best, tried = _proved(inverse, tried)
    shares = dict.fromkeys(inverse.effects, 0.0) | _shares(tried)
    rivals = _rivals(tried, best)
    close = [rival for rival in rivals if rival["separation_sigma"] < APART]
    share, unknown = _unknown(inverse)
    strange = share > STRUCTURE
    if share > MOSTLY:  # causes that leave that are what is nearest, not what is
        best, tried = inverse.supposed(()), []
        shares = dict.fromkeys(shares, 0.0)
        rivals = close = []
    verdict = (("ambiguous" if close else "cause") if best.effects else "unknown" if listed or strange else "none")
    after, skew = inverse.at(best.point, best.effects)
    finding = {
        "verdict": verdict, "wrong": listed, "causes": _causes(inverse, tried, best, shares),
        "together": [*best.effects],
        "ambiguous_with": close, "ruled_out": [r for r in rivals if r["separation_sigma"] >= APART],
        "next_manoeuvre": _next(inverse, tried, best, close[0]["effects"]) if close else None,
        "unknown": unknown if verdict == "unknown" else None, "gain": None}
    notices = [f"{c} always reads the same, which says nothing of what moves" for c in inverse.still]
    if strange:
        notices.append(f"no effect explains {100.0 * share:.0f} % of what is left at the {unknown['balance']}: it goes "
                       f"with the {unknown['driving_variable']}, {unknown['size']:.3g} from end to end")
    for c in inverse.channels:
        late = inverse.lateness(skew, c)
        if abs(late) > SKEW:
            notices.append(f"{c}: samples {1e3 * abs(late):.1f} ms {'late' if late > 0.0 else 'early'} against the "
                           "motion, which is taken for the logger's")
    traces = _traces(inverse, after, skew)
    if reserved:
        say("measuring the gain on " + ", ".join(run.name for run in reserved))
        # of other channels nothing was diagnosed
        untouched = _traces(Torques(plant, reserved, inverse.band, inverse.channels), after, skew)
        finding["gain"] = gained([Gain.of(run, channel, *courses, inverse.sigma[channel])
                                  for (run, channel), courses in untouched.items()])
        traces |= untouched
    else:
        notices.append("no recording is left over to measure the gain on")
    return BenchDiagnosis(finding, after, traces, shares, notices)


def _proved(inverse: Inverse, tried: Sequence[Supposition]) -> tuple[Supposition, list[Supposition]]:
    """The most evident set all of whose effects predict better time that was left out, and the sets still in question.

    An effect that does not is no cause in any set.
    """
    tried = list(tried)
    while tried[0].effects:
        doubts = inverse.significance(tried[0].effects)
        worst = max(doubts, key=doubts.__getitem__)
        if doubts[worst] < SIGNIFICANT:
            break
        tried = [s for s in tried if worst not in s.effects]
    return tried[0], tried


def _shares(tried: Sequence[Supposition]) -> dict[str, float]:
    """Probability of every effect: of all sets that hold it, each divided among its effects."""
    weight = np.exp(np.array([s.log_evidence for s in tried]) - tried[0].log_evidence)
    weight *= np.array([1.0 - something_else(len(s.effects)) for s in tried]) / weight.sum()
    names = {e for s in tried for e in s.effects}
    return {e: float(sum(w / len(s.effects) for s, w in zip(tried, weight) if e in s.effects)) for e in names}


def _causes(inverse: Inverse, tried: Sequence[Supposition], best: Supposition,
            shares: Mapping[str, float]) -> list[dict[str, Any]]:
    """Every effect of the best set, then less probable ones as they are in the most evident set with them."""
    found = []
    for name in sorted(shares, key=lambda e: (e not in best.effects, -shares[e])):
        if name not in best.effects and shares[name] < LISTED:
            continue
        fit = best if name in best.effects else next(s for s in tried if name in s.effects)
        parameters = {}
        for d, x, deviation in zip(inverse.directions, fit.point, inverse.deviations(fit)):
            if d.effect == name:
                ends = (d.size(x + side * 1.645 * deviation) for side in (0.0, -1.0, 1.0))
                parameters[d.name] = d.parameter.found(*ends, inverse.plant.values)
        found.append({"effect": name, "probability": shares[name], "parameters": parameters})
    return found


def _rivals(tried: Sequence[Supposition], best: Supposition) -> list[dict[str, Any]]:
    """What else might stand where one or more of the best set's effects do, closest first."""
    found: dict[tuple[str, ...], tuple[float, list[str]]] = {}
    for other in tried:
        instead = tuple(e for e in other.effects if e not in best.effects)
        replaced = [e for e in best.effects if e not in other.effects]
        if replaced and instead and np.isfinite(other.log_evidence) and not any(
                set(known) <= set(instead) for known in found):
            found[instead] = float(np.sqrt(2.0 * max(best.log_evidence - other.log_evidence, 0.0))), replaced
    return [{"effects": list(instead), "in_place_of": replaced, "separation_sigma": distance}
            for instead, (distance, replaced) in sorted(found.items(), key=lambda item: item[1][0])][:RIVALS]


def _wrong(inverse: Inverse) -> list[dict[str, Any]]:
    """What the vehicle file gets wrong of each channel: its zero, its size, its course."""
    units = {v.name: v.unit for v in (*inverse.plant.plant.inputs, *inverse.plant.plant.output_variables)}
    healthy, everything = inverse.predicted_errors(()), inverse.predicted_errors(inverse.effects)
    nominal, missing = inverse.needed(inverse.plant.values), inverse.missing_within(())
    found = []
    for c, channel in enumerate(inverse.channels):
        names = [run.name for run, error in zip(inverse.runs, missing) if channel in error]
        where = ", ".join(names) if len(names) <= FEW else f"{names[0]} to {names[-1]}, {len(names)} stretches"
        zeros, scales, scale, sigma = [], [], inverse.scale[channel], inverse.sigma[channel]
        for error, needed, blocks in zip(missing, nominal, inverse.blocks):
            if channel not in error:
                continue
            for e, n in zip(np.array_split(error[channel], len(blocks)), np.array_split(needed[channel], len(blocks))):
                zeros.append(float(np.mean(e)))
                scales.append(float(np.polyfit(n, e, 1)[0]))
        there = ~np.isnan(healthy[:, c])
        of_file, least = healthy[there, c], everything[there, c]
        zero, share = float(np.mean(zeros)), float(np.mean(scales))
        excess = float(np.sqrt(np.mean(of_file)) - np.sqrt(np.mean(least))) * sigma
        rows = (  # the last one is wrong to one side only: blocks may decide for it that a few large errors outweigh
            (zero, _mean_is_zero(zeros), units[channel], abs(zero) > SLIGHT * scale, "zero is off by {0:.3g} {1}"),
            (share, _mean_is_zero(scales), "1", abs(share) > SLIGHT,
             "reads {2:.3g} times what the measured motion needs"),
            (excess, paired(of_file, least), units[channel], excess > SLIGHT * sigma,
             "error {0:.3g} {1} larger than it would have to be"))
        for size, p, unit, shows, words in rows:
            if 3 * len(inverse.channels) * p < SIGNIFICANT and shows:
                found.append({"signal": channel, "where": where, "what": words.format(size, unit, 1.0 + size),
                              "size": size, "unit": unit, "p_value": min(1.0, 3 * len(inverse.channels) * p)})
    return sorted(found, key=lambda row: row["p_value"])


def _mean_is_zero(values: Sequence[float]) -> float:
    """p-value that blocks scatter about zero (Student's t)."""
    return float(ttest_1samp(values, 0.0).pvalue) if len(values) > 2 and np.ptp(values) > 0.0 else 1.0


def _unknown(inverse: Inverse) -> tuple[float, dict[str, Any]]:
    """What no effect explains: share of the noise that it is, and over what it shows best, and how.

    Searched in what is left when every effect may be there as it likes.
    """
    missing, found = inverse.missing_within(None), []
    for channel, node in inverse.plant.sections.items():
        if channel in inverse.channels:
            error = np.concatenate([m[channel] for m in missing if channel in m])
            for name in ("speed", "acceleration", "position", "time"):
                over = np.concatenate([inverse.thinned(getattr(motion, name))
                                       for m, motion in zip(missing, inverse.motions) if channel in m])
                share, shape, size = _shape(over, error)
                found.append((share, {"balance": node, "driving_variable": name, "shape": shape, "size": size,
                                      "unit": CANONICAL[channel].unit}))
    return max(found, key=lambda pair: pair[0])


def _shape(over: np.ndarray, error: np.ndarray, bins: int = 12) -> tuple[float, str, float]:
    """Share of the error that its mean over a variable predicts of the other half, the shape, its size."""
    edges = np.quantile(over, np.linspace(0.0, 1.0, bins + 1))
    place = np.clip(np.searchsorted(edges, over, side="right") - 1, 0, bins - 1)
    half = np.arange(over.size) * 20 // over.size % 2 == 0

    def means(chosen: np.ndarray) -> np.ndarray:
        return np.array([error[chosen & (place == b)].mean() if (chosen & (place == b)).any() else 0.0
                         for b in range(bins)])

    share = 1.0 - float(np.mean((error - means(half)[place])[~half] ** 2) / np.mean(error[~half] ** 2))
    curve = means(np.full(over.size, True))
    centres = np.array([np.median(over[place == b]) if (place == b).any() else 0.0 for b in range(bins)])
    x = centres / max(np.abs(centres).max(), 1e-300)
    shapes = {"constant": np.ones(bins), "proportional": x, "changes sign with it": np.sign(x), "even": x * x,
              "cubic": x**3}
    left = {name: float(np.sum((curve - s * (s @ curve) / (s @ s)) ** 2)) for name, s in shapes.items() if s @ s > 0.0}
    return share, min(left, key=left.__getitem__), float(np.ptp(curve) if np.ptp(curve) > 0.0 else curve[0])


def _traces(torques: Torques, values: Mapping[str, float],
            skew: Mapping[str, float]) -> dict[tuple[str, str], tuple[np.ndarray, ...]]:
    """Run and channel to clock, measured as if its samples were not late, before and after."""
    measured, before, after = torques.measured(skew), torques.needed(torques.plant.values), torques.needed(values)
    return {(run.name, c): (torques.clock(r), measured[r][c], before[r][c], after[r][c])
            for r, run in enumerate(torques.runs) for c in measured[r]}


def _next(inverse: Inverse, tried: Sequence[Supposition], best: Supposition,
          instead: Sequence[str]) -> dict[str, Any] | None:
    """What would tell the best set from the closest other: a torque not recorded yet, or another motion."""
    other = next(s for s in tried if tuple(e for e in s.effects if e not in best.effects) == tuple(instead))
    pair = [inverse.at(s.point, s.effects)[0] for s in (best, other)]
    plant, run, measured = inverse.plant, inverse.runs[0], inverse.motions[0]
    fastest = float(np.abs(measured.speed).max())
    time = measured.time - measured.time[0]
    angle = 2.0 * np.pi * (0.2 * time + 0.5 * (5.0 - 0.2) / time[-1] * time**2)
    speeds = {"bench": measured.speed, "sweep": fastest * np.sin(angle),
              "coast_down": fastest * (1.0 - 2.0 * time / time[-1])}
    found = []
    for kind, speed in speeds.items():
        motion = replace(measured, speed=speed, acceleration=np.gradient(speed, STEP))
        a, b = (plant.torques(values, run, motion, every=True) for values in pair)
        for channel in a:
            sigma = inverse.sigma.get(channel, SLIGHT * float(np.std(inverse.band.of(a[channel], STEP, inverse.trim))))
            apart = float(np.linalg.norm(inverse.band.of(a[channel] - b[channel], STEP, inverse.trim)))
            apart /= max(sigma, 1e-300)
            new = channel not in inverse.channels
            found.append({"kind": kind, "gear": 0, "separation_sigma": apart,
                          "why": (f"the two differ in {channel}" + (", which was not recorded" if new else "")
                                  + ("" if kind == "bench" else f"; {time[-1]:.0f} s up to the speed seen"))})
    chosen = max(found, key=lambda row: row["separation_sigma"])
    return chosen if chosen["separation_sigma"] > APART else None
