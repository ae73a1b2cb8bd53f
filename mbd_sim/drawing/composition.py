"""The layout of a drawing: the mechanism, its names and the legend, at the scale at which they fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbd_sim.appearance.implicit_curves import CurveLine
from mbd_sim.appearance.palette import part_colors
from mbd_sim.appearance.solids import is_invisible
from mbd_sim.drawing import legend
from mbd_sim.drawing.constraint_symbols import constraint_paths
from mbd_sim.drawing.curve_paths import constraint_curves, curve_paths
from mbd_sim.drawing.drive_symbols import drive_paths
from mbd_sim.drawing.joint_symbols import joint_paths, label_point
from mbd_sim.drawing.label_placement import place_labels
from mbd_sim.drawing.load_symbols import force_paths, two_point_paths
from mbd_sim.drawing.part_outlines import (
    bounding_points,
    mass_center,
    part_paths,
    pin_bar_paths,
)
from mbd_sim.drawing.placed_joint import PlacedJoint, middle, place_joint
from mbd_sim.drawing.projection import Page, view_of
from mbd_sim.drawing.sheet import FRONT, GRAY, INK, Sheet, SheetPath, SheetText, arc, outline_color
from mbd_sim.drawing.slider_symbols import carries_coordinate_only
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.records import Mechanism, Part

MAX_SIZE = np.array([500.0, 400.0])  # pt, of the mechanism
MIN_WIDTH = 330.0  # pt, of the whole drawing
MAX_ENLARGEMENT = 1.5  # relative to the scale at which the mechanism alone would fill the drawing
MARGIN, TITLE = 16.0, 26.0  # pt
PART_NAME, JOINT_NAME = 10.0, 9.0  # pt
MAX_COVERED = 8.0  # cost up to which the name of a joint may cover lines


@dataclass(frozen=True, eq=False)
class Composition:
    """A finished sheet from (0, 0) to `size` (2,), in points."""

    sheet: Sheet
    size: Array


def compose(mechanism: Mechanism, poses: Mapping[str, Pose], title: str | None = None) -> Composition:
    """Lay out a mechanism at the poses of its parts."""
    view = view_of(mechanism, poses)
    curves = constraint_curves(mechanism, poses, view)
    spread = bounding_points(mechanism, poses) @ np.column_stack([view.right, view.up])
    size = max(float(np.max(np.ptp(spread, axis=0))), 0.0) or 1.0
    scale = float(np.min(MAX_SIZE)) / size
    for _ in range(5):  # lines and symbols have sizes in points, so that the scale is found by iteration
        sheet = mechanism_sheet(Page(view, scale), mechanism, poses, size, curves)
        low, high = sheet.bounds()
        scale *= float(np.clip(np.min(MAX_SIZE / np.maximum(high - low, 1.0)), 0.2, 5.0))
        scale = min(scale, MAX_ENLARGEMENT * float(np.max(MAX_SIZE)) / size)  # the mechanism may be a single dot
    page = Page(view, scale)
    sheet = mechanism_sheet(page, mechanism, poses, size, curves)
    joints = [place_joint(page, mechanism, poses, joint) for joint in mechanism.all_joints.values()]
    sheet.texts += place_labels(sheet, _joint_and_part_labels(page, mechanism, poses, joints, size))
    low, high = sheet.bounds()
    width = max(float((high - low)[0]) + 2.0 * MARGIN, MIN_WIDTH)
    base = legend.HEIGHT + 0.5 * MARGIN
    sheet = sheet.translated(np.array([0.5 * width, base]) - [0.5 * (low + high)[0], low[1]])
    legend.add_strip(sheet, page, mechanism.gravity, width)
    height = base + float((high - low)[1]) + MARGIN
    if title:
        sheet.texts.append(SheetText(title, np.array([0.5 * width, height + 0.25 * TITLE]), 13.0, INK))
        height += TITLE
    return Composition(sheet, np.ceil([width, height]))  # whole points keep SVG short


def mechanism_sheet(
    page: Page,
    mechanism: Mechanism,
    poses: Mapping[str, Pose],
    size: float,
    curves: Sequence[CurveLine],
    start: Mapping[str, Pose] | None = None,
) -> Sheet:
    """The mechanism alone, without names.

    :param size: the length in m of the mechanism, to which the size of symbols is relative.
    :param start: the poses at which there is room for the supports of ground, which do not move; by default the same.
    """
    sheet, colors = Sheet(), part_colors(mechanism)
    joints = [place_joint(page, mechanism, poses, joint) for joint in mechanism.all_joints.values()]
    if start is not None:
        joints = [_supported_as_at(start, page, mechanism, joint) for joint in joints]
    for name, part in mechanism.parts.items():
        sheet.add(*part_paths(page, mechanism, part, poses[name], colors[name]))
    sheet.add(*pin_bar_paths(page, mechanism, poses, colors))
    occupied = [np.mean(path.points[:-1], axis=0) for path in sheet.paths if path.particle]
    sheet.add(*curve_paths(page, curves))
    sheet.add(*two_point_paths(page, mechanism, poses), *constraint_paths(page, mechanism, poses, size))
    for joint in joints:
        sheet.add(*joint_paths(page, joint, size))
    if page.view.planar:
        sheet.paths = [_without_depth(path) for path in sheet.paths]
    round_joints = [joint for joint in joints if joint.joint.kind.keeps_point and joint.joint.kind.connects]
    occupied += [page.project(joint.carrier_frame.position) for joint in round_joints]  # hidden by their symbols
    for name, part in mechanism.parts.items():
        sheet.add(*mass_center(page, part, poses[name], occupied))
    sheet.add(*force_paths(page, mechanism, poses), *drive_paths(page, mechanism, poses))
    return sheet


def _supported_as_at(start: Mapping[str, Pose], page: Page, mechanism: Mechanism, placed: PlacedJoint) -> PlacedJoint:
    if not placed.grounded:
        return placed
    return replace(placed, support_direction=place_joint(page, mechanism, start, placed.joint).support_direction)


def _without_depth(path: SheetPath) -> SheetPath:
    """Without depth: in a planar view things lie in the order of the file, with particles, springs and pins on top."""
    return replace(path, depth=0.0, layer=FRONT if path.particle else path.layer)


def _joint_and_part_labels(
    page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], joints: Sequence[PlacedJoint], size: float
) -> list[tuple[SheetText, float]]:
    """The names of the parts, and of the joints that move where there is room, each with the most it may cover."""
    colors = part_colors(mechanism)
    names = [
        (
            SheetText(_spaced(name), _label_point(page, part, poses[name]), PART_NAME, outline_color(colors[name])),
            math.inf,
        )
        for name, part in mechanism.parts.items()
        if not is_invisible(part)
    ]
    for joint in joints:
        if joint.joint.kind.connects and not carries_coordinate_only(joint):
            at = page.project(label_point(page, joint, size))
            names.append((SheetText(_spaced(joint.joint.name), at, JOINT_NAME, GRAY, italic=True), MAX_COVERED))
    return names


def _label_point(page: Page, part: Part, pose: Pose) -> Array:
    """The point (2,) on the sheet near which the name of a part is written; of a ring, a point on its rim."""
    if part.shapes and all(shape.kind == "ring" for shape in part.shapes):
        ring = pose @ part.shapes[0].pose
        circle = arc(np.zeros(2), part.shapes[0].size[0]) @ ring.rotation[:, :2].T
        projected = page.project(ring.position + circle)
        return np.asarray(projected[int(np.argmax(projected @ [0.6, 0.8]))])
    return page.project(pose.position + pose.rotation @ middle(part))


def _spaced(name: str) -> str:
    return name.replace("_", " ")
