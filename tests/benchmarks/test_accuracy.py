"""The accuracy benchmark in a small case: the implicit solver with events agrees, and is printed."""

import re
from pathlib import Path

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


def test_the_table_has_the_substeps_that_are_printed():
    """One that would be unstable is refused, so it cannot be printed any more."""
    text = (Path(accuracy.__file__).parent / "README.md").read_text(encoding="utf-8")
    section = text.partition("## Accuracy")[2].partition("\n## ")[0]
    shown = [float(us) * 1e-6 for us in re.findall(r"^\| \**([\d.]+)\**", section, re.MULTILINE)]
    assert np.allclose(shown, accuracy.SUBSTEPS)
    accuracy.plant(max(accuracy.SUBSTEPS))
