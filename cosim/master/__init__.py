"""The co-simulation master: integer clock, checked connections, several rates, recording."""

from cosim.master.fmu import FmuParticipant
from cosim.master.master import Interrupted, Master
from cosim.master.participants import ModelParticipant, Participant, SimulationError
from cosim.master.scenario import Scenario
from cosim.result import Result
from cosim.signals import Constant, FirstOrder, PulseTrain, Ramp, Signal, Step, Table
from driveline.quantities import InputError

__all__ = [
    "Constant", "FirstOrder", "FmuParticipant", "InputError", "Interrupted", "Master", "ModelParticipant",
    "Participant", "PulseTrain", "Ramp", "Result", "Scenario", "Signal", "SimulationError", "Step", "Table",
]
