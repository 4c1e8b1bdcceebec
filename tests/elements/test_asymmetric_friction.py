"""Loss by flank: the drive flanks keep theirs, the coast flanks have another."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from runs import ledger, plant, run, steps

from driveline.elements.asymmetric_friction import flank_loss_fraction
from driveline.quantities import InputError

SPEEDS = st.floats(-100.0, 100.0).filter(lambda x: abs(x) > 1e-3)
EXCESS = 0.2


@given(SPEEDS, st.floats(1.0, 1e3), st.floats(0.0, 0.1))
def test_the_flank_goes_by_the_direction_of_power(speed, torque, drive):
    along = torque * np.sign(speed)
    assert flank_loss_fraction(speed, along, drive, EXCESS) == drive
    assert flank_loss_fraction(speed, -along, drive, EXCESS) == drive + EXCESS


def test_overrun_loses_the_excess_and_drive_nothing_of_it():
    """Steady overrun: the pinion needs the wheels to make up for what the flanks take."""
    for torque in (-25.0, 120.0):
        records = [run(plant("plant_fom", {"start.vehicle_speed": 15.0,
                                           "asymmetric_friction.coast_loss_fraction": excess},
                             engine_torque=torque), 1e-3) for excess in (0.0, EXCESS)]
        if torque > 0.0:
            for name in ("axle_shaft_torque", "vehicle_acceleration"):
                assert records[1][name] == pytest.approx(records[0][name], rel=1e-9)
        else:
            p = plant("plant_fom", initialize=False).parameters
            ring = [r["axle_shaft_torque"][0] / p.final_drive.ratio for r in records]
            extra = ring[0] - ring[1]  # both negative: the wheels push more
            assert extra == pytest.approx(-EXCESS * ring[1], rel=0.05)


def test_energy_is_kept_through_reversals():
    model = plant("plant_fom", {"start.vehicle_speed": 12.0, "asymmetric_friction.coast_loss_fraction": EXCESS},
                  engine_torque=-20.0)
    record = run(model, 2.0, engine_torque=steps((0.0, -20.0), (0.3, 150.0), (1.2, -20.0)))
    assert np.ptp(ledger(record)) < 1e-6 * record["energy_stored"].max()


def test_a_loss_below_nothing_is_refused():
    with pytest.raises(InputError, match="asymmetric_friction.coast_loss_fraction"):
        plant("plant_fom", {"asymmetric_friction.coast_loss_fraction": -0.5})
