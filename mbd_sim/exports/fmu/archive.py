"""A Functional Mock-up Unit (FMI 3.0): its archive with description, sources, and a binary for this platform."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

from mbd_sim import __version__
from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.exports.c_code.model import ExportedModel
from mbd_sim.exports.c_code.module import c_module
from mbd_sim.exports.c_code.variables import Variable

COMPILERS = ("gcc", "cc", "clang")
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-fvisibility=hidden")
FUSED = ("-mfma", "-mavx2")  # on x86-64; the unit refuses to start on processors without them
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the time of all files, so that the same mechanism gives the same bytes

_MODEL_HEADER = """\
/* The names by which fmi3_functions.c calls {name}.c. */
#ifndef FMI3_MODEL_H
#define FMI3_MODEL_H

#include "{name}.h"

#define MODEL_TOKEN "{token}"
#define MODEL_STEP {step}
#define MODEL_STATES {states}
#define MODEL_NOMINALS {nominals} /* of the states */
#define MODEL_INPUTS {inputs}
#define MODEL_PARAMETERS {parameters}
#define MODEL_OUTPUTS {outputs}
#define MODEL_PROJECTS {projects} /* whether states are moved back to constraints or unit quaternions */
#define MODEL_ASSEMBLES {assembles} /* whether start values follow from parameters, or from each other */
#define MODEL_SAMPLED {sampled} /* whether something acts between fixed steps */

typedef {name}_state model_state;
typedef {name}_inputs model_inputs;
typedef {name}_parameters model_parameters;
typedef {name}_outputs model_outputs;
typedef {history} model_history;
#define model_start {name}_start
#define model_rates {name}_rates
#define model_project {name}_project
#define model_output {name}_output
#define model_step_between(state, history, ...) {name}_step_between(state, {passed}__VA_ARGS__)
#define model_tangent {name}_tangent
#if MODEL_ASSEMBLES
#define model_assemble {name}_assemble_given
#define model_unknown_start {name}_unknown_start
#endif

#endif
"""


def write_fmu(
    model: ExportedModel, path: Path, *, binary: bool = True, stage: Callable[[str], None] | None = None
) -> None:
    """Write an FMU for co-simulation and, without sampled controllers and delays, for model exchange.

    :param binary: compile the sources for this platform; without it the FMU is for tools that compile it.
    :param stage: called with the name of each stage when it begins.
    :raises InputError: there is no C compiler.
    :raises MbdSimError: it does not compile the sources.
    """
    begin = stage or (lambda _: None)
    begin("write the code")
    module = c_module(model, tangent=True, assembly=_assembles(model))
    token = hashlib.sha256("".join(module.values()).encode()).hexdigest()
    sources = {**module, **_interface_sources(model, token)}
    contents: dict[str, bytes] = {"modelDescription.xml": model_description(model, token).encode()}
    if binary:
        begin("compile the code")
        contents[f"binaries/{platform_tuple()}/{model.name}.so"] = _compiled(model.name, sources)
    contents |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    contents["sources/buildDescription.xml"] = build_description(model).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in contents.items():
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), content, zipfile.ZIP_DEFLATED)


def _assembles(model: ExportedModel) -> bool:
    """Whether start values follow from parameters, or from each other."""
    return bool(model.parameters or model.equations.rows)


def platform_tuple() -> str:
    """The platform of this machine as FMI names it, such as `x86_64-linux`."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    return f"{machine}-linux"


def _interface_sources(model: ExportedModel, token: str) -> Mapping[str, str]:
    """The sources of the interface by file name; the `token` identifies the module that they call."""
    generic, keeps = files("mbd_sim.exports.fmu") / "sources", model.methods[0].keeps_history
    return {
        "fmi3_model.h": _MODEL_HEADER.format(
            name=model.name,
            token=token,
            step=repr(model.step),
            states=len(model.states),
            inputs=len(model.inputs),
            parameters=len(model.parameters),
            outputs=len(model.output_variables),
            projects=int(model.equations.project is not None),
            assembles=int(_assembles(model)),
            sampled=int(model.between_steps is not None),
            nominals=", ".join(repr(state.nominal) for state in model.states),
            history=f"{model.name}_history" if keeps else "char",
            passed="history, " if keeps else "",
        ),
        **{name: (generic / name).read_text("utf-8") for name in ("fmi3_functions.c", "fmi3_types.h")},
    }


def _compiled(name: str, sources: Mapping[str, str]) -> bytes:
    """The shared library."""
    compiler = _compiler()
    is_x86 = platform_tuple().startswith("x86_64")
    fused, needed = (FUSED, ("-DMODEL_NEEDS_FMA",)) if is_x86 else ((), ())
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text, encoding="utf-8")
        for command in (
            [compiler, *FLAGS, *fused, "-c", f"{name}.c"],
            [compiler, *FLAGS, *needed, "-c", "fmi3_functions.c"],
            [compiler, "-shared", "-o", f"{name}.so", f"{name}.o", "fmi3_functions.o", "-lm"],
        ):
            done = subprocess.run(  # noqa: S603 - a compiler and fixed arguments
                command, cwd=folder, capture_output=True, text=True, check=False
            )
            if done.returncode:
                raise MbdSimError(f"{' '.join(command)} failed: {done.stderr.strip()[-2000:]}")
        return Path(folder, f"{name}.so").read_bytes()


def _compiler() -> str:
    """The C compiler: that of the variable CC, or the first of `COMPILERS`."""
    if (wanted := os.environ.get("CC")) and not shutil.which(wanted):
        raise InputError(f"CC={wanted}: there is no such compiler", "Set CC to the path of a C compiler, or unset it.")
    for name in (wanted, *COMPILERS):
        if name and (found := shutil.which(name)):
            return found
    remedy = "Install one, for example with 'apt install gcc'; or write an FMU without a binary: --sources-only."
    raise InputError("an FMU for this machine needs a C compiler, and there is none", remedy)


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
_NO_UNIT = {"", "1"}  # unknown, as of parameters, and that of pure numbers
_ENERGIES = ("work_applied", "work_drives", "dissipated")


@dataclass(frozen=True)
class UnitVariable:
    """A variable of the unit with its value reference."""

    reference: int
    variable: Variable
    causality: str
    variability: str
    initial: str = ""
    derivative_of: int | None = None


def entries(model: ExportedModel) -> list[UnitVariable]:
    """All variables but the time, in the order of their value references.

    States are outputs; energies of the audit and derivatives of states are local. A parameter with the name of another
    variable is called `parameters.NAME`.
    """
    others = {"time", *(one.name for one in (*model.states, *model.inputs, *model.output_variables))}
    found: list[UnitVariable] = []

    def add(variable: Variable, causality: str, variability: str, initial: str = "", of: int | None = None) -> None:
        found.append(UnitVariable(len(found) + 1, variable, causality, variability, initial, of))

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
    """The unit of the rate of a state; only those of coordinates and speeds have a name."""
    return {"m": "m/s", "m/s": "m/s2", "rad": "rad/s", "rad/s": "rad/s2"}.get(unit, "")


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
    for name in sorted({"s", *(entry.variable.unit for entry in variables)} - _NO_UNIT):
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


def _attributes(entry: UnitVariable) -> Iterator[tuple[str, str]]:
    variable = entry.variable
    yield "name", variable.name
    yield "valueReference", str(entry.reference)
    yield "causality", entry.causality
    yield "variability", entry.variability
    if entry.initial:
        yield "initial", entry.initial
    if entry.initial != "calculated":
        yield "start", repr(float(variable.start))
    if variable.unit not in _NO_UNIT:
        yield "unit", variable.unit
    if variable.nominal != 1.0:
        yield "nominal", repr(variable.nominal)
    if entry.derivative_of is not None:
        yield "derivative", str(entry.derivative_of)
    yield "description", variable.description


def _structure(root: ElementTree.Element, variables: list[UnitVariable]) -> None:
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
