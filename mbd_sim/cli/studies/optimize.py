"""`mbd_sim optimize`: find parameters of a mechanism for a path, a function, or the least effort of its drive."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import InputError
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_mechanism, print_notes, print_written
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep.plan import bare_variation_remark
from mbd_sim.studies.kinematic_analysis.picture import require_picture_suffix
from mbd_sim.studies.kinematic_analysis.system import bare_range_remark, drive_range, drive_speed
from mbd_sim.studies.synthesis.problem import bounds_of, goal_of
from mbd_sim.studies.synthesis.synthesis import Norm, design_text, draw_design, synthesize, write_mechanism


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    parser.add_argument(
        "--drive",
        required=True,
        metavar="NAME=RANGE",
        help="the driven coordinate and its range, such as crank=0:360deg:37 with 37 positions (default 37)",
    )
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        metavar="KEY=LOW:HIGH",
        help="a parameter of the file and its bounds, such as l=0.5:2; repeatable",
    )
    goal = parser.add_mutually_exclusive_group(required=True)
    goal.add_argument(
        "--path",
        metavar="PART.POINT=FILE",
        help="a point and the table of its path, .csv with columns x, y and z in m, as far as they matter, and perhaps "
        "drive in rad or m; without it the rows are equally spaced in the range",
    )
    goal.add_argument(
        "--function",
        metavar="NAME=EXPRESSION",
        help="a coordinate and its function of the drive in rad and m, such as 'rocker=1.2 + 0.3*sin(crank)'",
    )
    goal.add_argument("--least-effort", action="store_true", help="the effort of the drive at --speed is to be small")
    parser.add_argument("--free-timing", action="store_true", help="the path's points may be reached at any drive")
    parser.add_argument("--free-offset", action="store_true", help="a constant may be added to the function")
    parser.add_argument(
        "--norm",
        choices=["rms", "peak"],
        help="what is minimized: the root mean square of the deviations, or the largest one "
        "(default: rms; peak with --least-effort)",
    )
    parser.add_argument("--speed", default="1", metavar="V", help="of the drive: rad/s, m/s, or 60rpm (default 1)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the mechanism with the values found: .yaml")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw its motion: .png, .svg or .pdf")


def _execute(options: argparse.Namespace) -> int:
    """Search, print the values found, and write and draw the mechanism; returns 1 if the search did not converge."""
    if options.plot is not None:
        require_picture_suffix(options.plot)
    if options.out is not None and options.out.suffix not in (".yaml", ".yml"):
        raise InputError(f"{options.out} is not a mechanism file", "Use a file name that ends in .yaml.")
    mechanism = load_mechanism(options.mechanism)
    drive, count = drive_range(options.drive, mechanism)
    bounds = bounds_of(options.vary, mechanism)
    bare = [bare_range_remark(options.drive, mechanism)]
    bare += [bare_variation_remark(text, mechanism) for text in options.vary]
    print_notes(remark for remark in bare if remark)
    speed = drive_speed(options.speed, mechanism, [drive])
    goal = goal_of(options, mechanism, drive, count, speed)
    norm: Norm = options.norm or ("peak" if options.least_effort else "rms")
    design = synthesize(mechanism, drive.name, goal, bounds, norm=norm)
    print(design_text(mechanism, design, goal, norm))
    if options.out is not None:
        write_mechanism(options.out, design)
    if options.plot is not None:
        draw_design(options.plot, design, goal)
    print_written(options.out, options.plot)
    return 0 if design.converged else 1


COMMANDS = {
    "optimize": Command(
        "Find parameters of a mechanism of one degree of freedom with which a point follows a path, a coordinate "
        "follows a function of the drive, or the drive needs little effort. The search starts from the values in "
        "the file and ends in an optimum nearby.",
        _add_arguments,
        _execute,
    ),
}
