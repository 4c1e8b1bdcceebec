"""What mistakes in lumping would do to the 2DOF model: hypotheses for the thesis's 4.39 Hz.

The thesis prints neither its vehicle's numbers nor those of its 2DOF model. So no mistake can be proved; it
can only be shown which ones bring the frequency *and* the lack of damping it reports, for a vehicle whose
full-order model has the printed frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from driveline.plants.full_order import FullOrderParameters
from driveline.plants.reduced import TwoMassParameters, lumps, reduce, series


@dataclass(frozen=True)
class Mistake:
    """How the compliance behind the pinion is lumped; the defaults are right.

    Attributes:
        what: In words.
        axle_shafts, tyres: How many in parallel; no tyre means a rigid one.
        slip: Whether the tyre's contact patch, a damper in series, is in the lump.
        referred: Whether propeller shaft and transmission are referred to the wheels by i_fdr squared.
    """

    what: str
    axle_shafts: int = 2
    tyres: int = 2
    slip: bool = True
    referred: bool = True


MISTAKES = (
    Mistake("none: as reduced here"),
    Mistake("tyres without slip", slip=False),
    Mistake("tyres rigid", tyres=0, slip=False),
    Mistake("one axle shaft", axle_shafts=1),
    Mistake("one axle shaft, one tyre", axle_shafts=1, tyres=1),
    Mistake("one axle shaft, tyres rigid", axle_shafts=1, tyres=0, slip=False),
    Mistake("one axle shaft, tyres without slip", axle_shafts=1, slip=False),
    Mistake("one axle shaft, one tyre, without slip", axle_shafts=1, tyres=1, slip=False),
    Mistake("one tyre, without slip", tyres=1, slip=False),
    Mistake("propeller shaft not referred by i_fdr squared", slip=False, referred=False),
)


def two_mass(p: FullOrderParameters, mistake: Mistake, gear: int = 5, speed: float = 12.0,
             torque: float = 120.0) -> TwoMassParameters:
    """The 2DOF model lumped with a mistake in it; arguments as for ``reduced.reduce``.

    Shafts in series by their complex stiffness k + c s at the model's own vibration s, as there.
    """
    right = reduce(p, gear, speed, torque).two_mass
    i, i_fdr = right.gear.transmission_ratio, right.gear.final_drive_ratio
    driving, driven = right.engine_inertia * (i * i_fdr) ** 2, p.vehicle.mass * p.tyre.radius**2
    s = complex(-3.0, 40.0)
    for _ in range(500):
        parts = lumps(p, gear, s, speed, torque)
        referred = i_fdr**2 if mistake.referred else 1.0
        chain = [parts.transmission * referred, parts.propeller * referred,
                 0.5 * mistake.axle_shafts * parts.axle]
        if mistake.tyres:
            sidewall = p.tyre.stiffness + s * p.tyre.damping
            chain.append(mistake.tyres * (0.5 * parts.tyre if mistake.slip else sidewall))
        stiffness = series(*chain)
        new = 1j * np.sqrt(stiffness * (1.0 / driving + 1.0 / driven))
        change, s = abs(new - s), complex(0.5 * (s + new))
        if change < 1e-12 * abs(s):
            break
    at_shaft = stiffness / i_fdr**2
    damping = at_shaft.imag / s.imag
    shaft = replace(right.shaft, stiffness=at_shaft.real - damping * s.real, damping=damping)
    return replace(right, shaft=shaft)
