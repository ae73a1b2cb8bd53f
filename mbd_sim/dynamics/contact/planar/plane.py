"""The plane in which a mechanism moves, or some of its discs and rings do: there they touch as circles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.dynamics.constraints.start import given_start
from mbd_sim.dynamics.kinematics.poses import SymbolicPose
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.layouts.vectors import trial_states
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements.contacts import PlanarBody
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.parallel_axes import Poses, are_thin_barrels, stay_in_a_plane, with_ground

ROUND_OFF = 1e-13  # by which the axes of parts may differ from those of ground
TURNED = 1e-3  # rad, about; a turn that is large enough to tell its axis
IN_PLANE = 1e-10  # of unit vectors and positions, by which parts may leave a plane that is not one of ground's axes
DIGITS = 12  # of the normal of such a plane


def still_axis(poses: Sequence[SymbolicPose]) -> int | None:
    """The axis of ground, 0, 1 or 2, about which all parts turn and along which none moves; None without one."""
    unit = np.eye(3)
    for axis in range(3):
        columns = [ca.sparsify(pose.rotation[:, axis] - constant(unit[axis])) for pose in poses]
        if all(
            _is_round_off(column) and not ca.symvar(pose.position[axis])
            for column, pose in zip(columns, poses, strict=True)
        ):
            return axis
    return None


def _is_round_off(column: ca.SX) -> bool:
    """Whether differences of unit vectors are constant and zero, as those of axes that are turned there and back."""
    return column.is_constant() and bool(np.all(np.abs(ca.DM(column).full()) <= ROUND_OFF))


def places_along(traced: TracedMechanism, still: int | None) -> dict[str, float]:
    """Where parts are along the axis along which none moves, in m."""
    if still is None:
        return {}
    parts = zip((link.joint.outboard for link in traced.links), traced.poses, strict=True)
    return {GROUND: 0.0, **{part: float(pose.position[still]) for part, pose in parts}}


def plane_normal(traced: TracedMechanism, still: int | None) -> Array | None:
    """The direction (3,) of ground about which all parts turn and along which none moves; None without one.

    :param still: see `still_axis`.
    """
    if still is not None:
        return np.array([float(axis == still) for axis in range(3)])
    if any(joint.kind.quaternion is not None for joint in traced.numeric.joints.values()):
        return None
    start, *others = _placed_at_random(traced)
    moved = [(start[part], pose) for poses in others for part, pose in poses.items()]
    longest = max((_axis_of_turn(before, after) for before, after in moved), key=norm)
    if norm(longest) < TURNED:
        return None
    longest *= np.sign(longest[np.abs(longest).argmax()])
    normal: Array = np.round(longest / norm(longest), DIGITS)
    return normal if all(_moves_across(normal, before, after) for before, after in moved) else None


def _axis_of_turn(before: Pose, after: Pose) -> Array:
    """The axis (3,) of the turn between two poses, with twice the sine of its angle as its length."""
    turn = product(after.rotation, before.rotation.T)
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


def _moves_across(normal: Array, before: Pose, after: Pose) -> bool:
    """Whether a part turns about a direction (3,) only, and does not move along it."""
    held = product(after.rotation, product(before.rotation.T, normal)) - normal
    along = float(product(normal, after.position - before.position))
    return norm(held) <= IN_PLANE and abs(along) <= IN_PLANE * (norm(before.position) + norm(after.position))


def trial_poses(traced: TracedMechanism) -> list[Poses]:
    """The poses of the parts and ground at the start of the file and elsewhere, before loops are closed.

    Empty without contacts whose rows depend on them: those of outlines, and of discs and rings.
    """
    contacts = traced.numeric.contacts
    if not any(are_thin_barrels(one) or isinstance(one.first, PlanarBody) or isinstance(one.second, PlanarBody)
               for one in contacts):  # fmt: skip
        return []
    return _placed_at_random(traced)


def _placed_at_random(traced: TracedMechanism) -> list[Poses]:
    """The poses of the parts and ground at the start of the file and elsewhere, before loops are closed."""
    symbols = [traced.state.t, traced.state.q, traced.parameters.symbols]
    frames = [ca.horzcat(pose.rotation, pose.position) for pose in traced.poses]
    read = ca.Function("poses", symbols, [ca.horzcat(*frames)])
    found = []
    for time, q in trial_states(traced.numeric, traced.layout, given_start(traced.numeric, traced.layout)[0]):
        columns = np.array(read(time, q, traced.parameters.base))
        each = {link.joint.outboard: columns[:, 4 * k : 4 * k + 4] for k, link in enumerate(traced.links)}
        found.append(with_ground({part: Pose(frame[:, 3], frame[:, :3]) for part, frame in each.items()}))
    return found


def with_circles(traced: TracedMechanism, poses: Sequence[Poses]) -> Mechanism:
    """The mechanism, of which discs and rings that stay in one plane touch as circles: in space they have no inside."""
    contacts = tuple(
        replace(contact, slots=0) if are_thin_barrels(numeric) and stay_in_a_plane(numeric, poses) else contact
        for contact, numeric in zip(traced.mechanism.contacts, traced.numeric.contacts, strict=True)
    )
    return replace(traced.mechanism, contacts=contacts) if contacts != traced.mechanism.contacts else traced.mechanism
