"""The curves of a prescribed motion over its drive, in panels, independent of the plotting library."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.drive_loads import DriveLoads
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.motion_table import grounded_outputs
from mbd_sim.kinematic_analysis.prescribed_drives import is_rotation
from mbd_sim.kinematic_analysis.transmission import CouplerAndFollower, TransmissionAngle

MECHANISM = "mechanism"  # the drawing of the mechanism, which is not a panel
MOST_ADVANTAGE = 20.0  # that is drawn
DEGREES = 180.0 / np.pi


@dataclass(frozen=True, eq=False)
class MotionPanel:
    """Curves (n,) by name, over the positions of the drive."""

    title: str
    unit: str
    lines: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class _Curves:
    """What there is to draw."""

    motion: DrivenMotion
    points: Sequence[str]
    pins: Sequence[CouplerAndFollower]
    loads: DriveLoads | None


def motion_panels(
    motion: DrivenMotion,
    points: Sequence[str] = (),
    pins: Sequence[CouplerAndFollower] = (),
    loads: DriveLoads | None = None,
    show: Sequence[str] = (),
) -> list[MotionPanel]:
    """The panels of the groups `show`, in their order; by default, all for which there are data.

    :raises InputError: a group is unknown, or there are no data for it.
    """
    require_groups(show)
    curves = _Curves(motion, points, pins, loads)
    found = {name: list(build(curves)) for name, build in _BUILDERS.items() if not show or name in show}
    for name, panels in found.items():
        if show and not panels:
            raise InputError(f"show: there is nothing to draw for '{name}'", _REMEDIES.get(name, "Leave it out."))
    return [panel for name in show or found for panel in found.get(name, [])]


def require_groups(names: Sequence[str]) -> None:
    """Refuse names that are not in `GROUPS`.

    :raises InputError: there is no such group.
    """
    for name in names:
        if name not in GROUPS:
            raise InputError(f"show: there is no plot '{name}'", nearest(name, GROUPS))


def _coordinates(curves: _Curves, titles: tuple[str, str], units: tuple[str, str], order: int) -> Iterator[MotionPanel]:
    """Positions, velocities or accelerations of angles, then of displacements."""
    motion = curves.motion
    for title, unit, angle in zip(titles, units, (True, False), strict=True):
        factor = DEGREES if angle and order == 0 else 1.0
        names = [name for name in motion.outputs if motion.is_rotation(name) == angle]
        if names:
            yield MotionPanel(title, unit, {name: factor * motion.coordinate(name)[order] for name in names})


def _positions(curves: _Curves) -> Iterator[MotionPanel]:
    return _coordinates(curves, ("Angles", "Displacements"), ("deg", "m"), 0)


def _velocities(curves: _Curves) -> Iterator[MotionPanel]:
    return _coordinates(curves, ("Angular velocities", "Velocities"), ("rad/s", "m/s"), 1)


def _accelerations(curves: _Curves) -> Iterator[MotionPanel]:
    return _coordinates(curves, ("Angular accelerations", "Accelerations"), ("rad/s²", "m/s²"), 2)


def _points(curves: _Curves) -> Iterator[MotionPanel]:
    if curves.points:
        motions = {name: curves.motion.point(name) for name in curves.points}
        speeds = {name: np.linalg.norm(one.velocity, axis=1) for name, one in motions.items()}
        sizes = {name: np.linalg.norm(one.acceleration, axis=1) for name, one in motions.items()}
        yield MotionPanel("Speeds of points", "m/s", speeds)
        yield MotionPanel("Accelerations of points", "m/s²", sizes)


def _transmission(curves: _Curves) -> Iterator[MotionPanel]:
    if curves.pins:
        motion = curves.motion
        angles = {joints.pin: TransmissionAngle(motion.system, joints) for joints in curves.pins}
        lines = {name: DEGREES * np.array([angle(q) for q in motion.q]) for name, angle in angles.items()}
        yield MotionPanel("Transmission angles", "deg", lines)


def _advantage(curves: _Curves) -> Iterator[MotionPanel]:
    lines = {}
    for name in grounded_outputs(curves.motion):
        values = curves.motion.advantage(name)
        lines[name] = np.where(np.abs(values) <= MOST_ADVANTAGE, values, np.nan)
    if lines:
        yield MotionPanel(f"Mechanical advantage, up to {MOST_ADVANTAGE:g}", "", lines)


def _efforts(curves: _Curves) -> Iterator[MotionPanel]:
    if curves.loads is not None:
        mechanism = curves.motion.mechanism
        for name, effort in curves.loads.efforts.items():
            yield MotionPanel(f"Effort of {name}", "N·m" if is_rotation(mechanism, name) else "N", {name: effort})


def _reactions(curves: _Curves) -> Iterator[MotionPanel]:
    if curves.loads is not None:
        forces = {name: np.linalg.norm(one.force, axis=1) for name, one in curves.loads.reactions.items()}
        yield MotionPanel("Forces on joints", "N", forces)


_BUILDERS: Mapping[str, Callable[[_Curves], Iterator[MotionPanel]]] = {
    "positions": _positions,
    "velocities": _velocities,
    "accelerations": _accelerations,
    "points": _points,
    "transmission": _transmission,
    "advantage": _advantage,
    "efforts": _efforts,
    "reactions": _reactions,
}
_REMEDIES = {
    "points": "Name points with --point.",
    "transmission": "Name a pin with --transmission.",
    "efforts": "Give --loads too.",
    "reactions": "Give --loads too.",
}
GROUPS = (MECHANISM, *_BUILDERS)
