"""`mbd_sim fmu`: a mechanism as a Functional Mock-up Unit."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import InputError, counted
from mbd_sim.cli.shared.common import Waiting
from mbd_sim.cli.shared.setup_options import add_export, exported_model

HELP = "write a mechanism as an FMU, for use in other simulation tools"
DESCRIPTION = (
    "Write a mechanism as a Functional Mock-up Unit (FMI 3.0) for co-simulation and model exchange, with its C sources "
    "and a binary for this platform, which gcc compiles."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_export(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write: .fmu")
    parser.add_argument(
        "--sources-only", action="store_true", help="without a binary, for tools that compile the sources themselves"
    )


def execute(options: argparse.Namespace) -> int:
    """Write the FMU.

    :raises InputError: the file is not called .fmu, or there is no C compiler.
    """
    from mbd_sim.exports.fmu.archive import platform_tuple, write_fmu

    if options.out.suffix != ".fmu":
        raise InputError(f"{options.out}: an FMU has the suffix .fmu", f"Write {options.out.with_suffix('.fmu')}.")
    model = exported_model(options)
    if model.between_steps is not None:
        print("note: sampled controllers and delays act between fixed steps: the FMU is for co-simulation only")
    write_fmu(model, options.out, binary=not options.sources_only, stage=Waiting.stage)
    platform = "sources only" if options.sources_only else f"{platform_tuple()} and sources"
    variables = {"input": model.inputs, "parameter": model.parameters, "output": model.output_variables}
    counts = ", ".join(counted(len(found), noun) for noun, found in variables.items())
    print(f"wrote {options.out}: {platform}, {counts}, steps of {model.step:g} s with {model.methods[0].name}")
    return 0
