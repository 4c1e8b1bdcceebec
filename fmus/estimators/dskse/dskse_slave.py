"""The switched Kalman estimator of the backlash state as an FMI 2.0 co-simulation slave."""

from driveline.models import MODELS
from fmus.shell import ModelSlave


class Dskse(ModelSlave):
    """Mode, position in the lash, twists and speeds, from torque and two speeds."""

    models = MODELS
