"""The rows of two bodies of which one is round, as a function of their numbers and of both poses, as it is compiled."""

import functools

import casadi as ca
import numpy as np

from mbd_sim.dynamics.contact.smooth_rows import SMOOTH_SIZE, smooth_touch
from mbd_sim.dynamics.kinematics.poses import SymbolicPose


def row_of(bodies, features, poses):
    """The gap, the normal and the point of the row of features, at the poses of both bodies."""
    given = [np.concatenate([pose.position, pose.rotation.T.ravel()]) for pose in poses]
    return [np.array(each).ravel() for each in _row(*bodies)(features.numbers, *given)]


@functools.lru_cache(maxsize=8)
def _row(first, second):
    """Built once for a test, whose bodies are the same objects: that takes a hundred times as long as a call."""
    numbers, *poses = ca.SX.sym("numbers", SMOOTH_SIZE), ca.SX.sym("one", 12), ca.SX.sym("other", 12)
    frames = tuple(SymbolicPose(pose[:3], ca.reshape(pose[3:], 3, 3)) for pose in poses)
    touch = smooth_touch((first, second), numbers, frames, 1.0)
    values = [touch.iterated.inserted(each) for each in (touch.distance, touch.normal, touch.point)]
    return ca.Function("row", [numbers, *poses], values)
