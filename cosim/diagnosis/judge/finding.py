"""What a finding is made of and read by, as ``finding.json`` has it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from scipy.special import expit

from cosim.diagnosis.catalogue import bend_one_curve
from cosim.diagnosis.fit.regression import remaining

BLOCK = 0.5  # s of a recording that stand together where errors before and after are paired
# Probability that is left for what nobody thought of; and where it takes more than a pair of effects to explain what is
# measured, or two that bend one curve: they are rarer than something else that they imitate together. Of 300 findings
# in blind cases, none with three effects in it, eight took three, and in seven of these there was an effect outside the
# catalogue. Shafts that are softer and have two stages were named together twice, and were not there.
_SOMETHING_ELSE, _FOR_MANY, _PAIR = 0.03, 0.5, 2
# The nearer a missing torque comes to being one, the likelier that is: right causes mostly leave less than 10 units of
# log evidence for it, what imitates something else 10 to 500.
_AS_LIKELY, _SURER = 20.0, 4.0
_SAID = 0.1  # probability of something else from which on it is said for that
NOTHING = "nothing"  # for what a missing torque goes with
DELAY, FACTOR = "delay", "factor"  # kinds of a sensor's error, beside one that lasts
# What is no effect, and wrong in the vehicle file does what a factor of this sensor does, inversely, beside a rolling
# radius that makes up for it in the vehicle's speed.
_RATIOS = {"wheel_speed": "the ratio of the final drive"}
_ROUGHLY, _NEAR_ONE = 2, 0.1  # digits of such a factor; one more where it is nearer to 1
STILL = 1e-9  # share of a channel by which one that stands still changes at most, as it is rounded
_WHAT = {"N": "force", "N.m": "torque", "rad": "twist"}  # that is missing, by its unit


def something_else(count: int, lacking: float = 0.0, parameters: Collection[str] = ()) -> float:
    """Probability that what is explained is something that nobody thought of.

    Args:
        count: Of effects that explain it together.
        lacking: Log evidence of a torque that is missing beside them.
        parameters: Of these effects, by name.
    """
    many = _FOR_MANY if count > _PAIR or bend_one_curve(parameters) else _SOMETHING_ELSE
    return max(many, float(expit((lacking - _AS_LIKELY) / _SURER)))


def joint_probability(finding: Mapping[str, Any], effects: Collection[str]) -> float:
    """Probability of effects that explain it together: they divide it among them."""
    return sum(cause["probability"] for cause in finding["causes"] if cause["effect"] in effects)


def as_well(finding: Mapping[str, Any]) -> list[str]:
    """Effects that it could be as well, of all of ``ambiguous_with``, each once."""
    return list(dict.fromkeys(effect for entry in finding["ambiguous_with"] for effect in entry["effects"]))


def lacking(finding: Mapping[str, Any], effects: Collection[str]) -> bool:
    """Whether some effects are what is named without one of it."""
    return set(effects) < set(finding["together"])


def in_doubt(finding: Mapping[str, Any]) -> bool:
    """Whether nothing is named, but something is not excluded either: ``ambiguous_with`` says what."""
    return finding["verdict"] == "none" and bool(finding["ambiguous_with"])


def believed(finding: Mapping[str, Any]) -> bool:
    """Whether what explains it together is meant: beside something unknown it mostly only imitates that."""
    return finding["verdict"] != "unknown" or joint_probability(finding, finding["together"]) >= 0.5


def is_shown(row: Mapping[str, Any], value: float) -> bool:
    """Whether recordings would show a parameter that is as far off as this, by its row of ``would_show``."""
    limit = shown_from(row, value)
    return limit is not None and abs(value - row["nominal"]) >= abs(limit - row["nominal"])


def shown_from(row: Mapping[str, Any], value: float) -> float | None:
    """From where on recordings would show a parameter, to the side of a value; None where nothing plausible shows."""
    return row["above" if value > row["nominal"] else "below"]


def missing(unknown: Mapping[str, Any]) -> tuple[str, str]:
    """What an unknown effect is, a torque, a force or a twist, and its unit."""
    return _WHAT[unknown["unit"]], unknown["unit"]


def balances(unknown: Mapping[str, Any]) -> list[str]:
    """Where an unknown effect may be: the balance that is likeliest, and all that cannot be told from it."""
    return unknown.get("balances") or [unknown["balance"]]


def wrong_sensor(unknown: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The sensor whose error explains clearly more than any torque that is missing; None where there is none."""
    return unknown.get("sensor")


def errs(sensor: Mapping[str, Any]) -> str:
    """What is wrong with such a sensor, in words; its size is rough, as a healthy car was fitted to what it shows."""
    size = sensor["size"]
    if sensor["kind"] == DELAY:
        return f"as if it were some {1e3 * abs(size):.0f} ms {'late' if size > 0.0 else 'early'}"
    if sensor["kind"] == FACTOR:
        if size < 0.0:
            return "as if its sign were wrong"
        said = f"as if it showed some {_times(size)} times what is there"
        ratio = as_a_ratio(sensor)
        return f"{said}, or as if {ratio} were some {_times(1.0 / size)} times the vehicle file's" if ratio else said
    return f"by some {size:.2g} {sensor['unit']}"


def as_a_ratio(sensor: Mapping[str, Any]) -> str:
    """What of the vehicle file would do the same if it were wrong as what is wrong with such a sensor; or nothing."""
    return _RATIOS.get(sensor["channel"], "") if sensor["kind"] == FACTOR and sensor["size"] > 0.0 else ""


def _times(factor: float) -> str:
    return f"{factor:.{_ROUGHLY + (abs(factor - 1.0) < _NEAR_ONE)}g}"


def either(names: Sequence[str]) -> str:
    """Alternatives in words: ``a, b or c``."""
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def driven(proposed: Mapping[str, Any]) -> str:
    """The manoeuvre to drive next, in words; a bench has no gear, and nothing is driven again there."""
    gear = f" in gear {proposed['gear']}" if proposed["gear"] else ""
    times = proposed.get("times", 1)
    return proposed["kind"] + gear + f", {times} times" * (times > 1)


def goes_with_words(unknown: Mapping[str, Any]) -> str:
    """What the torque or force of an unknown effect goes with, in words."""
    variable = unknown["driving_variable"]
    return "nothing that was looked at" if variable == NOTHING else f"{variable.replace('_', ' ')}, {unknown['shape']}"


@dataclass(frozen=True)
class Gain:
    """How far one channel of a recording is from the plant before and after it was extended.

    Attributes:
        run, signal: Which.
        nrmse_before, nrmse_after, noise_floor: Root mean square error over the measured range; NaN for a channel that
            stands still, which has none.
        blocks: Logarithm of the ratio of errors after and before in every block of time, by its place in the recording.
    """

    run: str
    signal: str
    nrmse_before: float
    nrmse_after: float
    noise_floor: float
    blocks: Mapping[int, float] = field(repr=False)

    @classmethod
    def of(cls, run: str, signal: str, clock: np.ndarray, measured: np.ndarray, before: np.ndarray, after: np.ndarray,
           floor: float) -> Gain:
        """From the channel and what was simulated, alike in clock and unit; ``floor`` is its noise in that unit."""
        span, squares = float(np.ptp(measured)), [(measured - simulated) ** 2 for simulated in (before, after)]
        if span <= STILL * float(np.abs(measured).max()):
            span = float("nan")
        errors = (float(np.sqrt(np.mean(square))) / span for square in squares)
        place, blocks = np.floor(clock / BLOCK).astype(int), {}
        for k in np.unique(place):
            was, remains = (max(float(np.mean(square[place == k])), np.finfo(float).tiny) for square in squares)
            blocks[int(k)] = 0.5 * float(np.log(remains / was))
        return cls(run, signal, *errors, floor / span, blocks)

    @property
    def has_range(self) -> bool:
        """Whether there is a range that errors can be compared with."""
        return not np.isnan(self.noise_floor)


def gained(rows: Sequence[Gain]) -> dict[str, Any]:
    """The part ``gain`` of a finding.

    Args:
        rows: Of every channel of the recordings that were not used; one that stands still is left out.

    Returns:
        As the contract has it, and ``remains``: what is left of the error, mean over signals and blocks of time, with
        its 95 % interval; None for too little time. Without any channel all is empty or None.
    """
    rows = [row for row in rows if row.has_range]
    left = remaining(_changes(rows))
    return {"held_out": [{"manoeuvre": row.run, "signal": row.signal, "nrmse_before": row.nrmse_before,
                          "nrmse_after": row.nrmse_after, "noise_floor": row.noise_floor} for row in rows],
            "fraction_of_noise_floor":
                float(np.median([row.nrmse_after / row.noise_floor for row in rows])) if rows else None,
            "remains": left and asdict(left)}


def _changes(rows: Sequence[Gain]) -> np.ndarray:
    """Mean change of all signals in every block of every recording, in their order."""
    together: dict[tuple[str, int], list[float]] = {}
    for row in rows:
        for place, change in row.blocks.items():
            together.setdefault((row.run, place), []).append(change)
    return np.array([np.mean(together[key]) for key in sorted(together)])


def doubts(finding: Mapping[str, Any]) -> list[str]:
    """What speaks against the causes of a finding, in words."""
    found, together = [], finding["together"]
    if finding["verdict"] in ("cause", "ambiguous"):
        parameters = {p for cause in finding["causes"] if cause["effect"] in together for p in cause["parameters"]}
        if len(together) > _PAIR:
            found.append(f"it takes {len(together)} effects together to explain what was measured: something else, "
                         "that they imitate, is as likely")
        elif bend_one_curve(parameters):
            found.append(f"{' and '.join(name.replace('_', ' ') for name in together)} bend one curve: something else "
                         "that does, of another shape, is as likely")
    over = finding.get("left_over")
    if over and finding["verdict"] != "unknown" and something_else(1, over["log_evidence"]) > _SAID:
        what = "that the named effects imitate" if together else "too small to be sure of"
        found.append(f"a torque may be missing, {over['place']}, by {over['log_evidence']:.0f} units of log evidence: "
                     f"something unknown, {what}, is not unlikely")
    left = finding["gain"] and finding["gain"]["remains"]
    if left and left["share"] >= 1.0:
        found.append("the recording kept back does not confirm it: block by block the error there is "
                     f"{100.0 * left['share']:.0f} % of what it was")
    return found
