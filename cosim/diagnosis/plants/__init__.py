"""Which plant a measurement belongs to, and how one recording is driven through it in process.

A ``Run`` is one stretch of a recording made ready for simulation; a plant turns values (parameters of the
plant and of its sensors, by structured name) and nuisances (start speed, grade, torque bias of that run)
into what the measured channels should read on their own clocks. The tables of the vehicle file say which
plant it describes.
"""

from __future__ import annotations

from cosim.diagnosis.plants.base import InstrumentedPlant
from cosim.diagnosis.plants.bench import Bench
from cosim.diagnosis.plants.car import SETTLE, FullOrderCar
from cosim.diagnosis.plants.rigid import RigidPlant
from cosim.diagnosis.plants.run import NONE, STEP, Nuisance, Run
from cosim.diagnosis.plants.single_mass import SingleMass
from cosim.measured import Measurement
from driveline import vehicles
from driveline.quantities import InputError

__all__ = ["NONE", "SETTLE", "STEP", "Bench", "FullOrderCar", "InstrumentedPlant", "Nuisance", "RigidPlant", "Run",
           "SingleMass", "plant_for"]

# A table that only this plant's vehicle files have.
_TELLING: dict[str, type[InstrumentedPlant]] = {
    "transmission": FullOrderCar, "gearbox": FullOrderCar, "motor_bearing": Bench, "guide": SingleMass}


def plant_for(measurement: Measurement) -> InstrumentedPlant:
    """The plant that the measurement's vehicle file describes, with its instruments.

    Raises:
        InputError: The measurement names no vehicle, or the file describes none of the plants.
    """
    if measurement.vehicle is None:
        raise InputError(f"measurement '{measurement.name}': which vehicle? measurement.toml needs vehicle = \"...\", "
                         "a data file --vehicle beside it")
    tables = {name.partition(".")[0] for name in vehicles.load(measurement.vehicle, measurement.variant).values}
    for table, kind in _TELLING.items():
        if table in tables:
            return kind(measurement.vehicle, measurement.variant)
    raise InputError(f"vehicle '{measurement.vehicle}' has the tables {', '.join(sorted(tables))}: a car has "
                     "[transmission], a dynamometer [motor_bearing], a carriage [guide]")
