"""The catalogue: every effect a diagnosis can name, one file each in ``effects``."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from cosim.diagnosis import effects
from cosim.diagnosis.effect import Effect, Values
from cosim.messages import did_you_mean
from driveline.quantities import InputError


def _collected() -> dict[str, Effect]:
    found = {}
    for module in sorted(pkgutil.iter_modules(effects.__path__), key=lambda module: module.name):
        file = importlib.import_module(f"{effects.__name__}.{module.name}")
        summary, _, physics = inspect.cleandoc(file.__doc__).partition("\n")
        found[module.name] = replace(file.EFFECT, name=module.name, summary=summary.rstrip("."),
                                     physics=" ".join(physics.split()))
    return found


CATALOGUE: dict[str, Effect] = _collected()
_SAME_AS = {p.name: p.same_as for found in CATALOGUE.values() for p in found.parameters if p.same_as}


def effect(name: str) -> Effect:
    """An effect by name.

    Raises:
        InputError: There is none; the message names those that come close.
    """
    if name not in CATALOGUE:
        raise InputError(f"there is no effect '{name}'{did_you_mean(name, CATALOGUE)}; "
                         "`driveline list effects` gives all")
    return CATALOGUE[name]


def bend_one_curve(parameters: Collection[str]) -> bool:
    """Whether two of some parameters are of one thing: a shaft in two stages that is softer throughout as well."""
    return any(name in parameters and other in parameters for name, other in _SAME_AS.items())


def push_alike(one: Collection[str], other: Collection[str]) -> bool:
    """Whether some effects differ from others by one in place of another that does the same (``pushes_like``)."""
    def alike(a: str, b: str) -> bool:
        return any(x in CATALOGUE and y in CATALOGUE[x].pushes_like for x, y in ((a, b), (b, a)))

    gone, come = set(one) - set(other), set(other) - set(one)
    return bool(gone and come) and all(alike(a, b) for a in gone for b in come)


def apply(effect: Effect, sizes: Values, values: Values) -> dict[str, float]:
    """All values, with the effect in them.

    Args:
        effect: One of the catalogue.
        sizes: By parameter name; those that are missing are neutral.
        values: Plant parameters, input and sensor errors in one mapping; errors that are missing are none.
    """
    return {**values, **effect.changes(sizes, values)}


def apply_all(sizes: Mapping[str, Values], values: Values) -> dict[str, float]:
    """Several effects at once, ``{effect: {parameter: size}}``, one after the other in the order of the catalogue.

    Two of them may be of one thing: a lash elsewhere that is larger is not one that is larger and then moved.
    """
    for one in sorted(map(effect, sizes), key=[*CATALOGUE.values()].index):
        values = apply(one, sizes[one.name], values)
    return dict(values)


def shown_by(knows: Callable[[str], bool]) -> dict[str, Effect]:
    """The effects a plant can show, each with the parameters it has; see ``Effect.shown_by``."""
    found = {name: one.shown_by(knows) for name, one in CATALOGUE.items()}
    return {name: one for name, one in found.items() if one is not None}
