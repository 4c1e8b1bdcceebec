"""Which plant a measurement belongs to, and how one recording is driven through it in process.

A ``Run`` is one stretch of a recording made ready for simulation; a plant turns values (parameters of the
plant and of its sensors, by structured name) and nuisances (start speed, grade, torque bias of that run)
into what the measured channels should read on their own clocks.
"""

from cosim.diagnosis.plants.car import SETTLE, FullOrderCar
from cosim.diagnosis.plants.run import NONE, STEP, Nuisance, Run

__all__ = ["NONE", "SETTLE", "STEP", "FullOrderCar", "Nuisance", "Run"]
