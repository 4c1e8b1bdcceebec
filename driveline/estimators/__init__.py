"""Estimators of the backlash state and size, and the linear models they stand on.

A new estimator is a file here, a line in ``ESTIMATORS``, and a slave script in
``fmus/estimators/<name>/``; its compiled step, its FMU and its in-process twin follow.
"""

from __future__ import annotations

from .dskse import Dskse
from .estimator import Estimator
from .lash_observer import LashObserver
from .tkbse import Tkbse

ESTIMATORS: dict[str, type[Estimator]] = {
    "dskse": Dskse,
    "tkbse": Tkbse,
    "lash_observer": LashObserver,
}
