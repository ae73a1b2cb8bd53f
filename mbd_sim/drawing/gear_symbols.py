"""Gears and racks on the sheet: pitch circles and pitch lines, dash-dotted, with marks for their teeth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbd_sim.appearance.extent import half_sizes
from mbd_sim.drawing.part_outlines import reach
from mbd_sim.drawing.placed_joint import Held, held, own_frame
from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import BODIES, FRONT, INK, WHITE, Path
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import aligning_z, unit_or_zero
from mbd_sim.mechanism.constraints import Coupling
from mbd_sim.mechanism.records import Mechanism

TEETH, TOOTH = 7.0, 2.6  # pt, from tooth to tooth, and half their height
PITCH_LINE = (9.0, 2.5, 1.5, 2.5)  # pt
PARALLEL = 1e-6
FITTING = 0.2  # relative, how near the radius of a wheel must be to the pitch radius
NUDGE = 0.02  # toward the eye, by the radius


def coupling_paths(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], coupling: Coupling) -> list[Path]:
    """Two wheels, or a wheel and a rack or cable; other couplings, and wheels on skew axes, are not to be seen."""
    joints = {
        joint.name: held(page, mechanism, poses, joint)
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


def _gears(page: Page, first: Held, second: Held, ratio: float) -> list[Path]:
    """Pitch circles that touch: r1 + r2, or |r1 - r2| with inner teeth, is the distance of the axes."""
    facing = float(first.axis @ second.axis)
    line = second.carrier.position - first.carrier.position
    apart = float(np.linalg.norm(line - (line @ first.axis) * first.axis))
    together = abs(1.0 + ratio * np.sign(facing))
    if abs(facing) < 1.0 - PARALLEL or apart == 0.0 or together < PARALLEL:
        return []
    radius = apart / together
    return [*_wheel(page, first, abs(ratio) * radius), *_wheel(page, second, radius)]


def _wheel(page: Page, held: Held, radius: float) -> list[Path]:
    """A pitch circle with teeth, on the part's wheel where it has one of about that radius."""
    frame, center = aligning_z(held.axis), held.mover.position
    for shape in held.moving.shapes if held.moving else ():
        pose = held.mover @ own_frame(held, held.moving).inverse() @ shape.pose if held.moving else held.mover
        size = half_sizes(shape)
        fits = shape.kind in ("cylinder", "disc", "ring") and abs(size[0] - radius) < FITTING * radius
        if fits and abs(float(pose.rotation[:, 2] @ held.axis)) > 1.0 - PARALLEL:
            center = (
                pose.position
                + (size[2] if shape.kind == "cylinder" else 0.0) * np.sign(page.depth(held.axis)) * held.axis
            )
    count = max(round(2.0 * np.pi * radius * page.scale / TEETH), 8)
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    circle = center + radius * np.column_stack([np.cos(turn), np.sin(turn)]) @ frame[:, :2].T
    outward = np.array([[np.cos(a), np.sin(a)] for a in 2.0 * np.pi * np.arange(count) / count]) @ frame[:, :2].T
    half = TOOTH / page.scale
    teeth = [np.array([center + (radius - half) * out, center + (radius + half) * out]) for out in outward]
    return _strokes(page, circle, teeth, page.depth(center) + NUDGE * radius)


def _rack(page: Page, pinion: Held, rack: Held, radius: float) -> list[Path]:
    """The pitch circle of the pinion, and the pitch line of the rack where its part reaches it, or else a cable."""
    along = rack.axis
    contact = pinion.carrier.position + radius * np.cross(along, pinion.axis)
    body, into = rack.moving, rack.mover
    span = reach(body, own_frame(rack, body), into.rotation.T @ along) if body is not None else None
    low, high = (into.position @ along + (span or (0.0, 0.0)) - contact @ along) if body is not None else (0.0, 0.0)
    if abs(float(along @ pinion.axis)) > PARALLEL:
        return []
    depth = page.depth(contact) + NUDGE * abs(radius)
    if low <= 0.0 <= high:
        half, out = TOOTH / page.scale, unit_or_zero(np.cross(along, pinion.axis))
        count = max(round((high - low) * page.scale / TEETH), 1)
        places = [contact + at * along for at in low + (high - low) * (np.arange(count) + 0.5) / count]
        teeth = [np.array([at - half * out, at + half * out]) for at in places]
        line = contact + np.outer([low, high], along)
        return [*_wheel(page, pinion, abs(radius)), *_strokes(page, line, teeth, depth)]
    end = contact + (low if low > 0.0 else high) * along
    run = page.at(np.array([contact, end]))
    widths = ((WHITE, 3.0), (INK, 1.1))
    return [Path(run, edge=edge, width=width, layer=BODIES, depth=depth) for edge, width in widths]


def _strokes(page: Page, line: Array, teeth: list[Array], depth: float) -> list[Path]:
    layer = FRONT if page.view.planar else BODIES
    marks = [Path(page.at(tooth), edge=INK, width=0.9, layer=layer, depth=depth) for tooth in teeth]
    return [Path(page.at(line), edge=INK, width=0.7, dash=PITCH_LINE, layer=layer, depth=depth), *marks]
