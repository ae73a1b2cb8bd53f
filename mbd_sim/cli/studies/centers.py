"""`mbd_sim centers`: instant centers, polygons and centrodes of planar mechanisms."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from mbd_sim.base.errors import InputError
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_mechanism, add_repeatable, print_notes, print_written
from mbd_sim.cli.shared.setup_options import add_set, changed_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.views.table import require_table, write_columns
from mbd_sim.studies.kinematic_analysis.motion import POSITIONS, DrivenMotion, driven_motion
from mbd_sim.studies.kinematic_analysis.picture import require_picture_suffix
from mbd_sim.studies.kinematic_analysis.system import (
    UnreachableError,
    bare_range_remark,
    drive_range,
    drive_speed,
    is_rotation,
    position_count,
)
from mbd_sim.studies.plane_motion.centers import instant_centers
from mbd_sim.studies.plane_motion.centrodes import centrodes, inflection_circle
from mbd_sim.studies.plane_motion.pictures import draw_plane_motion
from mbd_sim.studies.plane_motion.polygons import polygons
from mbd_sim.studies.plane_motion.reports import centers_text, centrode_columns, inflection_text, polygons_text
from mbd_sim.studies.plane_motion.snapshot import PlanarDrive

SMALL = 1e-4  # rad or m: a range that begins where only one position is wanted


def _add(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_repeatable(
        parser,
        "--drive",
        "NAME=VALUE",
        "a driven coordinate and the position that is looked at, such as crank=60deg; or a range that begins there, "
        "such as crank=60:420deg, for centrodes; repeatable: the first one moves, the others are held",
        required=True,
    )
    add_set(parser)
    parser.add_argument(
        "--speed", metavar="V", help="of the first drive, with --polygons: rad/s, m/s, or 60rpm (default 1)"
    )
    parser.add_argument("--polygons", action="store_true", help="velocity and acceleration polygons of the joints")
    add_repeatable(parser, "--centrodes", "PART", "the centrodes of a part over the range of the drive; repeatable")
    add_repeatable(parser, "--inflection", "PART", "the inflection circle of a part; repeatable")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the centrodes: .csv, .parquet or .npz")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw everything: .png, .svg or .pdf")


def _centers(options: argparse.Namespace) -> int:
    """Print the centers and what is asked for, and write the table and the picture."""
    if options.plot is not None:
        require_picture_suffix(options.plot)
    require_table(options.out)
    if options.out is not None and not options.centrodes:
        raise InputError("--out without centrodes", "Give --centrodes PART and a range of the drive.")
    if options.speed is not None and not options.polygons:
        raise InputError("--speed has no effect without --polygons", "Give --polygons too, or leave it out.")
    mechanism = changed_mechanism(options)
    given = [drive_range(text, mechanism) for text in options.drive]
    print_notes(remark for text in options.drive if (remark := bare_range_remark(text, mechanism)))
    speed = drive_speed(options.speed or "1", mechanism, [one for one, _ in given])
    if speed == 0.0:
        raise InputError("with a speed of 0 nothing moves", "Give a positive speed.")
    ranges = {one.name: (one.start, one.stop) for one, _ in given}
    motion = _moved(mechanism, ranges, position_count(given, POSITIONS), speed)
    if options.centrodes and all(start == stop for start, stop in ranges.values()):
        raise InputError("centrodes need a range of the drive", "Give for example --drive crank=0:360deg.")
    plane = PlanarDrive(motion)
    snapshot = plane.at(0)
    centers = list(instant_centers(snapshot).values())
    print(centers_text(centers))
    found = polygons(snapshot) if options.polygons else None
    if found is not None:
        print(polygons_text(found))
    paths = [centrodes(plane, part) for part in options.centrodes]
    circles = [inflection_circle(snapshot, part) for part in options.inflection]
    for part, circle in zip(options.inflection, circles, strict=True):
        print(
            inflection_text(circle) if circle is not None else f"{part} does not turn here: it has no inflection circle"
        )
    if options.out is not None:
        name = f"{motion.drive_name}.position_{'rad' if is_rotation(mechanism, motion.drive_name) else 'm'}"
        write_columns(options.out, centrode_columns((name, motion.drive), paths), {"mechanism": mechanism.name})
    if options.plot is not None:
        drawn = [circle for circle in circles if circle is not None]
        draw_plane_motion(options.plot, snapshot, centers, found, paths, drawn, mechanism.name)
    print_written(options.out, options.plot)
    return 0


def _moved(mechanism: Mechanism, ranges: Mapping[str, tuple[float, float]], count: int, speed: float) -> DrivenMotion:
    """The motion through the ranges; where none is given, a short one from the position."""
    if any(start != stop for start, stop in ranges.values()):
        return driven_motion(mechanism, ranges, count, speed=speed)
    first, *_ = ranges
    start = ranges[first][0]
    try:
        return driven_motion(mechanism, {**ranges, first: (start, start + SMALL)}, 2, speed=speed)
    except UnreachableError:  # a dead point is just beyond
        motion = driven_motion(mechanism, {**ranges, first: (start, start - SMALL)}, 2, speed=speed)
        motion.u[:] *= -1.0
        return motion


COMMANDS = {
    "centers": Command(
        "Print the instant centers of all pairs of links of a planar mechanism in one position, by the theorem of "
        "Aronhold and Kennedy; on request also velocity and acceleration polygons, centrodes and inflection circles, "
        "as numbers and as a picture.",
        _add,
        _centers,
    ),
}
