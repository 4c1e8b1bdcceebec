"""The full-order driveline plant as an FMI 2.0 co-simulation slave."""

from driveline.models import MODELS
from fmus.shell import ModelSlave


class PlantFom(ModelSlave):
    """Engine to vehicle with every element of the thesis' full-order model."""

    models = MODELS
