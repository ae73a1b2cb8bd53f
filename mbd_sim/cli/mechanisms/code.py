"""`mbd_sim c-code` and `mbd_sim fmu`: a mechanism as code, for programs without this package."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import InputError, counted
from mbd_sim.cli.shared.command import Command, Waiting
from mbd_sim.cli.shared.common import add_mechanism, add_method_and_step, add_repeatable, print_notes
from mbd_sim.cli.shared.setup_options import add_set, changed_mechanism
from mbd_sim.exports.c_code.model import ExportedModel, export_model
from mbd_sim.exports.c_code.module import c_module
from mbd_sim.exports.fmu.archive import platform_tuple, write_fmu


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what is exported as code."""
    add_mechanism(parser)
    add_method_and_step(parser, "from the file")
    add_set(parser)
    add_repeatable(
        parser,
        "--parameter",
        "KEY",
        "a number of the file that stays variable, such as l or parts.rod.mass; repeatable",
    )
    add_repeatable(parser, "--wrench", "PART", "a part on which forces can act; repeatable")


def _exported(options: argparse.Namespace) -> ExportedModel:
    """The mechanism that the options describe, traced for code; what is left out is printed as notes.

    :raises MechanismError: it cannot be exported, see `export_model`.
    """
    mechanism = changed_mechanism(options)
    Waiting.stage("derive the equations")
    model = export_model(
        mechanism,
        method=options.method,
        step=options.step,
        parameters=options.parameter,
        wrenches=options.wrench,
    )
    print_notes(model.remarks)
    return model


def _add_c_code(parser: argparse.ArgumentParser) -> None:
    _add_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder for NAME.h and NAME.c")


def _write_c_code(options: argparse.Namespace) -> int:
    """Write the header and the source."""
    model = _exported(options)
    Waiting.stage("write the code")
    files = c_module(model)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        Path(options.out, name).write_text(text, encoding="utf-8")
    names = " and ".join(str(Path(options.out, name)) for name in files)
    methods = ", ".join(method.name for method in model.methods)
    states, inputs = counted(len(model.states), "state"), counted(len(model.inputs), "input")
    print(f"wrote {names}: {states}, {inputs}, steps of {methods}")
    return 0


def _add_fmu(parser: argparse.ArgumentParser) -> None:
    _add_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write: .fmu")
    parser.add_argument(
        "--sources-only", action="store_true", help="without a binary, for tools that compile the sources themselves"
    )


def _write_fmu(options: argparse.Namespace) -> int:
    """Write the FMU.

    :raises InputError: the file is not called .fmu, or there is no C compiler.
    """
    if options.out.suffix != ".fmu":
        raise InputError(f"{options.out}: an FMU has the suffix .fmu", f"Write {options.out.with_suffix('.fmu')}.")
    model = _exported(options)
    if model.between_steps is not None:
        print("note: sampled controllers and delays act between fixed steps: the FMU is for co-simulation only")
    write_fmu(model, options.out, binary=not options.sources_only, stage=Waiting.stage)
    platform = "sources only" if options.sources_only else f"{platform_tuple()} and sources"
    variables = {"input": model.inputs, "parameter": model.parameters, "output": model.output_variables}
    counts = ", ".join(counted(len(found), noun) for noun, found in variables.items())
    print(f"wrote {options.out}: {platform}, {counts}, steps of {model.step:g} s with {model.methods[0].name}")
    return 0


COMMANDS = {
    "c-code": Command(
        "Write the equations of motion of a mechanism as a C99 module without dependencies: its state, inputs, "
        "rates, outputs, and steps with the bits of the simulation.",
        _add_c_code,
        _write_c_code,
    ),
    "fmu": Command(
        "Write a mechanism as a Functional Mock-up Unit (FMI 3.0) for co-simulation and model exchange, with its C "
        "sources and a binary for this platform, which gcc compiles.",
        _add_fmu,
        _write_fmu,
    ),
}
