"""The toy model as a slave."""

from driveline.models import MODELS
from fmus.shell import ModelSlave


class Toy(ModelSlave):
    """A sprung mass."""

    models = MODELS
