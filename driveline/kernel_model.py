"""A model that is declared by a dataclass of parameters and steps by a compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from .kernels import native
from .model import Model
from .quantities import Variable, from_values, parameter_variables


class KernelModel(Model):
    """What plants and estimators share: variables from declarations, views for the kernel.

    Subclasses give ``Parameters`` (a dataclass of quantities), ``inputs``, ``output_variables`` and
    ``entry_point`` (name of the step's kernel). Inputs come first in ``values``, then outputs, then
    parameters, so that the kernel reads and writes them in place.

    Args:
        defaults: Start values by structured name; all of ``Parameters`` that have no default of
            their own.
        backend: ``auto``, ``native`` or ``python``; see ``kernels.native``.
    """

    Parameters: ClassVar[type]
    inputs: ClassVar[tuple[Variable, ...]] = ()
    output_variables: ClassVar[tuple[Variable, ...]] = ()
    entry_point: ClassVar[str]

    def __init__(self, defaults: Mapping[str, float], backend: str = "auto") -> None:
        parameters = from_values(self.Parameters, defaults)
        self.variables = (*self.inputs, *self.output_variables, *parameter_variables(parameters))
        super().__init__()
        for name in defaults:
            if name in self.index:
                self.values[self.index[name]] = defaults[name]
        n_in, n_out = len(self.inputs), len(self.output_variables)
        self._inputs = self.values[:n_in]
        self._outputs = self.values[n_in:n_in + n_out]
        self._kernel = native.load(self.entry_point, backend)
        if self._kernel.backend == "python":
            self.log.append(native.describe(backend))

    @property
    def parameters(self) -> Any:
        """The parameters as they stand, as an instance of ``Parameters``."""
        names = [v.name for v in self.variables if v.causality == "parameter"]
        return from_values(self.Parameters, {name: self.values[self.index[name]] for name in names})

    def retune(self) -> None:
        """Take over tunable parameters changed during a run; the state stays."""
        if self.state.size == 0:
            return
        self._check("parameter")
        state = self.state.copy()
        self._prepare()
        self.state[:] = state
