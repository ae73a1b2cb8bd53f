"""`mbd_sim export`: a recorded run as a table."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import counted
from mbd_sim.cli.shared.common import add_quiet, read_run_table
from mbd_sim.cli.shared.recorded_run import add_run, recorded_run

HELP = "export a run as a table, for example for pandas"
DESCRIPTION = (
    "Export a recorded run, or the run of a mechanism, as a flat table: one row per state, with the units in the "
    "column names."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_run(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write: .csv, .parquet or .npz")
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Write the table."""
    from mbd_sim.recordings.views import export
    from mbd_sim.recordings.views.plots import require_suffix

    require_suffix(options.out, export.SUFFIXES)
    export.require_packages_for(options.out)
    with recorded_run(options.recording, options) as path:
        table = read_run_table(path, options.quiet, options.recording)
    columns = export.export(options.out, table)
    print(f"wrote {options.out}: {counted(len(table), 'row')} of {counted(columns, 'column')}")
    return 0
