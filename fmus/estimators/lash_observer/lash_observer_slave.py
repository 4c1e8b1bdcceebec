"""The observer of lash position and size as an FMI 2.0 co-simulation slave."""

from driveline.models import MODELS
from fmus.shell import ModelSlave


class LashObserver(ModelSlave):
    """Position and size of the lash with their uncertainties, from torque and two speeds."""

    models = MODELS
