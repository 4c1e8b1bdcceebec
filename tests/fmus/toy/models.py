"""A sprung mass as payload of a test FMU: each kind of variable, and state that no variable shows."""

from .model import Model
from .quantities import Variable

GAIN = 1.0  # the tests build a second payload with another number here


class SprungMass(Model):
    """Mass on a spring, pushed by a force through a gear table."""

    name = "toy"
    description = "Mass on a spring"
    variables = (
        Variable("mass.inertia", "kg", "Mass", start=2.0, minimum=1e-3),
        Variable("spring.stiffness", "N/m", "Stiffness", variability="tunable", start=50.0, minimum=0.0),
        Variable("gear.gain[1]", "1", "Gain of gear 1", start=1.0),
        Variable("gear.gain[2]", "1", "Gain of gear 2", start=1.0 / 3.0),
        Variable("force", "N", "Force on the mass", "input", "continuous", nominal=10.0),
        Variable("gear", "1", "Engaged gear", "input", "discrete", "integer", 1, 1, 2),
        Variable("locked", "1", "Brake is on", "input", "discrete", "boolean"),
        Variable("mass.position", "m", "Position", "output", "continuous"),
        Variable("mass.velocity", "m/s", "Velocity", "output", "continuous"),
        Variable("engaged_gear", "1", "Gear used", "output", "discrete", "integer", depends_on=("gear",)),
        Variable("moving", "1", "Velocity is not zero", "output", "discrete", "boolean"),
    )

    def __init__(self, defaults: dict[str, float]) -> None:
        super().__init__()
        for name, value in defaults.items():
            self[name] = value
        self.log.append("no compiled kernel: running in plain Python")

    def _prepare(self) -> None:
        self.state = self.values[:3] * 0.0  # position, velocity, and the number of steps so far
        self.retune()

    def _initialize(self, start_time: float) -> None:
        self.state[:] = 0.0
        self._show()

    def retune(self) -> None:
        self._per_mass = GAIN / self["mass.inertia"]
        self._spring = self["spring.stiffness"] * self._per_mass

    def _step(self, time: float, dt: float) -> None:
        position, velocity, steps = self.state
        gain = self[f"gear.gain[{int(self['gear'])}]"]
        # the hidden count matters, so that a snapshot without it gives other numbers
        velocity += dt * (gain * self["force"] * self._per_mass - self._spring * position + 1e-3 * steps)
        velocity *= 1.0 - self["locked"]
        self.state[:] = position + dt * velocity, velocity, steps + 1.0
        self._show()

    def _show(self) -> None:
        self.values[7:] = self.state[0], self.state[1], self["gear"], self.state[1] != 0.0


MODELS = {"toy": SprungMass}
