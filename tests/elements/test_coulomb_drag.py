"""Dry friction on the axle: constant, against the rotation, holding at standstill."""

import numpy as np
import pytest
from runs import ledger, plant, run

TORQUE = 150.0


def coasting(**more):
    return plant("plant_fom", {"start.vehicle_speed": 8.0, **more}, gear=0, engine_torque=0.0)


def test_drag_slows_the_vehicle_by_its_torque_over_the_radius():
    free, dragged = (run(coasting(**p), 1.0) for p in ({}, {"coulomb_drag.torque": TORQUE}))
    p = coasting().parameters
    turning = (4.0 * (p.hub.inertia + p.tyre.belt_inertia) + p.final_drive.ring_inertia + 2.0 * p.axle_shaft.inertia
               + p.final_drive.ratio**2 * (p.propeller_shaft.inertia + p.final_drive.pinion_inertia
                                           + p.transmission.output_inertia + p.transmission.inertia[1]))
    mass = p.vehicle.mass + turning / p.tyre.radius**2
    more = free["vehicle_speed"][-1] - dragged["vehicle_speed"][-1]
    assert more == pytest.approx(TORQUE / p.tyre.radius / mass, rel=0.03)
    assert np.ptp(ledger(dragged)) < 1e-6 * dragged["energy_stored"].max()


def test_it_holds_the_vehicle_on_a_slope_that_would_move_it_otherwise():
    p = {"start.vehicle_speed": 0.0, "tyre.rolling_resistance": 0.0}
    model = plant("plant_fom", {**p, "coulomb_drag.torque": 800.0}, gear=0, lockup_command=0.0, road_grade=0.05)
    free = plant("plant_fom", p, gear=0, lockup_command=0.0, road_grade=0.05)
    held, rolling = (run(m, 4.0, road_grade=0.05)["travelled_distance"] for m in (model, free))
    # it rocks on its shafts and tyres about a place it stays at
    assert np.abs(held).max() < 0.05
    assert held[2000:].mean() == pytest.approx(held[1000:3000].mean(), abs=1e-3)
    assert rolling[-1] < -3.0
