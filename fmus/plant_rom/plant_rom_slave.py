"""A reduced driveline plant as an FMI 2.0 co-simulation slave; one script serves all three of them.

Which one an FMU holds (2DOF, 3DOF with lumped lash, 3DOF with split lash) stands in its model.json.
"""

from driveline.models import MODELS
from fmus.shell import ModelSlave


class PlantRom(ModelSlave):
    """Two or three inertias, one flexible shaft or two, backlash with the lash angle as a state."""

    models = MODELS
