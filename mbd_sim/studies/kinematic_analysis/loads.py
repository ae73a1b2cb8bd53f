"""The loads of a prescribed motion: efforts of drives, loads on joints, and the transmission angle.

Efforts and loads follow by inverse dynamics.

The transmission angle says how well a coupler moves its follower. It is the complement of the pressure angle, which is
the angle between the force of the coupler on the follower and the direction in which the follower lets the pin between
them move. In a coupler without mass and friction the force is along the line of its two pins. In a four-bar linkage
this is the angle between the lines of coupler and follower, in a slider-crank the one between the coupler and the
normal of the guide (Alt 1932; Uicker, Pennock & Shigley, ch. 1 and 3). If one of the coupler's joints is a slider, as
that of a block on a slotted lever, the force passes through the other joint, normal to the slide; this is then the
angle between the slide and the direction in which the follower lets the point under the pin move. It is given from 0 to
90°; 90° is best, and at 0 the follower cannot be moved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
from mbd_sim.analysis.mechanics.load_sharing import LoadSharing
from mbd_sim.base.errors import InputError, counted, listed, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.dynamics.equations import derive
from mbd_sim.mechanism.contents import require_two_sided
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import split_names
from mbd_sim.simulation.model.state_records import Reaction
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion, PointFunctions
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem


@record
class DriveLoads:
    """What a motion requires, one row for each configuration; nan at dead points and change points.

    `efforts` (n,) of each driven coordinate in N·m or N. `reactions` are the `force` (n, 3) in N and the `moment`
    (n, 3) in N·m that each joint transmits to its second part, about its point there, in ground's axes; the effort of a
    drive is part of that of its joint, see `Reaction`. `power` (n,) is that of all drives in W.
    """

    efforts: Mapping[str, Array]
    reactions: Mapping[str, Reaction]
    power: Array


@interruptible()
def drive_loads(motion: DrivenMotion) -> DriveLoads:
    """The loads of a motion with its speeds and accelerations: inertia, weight, springs, dampers and applied forces.

    Forces that depend on time take the time of the motion. Efforts follow from virtual power along the motion, and
    reactions from the multipliers of the constraints, see `InverseDynamics` and `LoadSharing`.

    :raises MechanismError: the mechanism has no equations of motion, because a part has no mass, or it has one-sided
        elements.
    """
    system, mechanism = motion.system, motion.mechanism
    require_two_sided(mechanism, "has no loads that follow from its motion")
    equations = derive(mechanism)
    inverse, sharing = InverseDynamics(mechanism, system.drives, equations), LoadSharing(mechanism, equations)
    inputs = equations.inputs_without_commands
    names = [*mechanism.joints, *mechanism.closing]
    efforts = np.full((len(motion), len(system.drives)), np.nan)
    loads = np.full((len(motion), len(names), 6), np.nan)
    for row in np.flatnonzero(np.all(np.isfinite(motion.u), axis=1)):
        q, u, time = motion.q[row], motion.u[row], float(motion.time[row])
        found = inverse(q, u, motion.u_rates[row], time)
        efforts[row] = found[system.u_driven]
        given = inputs.copy()
        given[equations.inputs.efforts] = found - inverse.efforts_of_actuators(q, u, time, inputs)
        loads[row] = sharing.reactions(time, inverse.state(q, u), given)
    return DriveLoads(
        dict(zip(system.drives, efforts.T, strict=True)),
        {name: Reaction(loads[:, index, :3], loads[:, index, 3:]) for index, name in enumerate(names)},
        np.sum(efforts * motion.u[:, system.u_driven], axis=1),
    )


LINE_OF_FORCE = ("revolute", "prismatic", "spherical", "universal")
PARALLEL = 1e-4  # sine of the angle up to which axes are parallel or normal to each other, as people write digits


@dataclass(frozen=True)
class CouplerAndFollower:
    """The joints that define a transmission angle, by name.

    `pin` connects coupler and follower, `coupler` is the coupler's other joint, and `follower` guides the follower: its
    pivot or its guide.
    """

    coupler: str
    pin: str
    follower: str

    __repr__ = short_repr


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
            if guides[0].name in driven or GROUND in (ends[0].parent, ends[0].child):
                continue
            if not _obstacle(ends[0], pin) and _is_plane(coupler, ends[0], pin) and _is_plane(follower, pin, guides[0]):
                found.append(CouplerAndFollower(ends[0].name, pin.name, guides[0].name))
    return tuple(found)


def coupler_and_follower(mechanism: Mechanism, drives: Sequence[str], text: str) -> CouplerAndFollower:
    """Read `PIN`, or `COUPLER,PIN,FOLLOWER` with the three joints.

    :raises InputError: there is no such joint, or the coupler and the follower of a pin are not evident.
    """
    names = split_names(text)
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
    if why := _obstacle(mechanism.all_joints[names[0]], mechanism.all_joints[names[1]]):
        raise InputError(f"'{names[0]}' and '{names[1]}' define no transmission angle: {why}", "Name other joints.")
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
        end, pin, guide = self._joints
        at, place, pivot = (poses[joint.parent] @ joint.parent_pose for joint in self._joints)
        axis = pivot.rotation @ guide.axis
        point = (at if pin.type == "prismatic" else place).position  # through which the force passes
        free = axis if guide.type == "prismatic" else np.cross(axis, point - pivot.position)
        if "prismatic" in (pin.type, end.type):
            slide = place.rotation @ pin.axis if pin.type == "prismatic" else at.rotation @ end.axis
            return _angle_between(slide, free)
        along = place.position - at.position
        if pin.type == "revolute":  # pins may lie in different planes, one behind the other
            normal = place.rotation @ pin.axis
            along = along - normal * (normal @ along)
        return float(np.arctan2(abs(along @ free), np.linalg.norm(np.cross(along, free))))


def _angle_between(one: Array, other: Array) -> float:
    """The angle of two lines, from 0 to pi/2."""
    return float(np.arctan2(np.linalg.norm(np.cross(one, other)), abs(one @ other)))


def _obstacle(end: Joint, pin: Joint) -> str:
    """Why a coupler with these two joints has no line along which its force acts, or ""."""
    for joint in (end, pin):
        if joint.type not in LINE_OF_FORCE:
            return f"'{joint.name}' is {_article(joint.type)} joint"
    if end.type == pin.type == "prismatic":
        return "between two sliders, a coupler transmits a moment and no force"
    if end.type == pin.type == "universal":
        return "between two universal joints, a coupler transmits a moment"
    return ""


def _is_plane(part: str, one: Joint, other: Joint) -> bool:
    """Whether the part moves in a plane as far as its two joints say: axes of pins parallel, slides normal to them."""
    if not {one.type, other.type} <= {"revolute", "prismatic"} or one.type == other.type == "prismatic":
        return True
    first, second = (_axis_in(part, joint) for joint in (one, other))
    along = abs(float(first @ second))
    return bool(along < PARALLEL if one.type != other.type else np.linalg.norm(np.cross(first, second)) < PARALLEL)


def _axis_in(part: str, joint: Joint) -> Array:
    """The axis of a revolute or prismatic joint in the frame of one of its parts."""
    pose = joint.parent_pose if joint.parent == part else joint.child_pose
    return np.asarray(pose.rotation @ joint.axis)


def _others(mechanism: Mechanism, part: str, pin: Joint) -> list[Joint]:
    """The other joints of a part."""
    return [one for one in mechanism.all_joints.values() if part in (one.parent, one.child) and one.name != pin.name]


def _guides(joint: Joint) -> bool:
    return joint.type in ("revolute", "prismatic")


def _article(word: str) -> str:
    return f"an {word}" if word[0] in "aeiou" else f"a {word}"
