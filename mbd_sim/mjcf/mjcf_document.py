"""An MJCF as it is written: its elements, and the list of what it does not contain."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.errors import listed
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import to_quaternion
from mbd_sim.mechanism.names import unique_name
from mbd_sim.mechanism.records import Attachment, Mechanism
from mbd_sim.mjcf.written_bodies import WrittenBody, WrittenJoint

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

    :param left_out: the names of what is left out, by kind.
    :param declaration: whether the file begins with an XML declaration.
    """
    sentences = tuple(f"{kind}: {listed(names, MOST)}" for kind, names in left_out.items())
    if sentences:
        # A comment must not contain "--", nor end with "-".
        root.insert(0, ElementTree.Comment(f" not in this file: {'; '.join(sentences)} ".replace("--", "- -")))
    ElementTree.indent(root)
    return Written(ElementTree.tostring(root, encoding="unicode", xml_declaration=declaration) + "\n", sentences)


@dataclass(eq=False)
class Document:
    """An MJCF as it is written: the root element, the bodies, and what is left out, by kind.

    `frames` are the elements of bodies by the names of their parts, `taken` the names of sites.
    """

    mechanism: Mechanism
    root: Element
    bodies: Mapping[str, WrittenBody]
    frames: dict[str, Element]
    left_out: dict[str, list[str]] = field(default_factory=dict)
    sites: dict[tuple[str, str], str] = field(default_factory=dict)

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
    def joints(self) -> dict[str, WrittenJoint]:
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
