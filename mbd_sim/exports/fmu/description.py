"""`modelDescription.xml` and `buildDescription.xml` of a Functional Mock-up Unit (FMI 3.0, sec. 2.4 and 2.5)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, replace

from mbd_sim import __version__
from mbd_sim.exports.c_code.model import ExportedModel
from mbd_sim.exports.c_code.variables import Variable

FMI_VERSION = "3.0"
# The exponents of SI base units of each unit.
_UNITS: dict[str, dict[str, int]] = {
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "A": {"A": 1},
    "s": {"s": 1},
}
_ENERGIES = ("work_applied", "work_drives", "dissipated")


@dataclass(frozen=True)
class Entry:
    """A variable of the unit with its value reference."""

    reference: int
    variable: Variable
    causality: str
    variability: str
    initial: str = ""
    derivative_of: int | None = None


def entries(model: ExportedModel) -> list[Entry]:
    """All variables but the time, in the order of their value references.

    States are outputs; energies of the audit and derivatives of states are local. A parameter with the name of another
    variable is called `parameters.NAME`.
    """
    others = {"time", *(one.name for one in (*model.states, *model.inputs, *model.output_variables))}
    found: list[Entry] = []

    def add(variable: Variable, causality: str, variability: str, initial: str = "", of: int | None = None) -> None:
        found.append(Entry(len(found) + 1, variable, causality, variability, initial, of))

    for state in model.states:
        add(state, "local" if state.name in _ENERGIES else "output", "continuous", "exact")
    for given in model.inputs:
        add(given, "input", "continuous")
    for parameter in model.parameters:
        name = f"parameters.{parameter.name}" if parameter.name in others else parameter.name
        add(replace(parameter, name=name), "parameter", "tunable", "exact")
    for output in model.output_variables:
        add(output, "output", "continuous", "calculated")
    if model.between_steps is None:
        for index, state in enumerate(model.states, 1):
            rate = Variable(
                f"der_{state.field}", f"der({state.name})", _per_second(state.unit), f"rate of {state.name}"
            )
            add(rate, "local", "continuous", "calculated", index)
    return found


def _per_second(unit: str) -> str:
    rate = {"m": "m/s", "m/s": "m/s2", "rad": "rad/s", "rad/s": "rad/s2"}.get(unit, "")
    return rate if rate in _UNITS else ""


def model_description(model: ExportedModel, token: str) -> str:
    """The text of `modelDescription.xml`; the `token` identifies what the binary is made of."""
    mechanism, variables = model.mechanism, entries(model)
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion=FMI_VERSION,
        modelName=mechanism.name,
        instantiationToken=token,
        description=" ".join(mechanism.description.split()),
        generationTool=f"mbd_sim {__version__}",
        variableNamingConvention="flat",
    )
    _interfaces(root, model)
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for name in sorted({"s", *(entry.variable.unit for entry in variables)} & _UNITS.keys()):
        exponents = {base: str(exponent) for base, exponent in _UNITS[name].items()}
        ElementTree.SubElement(ElementTree.SubElement(units, "Unit", name=name), "BaseUnit", exponents)
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="errors", description="what cannot be done, and the remedy")
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(model.step))
    listed = ElementTree.SubElement(root, "ModelVariables")
    ElementTree.SubElement(
        listed, "Float64", name="time", valueReference="0", causality="independent", variability="continuous", unit="s"
    )
    for entry in variables:
        ElementTree.SubElement(listed, "Float64", dict(_attributes(entry)))
    _structure(root, variables)
    return _text(root)


def _interfaces(root: ElementTree.Element, model: ExportedModel) -> None:
    """The two interfaces; sampled controllers and delays act between fixed steps, which only co-simulation takes."""
    sampled, projects = model.between_steps is not None, model.equations.project is not None
    common = {
        "modelIdentifier": model.name,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
    }
    if not sampled:
        ElementTree.SubElement(
            root, "ModelExchange", {**common, "needsCompletedIntegratorStep": "true" if projects else "false"}
        )
    variable = "false" if sampled else "true"
    further = {"canHandleVariableCommunicationStepSize": variable, "fixedInternalStepSize": repr(model.step)}
    ElementTree.SubElement(root, "CoSimulation", {**common, **further})


def _attributes(entry: Entry) -> Iterator[tuple[str, str]]:
    variable = entry.variable
    yield "name", variable.name
    yield "valueReference", str(entry.reference)
    yield "causality", entry.causality
    yield "variability", entry.variability
    if entry.initial:
        yield "initial", entry.initial
    if entry.initial != "calculated":
        yield "start", repr(float(variable.start))
    if variable.unit in _UNITS:
        yield "unit", variable.unit
    if variable.nominal != 1.0:
        yield "nominal", repr(variable.nominal)
    if entry.derivative_of is not None:
        yield "derivative", str(entry.derivative_of)
    yield "description", variable.description


def _structure(root: ElementTree.Element, variables: list[Entry]) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    derivatives = [entry for entry in variables if entry.derivative_of is not None]
    outputs = [entry for entry in variables if entry.causality == "output"]
    calculated = [entry for entry in outputs if entry.initial == "calculated"]
    for kind, listed in (
        ("Output", outputs),
        ("ContinuousStateDerivative", derivatives),
        ("InitialUnknown", [*calculated, *derivatives]),
    ):
        for entry in listed:
            ElementTree.SubElement(structure, kind, valueReference=str(entry.reference))


def build_description(model: ExportedModel) -> str:
    """The text of `sources/buildDescription.xml`, for tools that compile the sources."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion=FMI_VERSION)
    configuration = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=model.name)
    sources = ElementTree.SubElement(configuration, "SourceFileSet", language="C99")
    for name in (f"{model.name}.c", "fmi3_functions.c"):
        ElementTree.SubElement(sources, "SourceFile", name=name)
    ElementTree.SubElement(configuration, "Library", name="m")
    return _text(root)


def _text(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
