"""The symbols of the joints: pins, balls, crosses, threads and slides, with their supports in ground.

Sliding joints consist of guides, sliders on them, and the springs and dampers along them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.elements.parts import Shape
from mbd_sim.pictures.drawing.outlines import DOT, cylinder, rounded
from mbd_sim.pictures.drawing.parts import ROD_TOLERANCE, along_rod, is_point
from mbd_sim.pictures.drawing.sheet import (
    AXIS_DASH,
    BACK,
    BODIES,
    FRONT,
    GRAY,
    INK,
    STEEL,
    WHITE,
    ScaledView,
    SheetPath,
    arc,
    arrow_head,
    left_of,
    outline_color,
)
from mbd_sim.pictures.drawing.symbols import (
    PIN,
    PlacedJoint,
    ball,
    bearing,
    brake_shoe,
    frame_on_part,
    friction_teeth,
    hatched_line,
    pin,
    post,
    spring_and_damper,
    support,
    torsion_spring,
    wall,
)
from mbd_sim.pictures.shapes.palette import WORK_DRIVES
from mbd_sim.pictures.shapes.solids import half_sizes, is_invisible

SLIDER = np.array([11.0, 6.0])  # pt, half sizes
GUIDE = 0.36  # half length of a guide in ground, relative to the size of the mechanism
BODY = ("block", "cylinder", "sphere", "plate", "disc")


def slider_paths(page: ScaledView, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """A prismatic or cylindrical joint; `size` in m is that of the mechanism."""
    along = unit_or_zero(page.direction(placed.axis))
    if not along.any():
        return []
    depth = page.depth(placed.mover_frame.position)
    paths = _bar_to_center(page, placed)
    if not _on_rod(placed):
        paths += _guide(page, placed, size, along)
    if _body_span(placed) is None and not _in_tube(placed):
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * SLIDER
        box = page.project(placed.mover_frame.position) + corners @ np.array([along, left_of(along)])
        paths.append(SheetPath(rounded(box, 2.5), fill=WHITE, closed=True, width=1.2, depth=depth))
    if placed.joint.friction is not None:
        paths.append(_rough_faces(page, placed, along, depth))
    if placed.elastic() or placed.damped():
        paths += _spring_along_guide(page, placed, size, along)
    return paths


def _bar_to_center(page: ScaledView, placed: PlacedJoint) -> list[SheetPath]:
    """A bar from the slider to the mass center of a part without shapes, which would float beside it."""
    part = placed.mover_part
    if part is None or part.shapes or part.meshes or not part.mass:
        return []
    center = frame_on_part(placed, part).inverse() @ Pose(part.center, np.eye(3))
    end = placed.mover_frame @ center
    line = page.project(np.array([placed.mover_frame.position, end.position]))
    return _bar(line, BACK if page.view.planar else BODIES, page.depth(end.position))


def _bar(line: Array, layer: int, depth: float) -> list[SheetPath]:
    return [
        SheetPath(line, edge=INK, width=4.0, layer=layer, depth=depth),
        SheetPath(line, edge=STEEL, width=2.0, layer=layer, depth=depth),
    ]


def _spring_along_guide(page: ScaledView, placed: PlacedJoint, size: float, along: Array) -> list[SheetPath]:
    """The joint's spring and damper, from the lower end of the guide (or the upper, beyond it) to the sliding body."""
    position, span = placed.displacement, _body_span(placed)
    low, high = guide_range(placed, size)
    anchor = high if position > high + ROD_TOLERANCE * size else low
    sign = 1.0 if position > anchor else -1.0
    start = page.project(placed.carrier_frame.position + anchor * placed.axis)
    near_face = (span[0] if sign > 0.0 else span[1]) if span else 0.0
    depth = page.depth(placed.carrier_frame.position + 0.5 * (anchor + position + near_face) * placed.axis)
    if span:
        inset = abs(near_face) * page.scale * float(np.hypot(*page.direction(placed.axis)))
    else:
        inset = DOT if _in_tube(placed) else SLIDER[0]
    stop = page.project(placed.mover_frame.position) - sign * max(inset, DOT) * along
    paths = spring_and_damper(start, stop, placed.elastic(), placed.damped(), BODIES, depth)
    return [*paths, *(wall(start, -sign * along, depth) if placed.grounded else [])]


def carries_coordinate_only(placed: PlacedJoint) -> bool:
    """Whether a slide connects an invisible part and has no symbol of its own: it only provides a coordinate."""
    joint = placed.joint
    if joint.type != "prismatic" or joint.drive or joint.friction or placed.elastic() or placed.damped():
        return False
    return any(part is not None and is_invisible(part) for part in (placed.carrier_part, placed.mover_part))


def planar_joint_paths(page: ScaledView, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """A planar joint: the springs and dampers along its two directions, from walls in ground."""
    third = np.cross(placed.axis, placed.second)
    paths: list[SheetPath] = []
    for index, direction in enumerate((placed.second, third)):
        along, depth = unit_or_zero(page.direction(direction)), page.depth(placed.mover_frame.position)
        elastic, damped = placed.elastic(index), placed.damped(index)
        if not along.any() or not (elastic or damped):
            continue
        span = placed.mover_span(direction)
        inset = abs(span[0]) * page.scale if span else DOT
        at = page.project(placed.mover_frame.position)
        start = at - (inset + max(GUIDE * size * page.scale, 60.0)) * along
        paths += spring_and_damper(start, at - inset * along, elastic, damped, BODIES, depth)
        paths += wall(start, -along, depth) if placed.grounded else []
    return paths


def guide_end(page: ScaledView, placed: PlacedJoint, size: float) -> Array:
    """The point (3,) in ground's frame at which a guide in ground ends."""
    end = placed.carrier_frame.position + guide_range(placed, size)[1] * placed.axis
    if not page.view.planar:
        return np.asarray(end)
    side = _ground_side(unit_or_zero(page.direction(placed.axis)))
    return np.asarray(end + _half_height(page, placed, side) / page.scale * page.to_space(side))


def _ground_side(along: Array) -> Array:
    """The side (2,) of a guide along `along` (2,) on which ground is: below, or to the left of an upright guide."""
    return left_of(along) if left_of(along)[1] < -1e-9 else -left_of(along)


def _guide(page: ScaledView, placed: PlacedJoint, size: float, along: Array) -> list[SheetPath]:
    """A hatched line in ground in a planar view, otherwise a rod on both sides of the sliding body."""
    low, high = guide_range(placed, size)
    span = _body_span(placed) or (0.0, 0.0)
    faces = placed.displacement + span[0], placed.displacement + span[1]
    points = [placed.carrier_frame.position + position * placed.axis for position in (low, *faces, high)]
    if placed.grounded and page.view.planar:
        side = _ground_side(along)
        offset = _half_height(page, placed, side) * side
        return hatched_line(page.project(points[0]) + offset, page.project(points[3]) + offset, side)
    layer = BACK if page.view.planar else BODIES
    paths: list[SheetPath] = []
    for end, face, sign in ((points[0], points[1], -1.0), (points[3], points[2], 1.0)):
        line, depth = page.project(np.array([end, face])), page.depth((end + face) / 2.0)
        paths += _bar(line, layer, depth)
        paths += wall(page.project(end), sign * along, depth, layer) if placed.grounded else []
    return paths


def _rough_faces(page: ScaledView, placed: PlacedJoint, along: Array, depth: float) -> SheetPath:
    """The sign of friction: saw teeth between the body and its guide."""
    side, span = _ground_side(along), _body_span(placed) or (0.0, 0.0)
    at, foreshortening = page.project(placed.mover_frame.position), float(np.hypot(*page.direction(placed.axis)))
    low, high = (-SLIDER[0], SLIDER[0])
    if span[1] > span[0]:
        low, high = (value * page.scale * foreshortening for value in span)
    below = placed.mover_span(page.to_space(side), BODY)
    foot = at + (below[1] * page.scale if below else float(SLIDER[1])) * side
    return friction_teeth(foot + low * along, foot + high * along, side, FRONT if page.view.planar else BODIES, depth)


def _half_height(page: ScaledView, placed: PlacedJoint, side: Array) -> float:
    """The extent in points of the sliding body from the axis toward a side (2,) of the guide."""
    span = placed.mover_span(page.to_space(side), BODY)
    return max(span[1] * page.scale, 3.0) if span else float(SLIDER[1]) + 0.6


def guide_range(placed: PlacedJoint, size: float) -> tuple[float, float]:
    """Where the guide begins and ends, in m along the axis from the joint's point on the carrier."""
    carrier = placed.carrier_span(placed.axis)
    if carrier is not None and carrier[1] - carrier[0] > 0.02 * size:
        return carrier
    body = _body_span(placed)
    at, half = placed.displacement, GUIDE * size * (1.0 if placed.grounded else 0.6)
    half = max(half, max(-body[0], body[1]) + 0.4 * size) if body else half
    along = placed.joint.kind.coordinates[0]
    if along.direction == "axis" and not along.rotation and (limits := placed.joint.limits_of(0)):
        low, high = min(limits.lower, at) - 0.05 * size, max(limits.upper, at) + 0.05 * size
    else:
        low, high = at - half, at + half
    if placed.carrier_part is not None and not placed.carrier_part.shapes and not placed.carrier_part.meshes:
        return min(low, 0.0), max(high, 0.0)  # the guide begins on the carrier, of which nothing else is drawn
    return low, high


def _body_span(placed: PlacedJoint) -> tuple[float, float] | None:
    """The ends of the sliding body along the axis, in m from the joint's point on it; None where it has no body."""
    return placed.mover_span(placed.axis, BODY)


def _on_rod(placed: PlacedJoint) -> bool:
    """Whether a rod of the carrying part is the guide."""
    part = placed.carrier_part
    return part is not None and any(s.kind == "rod" and along_rod(placed.joint, s) for s in part.shapes)


def _in_tube(placed: PlacedJoint) -> bool:
    """Whether a particle slides along a rod, which is then drawn as a tube around it."""
    return _on_rod(placed) and placed.mover_part is not None and is_point(placed.mover_part)


NUDGE = 0.03  # toward the eye, relative to the size of the mechanism: joints lie in front of their parts
THREAD_PITCH = 6.0  # pt
DRIVE = outline_color(WORK_DRIVES)


def joint_paths(page: ScaledView, placed: PlacedJoint, size: float) -> list[SheetPath]:
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


def _pin(page: ScaledView, placed: PlacedJoint) -> list[SheetPath]:
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


def _hinge(page: ScaledView, placed: PlacedJoint, size: float) -> list[SheetPath]:
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


def _post_direction(page: ScaledView, placed: PlacedJoint, along: float, on_rim: bool) -> Array:
    """The direction (2,) from a pin to the ground that supports it: outward along the axis for pins on a rim."""
    projected = page.direction(placed.axis)
    if on_rim and float(np.hypot(*projected)) > 0.2:
        return unit_or_zero(projected) * (-1.0 if along < 0.0 else 1.0)
    if not on_rim and abs(placed.axis[2]) > 0.7:
        return np.array([0.0, -1.0])
    return placed.support_direction


def label_point(page: ScaledView, placed: PlacedJoint, size: float) -> Array:
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


def _cross(page: ScaledView, placed: PlacedJoint, size: float) -> list[SheetPath]:
    """The two short shafts of a universal joint."""
    center, depth = placed.carrier_frame.position, _depth_in_front(page, placed, size)
    at = page.project(center)
    paths = post(at, placed.support_direction, 24.0, depth, BODIES) if placed.grounded else []
    for axis in (placed.axis, placed.second):
        paths += _steel_cylinder(page, Pose(center, aligning_z(axis)), 30.0, 2.9, depth)
    return [*paths, SheetPath(arc(at, 4.4), fill=WHITE, closed=True, width=1.2, layer=BODIES, depth=depth)]


def _depth_in_front(page: ScaledView, placed: PlacedJoint, size: float) -> float:
    """A depth at which the symbol lies in front of the ends of the rods that it connects."""
    depths = [page.depth(placed.carrier_frame.position) + NUDGE * size]
    for part, frame in ((placed.carrier_part, placed.carrier_frame), (placed.mover_part, placed.mover_frame)):
        if part is not None:
            pose = frame @ frame_on_part(placed, part).inverse()
            rods = [pose @ shape.pose for shape in part.shapes if shape.kind == "rod"]
            depths += [page.depth(rod.position) + 1e-3 * size for rod in rods]
    return max(depths)


def _screw(page: ScaledView, placed: PlacedJoint, size: float) -> list[SheetPath]:
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


def _weld(page: ScaledView, placed: PlacedJoint) -> list[SheetPath]:
    if not placed.grounded:
        return []
    at = page.project(placed.carrier_frame.position)
    across = 17.0 * left_of(placed.support_direction)
    return hatched_line(at - across, at + across, placed.support_direction)


def _drive(page: ScaledView, placed: PlacedJoint) -> list[SheetPath]:
    """An arrow along or about the axis of a driven joint."""
    if not placed.joint.drive:
        return []
    along = unit_or_zero(page.direction(placed.axis))
    if (placed.joint.kind.slides_along_axis or placed.joint.kind.advances) and along.any():
        side = left_of(along) if left_of(along)[1] > 0.0 else -left_of(along)
        at = page.project(placed.mover_frame.position) + 20.0 * side
        heads = [arrow_head(at + sign * 18.0 * along, sign * along, DRIVE) for sign in (1.0, -1.0)]
        line = np.array([at - 13.0 * along, at + 13.0 * along])
        return [SheetPath(line, edge=DRIVE, width=1.4, layer=FRONT), *heads]
    positions = [0.0] if page.view.planar else _pin_positions(placed)
    highest = max(positions, key=lambda position: float(page.project(position * placed.axis)[1]))
    return turning_arrow(page, placed.carrier_frame.position + highest * placed.axis, placed.axis, 19.0)


def turning_arrow(
    page: ScaledView, center: Array, axis: Array, radius: float, color: tuple[int, int, int] = DRIVE
) -> list[SheetPath]:
    """An arrow about an axis (3,), right-handed, with a radius in points."""
    frame = aligning_z(unit_or_zero(axis))
    circle = arc(np.zeros(2), radius / page.scale, -0.3, 3.9, 61)
    points = page.project(center + circle @ frame[:, :2].T)
    head = arrow_head(points[-1] + 2.0 * unit_or_zero(points[-1] - points[-3]), points[-1] - points[-4], color)
    return [SheetPath(points[:-3], edge=color, width=1.4, layer=FRONT), head]


def _axis_line(page: ScaledView, center: Array, axis: Array, half: float, depth: float) -> SheetPath:
    ends = page.project(np.array([center - half * axis, center + half * axis]))
    return SheetPath(ends, edge=GRAY, width=0.8, dash=AXIS_DASH, layer=BODIES, depth=depth)


def _steel_cylinder(page: ScaledView, frame: Pose, length: float, radius: float, depth: float) -> list[SheetPath]:
    """A small steel cylinder about z of `frame`; `length` and `radius` in points."""
    paths = cylinder(page, frame, length / page.scale, radius / page.scale, STEEL)
    return [replace(path, edge=INK, depth=depth) for path in paths]
