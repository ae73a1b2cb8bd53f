"""`mbd_sim export`: a recorded run as a table."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.cli.common import ANY_RECORDING, add_quiet, add_recording, read_run_table

HELP = "export a recorded run as a table, for example for pandas"
DESCRIPTION = "Export a recorded run as a flat table: one row per state, with the units in the column names."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_recording(parser, ANY_RECORDING)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write: .csv, .parquet or .npz")
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Write the table."""
    from mbd_sim.playback import table_export
    from mbd_sim.playback.plot_files import require_suffix

    require_suffix(options.out, table_export.SUFFIXES)
    table = read_run_table(options.recording, options.quiet)
    columns = table_export.export(options.out, table)
    print(f"wrote {options.out}: {len(table)} rows of {columns} columns")
    return 0
