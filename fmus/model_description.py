"""``modelDescription.xml`` of a model, from the declarations of its variables."""

from __future__ import annotations

import os
from collections.abc import Iterable
from datetime import UTC, datetime
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import __version__ as pythonfmu_version
from pythonfmu.fmi2slave import Fmi2Slave

from driveline.model import Model
from driveline.quantities import InputError, Variable

from .units import base_unit

_CAPABILITIES = {
    # the host has to bring Python and numpy
    "needsExecutionTool": "true",
    "canHandleVariableCommunicationStepSize": "true",
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
}
_VARIABILITIES = {
    "parameter": ("fixed", "tunable"),
    "input": ("discrete", "continuous"),
    "output": ("discrete", "continuous"),
}
_STOP_TIME = 10.0


def _text(value: float, kind: str) -> str:
    """A number as XML, such that reading it gives the same double."""
    if kind == "real":
        return repr(float(value))
    return str(int(value)) if kind == "integer" else str(bool(value)).lower()


def _scalar_variable(reference: int, variable: Variable, start: float) -> Element:
    kind = variable.kind
    if variable.variability not in _VARIABILITIES.get(variable.causality, ()):
        possible = " or ".join(_VARIABILITIES.get(variable.causality, ()))
        raise InputError(f"{variable.name} is declared {variable.causality} and {variable.variability}: "
                         f"{possible or 'parameter, input or output'} is possible")
    discrete = variable.variability == "continuous" and kind != "real"
    element = Element("ScalarVariable", {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.meaning,
        "causality": variable.causality,
        "variability": "discrete" if discrete else variable.variability,
    })
    initial = {"parameter": "exact", "output": "calculated"}.get(variable.causality)
    if initial:
        element.set("initial", initial)
    typed = SubElement(element, kind.capitalize())
    if kind == "real":
        typed.set("unit", variable.unit)
    if kind != "boolean":
        for attribute, value in (("min", variable.minimum), ("max", variable.maximum)):
            if value is not None:
                typed.set(attribute, _text(value, kind))
    if kind == "real" and variable.nominal is not None:
        typed.set("nominal", _text(variable.nominal, kind))
    if variable.causality != "output":
        typed.set("start", _text(start, kind))
    return element


def _unknown(index: int, dependencies: Iterable[int]) -> Element:
    known = [str(i) for i in dependencies]
    return Element("Unknown", {
        "index": str(index),
        "dependencies": " ".join(known),
        "dependenciesKind": " ".join(["dependent"] * len(known)),
    })


def generation_time() -> datetime | None:
    """The time a build says it was made at: SOURCE_DATE_EPOCH, and none where that is not set."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    return datetime.fromtimestamp(int(epoch), UTC) if epoch else None


def model_description(model: Model, identifier: str, version: str) -> Element:
    """The ``fmiModelDescription`` element, with an empty GUID.

    Args:
        model: Its variables are declared, its ``values`` become the start values.
        identifier: Name of the FMU and of its binaries.
        version: What identifies the code inside.

    Raises:
        InputError: A variable's unit, or its causality and variability together, cannot be declared.
    """
    root = Element("fmiModelDescription", {
        "fmiVersion": "2.0",
        "modelName": identifier,
        "guid": "",
        "description": model.description,
        "version": version,
        "generationTool": f"PythonFMU {pythonfmu_version}",
        "variableNamingConvention": "structured",
    })
    if made := generation_time():
        root.set("generationDateAndTime", made.strftime("%Y-%m-%dT%H:%M:%SZ"))
    SubElement(root, "CoSimulation", {"modelIdentifier": identifier, **_CAPABILITIES})

    units = SubElement(root, "UnitDefinitions")
    for unit in sorted({v.unit for v in model.variables if v.kind == "real"}):
        definition = SubElement(units, "Unit", {"name": unit})
        if (attributes := base_unit(unit)) is not None:
            SubElement(definition, "BaseUnit", {name: repr(value) for name, value in attributes.items()})

    categories = SubElement(root, "LogCategories")
    for name, description in Fmi2Slave.log_categories.items():
        SubElement(categories, "Category", {"name": name, "description": description})
    SubElement(root, "DefaultExperiment", {
        "startTime": "0.0", "stopTime": repr(_STOP_TIME), "stepSize": repr(model.default_step)})

    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(model.variables):
        variables.append(_scalar_variable(reference, variable, float(model.values[reference])))

    # XML counts variables from 1; at initialisation an output may depend on everything that is set
    index = {variable.name: i for i, variable in enumerate(model.variables, start=1)}
    outputs = [v for v in model.variables if v.causality == "output"]
    set_before = [i for v, i in zip(model.variables, index.values(), strict=True) if v.causality != "output"]
    structure = SubElement(root, "ModelStructure")
    if outputs:
        nodes = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
        for variable in outputs:
            nodes[0].append(_unknown(index[variable.name], sorted(index[d] for d in variable.depends_on)))
            nodes[1].append(_unknown(index[variable.name], set_before))
    return root


def as_bytes(root: Element) -> bytes:
    """The document, indented, UTF-8."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
