"""An MJCF as it is written: the spanning tree of a mechanism as nested bodies, and the document that has them.

All joints are in the frame of their body. A body of MuJoCo must have a mass if it moves relative to its parent. So a
part without mass that leads to one other part only, and to which nothing is attached, is left out: its joints become
joints of the next body.

The document has the elements of the MJCF and the list of what it does not contain.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import listed
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import to_quaternion
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint, Limits, Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import unique_name


@dataclass(frozen=True, eq=False)
class MjcfJoint:
    """A joint of MuJoCo: its `kind`, and `frame`, in which its `axis` is given, in the frame of its body.

    `joint` is ours, and `index` the coordinate that it has there. A `reversed` one has the inverse motion of ours.
    """

    name: str
    kind: str
    frame: Pose
    joint: Joint
    axis: Array | None = None
    index: int = 0

    @property
    def single(self) -> bool:
        """Whether it has one coordinate."""
        return self.kind in ("hinge", "slide")

    @property
    def limits(self) -> Limits | None:
        """The range of its coordinate."""
        return self.joint.limits_of(self.index) if self.single and not self.joint.kind.advances else None


@dataclass(eq=False)
class WrittenBody:
    """A body: its part, its parent, and its pose in it and in the world where all coordinates are 0."""

    part: Part
    parent: str
    pose: Pose
    start: Pose
    joints: list[MjcfJoint] = field(default_factory=list)


def written_bodies(mechanism: Mechanism, attached: Collection[str]) -> tuple[dict[str, WrittenBody], list[str]]:
    """The bodies by the names of their parts, from ground outwards, and the parts that are merged into the next body.

    :param attached: parts that must have a body of their own.
    """
    children: dict[str, list[Joint]] = {}
    for joint in mechanism.tree_joints():
        children.setdefault(joint.inboard, []).append(joint)
    bodies: dict[str, WrittenBody] = {}
    pending: dict[str, WrittenBody] = {}  # of parts that are merged: what leads to them
    for joint in mechanism.tree_joints():
        part = mechanism.bodies[joint.outboard]
        before = pending.get(joint.inboard)
        inner, outer = (
            (joint.child_pose, joint.parent_pose) if joint.reversed else (joint.parent_pose, joint.child_pose)
        )
        step = inner @ outer.inverse()  # from the inboard part, where the coordinates are 0
        parent = before.parent if before else joint.inboard
        pose = before.pose @ step if before else step
        start = (bodies[parent].start if parent in bodies else identity_pose()) @ pose
        body = WrittenBody(part, parent, pose, start)
        if before:
            body.joints = [_moved(one, step.inverse()) for one in before.joints]
        body.joints += _written_joints(joint, outer)
        following = children.get(part.name, [])
        light = not part.mass and not np.any(part.inertia) and part.name not in attached
        if light and body.joints and len(following) == 1 and _may_follow(body.joints, following[0]):
            pending[part.name] = body
        else:
            bodies[part.name] = body
    return _depth_first(mechanism, bodies), [*pending]


def _depth_first(mechanism: Mechanism, bodies: dict[str, WrittenBody]) -> dict[str, WrittenBody]:
    """The bodies in the order of the file: each before what it carries, and those beside each other as declared."""
    declared = {name: index for index, name in enumerate(mechanism.joints)}
    inboard = {mechanism.joints[name].outboard: name for name in mechanism.tree}
    children: dict[str, list[str]] = {}
    for name, body in bodies.items():
        children.setdefault(body.parent, []).append(name)

    def place(name: str) -> int:
        joints = [one.joint.name for one in bodies[name].joints] or [inboard[name]]
        return min(declared[joint] for joint in joints)

    found: dict[str, WrittenBody] = {}
    waiting = sorted(children.get(GROUND, ()), key=place, reverse=True)
    while waiting:
        name = waiting.pop()
        found[name] = bodies[name]
        waiting += sorted(children.get(name, ()), key=place, reverse=True)
    return found


def _may_follow(joints: list[MjcfJoint], joint: Joint) -> bool:
    """Whether a body can have these joints and then another one: a free joint must be the only one."""
    return not any(one.kind == "free" for one in joints) and not is_free(joint)


def is_free(joint: Joint) -> bool:
    """Whether a joint is written as a free joint, which only a body in the world can have."""
    return joint.type == "free" and joint.inboard == GROUND and not joint.reversed


def _moved(joint: MjcfJoint, pose: Pose) -> MjcfJoint:
    """A joint in the frame of another body."""
    return MjcfJoint(joint.name, joint.kind, pose @ joint.frame, joint.joint, joint.axis, joint.index)


def _written_joints(joint: Joint, frame: Pose) -> list[MjcfJoint]:
    """The joints of MuJoCo that represent a joint, from its inboard to its outboard side."""
    match joint.type:
        case "fixed":
            return []
        case "spherical":
            return [MjcfJoint(joint.name, "ball", frame, joint)]
        case "free" if is_free(joint):
            return [MjcfJoint(joint.name, "free", frame, joint)]
        case "free":
            slides = [
                MjcfJoint(name, "slide", frame, joint, axis, index)
                for index, (name, axis) in enumerate(zip(joint.motion_names[:3], np.eye(3), strict=True))
            ]
            ball = MjcfJoint(f"{joint.name}.rotation", "ball", frame, joint)
            return [ball, *(_inverse(slide) for slide in slides[::-1])] if joint.reversed else [*slides, ball]
        case "screw":
            hinge = MjcfJoint(joint.name, "hinge", frame, joint, joint.axis)
            written = [hinge, MjcfJoint(f"{joint.name}.travel", "slide", frame, joint, joint.axis)]
        case "revolute" | "prismatic" | "cylindrical" | "universal" | "planar":
            written = [
                MjcfJoint(name, "hinge" if one.rotation else "slide", frame, joint, joint.direction(one), index)
                for index, (name, one) in enumerate(zip(joint.motion_names, joint.kind.coordinates, strict=True))
            ]
        case _:
            assert_never(joint.type)
    return [_inverse(one) for one in reversed(written)] if joint.reversed else written


def _inverse(one: MjcfJoint) -> MjcfJoint:
    assert one.axis is not None
    return MjcfJoint(one.name, one.kind, one.frame, one.joint, -one.axis, one.index)


Element = ElementTree.Element

MOST = 1000  # names of a kind in the list of what is left out


def add_element(parent: Element, tag: str, attributes: Mapping[str, str]) -> Element:
    """A new element at the end of another one."""
    return ElementTree.SubElement(parent, tag, dict(attributes))


@dataclass(frozen=True)
class Written:
    """A file in another format, and what it does not contain: a sentence for each kind."""

    text: str
    left_out: tuple[str, ...]


def written(root: Element, left_out: Mapping[str, Sequence[str]], *, declaration: bool = False) -> Written:
    """The file with this root element, and at its beginning a comment on what it does not contain.

    :param left_out: the names of what is left out, by kind; a name that several pairs of bodies share is told once.
    :param declaration: whether the file begins with an XML declaration.
    """
    sentences = tuple(f"{kind}: {listed(list(dict.fromkeys(names)), MOST)}" for kind, names in left_out.items())
    if sentences:
        # A comment must not contain "--", nor end with "-".
        root.insert(0, ElementTree.Comment(f" not in this file: {'; '.join(sentences)} ".replace("--", "- -")))
    ElementTree.indent(root)
    return Written(ElementTree.tostring(root, encoding="unicode", xml_declaration=declaration) + "\n", sentences)


@dataclass(eq=False)
class MjcfDocument:
    """An MJCF as it is written: the root element, the bodies, and what is left out, by kind.

    `frames` are the elements of bodies by the names of their parts, `sites` and `geoms` the names that these have.
    """

    mechanism: Mechanism
    root: Element
    bodies: Mapping[str, WrittenBody]
    frames: dict[str, Element]
    left_out: dict[str, list[str]] = field(default_factory=dict)
    sites: dict[tuple[str, str], str] = field(default_factory=dict)
    geoms: list[str] = field(default_factory=list)

    def leave_out(self, kind: str, name: str) -> None:
        """Note what is not written."""
        self.left_out.setdefault(kind, []).append(name)

    def section(self, tag: str) -> Element:
        """The section of the file with a tag."""
        found = self.root.find(tag)
        return add_element(self.root, tag, {}) if found is None else found

    def site(self, part: str, pose: Pose, wanted: str) -> str:
        """The name of a site on a part; a new one, unless there is one of this name there."""
        key = (part, wanted)
        if key not in self.sites:
            self.sites[key] = unique_name(wanted, self.sites.values())
            add_element(self.frames[part], "site", {"name": self.sites[key], **placed(pose)})
        return self.sites[key]

    def end(self, attachment: Attachment, wanted: str) -> str:
        """The name of a new site at a point of a part."""
        return self.site(attachment.part, Pose(attachment.point, np.eye(3)), wanted)

    def start(self, part: str, pose: Pose) -> Pose:
        """The pose in the world of a frame of a part, where all coordinates are 0."""
        return self.bodies[part].start @ pose if part in self.bodies else pose

    @property
    def joints(self) -> dict[str, MjcfJoint]:
        """The joints with one coordinate, by its name."""
        return {joint.name: joint for body in self.bodies.values() for joint in body.joints if joint.single}


def placed(pose: Pose) -> dict[str, str]:
    """The attributes of a pose."""
    found = {"pos": text(pose.position)} if np.any(pose.position) else {}
    return found | ({"quat": text(to_quaternion(pose.rotation))} if np.any(pose.rotation != np.eye(3)) else {})


def number(value: float) -> str:
    """A number as text that gives the same number."""
    value = float(value) + 0.0
    return str(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)


def text(values: Array) -> str:
    """Numbers, separated by spaces."""
    return " ".join(number(value) for value in values)
