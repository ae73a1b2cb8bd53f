"""Joints that slide: guides, sliders on them, and the springs and dampers along them."""

from __future__ import annotations

import numpy as np

from mbd_sim.drawing.ground_symbols import hatched, wall
from mbd_sim.drawing.part_outlines import (
    ALONG,
    along_rod,
    is_phantom,
    is_point,
    reach,
)
from mbd_sim.drawing.placed_joint import Held, own_frame
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.shape_outlines import DOT, rounded
from mbd_sim.drawing.sheet import BACK, BODIES, FRONT, INK, STEEL, WHITE, Path, left_of
from mbd_sim.drawing.spring_symbols import friction, spring_and_damper
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import unit_or_zero
from mbd_sim.mechanism.records import Part

SLIDER = np.array([11.0, 6.0])  # pt, half sizes
GUIDE = 0.36  # half length of a guide in ground, by the size of the mechanism
BODY = ("block", "cylinder", "sphere", "plate", "disc")


def slide(page: Page, held: Held, size: float) -> list[Path]:
    """A prismatic or cylindrical joint; `size` in m is that of the mechanism."""
    seen = unit_or_zero(page.seen(held.axis))
    if not seen.any():
        return []
    position, depth = held.displacement, page.depth(held.mover.position)
    low, high = guide_range(held, size)
    span = _span(held)
    at = page.at(held.mover.position)
    paths: list[Path] = []
    if not _in_rod(held):
        inside = (position + span[0], position + span[1]) if span else (position, position)
        paths += _guide(page, held, (low, *inside, high), seen)
    if span is None and not _in_tube(held):
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * SLIDER
        box = at + corners @ np.array([seen, left_of(seen)])
        paths.append(Path(rounded(box, 2.5), fill=WHITE, closed=True, width=1.2, depth=depth))
    if held.joint.friction is not None:
        paths += _rubbing(page, held, seen, depth)
    elastic, damped = held.elastic(), held.damped()
    if elastic or damped:
        anchor = high if position > high + ALONG * size else low
        sign = 1.0 if position > anchor else -1.0
        start = page.at(held.carrier.position + anchor * held.axis)
        face = position + (span[0] if sign > 0.0 else span[1]) if span else position
        depth = page.depth(held.carrier.position + 0.5 * (anchor + face) * held.axis)
        gap = SLIDER[0] if not _in_tube(held) else DOT
        inset = (
            abs(span[0] if sign > 0.0 else span[1]) * page.scale * float(np.hypot(*page.seen(held.axis)))
            if span
            else gap
        )
        paths += spring_and_damper(start, at - sign * max(inset, DOT) * seen, elastic, damped, BODIES, depth)
        paths += wall(start, -sign * seen, depth) if held.grounded else []
    return paths


def slides_phantom(held: Held) -> bool:
    """Whether a slide is there only for the sake of a coordinate: from or to a part that is not to be seen."""
    loose = held.joint.type == "prismatic" and not (held.elastic() or held.damped() or held.joint.friction)
    return loose and not held.joint.drive and any(part and is_phantom(part) for part in (held.carrying, held.moving))


def table(page: Page, held: Held, size: float) -> list[Path]:
    """A planar joint: the springs and dampers along its two directions, from walls in ground."""
    third = np.cross(held.axis, held.second)
    paths: list[Path] = []
    for place, direction in enumerate((held.second, third)):
        seen, depth = unit_or_zero(page.seen(direction)), page.depth(held.mover.position)
        elastic, damped = held.elastic(place), held.damped(place)
        span = (
            reach(held.moving, own_frame(held, held.moving), held.mover.rotation.T @ direction) if held.moving else None
        )
        inset = abs(span[0]) * page.scale if span else DOT
        if not seen.any() or not (elastic or damped):
            continue
        at = page.at(held.mover.position)
        start = at - (inset + max(GUIDE * size * page.scale, 60.0)) * seen
        paths += spring_and_damper(start, at - inset * seen, elastic, damped, BODIES, depth)
        paths += wall(start, -seen, depth) if held.grounded else []
    return paths


def guide_end(page: Page, held: Held, size: float) -> Array:
    """The point (3,) in ground's frame where a guide in ground ends."""
    end = held.carrier.position + guide_range(held, size)[1] * held.axis
    if not page.view.planar:
        return np.asarray(end)
    side = _side(unit_or_zero(page.seen(held.axis)))
    return np.asarray(
        end + _half_height(page, held, side) / page.scale * (side @ np.array([page.view.right, page.view.up]))
    )


def _side(seen: Array) -> Array:
    """The side (2,) of a guide on which ground is: below, or to the left of an upright one."""
    return left_of(seen) if left_of(seen)[1] < -1e-9 else -left_of(seen)


def _guide(page: Page, held: Held, where: tuple[float, float, float, float], seen: Array) -> list[Path]:
    """The guide on both sides of the body, from and to `where` in m along the axis."""
    points = [held.carrier.position + along * held.axis for along in where]
    if held.grounded and page.view.planar:
        side = _side(seen)
        offset = _half_height(page, held, side) * side
        return hatched(page.at(points[0]) + offset, page.at(points[3]) + offset, side)
    layer = BACK if page.view.planar else BODIES
    paths: list[Path] = []
    for end, face, sign in ((points[0], points[1], -1.0), (points[3], points[2], 1.0)):
        line, depth = page.at(np.array([end, face])), page.depth((end + face) / 2.0)
        paths += [Path(line, edge=INK, width=4.0, layer=layer, depth=depth)]
        paths += [Path(line, edge=STEEL, width=2.0, layer=layer, depth=depth)]
        paths += wall(page.at(end), sign * seen, depth, layer) if held.grounded else []
    return paths


def _rubbing(page: Page, held: Held, seen: Array, depth: float) -> list[Path]:
    """Teeth of a saw between the body and its guide."""
    side, span = _side(seen), _span(held) or (0.0, 0.0)
    at, shown = page.at(held.mover.position), float(np.hypot(*page.seen(held.axis)))
    low, high = (value * page.scale * shown for value in span) if span[1] > span[0] else (-SLIDER[0], SLIDER[0])
    across = side @ np.array([page.view.right, page.view.up])
    under = None
    if held.moving is not None:
        under = reach(held.moving, own_frame(held, held.moving), held.mover.rotation.T @ across, BODY)
    foot = at + (under[1] * page.scale if under else float(SLIDER[1])) * side
    return [friction(foot + low * seen, foot + high * seen, side, FRONT if page.view.planar else BODIES, depth)]


def _half_height(page: Page, held: Held, side: Array) -> float:
    """How far in points the sliding body goes to a side (2,) of the guide."""
    direction = side @ np.array([page.view.right, page.view.up])
    span = None
    if held.moving is not None:
        span = reach(held.moving, own_frame(held, held.moving), held.mover.rotation.T @ direction, BODY)
    return max(span[1] * page.scale, 3.0) if span else float(SLIDER[1]) + 0.6


def guide_range(held: Held, size: float) -> tuple[float, float]:
    """From where to where in m along the axis the guide goes."""
    if held.carrying is not None:
        span = reach(held.carrying, own_frame(held, held.carrying), held.carrier.rotation.T @ held.axis)
        if span is not None and span[1] - span[0] > 0.02 * size:
            return span
    body = _span(held)
    at, half = held.displacement, GUIDE * size * (1.0 if held.grounded else 0.6)
    half = max(half, max(-body[0], body[1]) + 0.4 * size) if body else half
    if held.joint.limits is not None:
        return min(held.joint.limits.lower, at) - 0.05 * size, max(held.joint.limits.upper, at) + 0.05 * size
    return at - half, at + half


def _span(held: Held) -> tuple[float, float] | None:
    """From where to where in m along the axis the sliding body goes; None where it has no body to be seen."""
    if held.moving is None:
        return None
    return reach(held.moving, own_frame(held, held.moving), held.mover.rotation.T @ held.axis, BODY)


def _in_rod(held: Held) -> bool:
    """Whether a rod of the carrying part is the guide."""
    part: Part | None = held.carrying
    return part is not None and any(s.kind == "rod" and along_rod(part, held.joint, s) for s in part.shapes)


def _in_tube(held: Held) -> bool:
    return _in_rod(held) and held.moving is not None and is_point(held.moving)
