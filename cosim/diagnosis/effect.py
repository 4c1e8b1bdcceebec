"""What an effect is: physics the model may lack, with the one to three numbers that would put it in.

All numbers of a simulation stand in one flat mapping by name: the plant's parameters
(``axle_shaft.stiffness``), the errors of the inputs (``input.road_grade.offset``) and of the sensors
(``observe.wheel_speed.delay``, see ``observation``). An effect changes some of them.

A *size* says by how much. Where the vehicle file has a number that may be wrong, it is a factor on it, 1
being as the file says (``scale`` is ``log``: what is searched and has the prior is its logarithm). Where
there is nothing to multiply, it is added, in SI, 0 being as the file says (``linear``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

from driveline.quantities import InputError

Values = Mapping[str, float]
SLOPE = "input.road_grade.offset"  # of the road as it is driven out; on the way back it has the other sign


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Attributes:
        name: As a finding bears it, ``axle_shaft_stiffness``.
        targets: Names of the values it changes, all in the same way; ``[*]``: every entry of a table.
        unit: SI unit of these values.
        meaning: One line.
        scale: ``log``: the size is a factor; ``linear``: it is added.
        spread: Standard deviation of the prior, of ``coordinate``.
        limits: Smallest and largest size that is plausible; outside it is not a cause. Where the smallest is neutral,
            of a file that has none: what a file has can be taken away.
        detection: Rough smallest change of ``coordinate`` that shows in a few recordings.
        probes: Sizes from which to start a search, for effects that do nothing while they are small.
        nominal: What the vehicle file has of it, in its unit, where that is not the first target.
        possible: Smallest and largest size that a vehicle can have, where that is less than what is plausible: what is
            not there cannot be taken away. A size beyond does what that one does.
        same_as: The parameter of another effect that does the same where the others of its own are beyond what a
            recording reaches; empty for none.
    """

    name: str
    targets: tuple[str, ...]
    unit: str
    meaning: str
    scale: str
    spread: float
    limits: tuple[float, float]
    detection: float
    probes: tuple[float, ...] = ()
    nominal: Callable[[Values], float] | None = None
    possible: Callable[[Values], tuple[float, float]] | None = None
    same_as: str = ""

    @property
    def neutral(self) -> float:
        """The size that changes nothing."""
        return 1.0 if self.scale == "log" else 0.0

    @property
    def size_unit(self) -> str:
        """The unit of the size itself."""
        return "1" if self.scale == "log" else self.unit

    def coordinate(self, size: float) -> float:
        """The size as it is searched: 0 where it changes nothing."""
        return math.log(size) if self.scale == "log" else size

    def size(self, coordinate: float) -> float:
        """The other way round."""
        return math.exp(coordinate) if self.scale == "log" else coordinate

    def applied(self, size: float, value: float) -> float:
        """A value the parameter acts on, changed."""
        return value * size if self.scale == "log" else value + size

    def physical(self, size: float, values: Values) -> tuple[float, float, str]:
        """Nominal value, value and unit, as an engineer reads them; a factor where there are several."""
        if self.scale == "log" and len(self.targets) + self.targets[0].count("*") > 1:
            return 1.0, size, "1"
        nominal = self.nominal(values) if self.nominal else values.get(self.targets[0], self.neutral)
        return nominal, self.applied(size, nominal), self.unit

    def found(self, size: float, low: float, high: float, values: Values) -> dict[str, float | str]:
        """A size and the ends of its 90 % interval, as ``finding.json`` has them."""
        nominal, value, unit = self.physical(size, values)
        ends = {name: self.physical(end, values)[1] for name, end in (("low90", low), ("high90", high))}
        return {"nominal": nominal, "value": value, **ends, "unit": unit}

    @property
    def one_sided(self) -> bool:
        """Whether there may be none of it, and not less than that."""
        return self.scale == "linear" and self.limits[0] == self.neutral

    def range(self, values: Values) -> tuple[float, float]:
        """Smallest and largest size that is plausible and that a vehicle can have."""
        low, high = self.limits
        if self.one_sided:
            low -= self.physical(self.neutral, values)[0]
        return self.within(low, values), self.within(high, values)

    def within(self, size: float, values: Values) -> float:
        """The size, or the nearest that a vehicle can have."""
        low, high = self.possible(values) if self.possible else (-math.inf, math.inf)
        return max(low, min(size, high))

    def check(self, size: float, values: Values) -> None:
        """Raise InputError unless the size is plausible, and a vehicle of these values can have it."""
        low, high = self.range(values)
        if not low <= size <= high:
            what = ("a factor on what the vehicle file says" if self.scale == "log" else
                    "a pure number" if self.unit == "1" else f"in {self.unit}")
            raise InputError(f"{self.name} is {size:g}: from {low:g} to {high:g} is plausible, {what}")


def factor(name: str, *targets: str, unit: str, meaning: str, spread: float, limits: tuple[float, float],
           detection: float, probes: tuple[float, ...] = (), same_as: str = "") -> EffectParameter:
    """A number of the vehicle file that may be wrong by a factor."""
    return EffectParameter(name, targets, unit, meaning, "log", spread, limits, detection, probes, same_as=same_as)


def shift(name: str, *targets: str, unit: str, meaning: str, spread: float, limits: tuple[float, float],
          detection: float, probes: tuple[float, ...] = (),
          nominal: Callable[[Values], float] | None = None,
          possible: Callable[[Values], tuple[float, float]] | None = None) -> EffectParameter:
    """A number that adds to what the vehicle file says."""
    return EffectParameter(name, targets, unit, meaning, "linear", spread, limits, detection, probes, nominal, possible)


def no_less_than_none(name: str) -> Callable[[Values], tuple[float, float]]:
    """What is ``possible`` of a shift of what cannot be negative: at most all that there is can be taken away."""
    return partial(_down_to_none, name)


def _down_to_none(name: str, values: Values) -> tuple[float, float]:
    return 0.0 - values[name], math.inf


def scaled(parameters: tuple[EffectParameter, ...], sizes: Values, values: Values) -> dict[str, float]:
    """What changes where every parameter multiplies, or adds to, its targets."""
    changed: dict[str, float] = {}
    for parameter in parameters:
        size = sizes.get(parameter.name, parameter.neutral)
        for target in parameter.targets:
            names = [target]
            if target.endswith("[*]"):
                names = [name for name in values if name.startswith(target[:-2])]
            for name in names:
                changed[name] = parameter.applied(size, values.get(name, parameter.neutral))
    return changed


@dataclass(frozen=True)
class Effect:
    """An effect of the catalogue.

    Attributes:
        acts_on: ``sensor CHANNEL``, ``input SIGNAL``, or the torque balance it enters: ``engine``,
            ``transmission``, ``propeller shaft``, ``axle``, ``wheel`` or ``vehicle``.
        parameters: One to three.
        directly: How it is measured beside the driving, in a line: what settles it where no manoeuvre does.
        nuisances: Values that come with it but say nothing, and differ from recording to recording (the
            phase of a ripple); to be fitted beside it.
        elsewhere: The same physics where it has other numbers: on a bench, on a carriage. A plant that has their
            targets shows them; a car has none of them.
        joint: Whether its parameters mean nothing alone.
        pushes_like: Other effects that do what it does, but for what a plant of another structure may do otherwise.
        change: What the sizes make of the values, where it is more than factors and sums:
            ``(sizes with none missing, none that a vehicle cannot have, values) -> changed values``.
        name, summary, physics: From the file: its name, the first line of its docstring, the rest.
    """

    acts_on: str
    parameters: tuple[EffectParameter, ...]
    directly: str
    nuisances: tuple[str, ...] = ()
    elsewhere: tuple[EffectParameter, ...] = ()
    joint: bool = False
    pushes_like: tuple[str, ...] = ()
    change: Callable[[Values, Values], dict[str, float]] | None = None
    name: str = ""
    summary: str = ""
    physics: str = ""

    @property
    def kind(self) -> str:
        """``sensor``, ``input`` or ``plant``."""
        first = self.acts_on.split()[0]
        return first if first in ("sensor", "input") else "plant"

    @property
    def swings(self) -> dict[str, str]:
        """The parameters that are how much something swings with an angle; the values that hold their phases."""
        return dict(zip((p.name for p in self.parameters), self.nuisances))

    @property
    def channels(self) -> tuple[str, ...]:
        """The measured channels whose sensor it is; none for an effect of plant or input."""
        names = (t.split(".")[1] for p in self.parameters for t in p.targets if t.startswith("observe."))
        return tuple(dict.fromkeys(names))

    def shown_by(self, knows: Callable[[str], bool]) -> Effect | None:
        """The effect as a plant shows it: the parameters and targets it has; None where it has none of them.

        Args:
            knows: Whether a value of this name does anything there; ``[1]`` stands for a table.
        """
        shown = []
        for p in (*self.parameters, *self.elsewhere):
            targets = tuple(t for t in p.targets if knows(t.replace("[*]", "[1]")))
            if targets and (len(targets) == len(p.targets) or self.change is None):
                shown.append(replace(p, targets=targets))
        if not shown:
            return None
        change = self.change if all(p.name in {s.name for s in shown} for p in self.parameters) else None
        return replace(self, parameters=tuple(shown), elsewhere=(), change=change)

    def complete(self, sizes: Values) -> dict[str, float]:
        """The sizes, with the neutral one for every parameter not given.

        Raises:
            InputError: A size for a parameter the effect does not have.
        """
        names = [parameter.name for parameter in self.parameters]
        for name in sizes:
            if name not in names:
                raise InputError(f"{self.name} has no parameter {name}; it has {', '.join(names)}")
        return {p.name: float(sizes.get(p.name, p.neutral)) for p in self.parameters}

    def changes(self, sizes: Values, values: Values) -> dict[str, float]:
        """The values the effect changes, and what they become."""
        complete = self.complete(sizes)
        had = {p.name: p.within(complete[p.name], values) for p in self.parameters}
        if self.change is not None:
            return self.change(had, values)
        return scaled(self.parameters, had, values)
