"""The points of a mechanism that leave a trace where the user does not name others."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Attachment, Mechanism, Part


def default_traces(mechanism: Mechanism) -> dict[str, Attachment]:
    """The tips of the parts at the ends of the kinematic chains, by the names of the parts."""
    inboard = {joint.inboard for joint in mechanism.tree_joints()}
    ends = [joint.outboard for joint in mechanism.tree_joints() if joint.outboard not in inboard and not joint.splits]
    return {name: Attachment(name, tip_of(mechanism.parts[name])) for name in ends}


def tip_of(part: Part) -> Array:
    """The point (3,) of a part that leaves a trace, in the part's frame: its point or rod end farthest from the origin.

    For a part with neither, a corner or a point on the rim, which is visible where the mass center would be hidden.
    """
    ends = [pose.position for pose in part.points.values()]
    for shape in part.shapes:
        if shape.kind == "rod":
            half = shape.pose.rotation[:, 2] * shape.size[0] / 2.0
            ends += [shape.pose.position - half, shape.pose.position + half]
    rims = {"block": (0.5, 0.5, 0.5), "plate": (0.5, 0.5), "disc": (1.0,), "ring": (1.0,)}
    if not ends and part.shapes and (factors := rims.get(part.shapes[0].kind)):
        pose, offset = part.shapes[0].pose, np.zeros(3)
        offset[: len(factors)] = np.multiply(factors, part.shapes[0].size)
        return np.asarray(pose.position + pose.rotation @ offset)
    ends.append(part.center)
    return max(ends, key=lambda point: float(np.linalg.norm(point)))
