"""A prescribed motion as a picture: the mechanism with the paths of points, and curves over the drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.appearance.polylines import circle
from mbd_sim.drawing.animation import TRACE_COLORS, TRACE_WIDTH, traced_point_paths, traced_points
from mbd_sim.drawing.composition import Composition, mechanism_sheet
from mbd_sim.drawing.curve_paths import constraint_curves
from mbd_sim.drawing.part_outlines import bounding_points
from mbd_sim.drawing.picture import POINTS, add_picture
from mbd_sim.drawing.projection import Page, view_of
from mbd_sim.drawing.sheet import FRONT, INK, MARKS, SheetPath
from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.kinematic_analysis.drive_loads import DriveLoads
from mbd_sim.kinematic_analysis.driven_motion import DrivenMotion
from mbd_sim.kinematic_analysis.motion_panels import DEGREES, MECHANISM, MotionPanel, motion_panels
from mbd_sim.kinematic_analysis.point_motion import PointFunctions
from mbd_sim.kinematic_analysis.prescribed_drives import is_rotation
from mbd_sim.kinematic_analysis.transmission import CouplerAndFollower
from mbd_sim.mechanism.attachments import split_reference
from mbd_sim.packages import require_packages
from mbd_sim.simulation.part_motion import points_of

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

    :param show: what is drawn, of `motion_panels.GROUPS`; by default, everything for which there are data.
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
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


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
        axes.xaxis.set_major_locator(_multiples_of(30.0 if np.ptp(x) <= 240.0 else 60.0))
    if len(panel.lines) > 1 or not any(name in panel.title for name in panel.lines):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize="small")


def _multiples_of(step: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(step)


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
    size = max(float(np.max(np.ptp(own, axis=0))), 1e-9)
    scale = float(np.min((DRAWN - 8.0 * MARGIN) / np.maximum(np.ptp(every, axis=0), 0.2 * size)))
    page = Page(view, scale)
    sheet = _sheet(page, motion, poses, size, points, paths)
    for dot in dots:
        outline = page.project(dot) + DOT * circle(np.linspace(0.0, 2.0 * np.pi, 13))
        sheet.add(SheetPath(outline, edge=None, fill=INK, closed=True, layer=MARKS))
    low, high = sheet.bounds()
    sheet = sheet.translated(MARGIN - low)
    return Composition(sheet, np.ceil(high - low + 2.0 * MARGIN))


def _sheet(
    page: Page,
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
