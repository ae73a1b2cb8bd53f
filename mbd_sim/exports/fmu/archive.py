"""The archive of a Functional Mock-up Unit: description, sources, and a binary for this platform."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path

from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.exports.c_code.model import ExportedModel
from mbd_sim.exports.c_code.module import c_module
from mbd_sim.exports.fmu.description import build_description, model_description

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
