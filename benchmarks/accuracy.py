"""How exact the full-order plant is: against an implicit solver at tight tolerance.

The reference integrates the same rates with SciPy's Radau method (order five, implicit, L-stable)
at a relative tolerance of 1e-10 and finds the lash contacts as its events, so it shares neither
the time stepping, nor the event location, nor the exact solution in the gap with the plant.

    python -m benchmarks.accuracy
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from driveline.kernels import layout as k
from driveline.plants.full_order import FullOrderPlant
from driveline.vehicles import load

STOP = 1.0
STEP = 1e-3
REQUEST = (-30.0, 200.0)
SUBSTEPS = (4e-4, 2.5e-4, 2e-4, 1.25e-4, 6.25e-5, 3.125e-5)


def plant(substep: float) -> FullOrderPlant:
    """The pickup coasting in fifth gear at 12 m/s, its air path without delay, at the start."""
    model = FullOrderPlant(load("pickup_10r80", "modified").values)
    for name, value in {"engine.air_delay": 0.0, "solver.maximum_substep": substep,
                        "start.vehicle_speed": 12.0, "engine_torque": REQUEST[0]}.items():
        model[name] = value
    model.initialize()
    return model


def trajectory(substep: float, propagated: bool = False) -> np.ndarray:
    """Propeller shaft torque [N.m] every STEP after a step of the requested torque."""
    model = plant(substep)
    inputs = np.tile(model.values[:len(model.inputs)], (round(STOP / STEP), 1))
    inputs[:, 0] = REQUEST[1]
    place = [v.name for v in model.output_variables].index("propeller_shaft_torque")
    return model.simulate(inputs, STEP, propagated=propagated)[:, place]


def reference(tolerance: float = 1e-10, stop: float = STOP) -> tuple[np.ndarray, int]:
    """The same by SciPy's Radau method with events; also the number of contact changes."""
    model = plant(1e-4)
    net = model.network
    model["engine_torque"] = REQUEST[1]
    n = int(net.plan[k.CONTINUOUS])
    lashes = {name: net.branches[name] for name in ("transmission", "final_drive")}
    gaps = {}
    for name, branch in lashes.items():
        row = net.plan[net.plan[k.BRANCH_TABLE] + branch * k.BRANCH_COLUMNS:][:k.BRANCH_COLUMNS]
        stiffness, damping, half_gap = net.constants[row[k.PARAMETER] + 2:][:3]
        gaps[name] = (int(row[k.TWIST]), stiffness, damping, half_gap)
    front = net.branches["propeller_shaft_front"]
    modes = model.state[net.modes]
    scratch = model.state.copy()

    def evaluate(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scratch[:n] = y
        scratch[net.modes] = modes
        rates, torques = model.rates(scratch)
        for name, (x, stiffness, damping, _) in gaps.items():
            if modes[lashes[name]] == 0.0:  # eq. 2.7: the shaft springs back
                rates[x + 1] = -stiffness / damping * y[x + 1]
        return rates, torques

    def torque_now(name: str):
        x, stiffness, damping, _ = gaps[name]
        return lambda t, y: stiffness * y[x + 1] + damping * evaluate(y)[0][x]

    def flank(name: str, side: float):
        x, _, _, half_gap = gaps[name]
        return lambda t, y: side * (y[x] - y[x + 1]) - half_gap

    times = np.arange(1, round(stop / STEP) + 1) * STEP
    found = np.empty(times.size)
    y, time, done, changes = model.state[:n].copy(), 0.0, 0, 0
    while done < times.size:
        events, meaning = [], []
        for name, branch in lashes.items():
            sides = (-1.0, 1.0) if modes[branch] == 0.0 else (0.0,)
            for side in sides:
                event = torque_now(name) if side == 0.0 else flank(name, side)
                event.terminal, event.direction = True, 1.0 if side or modes[branch] < 0.0 else -1.0
                events.append(event)
                meaning.append((name, side))
        piece = solve_ivp(lambda t, x: evaluate(x)[0], (time, stop), y, method="Radau", rtol=tolerance,
                          atol=1e-11, events=events, dense_output=True)
        inside = times[done:][times[done:] <= piece.t[-1] + 1e-12]
        for t in inside:
            found[done] = evaluate(piece.sol(t))[1][front]
            done += 1
        y, time = piece.y[:, -1].copy(), piece.t[-1]
        for (name, side), hits in zip(meaning, piece.t_events, strict=True):
            if hits.size:
                changes += 1
                modes[lashes[name]] = side
                x, _, _, half_gap = gaps[name]
                if side:
                    y[x + 1] = y[x] - side * half_gap
    return found, changes


def main() -> None:
    """Print the error over the sub-step, its order, and the contacts that were passed."""
    exact, changes = reference()
    peak = np.abs(exact).max()
    coarse, _ = reference(tolerance=1e-8)
    print(f"reference: {changes} contact changes, peak {peak:.1f} N.m, "
          f"itself converged to {np.abs(coarse - exact).max() / peak:.1e} of the peak")
    print("sub-step [us]   error / peak   order")
    before = None
    for substep in SUBSTEPS:
        error = np.abs(trajectory(substep) - exact).max() / peak
        order = "" if before is None else f"{np.log(before[1] / error) / np.log(before[0] / substep):8.2f}"
        print(f"{substep * 1e6:13.2f}   {error:12.2e} {order}")
        before = (substep, error)
    error = np.abs(trajectory(2e-4, propagated=True) - exact).max() / peak
    print(f"{'whole steps':>13}   {error:12.2e}   (kernels.propagation, 200 us where a contact changes)")


if __name__ == "__main__":
    main()
