"""What is hidden in the blind cases: N of each category, the same for the same seed.

The first n cases of a category are the same whatever N is, so a run can be made longer later on.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.effect import Effect
from cosim.diagnosis.hidden import COCKTAIL, VEHICLE, drawn, highest_gear, usual_variant
from cosim.diagnosis.hidden.outside import OUTSIDE, PREFIX
from cosim.diagnosis.hidden.recordings import KINDS, asked
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
ANY = "any"  # in place of a vehicle, or as the only entry of manoeuvres: each case its own
CARS = (VEHICLE, "suv_6l80")
THROUGH_LASH = ("tip_in", "tip_out", "pulse_train", "step")  # kinds of which any case has one at least
LOWEST, HIGHEST = 3, 8  # gears that are drawn


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
        vehicle: As ``hide`` takes it.
    """

    name: str
    category: str
    effects: tuple[str, ...]
    seed: int
    structure: str
    manoeuvres: tuple[str, ...] | None = None
    vehicle: str = VEHICLE


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


def cases(counts: Mapping[str, int], seed: int = 0, manoeuvres: tuple[str, ...] | None = None,
          vehicle: str = VEHICLE) -> list[BlindCase]:
    """The cases of the categories by turns, so that a run that was stopped has some of each.

    Args:
        counts: Category to number of cases, below 10000.
        seed: Another one gives other cases throughout.
        manoeuvres: In place of the usual ones, as ``hide`` takes them; ``("any",)``: one to three, of kinds and in
            gears that are drawn for each case.
        vehicle: One that is shipped; ``any``: one of ``CARS``, drawn for each case. The cocktail has its own.

    Raises:
        InputError: There is no such vehicle or manoeuvre.
    """
    for name in CARS if vehicle == ANY else (vehicle,):
        asked(() if manoeuvres in (None, (ANY,)) else manoeuvres, top_gear(name))
    rows = [(number, place, name) for place, name in enumerate(CATEGORIES) for number in range(counts.get(name, 0))]
    return [_case(name, place, number, seed, manoeuvres, vehicle) for number, place, name in sorted(rows)]


def _case(category: str, place: int, number: int, seed: int, manoeuvres: tuple[str, ...] | None,
          vehicle: str) -> BlindCase:
    random = np.random.default_rng([seed, place, number])
    varied = np.random.default_rng([seed, place, number, 1])  # of its own, so that the rest stays the same
    if vehicle == ANY:
        vehicle = str(varied.choice(CARS))
    own = (seed * len(CATEGORIES) + place) * 10_000 + number
    # the number's turn in a shuffled round, so that every effect comes once before any comes twice
    rounds = np.random.default_rng([seed, place, number // len(CATALOGUE)])
    turn = list(CATALOGUE)[rounds.permutation(len(CATALOGUE))[number % len(CATALOGUE)]]
    if manoeuvres == (ANY,):
        manoeuvres = _drawn_manoeuvres(vehicle, varied)
    if category == "single":
        effects = [turn]
    elif category == "weak":
        effects = [_weak(CATALOGUE[turn], vehicle, random)]
    elif category == "pair":
        effects = [turn, str(random.choice([name for name in CATALOGUE if name != turn]))]
    elif category == "outside":
        effects = [PREFIX + list(OUTSIDE)[number % len(OUTSIDE)]]
    elif category == "cocktail":
        effects, vehicle = [COCKTAIL], VEHICLE
    else:
        effects = []
        if category == "strange":
            kinds = [*NEVER_SEEN, str(random.choice(NEVER_SEEN))]
            manoeuvres = tuple(f"{kind}:{min(random.integers(4, 8), top_gear(vehicle))}" for kind in kinds)
    # the other structure for one in three, from the first on
    return BlindCase(f"{category}-{number:03d}", category, tuple(effects), own,
                     "other" if number % 3 == 0 else "same", manoeuvres, vehicle)


@functools.cache
def _nominal(vehicle: str) -> Mapping[str, float]:
    return vehicles.load(vehicle, usual_variant(vehicle)).values


def top_gear(vehicle: str) -> int:
    """The highest gear of a vehicle, by its name."""
    return highest_gear(_nominal(vehicle))


def _drawn_manoeuvres(vehicle: str, random: np.random.Generator) -> tuple[str, ...]:
    """One to three recordings as somebody may have made them: the first goes through the lash."""
    kinds = [random.choice(THROUGH_LASH), *random.choice(KINDS, random.integers(0, 3))]
    return tuple(f"{kind}:{random.integers(LOWEST, min(HIGHEST, top_gear(vehicle)) + 1)}" for kind in kinds)


def _weak(effect: Effect, vehicle: str, random: np.random.Generator) -> str:
    """The effect in the way of ``hide``, with sizes below the detection limit."""
    nominal = _nominal(vehicle)
    share = float(np.exp(random.uniform(np.log(WEAKEST), 0.0)))
    while True:
        sizes = {}
        for name, size in drawn(effect, random).items():
            parameter = next(p for p in effect.parameters if p.name == name)
            side = math.copysign(1.0, parameter.coordinate(size))
            sizes[name] = parameter.size(side * share * parameter.detection)
        if any(value != nominal.get(name) for name, value in effect.changes(sizes, nominal).items()):
            return f"{effect.name}=" + ",".join(f"{name}:{size!r}" for name, size in sizes.items())
