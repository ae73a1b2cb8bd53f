"""`mbd_sim modes`: natural modes and their shapes, root loci and stability maps."""

from __future__ import annotations

import argparse
import cmath
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_quiet, print_notes, print_written
from mbd_sim.cli.shared.progress import COUNT, ProgressBar, Waiting
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
from mbd_sim.recordings.views.export import require_table, write_columns
from mbd_sim.recordings.views.plots import PICTURE_SUFFIXES, require_plot, require_suffix
from mbd_sim.studies.linear_analysis.loci import EigenvalueLocus, eigenvalue_locus, equilibria_of
from mbd_sim.studies.linear_analysis.plots import ModeShape, animate_mode, draw_locus, mode_shapes

SHOWN = 1e-6  # entries of a shape below this are shown as zero


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_working_point(parser)
    parser.add_argument(
        "--equilibria", action="store_true", help="list the equilibria that are found near the start, the nearest first"
    )
    parser.add_argument("--animate", type=Path, metavar="FILE", help="animate a mode: .gif, .webp, .mp4 or .html")
    parser.add_argument("--mode", type=int, default=1, metavar="N", help="the mode for --animate (default 1)")
    parser.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=VALUES",
        help="vary a value of the file: joints.elbow.damping=0:2:50 (50 values from 0 to 2) or l=0.5,1,2; give it two "
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


def _execute(options: argparse.Namespace) -> int:
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
    return _modes(options)


def _modes(options: argparse.Namespace) -> int:
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
        write_columns(options.out, _columns(locus), {"mechanism": simulation.mechanism.name})
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


def _columns(locus: EigenvalueLocus) -> dict[str, Array]:
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
    "modes": Command(
        "Print the natural modes of small motions about a state: frequency, damping ratio, eigenvalue and shape. "
        "With --vary, print the eigenvalues over one value (root locus) or the largest growth rate over two "
        "(stability map). For the assembly modes of a loop see `mbd_sim kinematics --modes`.",
        _add_arguments,
        _execute,
    ),
}
