"""The carriage: one mass on a guide, driven by a force."""

from __future__ import annotations

from cosim.diagnosis.plants.rigid import RigidPlant
from cosim.diagnosis.plants.run import Nuisance, Run
from driveline.plants.bench import SingleMassPlant


class SingleMass(RigidPlant):
    """The carriage with its instruments: the force of the drive and the position."""

    name = "plant_single_mass"
    plant = SingleMassPlant
    driver = "force"
    channels = ("position",)
    motions = ("position",)
    sections = {"force": "carriage"}

    def _start(self, run: Run, nuisance: Nuisance) -> None:
        self._plant["start.speed"] = run.start_speed + nuisance.start_speed
