"""Gears and racks: pitch circles and pitch lines, dash-dotted, with marks for their teeth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.appearance.polylines import circle
from mbd_sim.appearance.solids import half_sizes
from mbd_sim.drawing.placed_joint import PlacedJoint, frame_on_part, place_joint
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import AXIS_DASH, BODIES, FRONT, INK, SheetPath
from mbd_sim.drawing.spring_symbols import cable_paths
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.constraints import Coupling
from mbd_sim.mechanism.records import Mechanism

TOOTH_SPACING, TOOTH = 7.0, 2.6  # pt, from tooth to tooth, and half their height

PARALLEL = 1e-6
FITTING = 0.2  # largest difference of a wheel's radius from the pitch radius, relative to the latter
NUDGE = 0.02  # toward the eye, relative to the radius


def coupling_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], coupling: Coupling) -> list[SheetPath]:
    """Two wheels, or a wheel and a rack or cable; other couplings, and wheels on skew axes, are not drawn."""
    joints = {
        joint.name: place_joint(page, mechanism, poses, joint)
        for joint in mechanism.all_joints.values()
        if joint.name in coupling.factors and joint.type in ("revolute", "prismatic")
    }
    if len(joints) != 2:
        return []
    (first, a), (second, b) = ((joints[name], factor) for name, factor in coupling.factors.items())
    if coupling.kind == "gear":
        return _gears(page, first, second, a / b)
    if coupling.kind == "rack":
        pinion, rack = (first, second) if first.joint.type == "revolute" else (second, first)
        return _rack(page, pinion, rack, -coupling.factors[pinion.joint.name] / coupling.factors[rack.joint.name])
    return []


def _gears(page: Page, first: PlacedJoint, second: PlacedJoint, ratio: float) -> list[SheetPath]:
    """Pitch circles that touch: r1 + r2, or |r1 - r2| with internal teeth, equals the distance of the axes."""
    facing = float(first.axis @ second.axis)
    line = second.carrier_frame.position - first.carrier_frame.position
    distance = float(np.linalg.norm(line - (line @ first.axis) * first.axis))
    distance_by_radius = abs(1.0 + ratio * np.sign(facing))
    if abs(facing) < 1.0 - PARALLEL or distance == 0.0 or distance_by_radius < PARALLEL:
        return []
    radius = distance / distance_by_radius
    return [*_wheel(page, first, abs(ratio) * radius), *_wheel(page, second, radius)]


def _wheel(page: Page, placed: PlacedJoint, radius: float) -> list[SheetPath]:
    """A pitch circle with teeth, on the face of the part's wheel if it has one of about that radius."""
    center = _wheel_center(page, placed, radius)
    plane = aligning_z(placed.axis)[:, :2].T
    count = max(round(2.0 * np.pi * radius * page.scale / TOOTH_SPACING), 8)
    pitch_circle = center + radius * circle(np.linspace(0.0, 2.0 * np.pi, 73)) @ plane
    outward = circle(2.0 * np.pi * np.arange(count) / count) @ plane
    half = TOOTH / page.scale
    teeth = [np.array([center + (radius - half) * out, center + (radius + half) * out]) for out in outward]
    return _pitch_line_and_teeth(page, pitch_circle, teeth, page.depth(center) + NUDGE * radius)


def _wheel_center(page: Page, placed: PlacedJoint, radius: float) -> Array:
    """The center (3,) of the face toward the eye of a part's wheel; the joint's point where there is no such wheel."""
    part, center = placed.mover_part, placed.mover_frame.position
    if part is None:
        return center
    for shape in part.shapes:
        pose = placed.mover_frame @ frame_on_part(placed, part).inverse() @ shape.pose
        size = half_sizes(shape)
        fits = shape.kind in ("cylinder", "disc", "ring") and abs(size[0] - radius) < FITTING * radius
        if fits and abs(float(pose.rotation[:, 2] @ placed.axis)) > 1.0 - PARALLEL:
            half_width = size[2] if shape.kind == "cylinder" else 0.0
            center = pose.position + half_width * np.sign(page.depth(placed.axis)) * placed.axis
    return center


def _rack(page: Page, pinion: PlacedJoint, rack: PlacedJoint, radius: float) -> list[SheetPath]:
    """The pinion's pitch circle and the rack's pitch line where its part reaches the pinion, otherwise a cable."""
    along = rack.axis
    contact = pinion.carrier_frame.position + radius * np.cross(along, pinion.axis)
    low, high = 0.0, 0.0
    if rack.mover_part is not None:
        low, high = rack.mover_frame.position @ along + (rack.mover_span(along) or (0.0, 0.0)) - contact @ along
    if abs(float(along @ pinion.axis)) > PARALLEL:
        return []
    depth = page.depth(contact) + NUDGE * abs(radius)
    if low <= 0.0 <= high:
        half, out = TOOTH / page.scale, unit_or_zero(np.cross(along, pinion.axis))
        count = max(round((high - low) * page.scale / TOOTH_SPACING), 1)
        feet = [contact + at * along for at in low + (high - low) * (np.arange(count) + 0.5) / count]
        teeth = [np.array([foot - half * out, foot + half * out]) for foot in feet]
        line = contact + np.outer([low, high], along)
        return [*_wheel(page, pinion, abs(radius)), *_pitch_line_and_teeth(page, line, teeth, depth)]
    end = contact + (low if low > 0.0 else high) * along
    return cable_paths(page, np.array([contact, end]), depth)


def _pitch_line_and_teeth(page: Page, line: Array, teeth: list[Array], depth: float) -> list[SheetPath]:
    layer = FRONT if page.view.planar else BODIES
    marks = [SheetPath(page.project(tooth), edge=INK, width=0.9, layer=layer, depth=depth) for tooth in teeth]
    return [SheetPath(page.project(line), edge=INK, width=0.7, dash=AXIS_DASH, layer=layer, depth=depth), *marks]
