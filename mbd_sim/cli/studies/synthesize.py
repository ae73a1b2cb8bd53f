"""`mbd_sim synthesize`: linkages for poses, dead centers and functions, without a mechanism to start from."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.cli.shared.command import Command, Waiting
from mbd_sim.cli.shared.common import add_repeatable, positive_in, positive_number, print_written
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.text.units import parse_value
from mbd_sim.mechanism.values.expression import evaluate
from mbd_sim.studies.kinematic_analysis.picture import require_picture_suffix
from mbd_sim.studies.synthesis.linkages.dead_centers import DeadCenterFourBar, crank_rockers, slider_cranks
from mbd_sim.studies.synthesis.linkages.dyads import PlanePose
from mbd_sim.studies.synthesis.linkages.functions import (
    FunctionFourBar,
    chebyshev_positions,
    function_four_bars,
)
from mbd_sim.studies.synthesis.linkages.mechanism_files import (
    four_bar_text,
    pose_linkage_text,
    slider_crank_text,
    verified,
)
from mbd_sim.studies.synthesis.linkages.pictures import draw_poses
from mbd_sim.studies.synthesis.linkages.poses import Given, Region, linkages_for_poses
from mbd_sim.studies.synthesis.linkages.reports import dead_center_text, functions_text, poses_text

MOST = 10  # solutions that are listed
OWN = {  # what each problem takes, and nothing else does
    "poses": ("pose", "center", "point", "guide", "line", "region", "plot"),
    "dead-center": ("swing", "stroke", "time_ratio", "rocker", "crank", "longest"),
    "function": ("function", "x", "input", "output", "positions", "input_start", "output_start"),
}
DEFAULTS = {"time_ratio": 1.0, "rocker": 1.0, "longest": 10.0, "positions": 5, "input_start": "0", "output_start": "0"}


def _add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("problem", choices=list(PROBLEMS), help="what the linkage is for")
    poses = parser.add_argument_group("poses")
    add_repeatable(
        poses,
        "--pose",
        "X,Y,ANGLE",
        "a pose of the body, such as --pose=0.1,0.2,30deg or --pose=-5cm,0,0.5; three to five",
    )
    add_repeatable(poses, "--center", "X,Y", "of three poses: a fixed pivot; repeatable")
    add_repeatable(poses, "--point", "X,Y", "of three poses: a point of the body, in its own axes; repeatable")
    add_repeatable(poses, "--guide", "ANGLE", "of three poses: the direction of a guide of a slider; repeatable")
    add_repeatable(
        poses, "--line", "ANGLE", "of three poses: a line of the body that slides through a pivoted block; repeatable"
    )
    poses.add_argument("--region", metavar="X0,X1,Y0,Y1", help="where fixed pivots may be (default: around the poses)")
    dead = parser.add_argument_group("dead-center")
    dead.add_argument("--swing", metavar="ANGLE", help="the angle through which the rocker of a crank-rocker swings")
    dead.add_argument("--stroke", type=positive_in("m"), metavar="M", help="the stroke of a slider-crank")
    dead.add_argument(
        "--time-ratio", type=positive_number, metavar="X", help="of the slow to the fast stroke (default 1)"
    )
    dead.add_argument("--rocker", type=positive_in("m"), metavar="M", help="of a crank-rocker (default 1 m)")
    dead.add_argument("--crank", type=positive_in("m"), metavar="M", help="its length (default: the best)")
    dead.add_argument("--longest", type=positive_number, help="ratio of the longest to the shortest link (default 10)")
    function = parser.add_argument_group("function")
    function.add_argument("--function", metavar="EXPRESSION", help="of x, such as 'x**1.5'")
    function.add_argument("--x", metavar="LOW:HIGH", help="the range of x, such as 1:2")
    function.add_argument("--input", metavar="ANGLE", help="by which the crank turns over the range")
    function.add_argument("--output", metavar="ANGLE", help="by which the follower turns over the range")
    function.add_argument("--positions", type=int, metavar="N", help="precision positions (default 5)")
    function.add_argument("--input-start", metavar="ANGLE", help="of the crank: with 3 or 4 positions")
    function.add_argument("--output-start", metavar="ANGLE", help="of the follower: with 3 positions")
    parser.add_argument(
        "--take", type=int, default=1, metavar="N", help="the solution for --out and --plot (default 1)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the mechanism file: .yaml")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="of poses: draw the solution: .png, .svg or .pdf")
    parser.set_defaults(**DEFAULTS)


def _synthesize(options: argparse.Namespace) -> int:
    _require_own(options)
    if options.plot is not None:
        require_picture_suffix(options.plot)
    if options.out is not None and options.out.suffix not in (".yaml", ".yml"):
        raise InputError(f"{options.out} is not a mechanism file", "Use a file name that ends in .yaml.")
    return PROBLEMS[options.problem](options)


def _require_own(options: argparse.Namespace) -> None:
    """Refuse options that have no effect.

    :raises InputError: one belongs to another problem, or to another number of positions.
    """
    for problem, names in OWN.items():
        for name in names:
            if problem != options.problem and _is_given(options, name):
                remedy = f"Leave it out, or write mbd_sim synthesize {problem}."
                raise InputError(f"--{name.replace('_', '-')} has no effect on {options.problem}", remedy)
    if options.stroke is not None and _is_given(options, "rocker"):
        raise InputError("--rocker has no effect on a slider-crank", "Leave it out, or give --swing.")
    for name, most in (("input_start", 4), ("output_start", 3)):
        if options.positions > most and _is_given(options, name):
            remedy = f"Leave it out, or give --positions {most}."
            raise InputError(f"--{name.replace('_', '-')} has no effect on {options.positions} positions", remedy)


def _is_given(options: argparse.Namespace, name: str) -> bool:
    return getattr(options, name) not in (None, [], DEFAULTS.get(name))


def _poses(options: argparse.Namespace) -> int:
    poses = [PlanePose(*_numbers(text, "--pose", ("m", "m", "rad"))) for text in options.pose]
    given = Given(
        [complex(*_numbers(text, "--center", ("m", "m"))) for text in options.center],
        [complex(*_numbers(text, "--point", ("m", "m"))) for text in options.point],
        [_numbers(text, "--guide", ("rad",))[0] for text in options.guide],
        [_numbers(text, "--line", ("rad",))[0] for text in options.line],
    )
    region = Region(*_numbers(options.region, "--region", ("m",) * 4)) if options.region else None
    found = linkages_for_poses(poses, given, region)
    print(poses_text(found, MOST))
    chosen = _taken(options, len(found.linkages))
    linkage = None if chosen is None else found.linkages[chosen]
    if linkage is not None:
        text = pose_linkage_text(_name(options.out, "poses"), poses, linkage)
        Waiting.stage("verify")
        trouble, deviation = verified(parse_mechanism(text), poses, linkage)
        result = trouble or f"it passes through all poses, to {deviation:.1g} of its size"
        print(f"{'Moved':<20}linkage {options.take}: {result}")
        _write(options.out, text)
    if options.plot is not None:
        draw_poses(options.plot, found, linkage)
    print_written(options.out if linkage is not None else None, options.plot)
    return 0 if linkage is not None and not linkage.defects else 1


def _dead_center(options: argparse.Namespace) -> int:
    if (options.swing is None) == (options.stroke is None):
        raise InputError("either --swing or --stroke is needed", "Give --swing 60deg, or --stroke 80mm.")
    limits = {"longest": options.longest, "crank": options.crank}
    if options.swing is not None:
        (swing,) = _numbers(options.swing, "--swing", ("rad",))
        found = crank_rockers(swing, options.time_ratio, options.rocker, **limits)
        what = f"A crank-rocker with a swing of {np.degrees(swing):.6g} deg"
    else:
        found = slider_cranks(options.stroke, options.time_ratio, **limits)
        what = f"A slider-crank with a stroke of {options.stroke:.6g} m"
    print(dead_center_text(found))
    about, name, best = (
        f"{what} and a time ratio of {options.time_ratio:.6g}.",
        _name(options.out, "dead_center"),
        found.best,
    )
    if isinstance(best, DeadCenterFourBar):
        lengths = (best.crank, best.coupler, best.rocker, best.base)
        text = four_bar_text(name, lengths, np.zeros(1), 1.0, about)
    else:
        text = slider_crank_text(name, best, about)
    _write(options.out, text)
    print_written(options.out)
    return 0


def _function(options: argparse.Namespace) -> int:
    for name in ("function", "x", "input", "output"):
        if getattr(options, name) is None:
            raise InputError(f"--{name} is needed", "Give --function 'x**1.5' --x 1:2 --input 90deg --output 60deg.")
    low, high = _numbers(options.x.replace(":", ","), "--x", (None, None))
    (turn,), (swing,) = (_numbers(getattr(options, one), f"--{one}", ("rad",)) for one in ("input", "output"))
    starts = [_numbers(getattr(options, f"{one}_start"), f"--{one}-start", ("rad",))[0] for one in ("input", "output")]
    x = chebyshev_positions(low, high, options.positions)
    values = np.array([evaluate(options.function, {"x": float(one)}) for one in (low, high, *x)])
    if values[0] == values[1]:
        raise InputError("the function has the same value at both ends of the range", "Give another range.")
    theta = starts[0] + turn * (x - low) / (high - low)
    phi = starts[1] + swing * (values[2:] - values[0]) / (values[1] - values[0])
    found = function_four_bars(theta.tolist(), phi.tolist())
    print(functions_text(found, MOST))
    chosen = _taken(options, len(found))
    if chosen is not None:
        _write(options.out, _function_text(options, found[chosen]))
        print_written(options.out)
    return 0 if chosen is not None and not found[chosen].defects else 1


def _function_text(options: argparse.Namespace, one: FunctionFourBar) -> str:
    about = f"A four-bar whose rocker turns as {options.function} of the crank, x from {options.x}."
    lengths = (one.crank, one.coupler, one.follower, 1.0)
    return four_bar_text(_name(options.out, "function"), lengths, one.theta, one.mode, about)


def _taken(options: argparse.Namespace, count: int) -> int | None:
    """The index of the solution to take; None if there is none."""
    if not count:
        return None
    if not 1 <= options.take <= count:
        raise InputError(f"there is no solution {options.take}", f"There are 1 to {count}.")
    return int(options.take) - 1


def _numbers(text: str, option: str, units: tuple[str | None, ...]) -> list[float]:
    """Numbers with or without units, separated by commas."""
    words = [word.strip() for word in text.split(",")]
    if len(words) != len(units):
        raise InputError(f"{option} {text}: {len(words)} numbers instead of {len(units)}", "Separate them by commas.")
    try:
        return [parse_value(word, {}, unit) for word, unit in zip(words, units, strict=True)]
    except InputError as error:
        raise InputError(f"{option} {text}: {error}", "Write numbers such as 0.1, 5cm or 30deg.") from None


def _name(out: Path | None, otherwise: str) -> str:
    name = "" if out is None else "".join(letter if letter.isalnum() else "_" for letter in out.stem)
    return name if name[:1].isalpha() else otherwise


def _write(path: Path | None, text: str) -> None:
    if path is not None:
        path.write_text(text, encoding="utf-8")


PROBLEMS = {"poses": _poses, "dead-center": _dead_center, "function": _function}
COMMANDS = {
    "synthesize": Command(
        "Find planar linkages by their geometry: that carry a body through three, four or five poses (Burmester), with "
        "a given swing or stroke and time ratio (dead centers), or whose follower turns as a function of the crank "
        "(Freudenstein). All solutions are listed, sorted by transmission angle; one is written as a mechanism file.",
        _add,
        _synthesize,
    ),
}
