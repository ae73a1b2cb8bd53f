"""`mbd_sim bode`: frequency responses from chosen inputs to chosen outputs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from mbd_sim.base.errors import InputError
from mbd_sim.cli.shared.common import Waiting, positive_in
from mbd_sim.cli.shared.working_point import add_working_point, simulation_at
from mbd_sim.cli.studies.linearize import add_signals

if TYPE_CHECKING:
    from mbd_sim.analysis.linear.state_space import StateSpace
    from mbd_sim.base.geometry.pose import Array

HELP = "compute the frequency response from chosen inputs to chosen outputs"
DESCRIPTION = (
    "Compute the frequency response of small motions about a state, from chosen inputs to chosen outputs, such as the "
    "acceleration of a drive or of ground to that of a point, and write it as a table and as a Bode plot."
)

FROM, TO, POINTS = 0.1, 100.0, 500


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_working_point(parser)
    add_signals(parser)
    parser.add_argument(
        "--from", dest="least", type=positive_in("Hz"), default=FROM, metavar="HZ", help=f"(default {FROM:g})"
    )
    parser.add_argument("--to", dest="most", type=positive_in("Hz"), default=TO, metavar="HZ", help=f"(default {TO:g})")
    parser.add_argument(
        "--points",
        type=int,
        default=POINTS,
        metavar="N",
        help=f"frequencies on a logarithmic scale (default {POINTS})",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write a table: .csv, .parquet or .npz")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw magnitude and phase: .png, .svg or .pdf")


def execute(options: argparse.Namespace) -> int:
    """Compute the response, print its peaks, and write the table and the picture."""
    import numpy as np

    from mbd_sim.recordings.views.export import SUFFIXES, require_packages_for, write_columns
    from mbd_sim.recordings.views.plots import PICTURE_SUFFIXES, require_suffix
    from mbd_sim.studies.linear_analysis.plots import draw_bode

    if options.least >= options.most or options.points < 2:
        raise InputError("--from must be below --to, and --points at least 2", "Write --from 0.1 --to 100.")
    if options.plot is not None:
        require_suffix(options.plot, PICTURE_SUFFIXES)
    if options.out is not None:
        require_suffix(options.out, SUFFIXES)
        require_packages_for(options.out)
    simulation, state = simulation_at(options)
    Waiting.stage("linearize")
    system = simulation.state_space(options.input, options.output)
    frequencies = np.geomspace(options.least, options.most, options.points)
    response = system.response(frequencies)
    title = state.splitlines()[0]
    print("\n".join([title, *_peaks(system, frequencies, response)]))
    if options.out is not None:
        write_columns(options.out, _columns(system, frequencies, response), {"mechanism": simulation.mechanism.name})
    if options.plot is not None:
        Waiting.stage("draw")
        draw_bode(options.plot, system, frequencies, simulation.mechanism.name)
    for path in (options.out, options.plot):
        if path is not None:
            print(f"wrote {path}")
    return 0


def _peaks(system: StateSpace, frequencies: Array, response: Array) -> Iterator[str]:
    """For each pair a line with its magnitude at both ends and its largest one."""
    import numpy as np

    for row, output in enumerate(system.outputs):
        for column, given in enumerate(system.inputs):
            size = np.abs(response[:, row, column])
            if not np.any(size):
                yield f"  {output} / {given}: zero"
                continue
            peak = int(np.nanargmax(size))
            ends = f"{size[0]:.4g} at {frequencies[0]:.4g} Hz, {size[-1]:.4g} at {frequencies[-1]:.4g} Hz"
            yield f"  {output} / {given}: {ends}; largest {size[peak]:.4g} at {frequencies[peak]:.4g} Hz"


def _columns(system: StateSpace, frequencies: Array, response: Array) -> dict[str, Array]:
    import numpy as np

    found = {"frequency_Hz": frequencies}
    for row, output in enumerate(system.outputs):
        for column, given in enumerate(system.inputs):
            values = response[:, row, column]
            found[f"{output}/{given}.magnitude"] = np.abs(values)
            found[f"{output}/{given}.phase_deg"] = np.degrees(np.unwrap(np.angle(values)))
    return found
