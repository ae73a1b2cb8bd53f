"""Sizes and frames of joints that the renderers share."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Pose
from mbd_sim.geometry.rotation import aligning_z
from mbd_sim.mechanism.records import GROUND, Joint, Mechanism


def joint_radius(mechanism: Mechanism, joint: Joint, size: float) -> float:
    """The radius in m of a joint's marker, slightly larger than the rods it connects so that it is visible.

    :param size: the length in m of the mechanism, which limits the radius.
    """
    parts = [mechanism.parts[name] for name in (joint.parent, joint.child) if name != GROUND]
    rods = [shape.size[1] for part in parts for shape in part.shapes if shape.kind == "rod"]
    return min(max(1.25 * max(rods, default=0.0), 0.012 * size), 0.04 * size)


def axis_frame(joint: Joint) -> Pose:
    """The parent-side frame of a joint rotated so that z is its axis; unchanged for joints without an axis."""
    pose = joint.parent_pose
    return Pose(pose.position, pose.rotation @ aligning_z(joint.axis)) if np.any(joint.axis) else pose
