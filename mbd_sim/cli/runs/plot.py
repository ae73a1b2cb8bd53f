"""`mbd_sim plot`: a recorded run as a picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.cli.shared.common import add_quiet, read_run_table
from mbd_sim.cli.shared.plot_options import (
    add_coordinates,
    add_plot_style,
    add_show,
    chosen_style,
    plotted_coordinates,
    shown_plots,
)
from mbd_sim.cli.shared.recorded_run import add_run, recorded_run

HELP = "plot energies, joints, residual, measurements and phase portrait of a run"
DESCRIPTION = "Plot a recorded run, or the run of a mechanism, as a picture or as an HTML page with zoomable plots."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_run(parser)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="file to write: .png, .svg, .pdf or .html"
    )
    add_show(parser)
    add_coordinates(parser)
    add_plot_style(parser)
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Draw the plots."""
    from mbd_sim.recordings.views import plots
    from mbd_sim.recordings.views.panels import panels
    from mbd_sim.recordings.views.plots import PLOT_SUFFIXES, require_plot_packages, require_suffix

    require_suffix(options.out, PLOT_SUFFIXES)
    require_plot_packages(options.out)
    style = chosen_style(options, options.out)
    names = shown_plots(options, options.out)
    with recorded_run(options.recording, options, reactions="reactions" in names) as path:
        table = read_run_table(path, options.quiet, options.recording)
    chosen = panels(table, names, plotted_coordinates(options, options.out), degrees=options.deg)
    plots.draw(options.out, table, chosen, style)
    print(f"wrote {options.out}: {', '.join(dict.fromkeys(panel.title.lower() for panel in chosen))}")
    return 0
