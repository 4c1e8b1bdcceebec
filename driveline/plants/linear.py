"""Small vibrations about the present state of a plant: modes, the shuffle mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .plant import Plant


@dataclass(frozen=True)
class Mode:
    """One damped vibration.

    Attributes:
        frequency: Damped natural frequency [Hz].
        damping_ratio: Damping over critical damping.
        eigenvalue: [1/s].
        shape: Entry of the eigenvector for every continuous state, by name.
    """

    frequency: float
    damping_ratio: float
    eigenvalue: complex
    shape: dict[str, complex]


def modes(plant: Plant) -> list[Mode]:
    """The vibrations at the present state, slowest first."""
    matrix, names = plant.state_matrix()
    values, vectors = np.linalg.eig(matrix)
    found = [
        Mode(abs(value.imag) / (2.0 * np.pi), -value.real / abs(value), complex(value),
             dict(zip(names, vectors[:, i], strict=True)))
        for i, value in enumerate(values) if value.imag > 1e-6
    ]
    return sorted(found, key=lambda mode: mode.frequency)


def shuffle_mode(plant: Plant) -> Mode:
    """The lowest vibration in which the engine swings against the vehicle.

    Raises:
        ValueError: No vibration involves the first node (the engine).
    """
    engine = plant.network.entries[0].name
    for mode in modes(plant):
        speeds = [abs(mode.shape[entry.name]) for entry in plant.network.entries if entry.unit == "rad/s"
                  and entry.name in mode.shape]
        if abs(mode.shape[engine]) > 0.3 * max(speeds):
            return mode
    raise ValueError(f"{plant.name}: no vibration of the engine against the vehicle at this state")
