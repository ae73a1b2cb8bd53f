"""A prescribed motion as a picture: the mechanism with the paths of points, and curves over the drive.

The curves are in panels that are independent of the plotting library.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError, cause_of, nearest
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.pictures.drawing.animation import TRACE_COLORS, TRACE_WIDTH, traced_point_paths
from mbd_sim.pictures.drawing.constraints import constraint_curves
from mbd_sim.pictures.drawing.parts import bounding_points
from mbd_sim.pictures.drawing.picture import POINTS, Composition, add_picture, mechanism_sheet
from mbd_sim.pictures.drawing.sheet import FRONT, INK, MARKS, ScaledView, SheetPath, view_of
from mbd_sim.pictures.shapes.joints import traced_points
from mbd_sim.pictures.shapes.solids import circle
from mbd_sim.simulation.run.moving_points import points_of
from mbd_sim.studies.kinematic_analysis.loads import CouplerAndFollower, DriveLoads, TransmissionAngle
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion, PointFunctions
from mbd_sim.studies.kinematic_analysis.system import is_rotation
from mbd_sim.studies.kinematic_analysis.text import grounded_outputs

MECHANISM = "mechanism"  # the drawing of the mechanism, which is not a panel
MOST_ADVANTAGE = 20.0  # that is drawn; of larger ones, that many times the least
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
    lines = {name: curves.motion.advantage(name) for name in grounded_outputs(curves.motion)}
    if lines:
        least = [float(np.nanmin(np.abs(values), initial=np.inf)) for values in lines.values()]
        most = MOST_ADVANTAGE * max([1.0, *(value for value in least if np.isfinite(value))])
        drawn = {name: np.where(np.abs(values) <= most, values, np.nan) for name, values in lines.items()}
        yield MotionPanel(f"Mechanical advantage, up to {most:.3g}", "", drawn)


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
    "positions": partial(_coordinates, titles=("Angles", "Displacements"), units=("deg", "m"), order=0),
    "velocities": partial(_coordinates, titles=("Angular velocities", "Velocities"), units=("rad/s", "m/s"), order=1),
    "accelerations": partial(
        _coordinates, titles=("Angular accelerations", "Accelerations"), units=("rad/s²", "m/s²"), order=2
    ),
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


SUFFIXES = (".png", ".svg", ".pdf")
DRAWN = np.array([420.0, 330.0])  # pt, of the mechanism
RESOLUTION = 110.0  # pixels per inch, of PNG
MARGIN = 14.0  # pt
DOT = 2.4  # pt, radius of a target


def require_picture_suffix(path: Path) -> None:
    """Refuse a file that is not one of `SUFFIXES`.

    :raises InputError: the suffix is a different one.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path} is not a picture", f"Use a file name that ends in {', '.join(SUFFIXES)}.")


@interruptible()
def draw_motion(
    path: Path,
    motion: DrivenMotion,
    points: Sequence[str] = (),
    pins: Sequence[CouplerAndFollower] = (),
    loads: DriveLoads | None = None,
    targets: Array | None = None,
    show: Sequence[str] = (),
) -> None:
    """Draw the motion into a file.

    :param show: what is drawn, of `GROUPS`; by default, everything for which there are data.
    :param targets: (k, 3) that the first point is to reach, drawn as dots; nan where a component does not matter. Rows
        are left out that leave open where the dot is.
    :raises InputError: the file has another suffix, or a name of `show` is unknown or has no data.
    :raises MbdSimError: it cannot be written.
    """
    require_picture_suffix(path)
    panels = motion_panels(motion, points, pins, loads, show)
    require_packages("matplotlib", purpose="A picture")
    from matplotlib.figure import Figure

    with_mechanism = MECHANISM in show or not show
    places = _places(len(panels), with_mechanism)
    rows, columns = (1 + max(place[axis] for place in places) for axis in (0, 1))
    figure = Figure(figsize=(5.5 * columns, 2.7 * rows + 0.4), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    if with_mechanism:
        picture = figure.add_subplot(grid[0:2, 0])
        picture.set_axis_off()
        places = places[2:]
    figure.suptitle(motion.mechanism.name)
    for place, panel in zip(places, panels, strict=True):
        _draw_panel(figure.add_subplot(grid[place]), motion, panel)
    try:
        if with_mechanism:
            _draw_mechanism(figure, picture, _mechanism(motion, points, _dots(motion, points, targets)))
        figure.savefig(path, dpi=RESOLUTION)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {cause_of(error)}") from error


def _draw_mechanism(figure: Any, axes: Any, mechanism: Composition) -> None:
    """Draw the mechanism as lines, as large as the axes are when everything else has its place."""
    figure.draw_without_rendering()
    room = axes.get_window_extent().size * POINTS / figure.dpi
    scale = float(np.min(room / mechanism.size))
    add_picture(axes, mechanism, scale)
    margin = 0.5 * (room / scale - mechanism.size)
    axes.set_xlim(-margin[0], mechanism.size[0] + margin[0])
    axes.set_ylim(-margin[1], mechanism.size[1] + margin[1])


def _places(panels: int, with_mechanism: bool) -> list[tuple[int, int]]:
    """The rows and columns of a grid: two, one below the other, of the mechanism, then one of each panel."""
    if not with_mechanism:
        return [divmod(number, 2) for number in range(panels)]
    beside = [(row, 1) for row in range(2)]
    return [(0, 0), (1, 0), *beside[:panels], *(divmod(number, 2) for number in range(4, panels + 2))]


def _draw_panel(axes: Any, motion: DrivenMotion, panel: MotionPanel) -> None:
    angle = is_rotation(motion.mechanism, motion.drive_name)
    x = motion.drive * (DEGREES if angle else 1.0)
    for name, values in panel.lines.items():
        axes.plot(x, values, linewidth=1.2, label=name)
    for one in motion.singular:
        axes.axvline(x[one.row], color="0.6", linewidth=0.8, linestyle=":")
    axes.set_title(panel.title, fontsize="medium")
    axes.set(xlabel=f"{motion.drive_name} ({'deg' if angle else 'm'})", ylabel=panel.unit)
    axes.grid(alpha=0.25)
    if angle and np.ptp(x) > 120.0:
        from matplotlib.ticker import MultipleLocator

        axes.xaxis.set_major_locator(MultipleLocator(30.0 if np.ptp(x) <= 240.0 else 60.0))
    if len(panel.lines) > 1 or not any(name in panel.title for name in panel.lines):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")


def _dots(motion: DrivenMotion, points: Sequence[str], targets: Array | None) -> Array:
    """The targets (k, 3) whose place is known, with components in which the point does not move from the point."""
    if targets is None or not points:
        return np.zeros((0, 3))
    path = motion.point(points[0]).position
    flat = np.ptp(path, axis=0) < 1e-9 * motion.system.constraints.size
    known = np.where(np.isnan(targets) & flat, path[0], targets)
    return known[np.all(np.isfinite(known), axis=1)]


def _mechanism(motion: DrivenMotion, points: Sequence[str], dots: Array) -> Composition:
    """The mechanism in its first configuration, and the paths of points."""
    mechanism = motion.mechanism
    poses = {name: PointFunctions(motion.system, name).pose(motion.q[0]) for name in mechanism.parts}
    paths = [motion.point(name).position for name in points]
    view = view_of(mechanism, poses)
    axes = np.column_stack([view.right, view.up])
    own = bounding_points(mechanism, poses) @ axes
    every = np.vstack([own, dots @ axes, *(path @ axes for path in paths)])
    size = float(np.max(np.ptp(own, axis=0))) or motion.system.constraints.size
    scale = float(np.min((DRAWN - 8.0 * MARGIN) / np.maximum(np.ptp(every, axis=0), 0.2 * size)))
    page = ScaledView(view, scale)
    sheet = _sheet(page, motion, poses, size, points, paths)
    for dot in dots:
        outline = page.project(dot) + DOT * circle(np.linspace(0.0, 2.0 * np.pi, 13))
        sheet.add(SheetPath(outline, edge=None, fill=INK, closed=True, layer=MARKS))
    low, high = sheet.bounds()
    sheet = sheet.translated(MARGIN - low)
    return Composition(sheet, np.ceil(high - low + 2.0 * MARGIN))


def _sheet(
    page: ScaledView,
    motion: DrivenMotion,
    poses: Mapping[str, Pose],
    size: float,
    points: Sequence[str],
    paths: Sequence[Array],
) -> Any:
    curves = constraint_curves(motion.mechanism, poses, page.view)
    sheet = mechanism_sheet(page, motion.mechanism, poses, size, curves)
    known = points_of(motion.mechanism)
    traced = traced_points(motion.mechanism, [name for name in points if split_reference(name, known)[1]])
    sheet.add(*traced_point_paths(page, motion.mechanism, traced, poses))
    for number, path in enumerate(paths):
        color = TRACE_COLORS[number % len(TRACE_COLORS)]
        sheet.add(SheetPath(page.project(path), edge=color, width=TRACE_WIDTH, layer=FRONT))
    return sheet
