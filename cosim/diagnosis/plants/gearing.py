"""What the speeds of a car say of the gear it is in, and what they are to one another in a gear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from cosim.measured import Manoeuvre
from driveline.elements.driveline_parts import in_gear
from driveline.quantities import InputError

LOCKED = 8.0  # rad/s: a lock-up clutch that is closed slips less, by its control, through a step of torque too
_FINE = 0.02  # s: how finely the gear, and whether clutch and brake let it be compared, are looked at in a drive
# By how much the ratio of speeds may be off its gear's, by slip of tyres and clutch, and by how much that of all gears,
# by what a vehicle file may have wrong; the closest gears are 8 % apart.
_IN_GEAR, _COMMON = 0.04, 0.08


@dataclass(frozen=True)
class Gearing:
    """What turns how many times as fast as what.

    Attributes:
        ratios: Of the transmission, by forward gear.
        final_drive: Ratio.
        radius: Of the tyres [m].
    """

    ratios: Mapping[int, float]
    final_drive: float
    radius: float

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Gearing:
        """That of a full-order plant, by its parameters."""
        ratios = {gear: ratio for gear in range(1, 11) if (ratio := values.get(in_gear("ratio", gear), 0.0)) > 0.0}
        return cls(ratios, values["final_drive.ratio"], values["tyre.radius"])

    def nearest(self, ratio: float) -> int:
        """The gear in which the turbine turns most nearly so many times as fast as the wheels."""
        return min(self.ratios, key=lambda gear: abs(np.log(self.final_drive * self.ratios[gear] / max(ratio, 1e-3))))

    def rolling(self, gear: int) -> dict[str, float]:
        """The vehicle's speed [m/s] over every other, without slip; the nearest to it first.

        Args:
            gear: Engaged; what turns before the gears is left out where that is no forward gear of the vehicle.
        """
        behind = {"vehicle_speed": 1.0, "wheel_speed": self.radius,
                  "transmission_output_speed": self.radius / self.final_drive}
        if gear not in self.ratios:
            return behind
        return behind | dict.fromkeys(("turbine_speed", "engine_speed"),
                                      self.radius / (self.final_drive * self.ratios[gear]))

    def most(self, manoeuvre: Manoeuvre, start: float, stop: float) -> int:
        """The gear whose ratio the measured speeds have; errors as ``parts``."""
        return self.nearest(float(np.median(self._shown(manoeuvre, np.linspace(start, stop, 200)))))

    def parts(self, manoeuvre: Manoeuvre, start: float, stop: float) -> list[tuple[float, float, int | None]]:
        """Parts of one gear each, and which where the speeds tell it: of a drive where nobody else does.

        Raises:
            InputError: The speeds have the ratio of no gear, or there are none that show it.
        """
        if "gear" in manoeuvre:
            gear = manoeuvre["gear"]
            change = np.flatnonzero(np.diff(gear.values)) + 1
            inside = (gear.time[change] > start) & (gear.time[change] < stop)
            edges = [start, *gear.time[change][inside].tolist(), stop]
            return [(begin, end, None) for begin, end in zip(edges, edges[1:])]
        if manoeuvre.kind != "drive" or manoeuvre.gear is not None:
            return [(start, stop, None)]
        times = np.arange(start, stop, _FINE)
        shown = self._shown(manoeuvre, times)
        gears = self._at(shown)
        if not gears.any():
            known = ", ".join(f"{self.final_drive * ratio:.3g}" for ratio in self.ratios.values())
            raise InputError(f"manoeuvre '{manoeuvre.name}': before the gears it turns {np.median(shown):.3g} times "
                             f"as fast as the wheels, in gear {known} times: write gear = N in its [[manoeuvre]]")
        edges = np.flatnonzero(np.diff(gears, prepend=-1, append=-1))
        ends = [*times.tolist(), stop]
        return [(ends[a], ends[b], int(gears[a])) for a, b in zip(edges, edges[1:]) if gears[a]]

    def _at(self, shown: np.ndarray) -> np.ndarray:
        """The gear at every instant of a drive by its ratios; 0 where it is none, as in a shift.

        By their median over a second, which a lash that is crossed does not reach, and less what all have in common:
        a radius or a ratio that is not the file's.
        """
        gears = np.array(sorted(self.ratios))
        known = np.log([self.final_drive * self.ratios[gear] for gear in gears])
        seen = np.log(np.maximum(median_filter(shown, round(1.0 / _FINE) + 1, mode="nearest"), 1e-3))
        nearest = np.abs(seen[:, None] - known).argmin(axis=1)
        common = float(np.median(seen - known[nearest]))
        if abs(common) < _COMMON:
            seen = seen - common
        off = np.abs(seen[:, None] - known)
        return np.where(off.min(axis=1) < _IN_GEAR, gears[off.argmin(axis=1)], 0)

    def _shown(self, manoeuvre: Manoeuvre, times: np.ndarray) -> np.ndarray:
        """How many times as fast as the wheels the turbine turns, or the engine where nobody recorded it."""
        over = next((name for name in ("turbine_speed", "engine_speed") if name in manoeuvre), None)
        if over is None or not ("wheel_speed" in manoeuvre or "vehicle_speed" in manoeuvre):
            raise InputError(f"manoeuvre '{manoeuvre.name}': neither a gear nor the speeds that show it; write "
                             "gear = N in its [[manoeuvre]]")
        wheel = (manoeuvre["wheel_speed"].at(times) if "wheel_speed" in manoeuvre
                 else manoeuvre["vehicle_speed"].at(times) / self.radius)
        return manoeuvre[over].at(times) / np.maximum(wheel, 0.1)


def coupled(manoeuvre: Manoeuvre, begin: float, end: float) -> list[tuple[float, float]]:
    """Parts of a drive with the lock-up clutch closed and the brakes released, as far as that was recorded.

    Of a drive nobody knows what the converter was told, and what a brake pedal does to undriven wheels is no
    business of the driveline. All other manoeuvres are taken whole: a clutch that slips there is a finding.
    """
    if manoeuvre.kind != "drive":
        return [(begin, end)]
    times = np.arange(begin, end, _FINE)
    good = np.ones(times.size, dtype=bool)
    if "engine_speed" in manoeuvre and "turbine_speed" in manoeuvre:
        good &= np.abs(manoeuvre["engine_speed"].at(times) - manoeuvre["turbine_speed"].at(times)) < LOCKED
    if "brake_torque" in manoeuvre:
        good &= manoeuvre["brake_torque"].at(times) < 1.0
    change = np.flatnonzero(np.diff(good.astype(int), prepend=0, append=0))
    # the last half a second of an opening clutch and the first of a closed one are neither
    return [(float(times[a]) + 0.5 * (a > 0), float(times[b - 1]) - 0.5 * (b < times.size))
            for a, b in zip(change[::2], change[1::2])]
