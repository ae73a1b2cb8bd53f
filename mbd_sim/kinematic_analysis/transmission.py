"""The transmission angle: how well a coupler moves its follower.

It is the complement of the pressure angle, which is the angle between the force of the coupler on the follower and the
direction in which the follower lets the pin between them move. In a coupler without mass and friction the force is
along the line of its two pins. In a four-bar linkage this is the angle between the lines of coupler and follower, in a
slider-crank the one between the coupler and the normal of the guide (Alt 1932; Uicker, Pennock & Shigley, ch. 1 and 3).
It is given from 0 to 90°; 90° is best, and at 0 the follower cannot be moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.errors import InputError, counted, listed, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.kinematic_analysis.kinematic_system import KinematicSystem
from mbd_sim.kinematic_analysis.point_motion import PointFunctions
from mbd_sim.mechanism.records import GROUND, Joint, Mechanism


@dataclass(frozen=True)
class CouplerAndFollower:
    """The joints that define a transmission angle, by name.

    `pin` connects coupler and follower, `coupler` is the coupler's other joint, and `follower` guides the follower: its
    pivot or its guide.
    """

    coupler: str
    pin: str
    follower: str


def couplers_and_followers(mechanism: Mechanism, drives: Sequence[str]) -> tuple[CouplerAndFollower, ...]:
    """All pins at which a coupler with two joints moves a follower that is guided by ground, and is not driven."""
    driven = {name for name, joint in mechanism.all_joints.items() if {*joint.motion_names, name} & {*drives}}
    found = []
    for pin in mechanism.all_joints.values():
        for coupler, follower in ((pin.parent, pin.child), (pin.child, pin.parent)):
            guides = [joint for joint in _others(mechanism, follower, pin) if GROUND in (joint.parent, joint.child)]
            ends = _others(mechanism, coupler, pin)
            if GROUND in (coupler, follower) or len(guides) != 1 or len(ends) != 1 or not _guides(guides[0]):
                continue
            if guides[0].name not in driven and GROUND not in (ends[0].parent, ends[0].child):
                found.append(CouplerAndFollower(ends[0].name, pin.name, guides[0].name))
    return tuple(found)


def coupler_and_follower(mechanism: Mechanism, drives: Sequence[str], text: str) -> CouplerAndFollower:
    """Read `PIN`, or `COUPLER,PIN,FOLLOWER` with the three joints.

    :raises InputError: there is no such joint, or the coupler and the follower of a pin are not evident.
    """
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in mechanism.all_joints:
            raise InputError(f"there is no joint '{name}'", nearest(name, mechanism.all_joints))
    if len(names) == 1:
        evident = couplers_and_followers(mechanism, drives)
        found = next((one for one in evident if one.pin == names[0]), None)
        if found is None:
            pins = listed([one.pin for one in evident])
            remedy = f"Write COUPLER,{names[0]},FOLLOWER with the other joint of the coupler, and the pivot or guide "
            remedy += "of the follower" + (f"; evident are those of {pins}." if pins else ".")
            raise InputError(f"the coupler and the follower of '{names[0]}' are not evident", remedy)
        return found
    if len(names) != 3:
        raise InputError(f"'{text}' names {counted(len(names), 'joint')}", "Write PIN, or COUPLER,PIN,FOLLOWER.")
    if not _guides(guide := mechanism.all_joints[names[2]]):
        message = f"'{guide.name}' is {_article(guide.type)} joint, which does not guide a point along a line"
        raise InputError(message, "Name a revolute or a prismatic joint as the last one.")
    return CouplerAndFollower(*names)


class TransmissionAngle:
    """The transmission angle at a pin as a function of the configuration."""

    def __init__(self, system: KinematicSystem, joints: CouplerAndFollower) -> None:
        mechanism = system.mechanism
        self._joints = [mechanism.all_joints[name] for name in (joints.coupler, joints.pin, joints.follower)]
        self._parts = {joint.parent: PointFunctions(system, joint.parent) for joint in self._joints}

    def __call__(self, q: Array) -> float:
        """The angle in rad, from 0 to pi/2, in a configuration (nq,)."""
        poses = {part: frame.pose(q) for part, frame in self._parts.items()}
        at, place, pivot = (poses[joint.parent] @ joint.parent_pose for joint in self._joints)
        guide = self._joints[2]
        axis, along = pivot.rotation @ guide.axis, place.position - at.position
        free = axis if guide.type == "prismatic" else np.cross(axis, place.position - pivot.position)
        return float(np.arctan2(abs(along @ free), np.linalg.norm(np.cross(along, free))))


def _others(mechanism: Mechanism, part: str, pin: Joint) -> list[Joint]:
    """The other joints of a part."""
    return [one for one in mechanism.all_joints.values() if part in (one.parent, one.child) and one.name != pin.name]


def _guides(joint: Joint) -> bool:
    return joint.type in ("revolute", "prismatic")


def _article(word: str) -> str:
    return f"an {word}" if word[0] in "aeiou" else f"a {word}"
