"""`mbd_sim linearize` and `mbd_sim bode`: the matrices and the frequency response of small motions."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.analysis.linear.state_space import StateSpace
from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import positive_in, print_written
from mbd_sim.cli.shared.progress import Waiting
from mbd_sim.cli.shared.working_point import add_working_point, simulation_at
from mbd_sim.recordings.views.export import require_table, write_columns
from mbd_sim.recordings.views.plots import PICTURE_SUFFIXES, require_plot
from mbd_sim.studies.linear_analysis.plots import draw_bode


def _add_signals(parser: argparse.ArgumentParser) -> None:
    """Declare `--input` and `--output`."""
    parser.add_argument(
        "--input",
        action="append",
        metavar="NAME",
        help="such as efforts.elbow, drives.crank, base.x or forces.rod.tip.x; repeatable (default: all efforts and "
        "commands)",
    )
    parser.add_argument(
        "--output",
        action="append",
        metavar="NAME",
        help="such as joints.elbow.position, points.rod.tip.acceleration or sensors.imu; repeatable (default: the "
        "positions of all coordinates)",
    )


ROUND_OFF = 1e-14


def _add_linearize(parser: argparse.ArgumentParser) -> None:
    add_working_point(parser)
    _add_signals(parser)
    parser.add_argument("--json", action="store_true", help="print names, units and matrices as JSON")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write a table: .csv, .parquet or .npz; a row for the rate of each state and for each output, a column "
        "for each state and each input",
    )


def _linearize(options: argparse.Namespace) -> int:
    """Print the system."""
    require_table(options.out)
    simulation, state = simulation_at(options)
    Waiting.stage("linearize")
    system = simulation.state_space(options.input, options.output)
    if options.out is not None:
        write_columns(options.out, _columns(system), {"mechanism": simulation.mechanism.name})
    if options.json:
        print(json.dumps(_content(system), indent=2, ensure_ascii=False))
        return 0
    print(state)
    for name, matrix, rows, columns in (
        ("A", system.a, system.states, system.states),
        ("B", system.b, system.states, system.inputs),
        ("C", system.c, system.outputs, system.states),
        ("D", system.d, system.outputs, system.inputs),
    ):
        print("\n".join(_table(name, matrix, rows, columns)))
    if options.out is not None:
        print(f"wrote {options.out}")
    return 0


def _columns(system: StateSpace) -> dict[str, Any]:
    """The names of the rows, and a column for each state and each input: A and B above C and D."""
    whole = np.block([[system.a, system.b], [system.c, system.d]])
    rows = [f"rate of {name}" for name in system.states] + list(system.outputs)
    return {"row": np.array(rows), **dict(zip((*system.states, *system.inputs), whole.T, strict=True))}


def _content(system: StateSpace) -> dict[str, object]:
    return {
        "states": system.states,
        "inputs": dict(zip(system.inputs, system.input_units, strict=True)),
        "outputs": dict(zip(system.outputs, system.output_units, strict=True)),
        **{name: getattr(system, name.lower()).tolist() for name in "ABCD"},
    }


def _table(name: str, matrix: Array, rows: Sequence[str], columns: Sequence[str]) -> Iterator[str]:
    """A matrix with the names of its rows and columns."""
    yield f"\n{name} ({len(rows)} × {len(columns)})"
    if not matrix.size:
        return
    texts = [[f"{value:.6g}" for value in row] for row in without_round_off(matrix).tolist()]
    widths = [max(len(column), *(len(row[place]) for row in texts)) for place, column in enumerate(columns)]
    first = max(map(len, rows))
    yield " ".join([" " * first, *(f"{column:>{width}}" for column, width in zip(columns, widths, strict=True))])
    for row, values in zip(rows, texts, strict=True):
        yield " ".join([f"{row:<{first}}", *(f"{value:>{width}}" for value, width in zip(values, widths, strict=True))])


def without_round_off(matrix: Array) -> Array:
    """A matrix with 0 in place of entries that are round-off in comparison with their row and with their column."""
    size = np.abs(matrix)
    scale = np.minimum(size.max(axis=0, keepdims=True), size.max(axis=1, keepdims=True))
    return np.where(size <= ROUND_OFF * scale, 0.0, matrix)


FROM, TO, POINTS = 0.1, 100.0, 500


def _add_bode(parser: argparse.ArgumentParser) -> None:
    add_working_point(parser)
    _add_signals(parser)
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


def _bode(options: argparse.Namespace) -> int:
    """Compute the response, print its peaks, and write the table and the picture."""
    if options.least >= options.most or options.points < 2:
        raise InputError("--from must be below --to, and --points at least 2", "Write --from 0.1 --to 100.")
    require_plot(options.plot, PICTURE_SUFFIXES)
    require_table(options.out)
    simulation, state = simulation_at(options)
    Waiting.stage("linearize")
    system = simulation.state_space(options.input, options.output)
    frequencies = np.geomspace(options.least, options.most, options.points)
    response = system.response(frequencies)
    title = state.splitlines()[0]
    print("\n".join([title, *_peaks(system, frequencies, response)]))
    if options.out is not None:
        write_columns(
            options.out, _response_columns(system, frequencies, response), {"mechanism": simulation.mechanism.name}
        )
    if options.plot is not None:
        Waiting.stage("draw")
        draw_bode(options.plot, system, frequencies, simulation.mechanism.name)
    print_written(options.out, options.plot)
    return 0


def _peaks(system: StateSpace, frequencies: Array, response: Array) -> Iterator[str]:
    """For each pair a line with its magnitude at both ends and its largest one."""
    for row, output in enumerate(system.outputs):
        for column, given in enumerate(system.inputs):
            size = np.abs(response[:, row, column])
            if not np.any(size):
                yield f"  {output} / {given}: zero"
                continue
            peak = int(np.nanargmax(size))
            ends = f"{size[0]:.4g} at {frequencies[0]:.4g} Hz, {size[-1]:.4g} at {frequencies[-1]:.4g} Hz"
            yield f"  {output} / {given}: {ends}; largest {size[peak]:.4g} at {frequencies[peak]:.4g} Hz"


def _response_columns(system: StateSpace, frequencies: Array, response: Array) -> dict[str, Array]:
    found = {"frequency_Hz": frequencies}
    for row, output in enumerate(system.outputs):
        for column, given in enumerate(system.inputs):
            values = response[:, row, column]
            found[f"{output}/{given}.magnitude"] = np.abs(values)
            found[f"{output}/{given}.phase_deg"] = np.degrees(np.unwrap(np.angle(values)))
    return found


COMMANDS = {
    "linearize": Command(
        "Print x' = A x + B i, o = C x + D i for small motions about a state, with exact derivatives. Inputs are "
        "efforts, commands, forces, and the motion of drives and of ground; outputs those of joints, points, "
        "reactions, sensors and actuators: see docs/linear_analysis.md. A name also stands for all names that begin"
        " with it and a dot.",
        _add_linearize,
        _linearize,
    ),
    "bode": Command(
        "Compute the frequency response of small motions about a state, from chosen inputs to chosen outputs, such "
        "as the acceleration of a drive or of ground to that of a point, and write it as a table and as a Bode "
        "plot.",
        _add_bode,
        _bode,
    ),
}
