"""Noise of the channels that tests add, root mean square, in the channels' units; a run as if it had been measured, and
the begin of one."""

from dataclasses import replace

import numpy as np

from cosim.diagnosis.plants import STEP
from cosim.diagnosis.plants.led import led_by

FLOORS = {"engine_speed": 0.06, "turbine_speed": 0.06, "transmission_output_speed": 0.06, "wheel_speed": 0.012,
          "vehicle_speed": 0.005, "propeller_shaft_torque": 1.5, "seat_acceleration": 0.03,
          "differential_acceleration": 0.5}


def measured(car, run, raw):
    """A run in which this was measured, with noise, and which is led along it."""
    random = np.random.default_rng(1)
    shown = car.instruments(raw, car.values, run)
    read = {name: shown[place] + FLOORS[name] * random.standard_normal(place.stop - place.start)
            for name, place in run.slices.items()}
    return replace(led_by(run, raw), measured=read)


def shortened(run, seconds):
    """The begin of a run, for tests that simulate it some hundred times; the driver tips in within its first 1.5 s."""
    early = {name: clock <= run.start + seconds for name, clock in run.clocks.items()}
    return replace(run, inputs=run.inputs[:round(seconds / STEP)],
                   clocks={name: clock[early[name]] for name, clock in run.clocks.items()},
                   measured={name: values[early[name]] for name, values in run.measured.items()})
