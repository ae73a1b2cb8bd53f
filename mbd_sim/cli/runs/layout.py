"""`mbd_sim layout`: plots of a mechanism in Foxglove and PlotJuggler."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_mechanism, print_written
from mbd_sim.files.load import load_mechanism
from mbd_sim.recordings.views.layouts import SUFFIXES, write_layout
from mbd_sim.recordings.views.table import require_suffix


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="file to write: .json for Foxglove, .xml for PlotJuggler",
    )
    parser.add_argument("--namespace", default="", metavar="NAME", help="of the node, such as /left (default: none)")
    parser.add_argument("--node", default="sim_node", metavar="NAME", help="name of the node (default sim_node)")


def _execute(options: argparse.Namespace) -> int:
    """Write the layout."""
    require_suffix(options.out, SUFFIXES)
    write_layout(options.out, load_mechanism(options.mechanism), options.namespace, options.node)
    print_written(options.out)
    return 0


COMMANDS = {
    "layout": Command(
        "Write a layout with the mechanism, its positions, velocities, efforts, energies and measurements: a .json "
        "file for Foxglove, or an .xml file for PlotJuggler. Both show recordings and the topics of a running node.",
        _add_arguments,
        _execute,
    ),
}
