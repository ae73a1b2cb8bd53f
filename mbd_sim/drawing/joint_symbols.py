"""The symbols of the joints: pins, balls, crosses, threads, and their supports in ground."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

import numpy as np

from mbd_sim.appearance.palette import WORK_DRIVES
from mbd_sim.appearance.solids import half_sizes
from mbd_sim.drawing.ground_symbols import (
    PIN,
    ball,
    bearing,
    hatched_line,
    pin,
    post,
    support,
)
from mbd_sim.drawing.placed_joint import PlacedJoint, frame_on_part
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.shape_outlines import cylinder
from mbd_sim.drawing.sheet import (
    AXIS_DASH,
    BACK,
    BODIES,
    FRONT,
    GRAY,
    INK,
    STEEL,
    WHITE,
    SheetPath,
    arc,
    arrow_head,
    left_of,
    outline_color,
)
from mbd_sim.drawing.slider_symbols import (
    carries_coordinate_only,
    guide_end,
    planar_joint_paths,
    slider_paths,
)
from mbd_sim.drawing.spring_symbols import brake_shoe, torsion_spring
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.records import Shape

NUDGE = 0.03  # toward the eye, relative to the size of the mechanism: joints lie in front of their parts
THREAD_PITCH = 6.0  # pt
DRIVE = outline_color(WORK_DRIVES)


def joint_paths(page: Page, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """The symbol of a joint; joints that only provide a coordinate have none. `size` in m is that of the mechanism."""
    if carries_coordinate_only(placed):
        return []
    match placed.joint.type:
        case "revolute":
            paths = _pin(page, placed) if page.view.planar else _hinge(page, placed, size)
        case "prismatic" | "cylindrical":
            paths = slider_paths(page, placed, size)
        case "planar":
            paths = planar_joint_paths(page, placed, size)
        case "screw":
            paths = _screw(page, placed, size)
        case "universal":
            paths = _cross(page, placed, size)
        case "spherical":
            depth = _depth_in_front(page, placed, size)
            at = page.project(placed.carrier_frame.position)
            base = post(at, placed.support_direction, 17.0, depth, BODIES) if placed.grounded else []
            paths = [*base, *ball(at, placed.support_direction, depth, BODIES)]
        case "fixed":
            paths = _weld(page, placed)
        case "free":
            paths = []
        case _:
            assert_never(placed.joint.type)
    return [*paths, *_drive(page, placed)]


def _pin(page: Page, placed: PlacedJoint) -> list[SheetPath]:
    """A pin seen along its axis; in ground it stands on a bracket, or in a bearing where the view is from above."""
    at = page.project(placed.carrier_frame.position)
    spring = torsion_spring(at, FRONT) if placed.elastic() else []
    spring += brake_shoe(at, -placed.support_direction, FRONT) if placed.joint.friction else []
    if not placed.grounded:
        return [*spring, *pin(at)]
    if abs(float(page.view.toward[2])) > 0.5:
        return [*bearing(at), *spring, *pin(at)]
    span = placed.mover_span(page.view.up, ("disc", "cylinder", "block", "plate", "sphere"))
    hidden = span is not None and span[0] < 0.0 < span[1]
    return [*support(at, placed.support_direction, BODIES if hidden else BACK), *spring, *pin(at)]


def _hinge(page: Page, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """The axis as a dash-dotted line, with pins on it: at the rims of a ring whose diameter it is, if there is one."""
    center, axis = placed.carrier_frame.position, placed.axis
    rims, pin_positions = _rims(placed), _pin_positions(placed)
    half_length = max(*pin_positions, 0.12 * size) + 22.0 / page.scale
    paths = [_axis_line(page, center, axis, half_length, page.depth(center) - 1e-3 * size)]
    for along in pin_positions:
        position = center + along * axis
        depth = page.depth(position) + NUDGE * size if any(pin_positions) else _depth_in_front(page, placed, size)
        if placed.grounded:
            outward = _post_direction(page, placed, along, bool(rims))
            paths += post(page.project(position), outward, 20.0, depth - 1e-6 * size, BODIES)
        paths += _steel_cylinder(page, Pose(position, aligning_z(axis)), 15.0, PIN, depth)
    at, depth = page.project(center), page.depth(center) + NUDGE * size
    spring = torsion_spring(at, BODIES, depth) if placed.elastic() else []
    brake = brake_shoe(at, -placed.support_direction, BODIES, depth) if placed.joint.friction else []
    return [*paths, *spring, *brake]


def _post_direction(page: Page, placed: PlacedJoint, along: float, on_rim: bool) -> Array:
    """The direction (2,) from a pin to the ground that supports it: outward along the axis for pins on a rim."""
    projected = page.direction(placed.axis)
    if on_rim and float(np.hypot(*projected)) > 0.2:
        return unit_or_zero(projected) * (-1.0 if along < 0.0 else 1.0)
    if not on_rim and abs(placed.axis[2]) > 0.7:
        return np.array([0.0, -1.0])
    return placed.support_direction


def label_point(page: Page, placed: PlacedJoint, size: float) -> Array:
    """The point (3,) in ground's frame near which the name of a joint is written."""
    if placed.joint.kind.slides_along_axis and placed.grounded:
        return guide_end(page, placed, size)
    if placed.joint.kind.slides:
        return placed.mover_frame.position
    if placed.joint.type == "revolute" and not page.view.planar:
        nearest = max(_pin_positions(placed), key=lambda along: along * page.depth(placed.axis))
        return np.asarray(placed.carrier_frame.position + nearest * placed.axis)
    return placed.carrier_frame.position


def _pin_positions(placed: PlacedJoint) -> list[float]:
    """The positions along the axis, in m from the joint's point, at which the pins of a hinge are visible."""
    rims = _rims(placed)
    if rims:
        return [max(rims), -max(rims)]
    span = placed.mover_span(placed.axis, ("block", "sphere"))
    if span is not None and span[0] < 0.0 < span[1]:
        return [span[1], span[0]]
    return [0.0]


def _rims(placed: PlacedJoint) -> list[float]:
    """Radii in m of the rings that have the joint's axis as a diameter."""
    radii: list[float] = []
    for part, frame in ((placed.carrier_part, placed.carrier_frame), (placed.mover_part, placed.mover_frame)):
        if part is None:
            continue
        into = frame_on_part(placed, part)
        own = into.rotation @ frame.rotation.T @ placed.axis
        radii += [
            shape.size[0]
            for shape in part.shapes
            if shape.kind == "ring"
            and np.allclose(shape.pose.position, into.position, atol=1e-9)
            and abs(float(shape.pose.rotation[:, 2] @ own)) < 1e-6
        ]
    return radii


def _cross(page: Page, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """The two short shafts of a universal joint."""
    center, depth = placed.carrier_frame.position, _depth_in_front(page, placed, size)
    at = page.project(center)
    paths = post(at, placed.support_direction, 24.0, depth, BODIES) if placed.grounded else []
    for axis in (placed.axis, placed.second):
        paths += _steel_cylinder(page, Pose(center, aligning_z(axis)), 30.0, 2.9, depth)
    return [*paths, SheetPath(arc(at, 4.4), fill=WHITE, closed=True, width=1.2, layer=BODIES, depth=depth)]


def _depth_in_front(page: Page, placed: PlacedJoint, size: float) -> float:
    """A depth at which the symbol lies in front of the ends of the rods that it connects."""
    depths = [page.depth(placed.carrier_frame.position) + NUDGE * size]
    for part, frame in ((placed.carrier_part, placed.carrier_frame), (placed.mover_part, placed.mover_frame)):
        if part is not None:
            pose = frame @ frame_on_part(placed, part).inverse()
            rods = [pose @ shape.pose for shape in part.shapes if shape.kind == "rod"]
            depths += [page.depth(rod.position) + 1e-3 * size for rod in rods]
    return max(depths)


def _screw(page: Page, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """A thread on the moving part's cylinder, in a nut; in ground the nut is hatched on both sides."""
    shafts = _shafts(placed)
    radius = max((half_sizes(shape)[0] for shape in shafts), default=7.0 / page.scale)
    length = max((half_sizes(shape)[2] for shape in shafts), default=40.0 / page.scale)
    center, nut = placed.mover_frame.position, placed.carrier_frame.position
    frame = aligning_z(placed.axis)
    across = unit_or_zero(np.cross(page.view.toward, placed.axis))
    depth, pitch = page.depth(nut) + 0.3 * NUDGE * size, THREAD_PITCH / page.scale
    paths = []
    if not shafts:
        paths = _steel_cylinder(page, Pose(center, frame), 2.0 * length * page.scale, radius * page.scale, depth)
    slant = radius * across + 0.25 * pitch * placed.axis
    for along in np.arange(-length + pitch, length - 0.5 * pitch, pitch):
        turn_center = center + along * placed.axis
        ends = page.project(np.array([turn_center + slant, turn_center - slant]))
        paths.append(SheetPath(ends, edge=GRAY, width=0.9, layer=BODIES, depth=depth))
    nut_paths = cylinder(page, Pose(nut, frame), 20.0 / page.scale, radius + 9.0 / page.scale, STEEL)
    paths += [replace(path, depth=depth + 1e-4 * size) for path in nut_paths]
    if placed.grounded:
        sideways = unit_or_zero(page.direction(across))
        for outward in (sideways, -sideways):
            edge, half = page.project(nut) + (radius * page.scale + 9.0) * outward, 15.0 * left_of(outward)
            paths += hatched_line(edge - half, edge + half, outward, BODIES, depth)
    return paths


def _shafts(placed: PlacedJoint) -> list[Shape]:
    """The cylinders of the moving part whose axis is parallel to the joint's."""
    if placed.mover_part is None:
        return []
    own = frame_on_part(placed, placed.mover_part).rotation @ placed.mover_frame.rotation.T @ placed.axis
    return [
        shape
        for shape in placed.mover_part.shapes
        if shape.kind == "cylinder" and abs(float(shape.pose.rotation[:, 2] @ own)) > 1.0 - 1e-6
    ]


def _weld(page: Page, placed: PlacedJoint) -> list[SheetPath]:
    if not placed.grounded:
        return []
    at = page.project(placed.carrier_frame.position)
    across = 17.0 * left_of(placed.support_direction)
    return hatched_line(at - across, at + across, placed.support_direction)


def _drive(page: Page, placed: PlacedJoint) -> list[SheetPath]:
    """An arrow along or about the axis of a driven joint."""
    if not placed.joint.drive:
        return []
    along = unit_or_zero(page.direction(placed.axis))
    if placed.joint.type in ("prismatic", "cylindrical", "screw") and along.any():
        side = left_of(along) if left_of(along)[1] > 0.0 else -left_of(along)
        at = page.project(placed.mover_frame.position) + 20.0 * side
        heads = [arrow_head(at + sign * 18.0 * along, sign * along, DRIVE) for sign in (1.0, -1.0)]
        line = np.array([at - 13.0 * along, at + 13.0 * along])
        return [SheetPath(line, edge=DRIVE, width=1.4, layer=FRONT), *heads]
    positions = [0.0] if page.view.planar else _pin_positions(placed)
    highest = max(positions, key=lambda position: float(page.project(position * placed.axis)[1]))
    return turning_arrow(page, placed.carrier_frame.position + highest * placed.axis, placed.axis, 19.0)


def turning_arrow(
    page: Page, center: Array, axis: Array, radius: float, color: tuple[int, int, int] = DRIVE
) -> list[SheetPath]:
    """An arrow about an axis (3,), right-handed, with a radius in points."""
    frame = aligning_z(unit_or_zero(axis))
    circle = arc(np.zeros(2), radius / page.scale, -0.3, 3.9, 61)
    points = page.project(center + circle @ frame[:, :2].T)
    head = arrow_head(points[-1] + 2.0 * unit_or_zero(points[-1] - points[-3]), points[-1] - points[-4], color)
    return [SheetPath(points[:-3], edge=color, width=1.4, layer=FRONT), head]


def _axis_line(page: Page, center: Array, axis: Array, half: float, depth: float) -> SheetPath:
    ends = page.project(np.array([center - half * axis, center + half * axis]))
    return SheetPath(ends, edge=GRAY, width=0.8, dash=AXIS_DASH, layer=BODIES, depth=depth)


def _steel_cylinder(page: Page, frame: Pose, length: float, radius: float, depth: float) -> list[SheetPath]:
    """A small steel cylinder about z of `frame`; `length` and `radius` in points."""
    paths = cylinder(page, frame, length / page.scale, radius / page.scale, STEEL)
    return [replace(path, edge=INK, depth=depth) for path in paths]
