"""The band in which torques that a measured motion needs are compared with measured ones: where the motion is known.

Both go through the same low pass, forward and backward so that it keeps the phase, and are thinned to what then is
independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import cheby1, sosfiltfilt


@dataclass(frozen=True)
class Band:
    """The part of a signal that is compared.

    Attributes:
        edge: Of the low pass [Hz], Chebyshev type I, forward and backward.
        ripple: In its pass band [dB].
        order: Of one pass.
        rate: Samples a second that are kept.
    """

    edge: float = 20.0
    ripple: float = 0.8
    order: int = 8
    rate: float = 40.0

    @classmethod
    def sampled(cls, interval: float) -> Band:
        """The band in which a motion sampled every ``interval`` [s] is known: ten samples a period, 20 Hz at most."""
        edge = min(20.0, 0.1 / interval)
        return cls(edge=edge, rate=2.0 * edge)

    @property
    def spoiled(self) -> float:
        """How much of a stretch [s] its filter spoils at either end, as it knows nothing of before and after."""
        return 6.0 / self.edge

    def of(self, signal: np.ndarray, step: float, trim: float = 0.0) -> np.ndarray:
        """A signal filtered and thinned.

        Args:
            signal: On an even clock, the last axis is time.
            step: Its distance [s].
            trim: Left out at either end [s], where the filter does not know what was before or comes after.
        """
        sections = cheby1(self.order, self.ripple, self.edge, fs=1.0 / step, output="sos")
        level = float(np.prod(sections[:, :3].sum(axis=1) / sections[:, 3:].sum(axis=1)))  # an even order sags at rest
        return self.thinned(sosfiltfilt(sections, signal, axis=-1) / level**2, step, trim)

    def thinned(self, signal: np.ndarray, step: float, trim: float = 0.0) -> np.ndarray:
        """The samples that are kept, of a signal or a clock as it is."""
        cut = round(trim / step)
        return signal[..., cut:signal.shape[-1] - cut:max(1, round(1.0 / (self.rate * step)))]
