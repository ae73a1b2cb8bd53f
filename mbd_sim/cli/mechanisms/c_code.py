"""`mbd_sim c-code`: a mechanism as C code without dependencies."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import counted
from mbd_sim.cli.shared.common import Waiting
from mbd_sim.cli.shared.setup_options import add_export, exported_model

HELP = "write the equations of motion of a mechanism and steps of them as C code"
DESCRIPTION = (
    "Write the equations of motion of a mechanism as a C99 module without dependencies: its state, inputs, rates, "
    "outputs, and steps with the bits of the simulation."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_export(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder for NAME.h and NAME.c")


def execute(options: argparse.Namespace) -> int:
    """Write the header and the source."""
    from mbd_sim.exports.c_code.module import c_module

    model = exported_model(options)
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
