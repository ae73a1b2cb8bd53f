"""The symbols of the joints: pins, balls, crosses, threads, and what in ground holds them."""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

import numpy as np

from mbd_sim.appearance.extent import half_sizes
from mbd_sim.appearance.palette import WORK_DRIVES
from mbd_sim.drawing.ground_symbols import (
    PIN,
    ball,
    bearing,
    hatched,
    pin,
    post,
    support,
)
from mbd_sim.drawing.part_outlines import reach
from mbd_sim.drawing.placed_joint import Held, own_frame
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.shape_outlines import cylinder
from mbd_sim.drawing.sheet import (
    BACK,
    BODIES,
    FRONT,
    GREY,
    INK,
    STEEL,
    WHITE,
    Path,
    arc,
    arrow_head,
    dark,
    left_of,
)
from mbd_sim.drawing.slider_symbols import (
    guide_end,
    slide,
    slides_phantom,
    table,
)
from mbd_sim.drawing.spring_symbols import brake, torsion
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.records import Shape

NUDGE = 0.03  # toward the eye, by the size of the mechanism, so that a joint is seen on its parts
THREAD = 6.0  # pt, from turn to turn
DRIVE = dark(WORK_DRIVES)


def joint_paths(page: Page, held: Held, size: float) -> list[Path]:
    """The symbol of a joint; `size` in m is that of the mechanism. Slides of phantoms have none."""
    if slides_phantom(held):
        return []
    match held.joint.type:
        case "revolute":
            paths = _pin(page, held) if page.view.planar else _hinge(page, held, size)
        case "prismatic":
            paths = slide(page, held, size)
        case "cylindrical":
            paths = slide(page, held, size)
        case "planar":
            paths = table(page, held, size)
        case "screw":
            paths = _screw(page, held, size)
        case "universal":
            paths = _cross(page, held, size)
        case "spherical":
            depth = _in_front(page, held, size)
            at = page.at(held.carrier.position)
            base = post(at, held.away, 17.0, depth, BODIES) if held.grounded else []
            paths = [*base, *ball(at, held.away, depth, BODIES)]
        case "fixed":
            paths = _weld(page, held)
        case "free":
            paths = []
        case _:
            assert_never(held.joint.type)
    return [*paths, *_drive(page, held)]


def _pin(page: Page, held: Held) -> list[Path]:
    at = page.at(held.carrier.position)
    spring = torsion(at, FRONT) if held.elastic() else []
    spring += brake(at, -held.away, FRONT) if held.joint.friction else []
    if not held.grounded:
        return [*spring, *pin(at)]
    if abs(float(page.view.toward[2])) > 0.5:
        return [*bearing(at), *spring, *pin(at)]
    span = None
    if held.moving is not None:
        across = held.mover.rotation.T @ page.view.up
        span = reach(
            held.moving, own_frame(held, held.moving), across, ("disc", "cylinder", "block", "plate", "sphere")
        )
    hidden = span is not None and span[0] < 0.0 < span[1]
    return [*support(at, held.away, BODIES if hidden else BACK), *spring, *pin(at)]


def _hinge(page: Page, held: Held, size: float) -> list[Path]:
    """A pin along the axis, at the rims of a ring where there is one, and the axis as a dash-dotted line."""
    center, axis, tilt = held.carrier.position, held.axis, float(np.hypot(*page.seen(held.axis)))
    rims, where = _rims(held), _ends(held)
    longest = max(*where, 0.12 * size) + 22.0 / page.scale
    paths = [_line(page, center, axis, longest, page.depth(center) - 1e-3 * size)]
    for along in where:
        place = center + along * axis
        depth = page.depth(place) + NUDGE * size if any(where) else _in_front(page, held, size)
        if held.grounded:
            outward = (
                unit_or_zero(page.seen(axis)) * (-1.0 if along < 0.0 else 1.0) if rims and tilt > 0.2 else held.away
            )
            if not rims and abs(axis[2]) > 0.7:
                outward = np.array([0.0, -1.0])
            paths += post(page.at(place), outward, 20.0, depth - 1e-6 * size, BODIES)
        frame = Pose(place, aligning_z(axis))
        paths += _symbol(page, frame, 15.0, PIN, depth)
    spring = torsion(page.at(center), BODIES, page.depth(center) + NUDGE * size) if held.elastic() else []
    rubbing = brake(page.at(center), -held.away, BODIES, page.depth(center) + NUDGE * size)
    return [*paths, *spring, *(rubbing if held.joint.friction else [])]


def name_place(page: Page, held: Held, size: float) -> Array:
    """The point (3,) in ground's frame that the name of a joint is near to."""
    if held.joint.kind.slides_along_axis and held.grounded:
        return guide_end(page, held, size)
    if held.joint.kind.slides:
        return held.mover.position
    if held.joint.type == "revolute" and not page.view.planar:
        nearest = max(_ends(held), key=lambda along: along * page.depth(held.axis))
        return np.asarray(held.carrier.position + nearest * held.axis)
    return held.carrier.position


def _ends(held: Held) -> list[float]:
    """Where along the axis, in m from the joint's point, the pins of a hinge are to be seen."""
    rims = _rims(held)
    if rims:
        return [max(rims), -max(rims)]
    if held.moving is not None:
        span = reach(held.moving, own_frame(held, held.moving), held.mover.rotation.T @ held.axis, ("block", "sphere"))
        if span is not None and span[0] < 0.0 < span[1]:
            return [span[1], span[0]]
    return [0.0]


def _rims(held: Held) -> list[float]:
    """Radii in m of the rings whose diameter is the joint's axis."""
    radii: list[float] = []
    for part, frame in ((held.carrying, held.carrier), (held.moving, held.mover)):
        if part is None:
            continue
        into = own_frame(held, part)
        own = into.rotation @ frame.rotation.T @ held.axis
        radii += [
            shape.size[0]
            for shape in part.shapes
            if shape.kind == "ring"
            and np.allclose(shape.pose.position, into.position, atol=1e-9)
            and abs(float(shape.pose.rotation[:, 2] @ own)) < 1e-6
        ]
    return radii


def _cross(page: Page, held: Held, size: float) -> list[Path]:
    """The two short shafts of a Cardan cross."""
    center, depth = held.carrier.position, _in_front(page, held, size)
    at = page.at(center)
    paths = post(at, held.away, 24.0, depth, BODIES) if held.grounded else []
    for axis in (held.axis, held.second):
        paths += _symbol(page, Pose(center, aligning_z(axis)), 30.0, 2.9, depth)
    return [*paths, Path(arc(at, 4.4), fill=WHITE, closed=True, width=1.2, layer=BODIES, depth=depth)]


def _in_front(page: Page, held: Held, size: float) -> float:
    """A depth at which the symbol is seen on the ends of the rods that it joins."""
    depths = [page.depth(held.carrier.position) + NUDGE * size]
    for part, frame in ((held.carrying, held.carrier), (held.moving, held.mover)):
        if part is not None:
            pose = frame @ own_frame(held, part).inverse()
            rods = [pose @ shape.pose for shape in part.shapes if shape.kind == "rod"]
            depths += [page.depth(rod.position) + 1e-3 * size for rod in rods]
    return max(depths)


def _screw(page: Page, held: Held, size: float) -> list[Path]:
    """A thread on the moving part's cylinder, in a nut."""
    shafts = _shafts(held)
    radius = max((half_sizes(shape)[0] for shape in shafts), default=7.0 / page.scale)
    length = max((half_sizes(shape)[2] for shape in shafts), default=40.0 / page.scale)
    center, frame, nut = held.mover.position, aligning_z(held.axis), held.carrier.position
    across = unit_or_zero(np.cross(page.view.toward, held.axis))
    depth, pitch = page.depth(nut) + 0.3 * NUDGE * size, THREAD / page.scale
    paths = [] if shafts else _symbol(page, Pose(center, frame), 2.0 * length * page.scale, radius * page.scale, depth)
    slant = radius * across + 0.25 * pitch * held.axis
    for along in np.arange(-length + pitch, length - 0.5 * pitch, pitch):
        middle = center + along * held.axis
        ends = page.at(np.array([middle + slant, middle - slant]))
        paths.append(Path(ends, edge=GREY, width=0.9, layer=BODIES, depth=depth))
    solid = cylinder(page, Pose(nut, frame), 20.0 / page.scale, radius + 9.0 / page.scale, STEEL)
    paths += [replace(path, depth=depth + 1e-4 * size) for path in solid]
    for outward in (unit_or_zero(page.seen(across)), -unit_or_zero(page.seen(across))) if held.grounded else ():
        edge, half = page.at(nut) + (radius * page.scale + 9.0) * outward, 15.0 * left_of(outward)
        paths += hatched(edge - half, edge + half, outward, BODIES, depth)
    return paths


def _shafts(held: Held) -> list[Shape]:
    """The cylinders of the moving part about the axis."""
    if held.moving is None:
        return []
    own = own_frame(held, held.moving).rotation @ held.mover.rotation.T @ held.axis
    return [
        shape
        for shape in held.moving.shapes
        if shape.kind == "cylinder" and abs(float(shape.pose.rotation[:, 2] @ own)) > 1.0 - 1e-6
    ]


def _weld(page: Page, held: Held) -> list[Path]:
    if not held.grounded:
        return []
    at = page.at(held.carrier.position)
    across = 17.0 * left_of(held.away)
    return hatched(at - across, at + across, held.away)


def _drive(page: Page, held: Held) -> list[Path]:
    """An arrow along or about the axis of a joint that is moved by a drive."""
    if not held.joint.drive:
        return []
    seen = unit_or_zero(page.seen(held.axis))
    if held.joint.type in ("prismatic", "cylindrical", "screw") and seen.any():
        side = left_of(seen) if left_of(seen)[1] > 0.0 else -left_of(seen)
        at = page.at(held.mover.position) + 20.0 * side
        heads = [arrow_head(at + sign * 18.0 * seen, sign * seen, DRIVE) for sign in (1.0, -1.0)]
        line = np.array([at - 13.0 * seen, at + 13.0 * seen])
        return [Path(line, edge=DRIVE, width=1.4, layer=FRONT), *heads]
    ends = [0.0] if page.view.planar else _ends(held)
    highest = max(ends, key=lambda along: float(page.at(along * held.axis)[1]))
    return turn_arrow(page, held.carrier.position + highest * held.axis, held.axis, 19.0)


def turn_arrow(
    page: Page, center: Array, axis: Array, radius: float, color: tuple[int, int, int] = DRIVE
) -> list[Path]:
    """An arrow about an axis (3,), right-handed, of a radius in points."""
    frame = aligning_z(unit_or_zero(axis))
    circle = arc(np.zeros(2), radius / page.scale, -0.3, 3.9, 61)
    points = page.at(center + circle @ frame[:, :2].T)
    head = arrow_head(points[-1] + 2.0 * unit_or_zero(points[-1] - points[-3]), points[-1] - points[-4], color)
    return [Path(points[:-3], edge=color, width=1.4, layer=FRONT), head]


def _line(page: Page, center: Array, axis: Array, half: float, depth: float) -> Path:
    ends = page.at(np.array([center - half * axis, center + half * axis]))
    return Path(ends, edge=GREY, width=0.8, dash=(9.0, 2.5, 1.5, 2.5), layer=BODIES, depth=depth)


def _symbol(page: Page, frame: Pose, length: float, radius: float, depth: float) -> list[Path]:
    """A small steel cylinder, sizes in points."""
    solid = cylinder(page, frame, length / page.scale, radius / page.scale, STEEL)
    return [replace(path, edge=INK, depth=depth) for path in solid]
