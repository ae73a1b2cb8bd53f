"""`mbd_sim linearize`: the matrices of small motions, with chosen inputs and outputs."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbd_sim.cli.shared.common import Waiting
from mbd_sim.cli.shared.working_point import add_working_point, simulation_at

if TYPE_CHECKING:
    from mbd_sim.analysis.linear.state_space import StateSpace
    from mbd_sim.base.geometry.pose import Array

HELP = "print the state-space model of small motions: A, B, C, D with chosen inputs and outputs"
DESCRIPTION = (
    "Print x' = A x + B i, o = C x + D i for small motions about a state, with exact derivatives. Inputs are efforts, "
    "commands, forces, and the motion of drives and of ground; outputs those of joints, points, reactions, sensors and "
    "actuators: see docs/linear_analysis.md. A name also stands for all names that begin with it and a dot."
)


def add_signals(parser: argparse.ArgumentParser) -> None:
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_working_point(parser)
    add_signals(parser)
    parser.add_argument("--json", action="store_true", help="print names, units and matrices as JSON")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write a table: .csv, .parquet or .npz; a row for the rate of each state and for each output, a column "
        "for each state and each input",
    )


def execute(options: argparse.Namespace) -> int:
    """Print the system."""
    from mbd_sim.recordings.views.export import SUFFIXES, require_packages_for, write_columns
    from mbd_sim.recordings.views.plots import require_suffix

    if options.out is not None:
        require_suffix(options.out, SUFFIXES)
        require_packages_for(options.out)
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
    import numpy as np

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
    texts = [[f"{value:.6g}" for value in row] for row in settled(matrix).tolist()]
    widths = [max(len(column), *(len(row[place]) for row in texts)) for place, column in enumerate(columns)]
    first = max(map(len, rows))
    yield " ".join([" " * first, *(f"{column:>{width}}" for column, width in zip(columns, widths, strict=True))])
    for row, values in zip(rows, texts, strict=True):
        yield " ".join([f"{row:<{first}}", *(f"{value:>{width}}" for value, width in zip(values, widths, strict=True))])


def settled(matrix: Array) -> Array:
    """A matrix with 0 in place of entries that are round-off in comparison with their row and with their column."""
    import numpy as np

    size = np.abs(matrix)
    scale = np.minimum(size.max(axis=0, keepdims=True), size.max(axis=1, keepdims=True))
    return np.where(size <= ROUND_OFF * scale, 0.0, matrix)
