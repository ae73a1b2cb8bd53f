"""Sliding joints: guides, sliders on them, and the springs and dampers along them."""

from __future__ import annotations

import numpy as np

from mbd_sim.appearance.solids import is_invisible
from mbd_sim.drawing.ground_symbols import hatched_line, wall
from mbd_sim.drawing.part_outlines import (
    ROD_TOLERANCE,
    along_rod,
    is_point,
)
from mbd_sim.drawing.placed_joint import PlacedJoint, frame_on_part
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.shape_outlines import DOT, rounded
from mbd_sim.drawing.sheet import BACK, BODIES, FRONT, INK, STEEL, WHITE, SheetPath, left_of
from mbd_sim.drawing.spring_symbols import friction_teeth, spring_and_damper
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import unit_or_zero

SLIDER = np.array([11.0, 6.0])  # pt, half sizes
GUIDE = 0.36  # half length of a guide in ground, relative to the size of the mechanism
BODY = ("block", "cylinder", "sphere", "plate", "disc")


def slider_paths(page: Page, placed: PlacedJoint, size: float) -> list[SheetPath]:
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


def _bar_to_center(page: Page, placed: PlacedJoint) -> list[SheetPath]:
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


def _spring_along_guide(page: Page, placed: PlacedJoint, size: float, along: Array) -> list[SheetPath]:
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


def planar_joint_paths(page: Page, placed: PlacedJoint, size: float) -> list[SheetPath]:
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


def guide_end(page: Page, placed: PlacedJoint, size: float) -> Array:
    """The point (3,) in ground's frame at which a guide in ground ends."""
    end = placed.carrier_frame.position + guide_range(placed, size)[1] * placed.axis
    if not page.view.planar:
        return np.asarray(end)
    side = _ground_side(unit_or_zero(page.direction(placed.axis)))
    return np.asarray(end + _half_height(page, placed, side) / page.scale * page.to_space(side))


def _ground_side(along: Array) -> Array:
    """The side (2,) of a guide along `along` (2,) on which ground is: below, or to the left of an upright guide."""
    return left_of(along) if left_of(along)[1] < -1e-9 else -left_of(along)


def _guide(page: Page, placed: PlacedJoint, size: float, along: Array) -> list[SheetPath]:
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


def _rough_faces(page: Page, placed: PlacedJoint, along: Array, depth: float) -> SheetPath:
    """The sign of friction: saw teeth between the body and its guide."""
    side, span = _ground_side(along), _body_span(placed) or (0.0, 0.0)
    at, foreshortening = page.project(placed.mover_frame.position), float(np.hypot(*page.direction(placed.axis)))
    low, high = (-SLIDER[0], SLIDER[0])
    if span[1] > span[0]:
        low, high = (value * page.scale * foreshortening for value in span)
    below = placed.mover_span(page.to_space(side), BODY)
    foot = at + (below[1] * page.scale if below else float(SLIDER[1])) * side
    return friction_teeth(foot + low * along, foot + high * along, side, FRONT if page.view.planar else BODIES, depth)


def _half_height(page: Page, placed: PlacedJoint, side: Array) -> float:
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
    return part is not None and any(s.kind == "rod" and along_rod(part, placed.joint, s) for s in part.shapes)


def _in_tube(placed: PlacedJoint) -> bool:
    """Whether a particle slides along a rod, which is then drawn as a tube around it."""
    return _on_rod(placed) and placed.mover_part is not None and is_point(placed.mover_part)
