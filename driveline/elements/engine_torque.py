"""Engine torque at the crankshaft: air path, spark path, uncertainty, friction, accessories.

The request is a brake torque: the control unit adds its friction model to get the indicated
torque it asks of the air path, and cannot ask for less than none (fuel cut). So

    indicated target = clip(request(t - delay) + friction(speed), 0, maximum)
    air path         lag * air' = target - air
    crankshaft       gain * spark_efficiency * air + offset + noise - friction - accessories

Source: thesis section 2.1.1 (base path, instantaneous path, torque uncertainty).
"""

from __future__ import annotations

from dataclasses import dataclass

from ..kernels.backend import kernel
from ..quantities import quantity
from .fade import fade

# Below about this speed [rad/s] friction, accessories and disturbances fade out: a standing
# engine is turned by nothing.
FADE_SPEED = 5.0


@dataclass(frozen=True)
class EngineTorque:
    """Crankshaft inertia and everything between the torque request and the crankshaft."""

    inertia: float = quantity("kg.m2", "crankshaft and flexplate or primary flywheel", minimum=1e-3, nominal=0.3)
    air_lag: float = quantity("s", "first-order lag of the air path", minimum=0.0)
    air_delay: float = quantity("s", "transport delay of the air path", minimum=0.0, maximum=1.0)
    torque_gain: float = quantity("1", "delivered over estimated indicated torque", minimum=0.0, tunable=True)
    torque_offset: float = quantity("N.m", "error of the estimated torque", tunable=True)
    torque_noise: float = quantity("N.m", "standard deviation of the torque noise", minimum=0.0, tunable=True)
    noise_period: float = quantity("s", "time for which one noise value holds", minimum=1e-4)
    noise_seed: int = quantity("1", "seed of the torque noise", kind="integer", minimum=0, maximum=2**31 - 1)
    friction_constant: float = quantity("N.m", "engine friction, constant part", minimum=0.0)
    friction_viscous: float = quantity("N.m.s/rad", "engine friction over speed", minimum=0.0)
    accessory_torque: float = quantity("N.m", "alternator, fan, pumps: not in the request", minimum=0.0, tunable=True)
    idle_speed: float = quantity("rad/s", "speed below which the idle governor adds torque", minimum=0.0)
    idle_gain: float = quantity("N.m.s/rad", "gain of the idle governor", minimum=0.0)
    maximum_torque: float = quantity("N.m", "largest indicated torque", minimum=0.0, nominal=500.0)


@kernel
def engine_friction(speed, constant, viscous):
    """Friction torque of the running engine [N.m], fading out at standstill."""
    return constant * fade(speed / FADE_SPEED) + viscous * speed


@kernel
def indicated_target(request, speed, friction, maximum, idle_speed, idle_gain):
    """Indicated torque [N.m] the control unit asks of the air path."""
    target = request + friction
    governed = idle_gain * (idle_speed - speed)
    if governed > target:
        target = governed
    if target < 0.0:
        target = 0.0
    if target > maximum:
        target = maximum
    return target
