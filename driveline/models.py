"""Every model there is: what an FMU is built from, and what the master runs in process."""

from __future__ import annotations

from .estimators import ESTIMATORS
from .model import Model
from .plants.full_order import FullOrderPlant
from .plants.reduced import SplitLashPlant, ThreeMassPlant, TwoMassPlant

# What shipped FMUs and twins start from: vehicle file, variant, gear.
SHIPPED_VEHICLE, SHIPPED_VARIANT, SHIPPED_GEAR = "pickup_10r80", "modified", 5

PLANTS: dict[str, type[Model]] = {
    model.name: model for model in (FullOrderPlant, TwoMassPlant, ThreeMassPlant, SplitLashPlant)
}
MODELS: dict[str, type[Model]] = PLANTS | ESTIMATORS
