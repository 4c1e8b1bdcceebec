"""What is hidden in the blind cases: N of each category, the same for the same seed.

The first n cases of a category are the same whatever N is, so a run can be made longer later on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import Effect
from cosim.diagnosis.hidden import COCKTAIL, VALIDATED, VEHICLE, drawn, highest_gear
from cosim.diagnosis.hidden.outside import OUTSIDE, PREFIX
from cosim.diagnosis.hidden.recordings import asked
from cosim.messages import did_you_mean
from driveline import vehicles
from driveline.quantities import InputError

WEAKEST = 0.25  # of a weak effect, in detection limits; the strongest is one
CATEGORIES = {
    "single": "one effect of the catalogue, 1 to 5 times its detection limit",
    "weak": "the same below the limit, so that the limit itself is seen",
    "pair": "two effects of the catalogue, each 1 to 5 times its detection limit",
    "null": "nothing hidden, usual manoeuvres",
    "strange": "nothing hidden, kinds of manoeuvre never seen before",
    "outside": "an effect that the catalogue does not know",
    "cocktail": "all of thesis table 2.3 at once",
}
NEVER_SEEN = ("step", "sweep", "cruise")


@dataclass(frozen=True)
class BlindCase:
    """One hidden measurement.

    Attributes:
        name: Category and number.
        category: One of ``CATEGORIES``.
        effects: As ``hide`` takes them.
        seed: Of ``hide``.
        structure: ``same`` or ``other``, of the hidden plant.
        manoeuvres: As ``hide`` takes them; None: the usual ones.
    """

    name: str
    category: str
    effects: tuple[str, ...]
    seed: int
    structure: str
    manoeuvres: tuple[str, ...] | None = None


def wanted(entries: Sequence[str], count: int) -> dict[str, int]:
    """``NAME`` or ``NAME:N`` to the number of cases of each category; all of them for no entries.

    Raises:
        InputError: No such category, or not a number.
    """
    found = {}
    for entry in entries or CATEGORIES:
        name, _, number = entry.partition(":")
        if name not in CATEGORIES:
            raise InputError(f"there is no category '{name}'{did_you_mean(name, CATEGORIES)}")
        if number and not number.isdigit():
            raise InputError(f"category {entry}: NAME:N is needed, such as null:100")
        found[name] = int(number or count)
    return found


def cases(counts: Mapping[str, int], seed: int = 0, manoeuvres: tuple[str, ...] | None = None) -> list[BlindCase]:
    """The cases of the categories by turns, so that a run that was stopped has some of each.

    Args:
        counts: Category to number of cases, below 10000.
        seed: Another one gives other cases throughout.
        manoeuvres: In place of the usual ones, as ``hide`` takes them.

    Raises:
        InputError: There is no such manoeuvre.
    """
    asked(manoeuvres or (), highest_gear(vehicles.load(VEHICLE, VALIDATED).values))
    rows = [(number, place, name) for place, name in enumerate(CATEGORIES) for number in range(counts.get(name, 0))]
    found = [_case(name, place, number, seed) for number, place, name in sorted(rows)]
    return [replace(case, manoeuvres=case.manoeuvres or manoeuvres) for case in found]


def _case(category: str, place: int, number: int, seed: int) -> BlindCase:
    random = np.random.default_rng([seed, place, number])
    own = (seed * len(CATEGORIES) + place) * 10_000 + number
    # the number's turn in a shuffled round, so that every effect comes once before any comes twice
    rounds = np.random.default_rng([seed, place, number // len(CATALOGUE)])
    turn = list(CATALOGUE)[rounds.permutation(len(CATALOGUE))[number % len(CATALOGUE)]]
    manoeuvres = None
    if category == "single":
        effects = [turn]
    elif category == "weak":
        effects = [_weak(CATALOGUE[turn], random)]
    elif category == "pair":
        effects = [turn, str(random.choice([name for name in CATALOGUE if name != turn]))]
    elif category == "outside":
        effects = [PREFIX + list(OUTSIDE)[number % len(OUTSIDE)]]
    elif category == "cocktail":
        effects = [COCKTAIL]
    else:
        effects = []
        if category == "strange":
            kinds = [*NEVER_SEEN, str(random.choice(NEVER_SEEN))]
            manoeuvres = tuple(f"{kind}:{random.integers(4, 8)}" for kind in kinds)
    # the other structure for one in three, from the first on
    return BlindCase(f"{category}-{number:03d}", category, tuple(effects), own,
                     "other" if number % 3 == 0 else "same", manoeuvres)


def _weak(effect: Effect, random: np.random.Generator) -> str:
    """The effect in the way of ``hide``, with sizes below the detection limit."""
    nominal = vehicles.load(VEHICLE, VALIDATED).values
    share = float(np.exp(random.uniform(np.log(WEAKEST), 0.0)))
    while True:
        sizes = {}
        for name, size in drawn(effect, random).items():
            parameter = next(p for p in effect.parameters if p.name == name)
            side = math.copysign(1.0, parameter.coordinate(size))
            sizes[name] = parameter.size(side * share * parameter.detection)
        if any(value != nominal.get(name) for name, value in effect.changes(sizes, nominal).items()):
            return f"{effect.name}=" + ",".join(f"{name}:{size!r}" for name, size in sizes.items())
