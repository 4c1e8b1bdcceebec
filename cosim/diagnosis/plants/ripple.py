"""What the firing of the cylinders does to the crankshaft's speed, and what samples of that look like.

The engine speed that leads a simulation is sampled at 100 Hz, ripple of the third order in a tip-in is at 70 to 120 Hz:
a curve through the samples swings slowly where the crankshaft swings fast, and led by that the driveline is shaken at
the frequency of its shuffle. So what the samples make of the ripple is taken off, and the ripple put in its place.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from cosim.diagnosis.plants.observation import Errors
from cosim.diagnosis.plants.run import STEP
from driveline.plants.plant import Plant

_FREQUENCIES = 12  # at which the response is computed, over the range of a run


def swing(plant: Plant, led: str, node: str, gain: float, speed: np.ndarray) -> np.ndarray:
    """What the torque ripple does to the crankshaft's speed [rad/s], by the plant's response where it starts.

    Args:
        plant: Initialised.
        led: Its input that leads the crankshaft.
        node: The crankshaft.
        gain: Torque that leads it over what its speed differs by [N.m.s/rad].
        speed: Of it, in the middle of every step [rad/s].
    """
    place = list(plant.network.nodes).index(node)
    matrix, _ = plant.state_matrix()
    there, before = plant[led], plant.rates()[0]
    plant[led] = there + 1.0
    pull = (plant.rates()[0] - before)[:len(matrix)]  # also on what sticks to the crankshaft
    plant[led] = there
    matrix[:, place] += pull  # as if it were not led
    fast = plant["torque_ripple.order"] * speed
    frequencies = np.linspace(fast.min(), fast.max(), _FREQUENCIES)
    systems = 1j * frequencies[:, None, None] * np.eye(len(matrix)) - matrix
    response = np.linalg.solve(systems, pull[:, None] / gain)[:, place, 0]
    here = np.interp(fast, frequencies, response.real) + 1j * np.interp(fast, frequencies, response.imag)
    angle = STEP * (np.cumsum(fast) - 0.5 * fast) + plant["torque_ripple.phase"]
    return plant["torque_ripple.amplitude"] * np.imag(here * np.exp(1j * angle))


def beyond_samples(swing: np.ndarray, time: np.ndarray, shown: CubicSpline, errors: Errors) -> np.ndarray:
    """What a curve through samples misses of a swing, and makes of it instead, taken off.

    Args:
        swing, time: In the middle of every step.
        shown: Through the samples, over the times of the logger.
        errors: Of the channel.
    """
    sampled = CubicSpline(shown.x, np.interp(errors.instants(shown.x), time, swing))
    return swing - sampled(np.clip(errors.stamps(time), shown.x[0], shown.x[-1]))
