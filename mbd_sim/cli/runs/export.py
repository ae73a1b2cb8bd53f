"""`mbd_sim export` and `mbd_sim plot`: a run as a table, or as a picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import counted
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import (
    add_coordinates,
    add_plot_style,
    add_quiet,
    add_show,
    chosen_style,
    plotted_coordinates,
    shown_plots,
)
from mbd_sim.cli.shared.recorded_run import add_run, read_run_table, recorded_run
from mbd_sim.recordings.views import plots
from mbd_sim.recordings.views.panels import panels, require_names
from mbd_sim.recordings.views.table import export, require_table


def _add_export(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write: .csv, .parquet or .npz")
    add_quiet(parser)


def _export(options: argparse.Namespace) -> int:
    """Write the table."""
    require_table(options.out)
    with recorded_run(options.recording, options) as path:
        table = read_run_table(path, options.quiet, options.recording)
    columns = export(options.out, table)
    print(f"wrote {options.out}: {counted(len(table), 'row')} of {counted(columns, 'column')}")
    return 0


def _add_plot(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="file to write: .png, .svg, .pdf or .html"
    )
    add_show(parser)
    add_coordinates(parser)
    add_plot_style(parser)
    add_quiet(parser)


def _plot(options: argparse.Namespace) -> int:
    """Draw the plots."""
    plots.require_plot(options.out)
    style = chosen_style(options, options.out)
    names = shown_plots(options, options.out)
    require_names(names)  # before anything is run
    with recorded_run(options.recording, options, reactions="reactions" in names) as path:
        table = read_run_table(path, options.quiet, options.recording)
    chosen = panels(table, names, plotted_coordinates(options, options.out), degrees=options.deg)
    plots.draw(options.out, table, chosen, style)
    print(f"wrote {options.out}: {', '.join(dict.fromkeys(panel.title.lower() for panel in chosen))}")
    return 0


COMMANDS = {
    "export": Command(
        "Export a recorded run, or the run of a mechanism, as a flat table: one row per state, with the units in "
        "the column names.",
        _add_export,
        _export,
    ),
    "plot": Command(
        "Plot a recorded run, or the run of a mechanism, as a picture or as an HTML page with zoomable plots.",
        _add_plot,
        _plot,
    ),
}
