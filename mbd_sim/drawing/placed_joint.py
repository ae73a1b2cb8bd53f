"""A joint at a state: the part that carries it, the part that moves, its frames and its axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mbd_sim.drawing.part_outlines import span_along
from mbd_sim.drawing.projection import Page, frame_of
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.mechanism.records import (
    GROUND,
    Joint,
    Mechanism,
    Part,
)


@dataclass(frozen=True, eq=False)
class PlacedJoint:
    """A joint at a state. The carrier is ground wherever ground is one of the two parts.

    `carrier_frame` and `mover_frame` are the joint's frames on the two parts, and `axis` and `second` (3,) its axes, in
    ground's frame. `support_direction` (2,) is the direction on the sheet in which there is room for ground.
    """

    joint: Joint
    carrier_frame: Pose
    mover_frame: Pose
    carrier_part: Part | None
    mover_part: Part | None
    axis: Array
    second: Array
    support_direction: Array

    @property
    def grounded(self) -> bool:
        """Whether the joint is on ground."""
        return self.carrier_part is None

    def elastic(self, index: int = 0) -> bool:
        """Whether one of its coordinates has a spring."""
        return bool(self.joint.stiffness[index : index + 1].any()) or self.joint.spring is not None

    def damped(self, index: int = 0) -> bool:
        """Whether one of its coordinates has a damper."""
        return bool(self.joint.damping[index : index + 1].any()) or self.joint.damper is not None

    def mover_span(self, direction: Array, kinds: tuple[str, ...] = ()) -> tuple[float, float] | None:
        """The smallest and largest coordinate in m of the moving part along `direction` (3,), from the mover's frame.

        Only shapes of the given `kinds` count, all where none is given; None where there is no such shape.
        """
        return self._span(self.mover_part, self.mover_frame, direction, kinds)

    def carrier_span(self, direction: Array) -> tuple[float, float] | None:
        """The span of the carrying part along a direction, from the carrier's frame."""
        return self._span(self.carrier_part, self.carrier_frame, direction, ())

    def _span(
        self, part: Part | None, frame: Pose, direction: Array, kinds: tuple[str, ...]
    ) -> tuple[float, float] | None:
        if part is None:
            return None
        return span_along(part, frame_on_part(self, part), frame.rotation.T @ direction, kinds)

    @property
    def displacement(self) -> float:
        """The displacement in m of the mover's frame along the axis."""
        return float((self.mover_frame.position - self.carrier_frame.position) @ self.axis)


def place_joint(page: Page, mechanism: Mechanism, poses: Mapping[str, Pose], joint: Joint) -> PlacedJoint:
    """A joint of the mechanism at the poses of its parts."""
    first = frame_of(poses, joint.parent, joint.parent_pose)
    second = frame_of(poses, joint.child, joint.child_pose)
    names, frames = [joint.parent, joint.child], [first, second]
    if joint.child == GROUND:
        names.reverse()
        frames.reverse()
    parts = [mechanism.parts.get(name) for name in names]
    center = frames[1].position
    if parts[1] is not None:
        center = poses[parts[1].name].position + poses[parts[1].name].rotation @ middle(parts[1])
    return PlacedJoint(
        joint=joint,
        carrier_frame=frames[0],
        mover_frame=frames[1],
        carrier_part=parts[0],
        mover_part=parts[1],
        axis=first.rotation @ joint.axis,
        second=first.rotation @ joint.second,
        support_direction=_support_direction(page, center - frames[0].position),
    )


def frame_on_part(placed: PlacedJoint, part: Part) -> Pose:
    """The joint's frame in the frame of one of its parts."""
    return placed.joint.parent_pose if placed.joint.parent == part.name else placed.joint.child_pose


def middle(part: Part) -> Array:
    """The middle (3,) of a part, for symbols and names: its mass center, or that of its shapes if it has no mass."""
    if part.mass or not part.shapes:
        return part.center
    return np.asarray(np.mean([shape.pose.position for shape in part.shapes], axis=0))


def _support_direction(page: Page, toward_part: Array) -> Array:
    """Up for parts that hang from or lie beside the joint, down for those that stand on it or are centered on it."""
    projected = page.project(toward_part)
    stands = projected[1] > 0.35 * abs(projected[0]) or float(np.hypot(*projected)) < 1.0
    return np.array([0.0, -1.0 if stands else 1.0])
