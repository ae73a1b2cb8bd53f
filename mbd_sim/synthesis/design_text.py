"""A design as text, as a mechanism file, and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mbd_sim.errors import MbdSimError, counted
from mbd_sim.kinematic_analysis.drive_loads import drive_loads
from mbd_sim.kinematic_analysis.driven_motion import driven_motion
from mbd_sim.kinematic_analysis.motion_picture import draw_motion
from mbd_sim.kinematic_analysis.prescribed_drives import is_rotation
from mbd_sim.kinematic_analysis.transmission import couplers_and_followers
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.mesh_files import with_meshes_seen_from
from mbd_sim.mechanism_file.override import values_of
from mbd_sim.mechanism_file.yaml_writer import mechanism_text
from mbd_sim.synthesis.goals import EffortGoal, FunctionGoal, Goal, PathGoal
from mbd_sim.synthesis.synthesis import Design, Norm

HEAD = 20  # width of the first column
NEAR = 1e-6  # distance from a bound, relative to its size, at which a value counts as lying on it


def design_text(mechanism: Mechanism, design: Design, goal: Goal, norm: Norm) -> str:
    """The values before and after, and the deviations from the goal."""
    before, unit = values_of(mechanism, list(design.values)), _unit(mechanism, design.drive, goal)
    lines = []
    for key, value in design.values.items():
        low, high = design.bounds[key]
        near = next((f"  at its bound {bound:.6g}" for bound in (low, high) if _is_near(value, bound)), "")
        lines.append(f"{key:<{HEAD}}{before[key]:.6g} -> {value:.10g}{near}")
    if isinstance(goal, FunctionGoal) and goal.free_offset:
        lines.append(f"{'Offset':<{HEAD}}{design.offset:.10g} {unit}")
    what = "Effort" if isinstance(goal, EffortGoal) else "Deviation"
    for name, start, end in (("rms", design.start_rms, design.rms), ("peak", design.start_peak, design.peak)):
        mark = "  (minimized)" if name == norm else ""
        lines.append(f"{f'{what}, {name}':<{HEAD}}{start:.6g} -> {end:.6g} {unit}{mark}")
    ended = "" if design.converged else "; not converged: run again from the values found"
    lines.append(f"{'Search':<{HEAD}}{counted(design.steps, 'step')}{ended}")
    return "\n".join(lines)


def write_mechanism(path: Path, design: Design) -> None:
    """Write the mechanism with the values found; comments of the file are not kept.

    :raises MbdSimError: it cannot be written.
    """
    mechanism = with_meshes_seen_from(design.mechanism, path.parent)
    try:
        path.write_text(mechanism_text(mechanism.source), encoding="utf-8")
    except OSError as error:
        raise MbdSimError(f"{path} cannot be written: {error}") from error


def draw_design(path: Path, design: Design, goal: Goal) -> None:
    """Draw the motion of the mechanism found through the positions of the drive.

    :raises MbdSimError: the picture cannot be written.
    """
    ends = float(np.min(design.drives)), float(np.max(design.drives))
    speed = goal.speed if isinstance(goal, EffortGoal) else 1.0
    motion = driven_motion(design.mechanism, {design.drive: ends}, speed=speed)
    points = [goal.point] if isinstance(goal, PathGoal) else []
    targets = goal.positions if isinstance(goal, PathGoal) else None
    loads = drive_loads(motion) if isinstance(goal, EffortGoal) else None
    draw_motion(path, motion, points, couplers_and_followers(motion.mechanism, [design.drive]), loads, targets)


def _is_near(value: float, bound: float) -> bool:
    return abs(value - bound) <= NEAR * max(abs(bound), 1e-3)


def _unit(mechanism: Mechanism, drive: str, goal: Goal) -> str:
    match goal:
        case PathGoal():
            return "m"
        case FunctionGoal(output=output):
            return "rad" if is_rotation(mechanism, output) else "m"
        case EffortGoal():
            return "N·m" if is_rotation(mechanism, drive) else "N"
