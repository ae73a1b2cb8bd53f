"""`mbd_sim linearize`, `bode` and `modes`: matrices, frequency response and natural modes of small motions."""

from __future__ import annotations

import argparse
import cmath
import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.analysis.linear.state_space import StateSpace
from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.cli.shared.command import COUNT, Command, ProgressBar, Waiting
from mbd_sim.cli.shared.common import add_quiet, add_repeatable, positive_in, print_notes, print_written
from mbd_sim.cli.shared.setup_options import build_simulation
from mbd_sim.cli.shared.working_point import (
    EQUILIBRIUM,
    START,
    add_working_point,
    equilibrium_text,
    place_text,
    simulation_at,
)
from mbd_sim.many.sweep.plan import Grid, bare_variation_remark, variation
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.animation import SUFFIXES as ANIMATIONS
from mbd_sim.recordings.views.plots import PICTURE_SUFFIXES, require_plot
from mbd_sim.recordings.views.table import require_suffix, require_table, write_columns
from mbd_sim.studies.linear_analysis.loci import EigenvalueLocus, eigenvalue_locus, equilibria_of
from mbd_sim.studies.linear_analysis.plots import ModeShape, animate_mode, draw_bode, draw_locus, mode_shapes


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


SHOWN = 1e-6  # entries of a shape below this are shown as zero


def _add_modes(parser: argparse.ArgumentParser) -> None:
    add_working_point(parser)
    parser.add_argument(
        "--equilibria", action="store_true", help="list the equilibria that are found near the start, the nearest first"
    )
    parser.add_argument("--animate", type=Path, metavar="FILE", help="animate a mode: .gif, .webp, .mp4 or .html")
    parser.add_argument("--mode", type=int, default=1, metavar="N", help="the mode for --animate (default 1)")
    add_repeatable(
        parser,
        "--vary",
        "KEY=VALUES",
        "vary a value of the file: joints.elbow.damping=0:2:50 (50 values from 0 to 2) or l=0.5,1,2; give it two "
        "times for a stability map",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write a table of the modes, or of the eigenvalues over --vary: .csv, .parquet or .npz",
    )
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="with --vary, draw it: .png, .svg or .pdf")
    add_quiet(parser)


def _modes(options: argparse.Namespace) -> int:
    """Print the modes, or the eigenvalues over varied values, and write the files.

    :raises InputError: options that have no effect.
    """
    if (options.vary or options.equilibria) and (options.animate or options.mode != 1):
        others = "--vary and --equilibria, or --animate and --mode"
        raise InputError("--animate and --mode show one state", f"Leave out {others}.")
    if options.equilibria:
        if options.vary or options.at != EQUILIBRIUM:
            raise InputError("--equilibria lists those of the mechanism as it is", "Leave out --vary and --at.")
        return _equilibria(options)
    if options.vary:
        return _varied(options)
    if options.plot:
        raise InputError("--plot is for eigenvalues over varied values", "Give --vary, or --animate.")
    return _modes_of_one_state(options)


def _modes_of_one_state(options: argparse.Namespace) -> int:
    require_table(options.out)
    if options.animate is not None:
        require_suffix(options.animate, ANIMATIONS)
    simulation, state = simulation_at(options)
    Waiting.stage("linearize")
    linearization = simulation.linearize()
    shapes = mode_shapes(linearization)
    if options.animate is not None and not 1 <= options.mode <= len(shapes):
        raise InputError(f"--mode {options.mode}: there are {len(shapes)} modes", "Choose one of them.")
    print(state)
    if linearization.remark:
        print(f"REMARK: {linearization.remark}")
    for number, shape in enumerate(shapes, 1):
        print("\n".join(_mode_lines(number, shape, simulation.coordinate_names)))
    if options.out is not None:
        write_columns(
            options.out, _mode_columns(shapes, simulation.coordinate_names), {"mechanism": simulation.mechanism.name}
        )
        print(f"wrote {options.out}")
    if options.animate is not None:
        shape = shapes[options.mode - 1]
        title = f"mode {options.mode}: {_rate(shape)}"
        amplitude = animate_mode(simulation, shape, options.animate, title=title)
        print(f"wrote {options.animate}: mode {options.mode}, with a largest displacement of {amplitude:.3g} m or rad")
    return 0


def _equilibria(options: argparse.Namespace) -> int:
    simulation = build_simulation(options)
    found = equilibria_of(simulation)
    print(
        f"{simulation.mechanism.name}: {len(found)} equilibria found near the start; take one with --at equilibrium:N"
    )
    for number, one in enumerate(found, 1):
        print(f"{number:>3}  {place_text(simulation, one.q)}\n   {equilibrium_text(simulation, one)}")
    return 0


def _mode_columns(shapes: Sequence[ModeShape], names: Sequence[str]) -> dict[str, Array]:
    """A row for each mode; the shape has an amplitude in m or rad and a phase for each coordinate."""
    values = np.array([shape.mode.eigenvalue for shape in shapes])
    found = {
        "frequency_Hz": np.array([shape.mode.frequency for shape in shapes]),
        "damping_ratio": np.array([shape.mode.damping for shape in shapes]),
        "real_1_s": values.real,
        "imaginary_rad_s": values.imag,
    }
    for index, name in enumerate(names):
        entries = np.array([shape.displacements[index] for shape in shapes])
        found[f"{name}.amplitude"], found[f"{name}.phase_deg"] = np.abs(entries), np.degrees(np.angle(entries))
    return found


def _rate(shape: ModeShape) -> str:
    mode = shape.mode
    if mode.frequency:
        return f"{mode.frequency:.6g} Hz, damping ratio {mode.damping:.4g}"
    return f"{mode.eigenvalue.real:.6g} 1/s, no oscillation" if mode.eigenvalue else "neutral"


def _mode_lines(number: int, shape: ModeShape, names: tuple[str, ...]) -> Iterator[str]:
    value, real = shape.mode.eigenvalue, shape.mode.eigenvalue.real if shape.mode.damping else 0.0
    oscillation = f" ± {abs(value.imag):.6g}i" if value.imag else ""
    yield f"Mode {number:<3} {_rate(shape)}; eigenvalue {real:.6g}{oscillation} 1/s"
    for name, entry in zip(names, shape.displacements.tolist(), strict=True):
        if abs(entry) < SHOWN:
            yield f"    {name} 0"
        elif abs(entry.imag) < SHOWN * abs(entry):
            yield f"    {name} {entry.real:.6g}"
        else:
            yield f"    {name} {abs(entry):.6g} at {math.degrees(cmath.phase(entry)):.4g}°"


def _varied(options: argparse.Namespace) -> int:
    if options.at not in (EQUILIBRIUM, START):
        raise InputError(
            f"--at {options.at}: eigenvalues over values are about the equilibrium or the start", "Give --at start."
        )
    require_plot(options.plot, PICTURE_SUFFIXES)
    if options.plot is not None and len(options.vary) > 2:
        raise InputError("--plot shows up to two varied values", "Write a table with --out.")
    require_table(options.out)
    simulation = build_simulation(options)
    efforts = dict(zip(simulation.coordinate_names, simulation.efforts.tolist(), strict=True))
    values = dict(_values(text, simulation.mechanism) for text in options.vary)
    print_notes(remark for text in options.vary if (remark := bare_variation_remark(text, simulation.mechanism)))
    total = float(np.prod([len(one) for one in values.values()]))
    with ProgressBar("eigenvalues", options.quiet, total=total, amount=COUNT) as progress:
        locus = eigenvalue_locus(simulation.mechanism, values, options.at, efforts, progress.advance)
    print("\n".join([f"{simulation.mechanism.name} about the {options.at}", *_locus_lines(locus)]))
    if options.out is not None:
        write_columns(options.out, _locus_columns(locus), {"mechanism": simulation.mechanism.name})
    if options.plot is not None:
        draw_locus(options.plot, locus, simulation.mechanism.name)
    print_written(options.out, options.plot)
    return 0


def _values(text: str, mechanism: Mechanism) -> tuple[str, Array]:
    """The key and the values of `--vary`, as in `mbd_sim sweep`.

    :raises InputError: they are a distribution, an effort, or not numbers.
    """
    found = variation(text, mechanism)
    if not isinstance(found, Grid) or found.name.startswith("efforts."):
        raise InputError(
            f"--vary {text}: not values at a key of the file", "Write for example l=0.5:2:20 or l=0.5,1,2."
        )
    return found.name, np.asarray(found.values, dtype=float)


def _locus_lines(locus: EigenvalueLocus) -> Iterator[str]:
    """The largest growth rate over the values, and where it changes its sign along the first of them."""
    growth = locus.growth
    if np.all(np.isnan(growth)):
        yield "  no equilibrium with any of these values"
        return
    for what, index in (("least", int(np.nanargmin(growth))), ("greatest", int(np.nanargmax(growth)))):
        place = np.unravel_index(index, growth.shape)
        at = ", ".join(
            f"{name} = {axis[one]:.6g}" for name, axis, one in zip(locus.names, locus.values, place, strict=True)
        )
        yield f"  {what} of the largest real parts: {growth[place] + 0.0:.6g} 1/s at {at}"
    if growth.ndim == 1:
        for index in np.flatnonzero((growth[:-1] > 0.0) != (growth[1:] > 0.0)).tolist():
            one, other = locus.values[0][index], locus.values[0][index + 1]
            yield f"  stability changes between {locus.names[0]} = {one:.6g} and {other:.6g}"
    missing = int(np.sum(np.isnan(growth)))
    if missing:
        yield f"  no equilibrium with {missing} of {growth.size} combinations"


def _locus_columns(locus: EigenvalueLocus) -> dict[str, Array]:
    grid = np.meshgrid(*locus.values, indexing="ij")
    found = {name: axis.ravel() for name, axis in zip(locus.names, grid, strict=True)}
    roots = locus.eigenvalues.reshape(-1, locus.eigenvalues.shape[-1])
    for number in range(roots.shape[1]):
        found[f"real_{number + 1}_1_s"], found[f"imaginary_{number + 1}_rad_s"] = (
            roots[:, number].real,
            roots[:, number].imag,
        )
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
    "modes": Command(
        "Print the natural modes of small motions about a state: frequency, damping ratio, eigenvalue and shape. "
        "With --vary, print the eigenvalues over one value (root locus) or the largest growth rate over two "
        "(stability map). For the assembly modes of a loop see `mbd_sim kinematics --modes`.",
        _add_modes,
        _modes,
    ),
}
