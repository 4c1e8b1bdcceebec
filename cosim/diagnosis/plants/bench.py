"""The dynamometer: a motor drives a load through an inline torque sensor."""

from __future__ import annotations

from cosim.diagnosis.plants.rigid import RigidPlant
from cosim.diagnosis.plants.run import Nuisance, Run
from driveline.plants.bench import BenchPlant


class Bench(RigidPlant):
    """The dynamometer with its instruments: two torque channels, motor and inline sensor."""

    name = "plant_bench"
    plant = BenchPlant
    driver = "motor_torque"
    channels = ("motor_speed", "motor_position", "inline_torque")
    motions = ("motor_position", "motor_speed")
    sections = {"motor_torque": "motor", "inline_torque": "load"}

    def _start(self, run: Run, nuisance: Nuisance) -> None:
        self._plant["start.motor_speed"] = run.start_speed + nuisance.start_speed
