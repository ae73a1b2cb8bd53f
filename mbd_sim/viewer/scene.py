"""What stands still in the recording: the shapes of the parts in the parts' own frames, joints and ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from mbd_sim.mechanism import rotation as rot
from mbd_sim.mechanism.model import GROUND, Joint, Mechanism, Part, Pose
from mbd_sim.viewer import palette, paths, shapes
from mbd_sim.viewer.extent import Extent, joint_radius

if TYPE_CHECKING:
    from rerun import RecordingStream


def log_scene(recording: RecordingStream, mechanism: Mechanism, extent: Extent) -> None:
    """Log everything that does not change, once; the parts' transforms place it afterwards."""
    recording.log(paths.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    colors = palette.part_colors(mechanism)
    for name, part in mechanism.parts.items():
        _log_part(recording, part, colors[name], extent.size)
    for name in paths.ends(mechanism):
        style = rr.LineStrips3D.from_fields(colors=[colors[name]], radii=[0.005 * extent.size])
        recording.log(paths.trace(name), style, static=True)
    _log_ground(recording, extent.size)
    for joint in mechanism.all_joints.values():
        _log_joint(recording, mechanism, joint, extent.size)
    _log_series(recording, mechanism)


def _log_ground(recording: RecordingStream, size: float) -> None:
    axes = rr.Arrows3D(
        vectors=0.12 * size * np.eye(3), radii=0.003 * size, colors=[palette.AXIS_X, palette.AXIS_Y, palette.AXIS_Z]
    )
    recording.log(f"{paths.part(GROUND)}/axes", axes, static=True)


def _log_part(recording: RecordingStream, part: Part, color: palette.Color, size: float) -> None:
    entity = paths.part(part.name)
    for index, shape in enumerate(part.shapes):
        own = palette.from_hex(shape.color) if shape.color else palette.lit(color)
        recording.log(f"{entity}/{index}_{shape.kind}", shapes.solid(shape, own), static=True)
        if not shape.hole and (mark := shapes.mark(shape, own)) is not None:
            recording.log(f"{entity}/{index}_{shape.kind}/mark", mark, static=True)
    if not part.shapes:
        recording.log(f"{entity}/center", shapes.sphere(part.center, 0.02 * size, palette.lit(color)), static=True)
        ends = [pose.position for pose in part.points.values()] or [part.center]
        strips = [np.array([np.zeros(3), end]) for end in ends if np.any(end)]
        if strips:
            recording.log(f"{entity}/points", rr.LineStrips3D(strips, radii=0.006 * size, colors=[color]), static=True)


def _log_joint(recording: RecordingStream, mechanism: Mechanism, joint: Joint, size: float) -> None:
    """A pin along a revolute axis, a guide along a prismatic one, a ball for the others; none where nothing holds."""
    if joint.type in ("fixed", "free"):
        return
    entity = f"{paths.part(joint.parent)}/joints/{joint.name}"
    pose = joint.parent_pose
    radius = joint_radius(mechanism, joint, size)
    color = palette.STEEL if joint.parent == GROUND else palette.JOINT
    if joint.type in ("revolute", "prismatic"):
        along = Pose(pose.position, pose.rotation @ rot.aligning_z(joint.axis))
        if joint.type == "revolute":
            recording.log(entity, shapes.cylinder(along, 4.0 * radius, radius, color), static=True)
        else:
            recording.log(entity, shapes.cylinder(along, 0.5 * size, 0.3 * radius, color), static=True)
    else:
        recording.log(entity, shapes.sphere(pose.position, 1.3 * radius, color), static=True)


def _log_series(recording: RecordingStream, mechanism: Mechanism) -> None:
    """The name and colour of each line in the plots."""
    names, colors = list(mechanism.coordinate_names), palette.series_colors(mechanism)
    series = {
        paths.POSITION: (names, colors),
        paths.VELOCITY: (names, colors),
        paths.EFFORT: (names, colors),
        paths.BALANCE: (["kinetic", "potential", "total"], [palette.KINETIC, palette.POTENTIAL, palette.TOTAL]),
        paths.EXCHANGE: (
            ["dissipated", "work of efforts", "work of drives"],
            [palette.DISSIPATED, palette.WORK_APPLIED, palette.WORK_DRIVES],
        ),
        paths.RESIDUAL: (["residual"], [palette.RESIDUAL]),
    }
    for entity, (labels, lines) in series.items():
        if labels:
            style = rr.SeriesLines(names=labels, colors=lines, widths=[1.6] * len(labels))
            recording.log(entity, style, static=True)
