"""The accuracy benchmark in a small case: the implicit solver with events agrees, and is printed."""

import numpy as np

from benchmarks import accuracy


def test_the_implicit_reference_and_the_plant_agree_across_contacts():
    exact, changes = accuracy.reference(tolerance=1e-8, stop=0.25)
    assert changes >= 2  # a lash was crossed
    peak = np.abs(exact).max()
    errors = [np.abs(accuracy.trajectory(substep)[:exact.size] - exact).max() / peak
              for substep in (4e-4, 2e-4)]
    assert errors[1] < 1e-3
    assert errors[1] < errors[0] / 4.0
