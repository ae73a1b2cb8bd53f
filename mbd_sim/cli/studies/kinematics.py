"""`mbd_sim kinematics` and `mbd_sim optimize`: drives are moved through ranges, without dynamics."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.operating_system import processors
from mbd_sim.cli.shared.command import Command, ProgressBar, Waiting
from mbd_sim.cli.shared.common import (
    add_mechanism,
    add_quiet,
    add_repeatable,
    add_show,
    print_notes,
    print_written,
    seed_number,
    shown_plots,
)
from mbd_sim.cli.shared.setup_options import add_set, changed_mechanism
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep.plan import bare_variation_remark
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.views.table import require_table, write_columns
from mbd_sim.studies.kinematic_analysis.loads import coupler_and_follower, couplers_and_followers, drive_loads
from mbd_sim.studies.kinematic_analysis.motion import POSITIONS, DrivenMotion, PointFunctions, driven_motion
from mbd_sim.studies.kinematic_analysis.picture import draw_motion, require_groups, require_picture_suffix
from mbd_sim.studies.kinematic_analysis.system import (
    DriveRange,
    bare_range_remark,
    drive_range,
    drive_speed,
    parameter_value,
    position_count,
)
from mbd_sim.studies.kinematic_analysis.text import (
    chosen_columns,
    column_limit,
    exceeded_limits,
    motion_columns,
    motion_text,
)
from mbd_sim.studies.synthesis.conditions import Condition, conditions_of
from mbd_sim.studies.synthesis.global_search import GENERATIONS, POPULATION, synthesize_globally
from mbd_sim.studies.synthesis.problem import Goal, bounds_of, goal_of
from mbd_sim.studies.synthesis.synthesis import Design, Norm, design_text, draw_design, synthesize, write_mechanism

DXF = ".dxf"
CURVES = "positions", "velocities", "accelerations", "points", "transmission", "advantage", "efforts", "reactions"


def _add_kinematics(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_repeatable(
        parser,
        "--drive",
        "NAME=RANGE",
        "a driven coordinate and its range, such as crank=0:360deg, or crank=0:360deg:73 for 73 positions, or a "
        "value at which it is held; repeatable: as many as the mechanism has degrees of freedom",
        required=True,
    )
    add_set(parser)
    parser.add_argument(
        "--speed", default="1", metavar="V", help="of the first drive: rad/s, m/s, or 60rpm (default 1)"
    )
    add_repeatable(parser, "--point", "PART.POINT", "a point whose path is wanted; repeatable")
    parser.add_argument(
        "--transmission",
        action="append",
        metavar="PIN",
        help="the pin between a coupler and a follower whose transmission angle is wanted, or COUPLER,PIN,FOLLOWER "
        "with the other joint of the coupler and the pivot or guide of the follower; repeatable (default: all that are "
        "evident)",
    )
    parser.add_argument("--loads", action="store_true", help="determine efforts of drives and loads on joints")
    parser.add_argument("--modes", action="store_true", help="list all assembly modes at the start of the range")
    parser.add_argument("--mode", type=int, metavar="N", help="begin in assembly mode N (default: that of the file)")
    parser.add_argument(
        "--through-dead-points",
        action="store_true",
        help="follow the motion through dead points, where the drive turns back, and straight through change points",
    )
    add_repeatable(
        parser, "--sensitivity", "KEY", "a parameter of the file by which positions are differentiated; repeatable"
    )
    add_repeatable(
        parser, "--tolerance", "KEY=VALUE", "a tolerance ± of a parameter of the file, such as l=0.1mm; repeatable"
    )
    parser.add_argument(
        "--samples", type=int, default=0, metavar="N", help="random samples within the tolerances (default: none)"
    )
    parser.add_argument(
        "--seed", type=seed_number, metavar="N", help="with --samples: of the random numbers (default 0)"
    )
    _add_outputs(parser)


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    add_repeatable(
        parser,
        "--column",
        "NAME",
        "a column of the printed table and of the file, or a pattern such as 'reaction.*.force_N'; repeatable "
        "(default: positions and efforts are printed, and all columns written)",
    )
    add_repeatable(
        parser,
        "--limit",
        "NAME=VALUE",
        "a limit of the magnitude of a column, in its unit, such as reaction.crank_pin.force_N=500; the status is "
        "1 if it is exceeded; repeatable",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write a table: .csv, .parquet or .npz; or the paths of the points as a drawing: .dxf",
    )
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw the motion: .png, .svg or .pdf")
    add_show(parser, ("mechanism", *CURVES))


def _kinematics(options: argparse.Namespace) -> int:
    """Analyze the motion, print the report, and write the table and the picture."""
    if options.seed is not None and not options.samples:
        raise InputError("--seed has no effect without --samples", "Give --samples too, or leave it out.")
    limits = [column_limit(text) for text in options.limit]
    show = shown_plots(options, options.plot)
    require_groups(show)
    if options.plot is not None:
        require_picture_suffix(options.plot)
    require_table(options.out, DXF)
    if is_drawing(options.out) and not options.point:
        raise InputError(f"{options.out}: there are no paths to draw", "Name points with --point.")
    mechanism = changed_mechanism(options)
    given = _ranges(options.drive, mechanism)
    drives = {one.name: (one.start, one.stop) for one, _ in given}
    count = position_count(given, POSITIONS)
    if options.modes:
        _print_modes(mechanism, {one.name: one.start for one, _ in given})
    motion = driven_motion(
        mechanism,
        drives,
        count,
        speed=drive_speed(options.speed, mechanism, [one for one, _ in given]),
        mode=options.mode,
        dead_points="follow" if options.through_dead_points else "refuse",
    )
    pins = couplers_and_followers(motion.mechanism, list(drives))
    if options.transmission is not None:
        pins = tuple(coupler_and_follower(motion.mechanism, list(drives), text) for text in options.transmission)
    loads = drive_loads(motion) if options.loads else None
    lines, columns = _accuracy(options, mechanism, motion)
    chosen, exceeded = None, False
    if options.out is not None or options.column or limits:
        columns = motion_columns(motion, options.point, pins, loads) | columns
        of_limits, exceeded = exceeded_limits(motion, columns, limits)
        lines += of_limits
    if options.column:
        chosen = chosen_columns(columns, options.column)
        moved = {name: values for name, values in columns.items() if name in _abscissas(motion)}
        columns = {**moved, **{name: values for name, values in chosen.items() if name not in moved}}
    print(motion_text(motion, options.point, pins, loads, lines, chosen))
    if is_drawing(options.out):
        _write_paths(options.out, motion, options.point)
    elif options.out is not None:
        about = {"mechanism": mechanism.name, "drives": ", ".join(options.drive), "speed": str(motion.speed)}
        write_columns(options.out, columns, about)
    if options.plot is not None:
        draw_motion(options.plot, motion, options.point, pins, loads, show=show)
    print_written(options.out, options.plot)
    return 1 if exceeded else 0


def _abscissas(motion: DrivenMotion) -> list[str]:
    """The columns with the positions of the drives, without which the others of a file have no abscissa."""
    return [f"{name}.position_{'rad' if motion.is_rotation(name) else 'm'}" for name in motion.system.drives]


def is_drawing(path: Path | None) -> bool:
    """Whether a file is a DXF drawing."""
    return path is not None and path.suffix == DXF


def _write_paths(path: Path, motion: DrivenMotion, points: Sequence[str]) -> None:
    from mbd_sim.pictures.technical.dxf import write_curves

    poses = {name: PointFunctions(motion.system, name).pose(motion.q[0]) for name in motion.mechanism.parts}
    write_curves(path, motion.mechanism, poses, {name: motion.point(name).position for name in points})


def _print_modes(mechanism: Mechanism, drives: Mapping[str, float]) -> None:
    from mbd_sim.studies.kinematic_analysis.modes import assembly_modes
    from mbd_sim.studies.kinematic_analysis.text import modes_text

    print(modes_text(assembly_modes(mechanism, drives)))


def _ranges(texts: Sequence[str], mechanism: Mechanism) -> list[tuple[DriveRange, int | None]]:
    """The ranges of `--drive` with their numbers of positions; angles that were probably meant in degrees are noted."""
    found = [drive_range(text, mechanism) for text in texts]
    print_notes(remark for text in texts if (remark := bare_range_remark(text, mechanism)))
    return found


def _accuracy(
    options: argparse.Namespace, mechanism: Mechanism, motion: DrivenMotion
) -> tuple[list[str], dict[str, Array]]:
    """Lines and columns about sensitivities and tolerances."""
    from mbd_sim.studies.kinematic_analysis import tolerances as report
    from mbd_sim.studies.kinematic_analysis.parametric import MotionSensitivity
    from mbd_sim.studies.kinematic_analysis.tolerances import ToleranceAnalysis

    lines: list[str] = []
    columns: dict[str, Array] = {}
    if options.sensitivity:
        sensitivity = MotionSensitivity(mechanism, motion, options.sensitivity)
        lines += report.sensitivity_lines(sensitivity, options.point)
        columns |= report.sensitivity_columns(sensitivity, options.point)
    if options.tolerance:
        given = dict(parameter_value(text, mechanism) for text in options.tolerance)
        tolerances = ToleranceAnalysis(mechanism, motion, given, samples=options.samples, seed=options.seed or 0)
        lines += report.tolerance_lines(tolerances, options.point)
        columns |= report.tolerance_columns(tolerances, options.point)
    elif options.samples:
        raise InputError("--samples without tolerances", "Give --tolerance KEY=VALUE.")
    return lines, columns


def _add_optimize(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    parser.add_argument(
        "--drive",
        required=True,
        metavar="NAME=RANGE",
        help="the driven coordinate and its range, such as crank=0:360deg:37 with 37 positions (default 37)",
    )
    add_repeatable(
        parser,
        "--vary",
        "KEY=LOW:HIGH",
        "a parameter of the file and its bounds, such as l=0.5:2; repeatable",
        required=True,
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
    add_repeatable(
        parser,
        "--keep",
        "CONDITION",
        "a condition on a coordinate or a component of a point over the range, such as 'stroke(ram)=100mm', "
        "'min(knee)>=10deg' or 'max(coupler.tip.z)<=0.3'; repeatable",
    )
    parser.add_argument("--free-timing", action="store_true", help="the path's points may be reached at any drive")
    parser.add_argument("--free-offset", action="store_true", help="a constant may be added to the function")
    parser.add_argument(
        "--norm",
        choices=["rms", "peak"],
        help="what is minimized: the root mean square of the deviations, or the largest one "
        "(default: rms; peak with --least-effort)",
    )
    parser.add_argument("--speed", default="1", metavar="V", help="of the drive: rad/s, m/s, or 60rpm (default 1)")
    _add_global(parser)
    add_quiet(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the mechanism with the values found: .yaml")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw its motion: .png, .svg or .pdf")


def _add_global(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--global",
        dest="everywhere",
        action="store_true",
        help="search everywhere between the bounds and in all assembly modes, by differential evolution, then polish",
    )
    parser.add_argument("--seed", type=seed_number, metavar="N", help="of the search with --global (default 0)")
    parser.add_argument(
        "--generations",
        type=int,
        metavar="N",
        help=f"with --global, at most (default {GENERATIONS})",
    )
    parser.add_argument(
        "--population",
        type=int,
        metavar="N",
        help=f"with --global, members for each parameter (default {POPULATION})",
    )
    parser.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="processes with --global, without influence on the result (default: all)",
    )


def _optimize(options: argparse.Namespace) -> int:
    """Search, print the values found, and write and draw the mechanism; returns 1 if it failed."""
    if options.plot is not None:
        require_picture_suffix(options.plot)
    if options.out is not None and options.out.suffix not in (".yaml", ".yml"):
        raise InputError(f"{options.out} is not a mechanism file", "Use a file name that ends in .yaml.")
    if not options.everywhere:
        for name in ("seed", "generations", "population", "workers"):
            if getattr(options, name) is not None:
                raise InputError(f"--{name} has no effect without --global", "Give --global too, or leave it out.")
    mechanism = load_mechanism(options.mechanism)
    drive, count = drive_range(options.drive, mechanism)
    bounds = bounds_of(options.vary, mechanism)
    bare = [bare_range_remark(options.drive, mechanism)]
    bare += [bare_variation_remark(text, mechanism) for text in options.vary]
    print_notes(remark for remark in bare if remark)
    speed = drive_speed(options.speed, mechanism, [drive])
    goal = goal_of(options, mechanism, drive, count, speed)
    norm: Norm = options.norm or ("peak" if options.least_effort else "rms")
    conditions = conditions_of(options.keep, mechanism)
    if options.everywhere:
        design = _searched_everywhere(options, mechanism, drive.name, goal, bounds, norm, conditions)
    else:
        Waiting.stage("derive the equations and search")
        design = synthesize(mechanism, drive.name, goal, bounds, norm=norm, conditions=conditions)
    print(design_text(mechanism, design, goal, norm))
    if options.out is not None:
        write_mechanism(options.out, design)
    if options.plot is not None:
        draw_design(options.plot, design, goal)
    print_written(options.out, options.plot)
    return 0 if design.converged and design.keeps_conditions else 1


def _searched_everywhere(
    options: argparse.Namespace,
    mechanism: Mechanism,
    drive: str,
    goal: Goal,
    bounds: Mapping[str, tuple[float, float]],
    norm: Norm,
    conditions: Sequence[Condition],
) -> Design:
    with ProgressBar("search", options.quiet or sys.stdout is None or not sys.stdout.isatty()) as bar:
        return synthesize_globally(
            mechanism,
            drive,
            goal,
            bounds,
            norm=norm,
            conditions=conditions,
            seed=options.seed or 0,
            generations=GENERATIONS if options.generations is None else options.generations,
            population=POPULATION if options.population is None else options.population,
            workers=processors() if options.workers is None else options.workers,
            progress=lambda part, _: bar.show(part),
        )


COMMANDS = {
    "kinematics": Command(
        "Move the drives of a mechanism through their ranges and determine everything else from the constraints: "
        "positions, velocities, accelerations, paths of points, dead points, limit positions, transmission angles "
        "and mechanical advantage; with --loads also efforts and reactions by inverse dynamics.",
        _add_kinematics,
        _kinematics,
    ),
    "optimize": Command(
        "Find parameters of a mechanism of one degree of freedom with which a point follows a path, a coordinate "
        "follows a function of the drive, or the drive needs little effort. The search starts from the values in "
        "the file and ends in an optimum nearby; with --global it looks everywhere between the bounds.",
        _add_optimize,
        _optimize,
    ),
}
