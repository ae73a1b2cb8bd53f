"""`mbd_sim size`: motors, gears, flywheels and springs for a motion and its loads."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import InputError, listed, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.cli.shared.command import Command
from mbd_sim.cli.shared.common import add_quiet, add_repeatable, positive_in, print_notes, print_written, text_table
from mbd_sim.cli.shared.recorded_run import add_run, read_run_table, recorded_run
from mbd_sim.cli.shared.setup_options import changed_mechanism
from mbd_sim.files.text.units import parse_value
from mbd_sim.recordings.views.cycles import run_cycle
from mbd_sim.recordings.views.table import require_table, write_columns
from mbd_sim.studies.kinematic_analysis.motion import POSITIONS, DrivenMotion, driven_motion
from mbd_sim.studies.kinematic_analysis.picture import require_picture_suffix
from mbd_sim.studies.kinematic_analysis.system import bare_range_remark, drive_range, drive_speed, position_count
from mbd_sim.studies.sizing.catalog import AMBIENT, Catalog, GearType, MotorType, read_catalog, shipped_catalog
from mbd_sim.studies.sizing.cycle import LoadCycle, drive_cycles, read_cycle
from mbd_sim.studies.sizing.duty import MotorDuty, motor_duty
from mbd_sim.studies.sizing.flywheel import flywheel, load_beside, with_flywheel
from mbd_sim.studies.sizing.gears import best_ratio
from mbd_sim.studies.sizing.laws import LAWS, SHARE, MotionLaw, law_of_text, motion_law
from mbd_sim.studies.sizing.picture import draw_duty
from mbd_sim.studies.sizing.springs import balancing_spring, spring_between
from mbd_sim.studies.sizing.text import (
    duty_columns,
    duty_series,
    flywheel_lines,
    load_lines,
    load_series,
    ordered,
    spring_lines,
)

BEST = "best"
MOST_ROWS = 15  # of the table of motors
DEFAULT_RATE = 1000.0  # Hz, of a run that is made for its loads
# Options that only some sources of loads take, by their names in the parsed options.
OF_LAWS = {"share": "--share", "dwell": "--dwell", "returns": "--return"}
OF_MOTIONS = {"speed": "--speed", "motion": "--motion", **OF_LAWS, "between": "--between"}
OF_MECHANISMS = {"time": "--time", "method": "--method", "step": "--step", "start": "--start", "effort": "--effort"}
OF_CYCLES = {"start_time": "--from", "end_time": "--to", "once": "--once", "inertia": "--inertia"}


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_run(parser)
    parser.add_argument(
        "--joint", metavar="NAME", help="the coordinate whose drive is sized (default: if there is only one)"
    )
    motion = parser.add_argument_group("a prescribed motion of a mechanism, without a run")
    add_repeatable(motion, "--drive", "NAME=RANGE", "a driven coordinate and its range, as in kinematics; repeatable")
    motion.add_argument("--speed", metavar="V", help="constant speed of the first drive: rad/s, m/s, or 60rpm")
    motion.add_argument(
        "--motion", metavar="LAW:TIME", help=f"from rest to rest by a law of motion: {', '.join(LAWS)}; trapezoid:0.5s"
    )
    motion.add_argument("--share", type=float, help=f"of TIME to speed up, in a trapezoid (default {SHARE:.3g})")
    motion.add_argument("--dwell", type=positive_in("s"), metavar="S", help="rest after each way")
    motion.add_argument("--return", dest="returns", action="store_true", help="go back by the same law")
    part = parser.add_argument_group("of a run, a recording, or a table (.csv) with time, speed and effort")
    part.add_argument("--from", dest="start_time", type=float, metavar="S", help="begin the cycle here")
    part.add_argument("--to", dest="end_time", type=float, metavar="S", help="end the cycle here")
    part.add_argument("--once", action="store_true", help="the cycle does not repeat itself: the motor starts cold")
    part.add_argument("--inertia", metavar="J", help="of the load, where it is not known: kg·m² or kg, or with a unit")
    _add_choices(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the cycle: .csv, .parquet or .npz")
    parser.add_argument("--plot", type=Path, metavar="PICTURE", help="draw the cycle: .png, .svg or .pdf")
    add_quiet(parser)


def _add_choices(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("motors, gears, springs and flywheels")
    add_repeatable(group, "--catalog", "FILE", "motors and gears, .yaml or .csv, besides the generic ones; repeatable")
    add_repeatable(
        group, "--motor", "NAME", "only this motor; repeatable (default: those of the catalogs given, or all)"
    )
    add_repeatable(
        group,
        "--gear",
        "GEAR",
        "a ratio, lead=10mm, a name of the catalog, or 'best', the ratio of least RMS torque; repeatable",
    )
    group.add_argument(
        "--efficiency", type=float, default=1.0, metavar="X", help="of gears that are given by numbers (default 1)"
    )
    group.add_argument(
        "--ambient", type=float, default=AMBIENT, metavar="C", help=f"surroundings, °C (default {AMBIENT:g})"
    )
    group.add_argument("--spring", choices=("rms", "peak"), help="balance the load by a spring: what is to be least")
    group.add_argument("--between", metavar="A,B", help="where the spring is: two points, such as ground.hook,arm.tip")
    group.add_argument(
        "--rest", metavar="L", help="where the spring exerts nothing, if it is given: rad or m, or a unit"
    )
    group.add_argument("--flywheel", type=float, metavar="D", help="coefficient of speed fluctuation, such as 0.02")


def _execute(options: argparse.Namespace) -> int:
    """Find the load, print what it needs, and write the cycle; the status is 1 if no motor suffices."""
    require_table(options.out)
    if options.plot is not None:
        require_picture_suffix(options.plot)
    catalog = _catalog(options)
    load, motion, law = _load(options)
    print("\n".join(load_lines(load)))
    changed, speed = _balanced(options, load, motion, law)
    duties = ordered(_duties(options, catalog, changed))
    if duties:
        print()
        for line in text_table(duty_columns(duties), MOST_ROWS):
            print(line)
        if len(duties) > MOST_ROWS:
            print(f"… and {len(duties) - MOST_ROWS} more")
    first = duties[0] if duties else None
    if options.out is not None:
        about = {
            "joint": load.name,
            "motor": first.motor.name if first else "",
            "gear": first.gear.name if first else "",
        }
        write_columns(options.out, duty_series(first) if first else load_series(changed), about)
    if options.plot is not None:
        draw_duty(options.plot, changed, first, load if changed is not load else None, speed)
    print_written(options.out, options.plot)
    return 0 if not duties or duties[0].suffices else 1


def _catalog(options: argparse.Namespace) -> Catalog:
    """The motors that are compared, and all gears."""
    given = [read_catalog(path) for path in options.catalog]
    whole = shipped_catalog()
    for one in given:
        whole = whole | one
    if options.motor:
        return replace(whole, motors={name: whole.motor(name) for name in options.motor})
    own = {name: motor for one in given for name, motor in one.motors.items()}
    return replace(whole, motors=own or whole.motors)


def _load(options: argparse.Namespace) -> tuple[LoadCycle, DrivenMotion | None, MotionLaw | None]:
    if options.drive:
        return _prescribed(options)
    _refuse(options, OF_MOTIONS, "is for a prescribed motion", "Give --drive too.")
    if Path(options.recording).suffix == ".csv":
        _refuse(options, {**OF_MECHANISMS, "changes": "--set"}, "has no effect on a table", "Leave it out.")
        load = read_cycle(options.recording, options.joint or "")
    else:
        with recorded_run(options.recording, options, rate=DEFAULT_RATE) as path:
            load = run_cycle(read_run_table(path, options.quiet, options.recording), options.joint)
    if options.start_time is not None or options.end_time is not None:
        first, last = float(load.time[0]), float(load.time[-1])
        load = load.between(
            first if options.start_time is None else options.start_time,
            last if options.end_time is None else options.end_time,
        )
    inertia = load.inertia
    if options.inertia:
        unit = "kg*m**2" if load.rotation else "kg"
        inertia = np.full(len(load), parse_value(options.inertia, {}, unit))
    return replace(load, cyclic=not options.once, inertia=inertia), None, None


def _refuse(options: argparse.Namespace, names: Mapping[str, str], why: str, remedy: str) -> None:
    for name, option in names.items():
        if getattr(options, name) not in (None, False, []):
            raise InputError(f"{option} {why}", remedy)


def _prescribed(options: argparse.Namespace) -> tuple[LoadCycle, DrivenMotion, MotionLaw | None]:
    """The load of a drive that moves through its range."""
    if options.speed and options.motion:
        raise InputError("--speed and --motion both say how the drive moves", "Give one of them.")
    _refuse(options, {**OF_MECHANISMS, **OF_CYCLES}, "has no effect on a prescribed motion", "Leave it out.")
    if not options.motion:
        _refuse(options, OF_LAWS, "has no effect on a constant speed", "Give --motion, such as trapezoid:1s.")
    elif options.share is not None and not options.motion.startswith("trapezoid"):
        raise InputError(f"--share has no effect on {options.motion}", "Leave it out, or choose a trapezoid.")
    options.mechanism = options.recording
    mechanism = changed_mechanism(options)
    given = [drive_range(text, mechanism) for text in options.drive]
    print_notes(remark for text in options.drive if (remark := bare_range_remark(text, mechanism)))
    drives = {one.name: (one.start, one.stop) for one, _ in given}
    count = position_count(given, POSITIONS)
    law = None
    if options.motion:
        kind, duration = law_of_text(options.motion)
        share = SHARE if options.share is None else options.share
        law = motion_law(kind, duration, count, share=share, dwell=options.dwell or 0.0, returns=options.returns)
        motion = driven_motion(mechanism, drives, law.places)
    else:
        speed = drive_speed(options.speed or "1", mechanism, [one for one, _ in given])
        motion = driven_motion(mechanism, drives, count, speed=speed)
    cycles = drive_cycles(motion, law)
    name = options.joint or (next(iter(cycles)) if len(cycles) == 1 else "")
    if name not in cycles:
        raise InputError(
            f"there is no drive '{name}'" if name else "there are several drives", _joints(list(cycles), name)
        )
    return cycles[name], motion, law


def _joints(known: Sequence[str], name: str) -> str:
    return nearest(name, known) if name else f"Name one with --joint: {listed(known)}."


def _balanced(
    options: argparse.Namespace, load: LoadCycle, motion: DrivenMotion | None, law: MotionLaw | None
) -> tuple[LoadCycle, Array | None]:
    """The load of the motor after the spring and the flywheel, which are printed; and the speed with a flywheel."""
    if not options.spring and (options.between or options.rest):
        raise InputError("--between and --rest are of a spring", "Give --spring too.")
    if options.spring:
        length = rate = rest = None
        if options.between:
            assert motion is not None
            first, comma, second = options.between.partition(",")
            if not comma:
                raise InputError(f"'{options.between}' is not two points", "Write --between ground.hook,arm.tip.")
            length, rate = spring_between(motion, load.name, first.strip(), second.strip(), law)
        if options.rest:
            rest = parse_value(options.rest, {}, "m" if options.between or not load.rotation else "rad")
        found = balancing_spring(load, options.spring, length=length, rate=rate, rest=rest)
        where = options.between and f"between {options.between.replace(',', ' and ')}"
        print("\n".join(spring_lines(found, load, where or "")))
        load = found.load
    if options.flywheel is not None:
        wheel = flywheel(load, options.flywheel)
        print("\n".join(flywheel_lines(wheel)))
        return load_beside(load, wheel), with_flywheel(load, wheel) if wheel.total else None
    return load, None


def _duties(options: argparse.Namespace, catalog: Catalog, load: LoadCycle) -> list[MotorDuty]:
    """Each motor with each gear; by default the best ratio, and the gears of the catalog that fit."""
    names = options.gear or [BEST, *(name for name, gear in catalog.gears.items() if gear.linear != load.rotation)]
    if not 0.0 < options.efficiency <= 1.0:
        raise InputError(f"an efficiency of {options.efficiency:g} is not possible", "Give one above 0 and up to 1.")
    return [
        motor_duty(load, motor, gear, options.ambient)
        for motor in catalog.motors.values()
        for gear in (_gear(name, catalog, load, motor, options.efficiency) for name in names)
    ]


def _gear(name: str, catalog: Catalog, load: LoadCycle, motor: MotorType, efficiency: float) -> GearType:
    if name == BEST:
        ratio = best_ratio(load, motor, efficiency=efficiency)
        return GearType(BEST, ratio, efficiency, linear=not load.rotation)
    gear = catalog.gear(name, not load.rotation)
    return gear if name in catalog.gears else replace(gear, efficiency=efficiency)


COMMANDS = {
    "size": Command(
        "Size the drive of a joint for a motion and its loads: of a mechanism whose drives move through ranges, of a "
        "run, a recording or a table. Prints peak and RMS efforts and energies, the torque, current, temperature and "
        "limits of each motor of a catalog with each gear, the gear of least RMS torque, a balancing spring and a "
        "flywheel. The status is 1 if no motor suffices.",
        _add_arguments,
        _execute,
    ),
}
