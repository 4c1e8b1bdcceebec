"""A stepped automatic gearbox from its planetary sets: speeds, torques and inertia in every gear.

A gearbox is a handful of shafts. Each simple planetary set ties the speeds of three of them
together (Willis), each engaged clutch makes two equal, each engaged brake stops one. What is left
must be exactly one degree of freedom; its speeds per unit input speed are the null vector of those
constraints, and the torques follow from the same matrix by virtual work.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..quantities import InputError

HOUSING = "housing"
NEUTRAL = 0


@dataclass(frozen=True)
class PlanetarySet:
    """A simple planetary set with its three members on named shafts.

    Attributes:
        sun, ring, carrier: The shaft each member belongs to.
        sun_teeth, ring_teeth: Tooth counts, both positive, the ring with more than the sun.
    """

    sun: str
    ring: str
    carrier: str
    sun_teeth: int
    ring_teeth: int

    @property
    def coefficients(self) -> tuple[tuple[str, float], ...]:
        """Shaft and factor of each term of (z_s w_s + z_r w_r) / (z_s + z_r) - w_c = 0 (Willis)."""
        total = self.sun_teeth + self.ring_teeth
        return (self.sun, self.sun_teeth / total), (self.ring, self.ring_teeth / total), (self.carrier, -1.0)


@dataclass(frozen=True)
class ShiftElement:
    """A clutch between two shafts, or a brake where ``to`` is the housing."""

    shaft: str
    to: str = HOUSING

    @property
    def coefficients(self) -> tuple[tuple[str, float], ...]:
        """Shaft and factor of each term of w_shaft - w_to = 0; the housing stands still."""
        return tuple((name, sign) for name, sign in ((self.shaft, 1.0), (self.to, -1.0)) if name != HOUSING)


@dataclass(frozen=True)
class GearTorques:
    """Torques [N.m] in one gear at steady speed without losses; positive in the input's direction.

    Attributes:
        output: Torque the load puts on the output shaft (the gearbox delivers the opposite).
        members: (sets, 3): what each set puts on the shafts of its sun, ring and carrier.
        shift_elements: Name to the torque the engaged element puts on its ``shaft``; for a brake
            that is the reaction of the housing.
    """

    output: float
    members: np.ndarray
    shift_elements: dict[str, float]


@dataclass(frozen=True)
class Gearbox:
    """Planetary sets, shift elements and the table of who is engaged in which gear.

    Attributes:
        shafts: Names of the shafts; their order is the order of every array.
        input_shaft, output_shaft: Two of them.
        sets: The planetary sets by name.
        shift_elements: The clutches and brakes by name.
        clutch_table: Gear (-1 reverse, 0 neutral, 1 ... forward) to the names of the engaged elements.
        inertias: Moment of inertia [kg.m2] of each shaft with everything fixed to it.

    Raises:
        InputError: A shaft, element or tooth count does not make sense.
    """

    shafts: tuple[str, ...]
    input_shaft: str
    output_shaft: str
    sets: Mapping[str, PlanetarySet]
    shift_elements: Mapping[str, ShiftElement]
    clutch_table: Mapping[int, tuple[str, ...]]
    inertias: tuple[float, ...]

    def __post_init__(self) -> None:
        known = set(self.shafts)
        for name, planetary in self.sets.items():
            if not 0 < planetary.sun_teeth < planetary.ring_teeth:
                raise InputError(
                    f"planetary set {name} has {planetary.sun_teeth:g} sun and {planetary.ring_teeth:g} ring "
                    "teeth: a simple set needs a positive sun and a larger ring")
        users = {"the input": {self.input_shaft}, "the output": {self.output_shaft}}
        users |= {f"planetary set {n}": {s.sun, s.ring, s.carrier} for n, s in self.sets.items()}
        users |= {f"shift element {n}": {e.shaft, e.to} - {HOUSING} for n, e in self.shift_elements.items()}
        for user, needed in users.items():
            if unknown := sorted(needed - known):
                raise InputError(f"{user} names the shaft {unknown[0]!r}; there are {', '.join(self.shafts)}")
        for gear, engaged in self.clutch_table.items():
            if unknown := sorted(set(engaged) - set(self.shift_elements)):
                raise InputError(f"gear {gear} engages {unknown[0]!r}; the shift elements are "
                                 f"{', '.join(self.shift_elements)}")
        if len(self.inertias) != len(self.shafts) or not all(0 <= j < np.inf for j in self.inertias):
            raise InputError(f"{len(self.shafts)} shafts need as many inertias, none negative; "
                             f"given are {tuple(self.inertias)}")

    @cached_property
    def _index(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.shafts)}

    def _engaged(self, gear: int) -> tuple[str, ...]:
        if gear not in self.clutch_table:
            gears = ", ".join(str(g) for g in sorted(self.clutch_table))
            raise InputError(f"gear {gear} is not in the clutch table; it has {gears}")
        return tuple(self.clutch_table[gear])

    def _constraints(self, gear: int) -> np.ndarray:
        """One row a planetary set, then one an engaged element: rows @ speeds = 0."""
        parts = [*self.sets.values(), *(self.shift_elements[name] for name in self._engaged(gear))]
        rows = np.zeros((len(parts), len(self.shafts)))
        for row, part in zip(rows, parts):
            for shaft, factor in part.coefficients:
                row[self._index[shaft]] += factor
        return rows

    def speeds(self, gear: int) -> np.ndarray:
        """Speed of each shaft per unit input speed; shape (shafts,).

        In neutral the output is taken to stand still, as in a vehicle at rest.

        Raises:
            InputError: The gear is not in the table, or its row does not leave exactly one degree
                of freedom that turns the input and, except in neutral, the output.
        """
        rows = self._constraints(gear)
        what = f"gear {gear} (engaged: {' '.join(self._engaged(gear))})"
        if gear == NEUTRAL:
            rows = np.vstack([rows, np.eye(len(self.shafts))[self._index[self.output_shaft]]])
        _, sizes, directions = np.linalg.svd(rows)
        freedom = len(self.shafts) - int((sizes > 1e-9 * sizes[0]).sum())
        if freedom != 1:
            raise InputError(f"{what} leaves {freedom} degrees of freedom: exactly one is needed")
        speeds = directions[-1]
        moving = np.abs(speeds) > 1e-9
        if not moving[self._index[self.input_shaft]]:
            raise InputError(f"{what} holds the input shaft still")
        if gear != NEUTRAL and not moving[self._index[self.output_shaft]]:
            raise InputError(f"{what} holds the output shaft still")
        return np.where(moving, speeds / speeds[self._index[self.input_shaft]], 0.0)

    def ratio(self, gear: int) -> float:
        """Input speed over output speed; negative in reverse.

        Raises:
            InputError: As ``speeds``; neutral has no ratio.
        """
        if gear == NEUTRAL:
            raise InputError("neutral has no ratio: the output does not follow the input")
        return float(1.0 / self.speeds(gear)[self._index[self.output_shaft]])

    def inertia_at_input(self, gear: int) -> float:
        """The inertia [kg.m2] that at input speed holds the energy of all shafts: sum J (w / w_in)^2."""
        return float(np.asarray(self.inertias) @ self.speeds(gear) ** 2)

    def torques(self, gear: int, input_torque: float) -> GearTorques:
        """What every member, engaged element and the load carry for ``input_torque`` [N.m] at the input.

        Virtual work: each constraint ``row @ speeds = 0`` acts on the shafts with ``factor * row``,
        and on every shaft these and the external torques cancel.
        """
        self.speeds(gear)  # a row that is not one degree of freedom has no unique torques
        if gear == NEUTRAL:
            raise InputError("neutral carries no torque")
        rows = self._constraints(gear)
        unit = np.eye(len(self.shafts))
        unknown = np.column_stack([rows.T, unit[self._index[self.output_shaft]]])
        factors = np.linalg.solve(unknown, -input_torque * unit[self._index[self.input_shaft]])
        members = np.array([
            [factor * share for _, share in planetary.coefficients]
            for factor, planetary in zip(factors, self.sets.values())])
        engaged = self._engaged(gear)
        return GearTorques(
            output=float(factors[-1]), members=members,
            shift_elements=dict(zip(engaged, factors[len(self.sets):-1].tolist())))
