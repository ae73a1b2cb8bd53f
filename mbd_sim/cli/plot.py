"""`mbd_sim plot`: a recorded run as a picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.cli.common import ANY_RECORDING, add_quiet, add_recording, read_run_table

HELP = "plot energies, joints, residual and phase portrait of a recorded run"
DESCRIPTION = "Plot a recorded run as a picture, or as an HTML page with zoomable plots."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_recording(parser, ANY_RECORDING)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="file to write: .png, .svg, .pdf or .html"
    )
    parser.add_argument(
        "--show",
        metavar="PANELS",
        default="",
        help="comma-separated list of energies, joints, residual, phase (default: all that the recording allows)",
    )
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Draw the plots."""
    from mbd_sim.playback import run_plots
    from mbd_sim.playback.panels import panels
    from mbd_sim.playback.plot_files import PLOT_SUFFIXES, require_suffix

    require_suffix(options.out, PLOT_SUFFIXES)
    table = read_run_table(options.recording, options.quiet)
    chosen = panels(table, [name.strip() for name in options.show.split(",") if name.strip()])
    run_plots.draw(options.out, table, chosen)
    print(f"wrote {options.out}: {', '.join(dict.fromkeys(panel.title.lower() for panel in chosen))}")
    return 0
