"""Points of moving parts, and the wrenches that gather on the links from what acts at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose
from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.spatial_algebra import constant, skew, symbolic
from mbd_sim.mechanism.records import GROUND, Attachment


@dataclass(frozen=True, eq=False)
class Place:
    """A point in ground's axes: its position, velocity, and its part's rotation and angular velocity."""

    position: ca.SX
    velocity: ca.SX
    rotation: ca.SX
    omega: ca.SX


class Points:
    """Points of parts, and the `wrenches` (6,) = [moment; force] on their links, in the links' frames."""

    def __init__(self, links: Sequence[Link], motions: Sequence[LinkMotion], poses: Sequence[WorldPose]) -> None:
        self._links, self._motions, self._poses = links, motions, poses
        self._index = {link.joint.outboard: index for index, link in enumerate(links)}
        self.wrenches = [ca.SX(6, 1) for _ in links]

    def at(self, at: Attachment) -> Place:
        """Where a point is and how it moves."""
        if at.part == GROUND:
            return Place(constant(at.point), ca.SX(3, 1), constant(np.eye(3)), ca.SX(3, 1))
        index = self._index[at.part]
        pose, velocity = self._poses[index], self._motions[index].velocity
        to_world = self._to_world(index)
        arm = self._arm(index, at)
        return Place(
            position=pose.position + pose.rotation @ constant(at.point),
            velocity=to_world @ (velocity[3:] - skew(arm) @ velocity[:3]),
            rotation=pose.rotation,
            omega=to_world @ velocity[:3],
        )

    def rotation(self, part: str) -> ca.SX:
        """The axes (3, 3) of a part in ground's."""
        return constant(np.eye(3)) if part == GROUND else self._poses[self._index[part]].rotation

    def push(self, at: Attachment, force: ca.SX) -> None:
        """Let a force (3,) in ground's axes act at a point."""
        if at.part != GROUND:
            index = self._index[at.part]
            own = self._to_world(index).T @ force
            self.wrenches[index] += ca.vertcat(skew(self._arm(index, at)) @ own, own)

    def turn(self, at: Attachment, moment: ca.SX) -> None:
        """Let a couple (3,) in ground's axes act on a part."""
        index = self._index[at.part]
        self.wrenches[index] += ca.vertcat(self._to_world(index).T @ moment, ca.SX(3, 1))

    def follow(self, at: Attachment, vector: ca.SX, couple: bool) -> ca.SX:
        """Let a force, or a couple, (3,) in the part's own axes act on it; returns its power.

        On its way to ground's axes and back it would cost forty instructions, as nothing there cancels.
        """
        index = self._index[at.part]
        own = ca.sparsify(constant(self._links[index].part.rotation) @ vector)
        moment, force = (own, ca.SX(3, 1)) if couple else (skew(self._arm(index, at)) @ own, own)
        wrench = ca.sparsify(ca.vertcat(moment, force))
        self.wrenches[index] += wrench
        return ca.dot(wrench, self._motions[index].velocity)

    def _to_world(self, index: int) -> ca.SX:
        return ca.sparsify(self._poses[index].rotation @ constant(self._links[index].part.rotation.T))

    def _arm(self, index: int, at: Attachment) -> ca.SX:
        part = self._links[index].part
        if symbolic(at.point, part.position, part.rotation):
            return ca.sparsify(constant(part.position) + constant(part.rotation) @ constant(at.point))
        return constant(part.position + part.rotation @ at.point)
