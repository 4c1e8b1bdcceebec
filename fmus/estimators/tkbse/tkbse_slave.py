"""The triggered Kalman estimator of the backlash size as an FMI 2.0 co-simulation slave."""

from driveline.models import MODELS
from fmus.shell import ModelSlave


class Tkbse(ModelSlave):
    """Size of the lash, from torque and two speeds during tip-ins."""

    models = MODELS
