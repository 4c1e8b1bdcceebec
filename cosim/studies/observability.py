"""Observability of the two modes of the 3DOF model, with engine and wheel speed measured.

Tables 3.1 and 3.2 and the reduced model of eq. 3.18 to 3.21. Ranks are exact, by rational arithmetic on the
very numbers of the model; singular values and the observability Gramian say how strongly each is seen.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.linalg import expm

from cosim.report.study_figures import Curve, Panel, draw
from cosim.studies.findings import THESIS, Findings
from driveline import vehicles
from driveline.estimators.state_space import (
    BACKLASH,
    CONTACT,
    Lumped,
    StateSpace,
    observability_matrix,
    positions,
    reduced,
    scaled,
    twists,
)
from driveline.plants.full_order import FullOrderParameters
from driveline.plants.reduced import ThreeMassParameters, reduce

SOURCE = f"{THESIS}, tables 3.1, 3.2, eq. 3.5 to 3.21"
RATE = 2.0 * np.pi * 5.85  # [1/s]; scales time and angles to the shuffle of the 3DOF model
HORIZON = 0.13  # [s], the lash crossing: as long as there is to see anything in the lash

IMPOSSIBLE = ("; the printed rank is not possible: in contact only twist less lash angle acts, the first and "
              "last columns of eq. 3.14 are opposite, and moving both states alike changes nothing")

CASES: tuple[tuple[str, Callable[[Lumped], StateSpace], int], ...] = (
    ("model I, contact (table 3.1)", lambda p: positions(p, CONTACT), 5),
    ("model I, backlash (table 3.1)", lambda p: positions(p, BACKLASH), 4),
    ("model II, contact (table 3.2)", lambda p: twists(p, CONTACT), 6),
    ("model II, backlash (table 3.2)", lambda p: twists(p, BACKLASH), 4),
    ("reduced model, backlash (eq. 3.19)", reduced, 4),
)


def exact_rank(matrix: np.ndarray) -> tuple[int, list[list[Fraction]]]:
    """Rank of a matrix of ``Fraction``, and a basis of what it maps to zero.

    By elimination to the reduced echelon form: no rounding, no tolerance.
    """
    rows, pivots = [list(row) for row in matrix], []
    columns = range(len(rows[0]))
    for column in columns:
        rank = len(pivots)
        pivot = next((i for i in range(rank, len(rows)) if rows[i][column] != 0), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        rows[rank] = [entry / rows[rank][column] for entry in rows[rank]]
        for i, row in enumerate(rows):
            if i != rank and row[column] != 0:
                rows[i] = [a - row[column] * b for a, b in zip(row, rows[rank])]
        pivots.append(column)
    null = []
    for free in (column for column in columns if column not in pivots):
        direction = [Fraction(int(column == free)) for column in columns]
        for row, pivot in zip(rows, pivots):
            direction[pivot] = -row[free]
        null.append(direction)
    return len(pivots), null


def gramian(model: StateSpace, horizon: float, steps: int = 200) -> np.ndarray:
    """Integral of exp(A't) C'C exp(At) over ``horizon`` (Simpson's rule on ``steps`` pieces)."""
    width = horizon / steps
    advance, weight = expm(model.A * width), np.ones(steps + 1)
    weight[1:-1:2], weight[2:-1:2] = 4.0, 2.0
    total, seen = np.zeros_like(model.A), model.C
    for w in weight * width / 3.0:
        total += w * seen.T @ seen
        seen = seen @ advance
    return total


def in_words(null: list[list[Fraction]], states: tuple[str, ...]) -> str:
    """Directions of the state without effect on the measurements, as text."""
    return "; ".join(
        " ".join(f"{float(weight):+.4g} {state}" for weight, state in zip(direction, states) if weight != 0)
        for direction in null)


def three_mass() -> ThreeMassParameters:
    """The 3DOF model of the modified vehicle in 5th gear."""
    vehicle = vehicles.load("pickup_10r80", "modified")
    return reduce(vehicle.parameters(FullOrderParameters)).three_mass


def run(out: Path, progress: Callable[[float], None], pieces: int = 200) -> Findings:
    """Rows and a picture; ``pieces`` of the Gramian's integral."""
    parameters = three_mass()
    floats, exact = Lumped.of(parameters), Lumped.of(parameters, Fraction)
    findings = Findings()
    spectra, strengths = {}, {}
    for number, (name, build, printed) in enumerate(CASES):
        progress(number / len(CASES))
        rational, unscaled, model = build(exact), build(floats), scaled(build(floats), RATE)
        rank, hidden = exact_rank(observability_matrix(rational.A, rational.C))
        values = np.linalg.svd(observability_matrix(model.A, model.C), compute_uv=False)
        naive = np.linalg.matrix_rank(observability_matrix(unscaled.A, unscaled.C))
        states = len(model.states)
        note = f"of {states} states; exact; unscaled floating point at the usual tolerance says {naive}"
        if hidden:
            note += "; without effect on the measurements: " + in_words(hidden, model.states)
        if rank != printed:
            note += IMPOSSIBLE
        findings.add(f"rank of the observability matrix, {name}", "1", printed, rank, note)
        findings.add(f"rank by singular values, {name}", "1", printed, rank_of(values),
                     f"scaled; smallest kept {values[rank - 1]:.3g}, largest dropped "
                     f"{values[rank] if rank < states else 0.0:.1g}")
        strength = np.sqrt(np.maximum(np.linalg.eigvalsh(gramian(model, HORIZON * RATE, pieces))[::-1], 0.0))
        findings.add(f"weakest seen direction, {name}", "1", None, strength[rank - 1] / strength[0],
                     "root of the Gramian's eigenvalue over the largest one, 0.13 s of measurement, scaled")
        spectra[name], strengths[name] = values / values[0], strength / strength[0]
    findings.add("rank with the lash angle known, model II, contact, 5 states", "1", None, _known_lash(exact),
                 "observable: in contact the lash angle is half the gap, and with it the twist is seen")
    findings.add("rank with entry (2,1) of eq. 3.7 left in eq. 3.14", "1", 6.0, _copied_entry(exact),
                 "hypothesis for the printed 6: one i_tr too many in that entry, and the columns differ")
    findings.figures.append(_figure(out, spectra, strengths))
    return findings


def rank_of(singular_values: np.ndarray) -> int:
    """Rank by the usual tolerance: n times machine precision of the largest, rounded up tenfold.

    Powers up to A^5 are formed in floating point, each adds errors of the order of that tolerance.
    """
    tolerance = 10.0 * len(singular_values) * np.finfo(float).eps * singular_values[0]
    return int((singular_values > tolerance).sum())


def _copied_entry(exact: Lumped) -> int:
    """Exact rank of model II in contact if its entry (2,1) were the one of model I."""
    model = twists(exact, CONTACT)
    A = model.A.copy()
    A[1, 0] = A[1, 0] / exact.i_tr
    return exact_rank(observability_matrix(A, model.C))[0]


def _known_lash(exact: Lumped) -> int:
    """Exact rank of model II in contact without the lash angle among its states."""
    model = twists(exact, CONTACT)
    return exact_rank(observability_matrix(model.A[:-1, :-1], model.C[:, :-1]))[0]


def _figure(out: Path, spectra: dict[str, np.ndarray], strengths: dict[str, np.ndarray]) -> str:
    colors = ("measured", "first", "second", "third", "fourth")

    def panel(title: str, data: dict[str, np.ndarray], floor: float, y_label: str) -> Panel:
        curves = [Curve(np.arange(1, values.size + 1), np.maximum(values, floor), name, color, "o-", 1.0)
                  for color, (name, values) in zip(colors, data.items())]
        return Panel(title, curves, y_label, "number", log_y=True, ticks=range(1, 8))

    return draw(out / "observability.png", "Observability of the 3DOF model's modes (tables 3.1 and 3.2)", [
        panel("singular values of the scaled observability matrix (1e-16 and below: zero)", spectra, 1e-20,
              "over the largest [1]"),
        panel("what 0.13 s of measurement show: roots of the Gramian's eigenvalues", strengths, 1e-9,
              "over the largest [1]")], columns=1)
