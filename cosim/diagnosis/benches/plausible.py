"""Whether recordings can be of this bench at all: a wrong unit, sign or clock would be explained at length otherwise.

What a bench needs for its acceleration is its masses', and no effect of the catalogue makes six times of them. Friction
may be many times the file's, so of that nothing is asked; but dry friction, which no unit of a motion changes, says
whose unit is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.diagnosis.benches.inverse import Torques
from cosim.diagnosis.plants import clocks
from cosim.diagnosis.plants.plausible import apart, as_if
from cosim.diagnosis.plants.run import STEP
from driveline.quantities import InputError

_MASSES = 6.0  # times those of the file, either way: a load of 2.5 times by a torque meter of twice its gain is 5
_MOTION = 1.4  # times what another channel shows of it, either way
_GOES_WITH = 0.25  # share of what a channel does that has to go with a motion, for anything to be asked
_SHOWS = 0.03  # the same of dry friction
_ALIKE = 2.0  # times: masses and friction that are off by more are not off alike
_SLOWLY = 1e-6  # share of the speed at which friction is dry
_Signals = Mapping[str, np.ndarray]  # of a run, by channel


@dataclass(frozen=True)
class _Share:
    """How many times the file's masses a channel shows, and its dry friction; None where that shows too little."""

    masses: float
    dry: float | None

    @property
    def possible(self) -> bool:
        """Whether a bench may have such masses."""
        return _off(self.masses) < _MASSES

    @property
    def alike(self) -> bool | None:
        """Whether both are off as much; None where nobody can say."""
        return None if self.dry is None else 1.0 / _ALIKE < self.dry / self.masses < _ALIKE


def check(torques: Torques) -> None:
    """Refuse recordings that cannot be of a bench.

    Args:
        torques: Measured ones, and those that the vehicle file needs.

    Raises:
        InputError: The unit, the sign or the clock of a torque, a force or a motion is not right.
    """
    measured, needed = torques.measured({}), torques.needed(torques.plant.values)
    _check_clocks(torques, measured, needed)
    shares = _shares(torques, measured, needed)
    _check_motions(torques, shares)
    _check_torques(torques, shares)


def _check_clocks(torques: Torques, measured: Sequence[_Signals], needed: Sequence[_Signals]) -> None:
    """Whether torques come when the motion needs them; neither a unit nor a sign changes when."""
    for i, (run, shown, wanted) in enumerate(zip(torques.runs, measured, needed)):
        every = float(np.median(np.diff(torques.clock(i))))
        clocks.refuse(run.name, torques.plant.motion_of(run),
                      {name: clocks.lag(shown[name], wanted[name], every) for name in shown})


def _check_motions(torques: Torques, shares: Mapping[str, _Share]) -> None:
    """Whether a speed is what the position beside it makes it; where not, that is wrong by which masses are."""
    position = torques.plant.motions[0]
    for name in torques.plant.motions:
        rows = [[torques.band.of(signal, STEP, torques.trim) for signal in
                 (np.interp(motion.time, run.clocks[name], run.measured[name]), motion.speed)]
                for run, motion in zip(torques.runs, torques.motions)
                if name in run.clocks and name != torques.plant.motion_of(run)]
        if not rows:
            continue
        (share,), (explained,) = _made_of(*(np.concatenate(parts) for parts in zip(*rows)))
        # noise in the position makes it less, that in the speed makes its inverse less
        if explained < _GOES_WITH or min(_off(share), _off(share / explained)) < _MOTION:
            continue
        said, suspect = "has the other sign than" if share < 0.0 else f"is {share:.3g} times", None
        if shares:
            masses = float(np.median([s.masses for s in shares.values()]))
            suspect = name if _off(masses) < _off(masses / share) else position
        raise _refusal(f"{name} {said} what {position} makes it", share, name, position, suspect)


def _check_torques(torques: Torques, shares: Mapping[str, _Share]) -> None:
    """Whether torques go with the acceleration about as the masses of the file make them."""
    off = {channel: share for channel, share in shares.items() if not share.possible}
    if not off:
        return
    channel = max(off, key=lambda name: _off(off[name].masses))
    share, motion = off[channel], torques.plant.motion_of(torques.runs[0])
    suspect = None
    if len(off) < len(shares):  # the motion is right for another
        suspect = channel
    elif len(off) > 1:
        suspect = motion
    elif share.masses > 0.0 and share.alike is not None:
        suspect = channel if share.alike else motion
    said = (f"has the other sign than what {motion} needs" if share.masses < 0.0 else f"goes with the acceleration "
            f"{share.masses:.4g} times as much as the masses of the vehicle file make it")
    raise _refusal(f"{channel} {said}", share.masses, channel, motion, suspect)


def _refusal(said: str, share: float, channel: str, motion: str, suspect: str | None) -> InputError:
    """What is off, and where to look: at the channel, or at the motion; at both where nobody can say.

    Args:
        said: What is off.
        share: How many times the channel is what the motion makes it.
        channel, motion: Which.
        suspect: One of them, or None.
    """
    whose = suspect or f"{channel} or {motion}"
    if share < 0.0:
        return InputError(f"{said}: is the sign of {whose} right?")
    hint = as_if(suspect, share if suspect == channel else 1.0 / share) if suspect else ""
    return InputError(f"{said}: is the unit of {whose} right?{hint}")


def _off(share: float) -> float:
    """How many times too large or too small; infinite where the sign is wrong."""
    return apart(share) if share > 0.0 else np.inf


def _shares(torques: Torques, measured: Sequence[_Signals], needed: Sequence[_Signals]) -> dict[str, _Share]:
    """Of every channel that goes with the acceleration."""
    values, found = torques.plant.values, {}
    rows = measured, needed, torques.resisted(values), torques.resisted(values, _SLOWLY)
    for channel in torques.channels:
        shown, wanted, resisted, dry = (
            np.concatenate([run[channel] for run, there in zip(row, measured) if channel in there]) for row in rows)
        factors, explained = _made_of(shown, wanted - resisted, dry, resisted - dry)
        if explained[0] > _GOES_WITH:
            found[channel] = _Share(factors[0], factors[1] if explained[1] > _SHOWS else None)
    return found


def _made_of(shown: np.ndarray, *parts: np.ndarray) -> tuple[list[float], list[float]]:
    """By which factors parts, and a constant, are most nearly what is shown; the share of its variance that each is."""
    factors = np.linalg.lstsq(np.column_stack([*parts, np.ones(shown.size)]), shown, rcond=None)[0][:-1]
    variance = max(float(np.var(shown)), 1e-300)
    return factors.tolist(), [float(factor**2 * np.var(part)) / variance for factor, part in zip(factors, parts)]
