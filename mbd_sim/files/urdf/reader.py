"""A URDF as the source of a mechanism: its links and joints become the parts and joints of a mechanism file.

A joint's frame becomes a point of its parent link, named after the joint; a link keeps its frame. The root link is
welded to ground, or flies freely, by a joint named base.

Attributes and elements of an XML file that a table of those that are read does not have are listed as not read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import listed, nearest, quoted
from mbd_sim.files.text.library import file_error
from mbd_sim.files.text.xml import Base, Element, Reading, parse_xml, text_of
from mbd_sim.files.urdf.closing_frames import closing_joints
from mbd_sim.files.urdf.elements import AXIAL, MOMENTS, Origins, color_of, joint_of, mimic_of, part_of
from mbd_sim.files.urdf.gazebo import GAZEBO, has_spring, springs_of
from mbd_sim.mechanism.elements.parts import GROUND, is_frame_name
from mbd_sim.mechanism.values.names import LONGEST_NAME, accepted_names, reference, unique_name
from mbd_sim.mechanism.values.source import Location, Origin, Source


@dataclass(frozen=True)
class Read:
    """What is read of an element: `attributes`, `elements` of which each is read, and `single` ones, read once.

    Of one that is `checked`, other elements are listed by the function that reads it.
    """

    attributes: frozenset[str]
    single: frozenset[str]
    elements: frozenset[str]
    checked: bool


def read(attributes: str = "", single: str = "", elements: str = "", *, checked: bool = False) -> Read:
    """The record, from words."""
    return Read(frozenset(attributes.split()), frozenset(single.split()), frozenset(elements.split()), checked)


Table = Mapping[str, Read]  # by tag, or by parent/tag where that is not enough


def note_unread(reading: Reading, element: Element, key: str, table: Table) -> None:
    """List the attributes and elements in an element and all within it that are not read, with their lines.

    An element whose tag is not in the table is not looked into.

    :param key: how the element is named.
    """
    waiting = [(element, key, table.get(element.tag))]
    while waiting:
        one, own, known = waiting.pop()
        if known is None:
            continue
        for name in one.attributes:
            if name not in known.attributes and not name.startswith("xmlns"):
                reading.leave_out_at(f"{name} of <{one.tag}>", one, own)
        seen: set[str] = set()
        further = []
        for child in one.children:
            inner = f"{own}.{_named(child)}"
            if child.tag in known.elements or (child.tag in known.single and child.tag not in seen):
                further.append((child, inner, table.get(f"{one.tag}/{child.tag}", table.get(child.tag))))
            elif child.tag in known.single:
                reading.leave_out_at(f"<{child.tag}> that is not the first of <{one.tag}>", child, own)
            elif not known.checked:
                reading.leave_out_at(f"<{child.tag}> of <{one.tag}>", child, own)
            seen.add(child.tag)
        waiting += reversed(further)


def _named(element: Element) -> str:
    name = element.attributes.get("name", "")
    return f"{element.tag}[{name}]" if name.isprintable() and 0 < len(name) <= 60 else element.tag


BASE = "base"  # the name of its joint
# What is read of each element; everything else is listed.
READ = {
    "link": read("name type", "inertial", "visual collision"),
    "inertial": read("", "origin mass inertia"),
    "origin": read("xyz rpy"),
    "mass": read("value"),
    "inertia": read(" ".join(MOMENTS)),
    **dict.fromkeys(("visual", "collision"), read("name", "origin geometry material")),
    "geometry": read("", "box cylinder sphere capsule mesh", checked=True),
    "box": read("size"),
    **dict.fromkeys(("cylinder", "capsule"), read("radius length")),
    "sphere": read("radius"),
    "mesh": read("filename scale"),
    "material": read("name", "color"),
    "color": read("rgba"),
    "joint": read("name type", "origin parent child axis limit dynamics mimic", "calibration safety_controller"),
    **dict.fromkeys(("parent", "child"), read("link")),
    "axis": read("xyz"),
    "limit": read("lower upper effort velocity"),
    "dynamics": read("damping friction"),
    "mimic": read("joint multiplier offset"),
}
WORLDS = (GROUND, "world")  # names of a root link that stands for ground where it has no mass
XACRO_REMEDY = 'Declare xmlns:xacro="http://www.ros.org/wiki/xacro" in <robot>, so that the file is expanded.'


def urdf_source(text: str, file: str, base: Base | None = None) -> Source:
    """A URDF as the source of a mechanism file, with the origins of its values.

    Problems of single elements are among its `problems`, with which `validate` refuses it.

    :param base: whether the root link is `fixed` to ground, the default, or `free`.
    :raises MechanismError: the text is not XML, or not a URDF.
    """
    robot = parse_xml(text, file)
    _check_robot(robot, file)
    reader = _Robot(robot, file, base)
    source = reader.source()
    source.comments = (f"From {Path(file).name}.", *source.notes)
    return source


def _check_robot(robot: Element, file: str) -> None:
    for element in robot.walk():
        if element.tag.startswith("xacro:"):
            message = "is an element of xacro, whose namespace the file does not declare"
            raise file_error(file, element.line, message, XACRO_REMEDY, key=element.tag)
    if robot.tag != "robot":
        known = {"sdf": "SDF", "mujoco": "MJCF", "COLLADA": "COLLADA", "gazebo": "SDF"}.get(robot.tag)
        message = f"this is {known}, not URDF" if known else "this is not URDF"
        remedy = "A URDF's root element is <robot>."
        if known in ("SDF", "MJCF"):
            remedy = "Convert it to a mechanism file, which you can edit: mbd_sim convert FILE > FILE.yaml."
        raise file_error(file, robot.line, message, remedy, value=f"<{robot.tag[:60]}>")
    if not robot.all("link"):
        raise file_error(file, robot.line, "has no <link>", "Add the links and joints of the robot.", key="robot")


class _Robot:
    """The parsed elements of a URDF, and their conversion to the data of a mechanism file."""

    def __init__(self, robot: Element, file: str, base: Base | None) -> None:
        self.robot, self.base = robot, base or "fixed"
        self.reading = Reading(file)
        self.reading.note_slips(robot)
        self.origins: dict[Location, Origin] = {}
        self.links = self._named("link")
        named = self._named("joint")
        self.kinds = {name: joint.attributes.get("type", "") for name, joint in named.items()}
        self.joints = self._connected(named)
        axial = [name for name in self.joints if self.kinds[name] in AXIAL]
        self.springs = springs_of(self.reading, robot, axial)
        self.part_names = accepted_names(self.links, "link", is_frame_name)
        self.joint_names = accepted_names(self.joints, "joint")
        self.root = self._root()
        self.grounded = self._is_ground()
        if self.grounded:
            self.part_names[str(self.root)] = GROUND
        for written, name in [*self.part_names.items(), *self.joint_names.items()]:
            if written != name:
                self.reading.leave_out("names that are not valid here, as old → new", f"{written} → {name}")

    def source(self) -> Source:
        """The data, and the origins of its values."""
        name = self.robot.attributes.get("name") or "robot"
        data: dict[str, Any] = {"mechanism": accepted_names([name], "robot")[name]}
        colors = self._colors()
        parts = {
            self.part_names[name]: self._part(link, name, colors)
            for name, link in self.links.items()
            if self.part_names[name] != GROUND
        }
        ground: dict[str, Any] = {}
        joints = self._base_joint() if self.root and not self.grounded else {}
        for name, joint in self.joints.items():
            record, pose = self._joint(name, joint)
            if pose:
                parent = self.part_names[_link(joint, "parent")]
                holder = ground if parent == GROUND else parts[parent]
                points = holder.setdefault("points", {})
                points[self.joint_names[name]] = pose["at"] if pose.keys() == {"at"} else pose
            joints[self.joint_names[name]] = record
        joints |= closing_joints(self.reading, self.part_names, joints)
        data |= {"ground": ground} if ground else {}
        data |= {"parts": parts, "joints": joints}
        if couplings := self._couplings():
            data["constraints"] = couplings
        if blocks := self.robot.all("ros2_control"):
            data["ros2_control"] = text_of(blocks)
            self._note_places(blocks)
        for element in self.robot.children:
            if element.tag == GAZEBO and has_spring(element):
                continue  # whose rest is listed
            if element.tag not in ("link", "joint", "material"):
                name = element.attributes.get("name") or element.attributes.get("reference") or "without a name"
                hint = ", which acts with --control" if element.tag == "ros2_control" else ""
                self.reading.leave_out(f"<{element.tag}>{hint}", name)
            else:
                key = _key(element.tag, element.attributes.get("name", ""))
                note_unread(self.reading, element, key, READ)
        return Source(
            data=data,
            file=self.reading.file,
            problems=self.reading.problems,
            origins=self.origins,
            notes=self.reading.notes,
            format="URDF",
        )

    def _named(self, tag: str) -> dict[str, Element]:
        found: dict[str, Element] = {}
        for element in self.robot.all(tag):
            name = element.attributes.get("name", "")
            if not name:
                self.reading.report(element, tag, "'name' is missing", "Add it.")
            elif name in found:
                first = found[name].line
                remedy = "Rename one of them."
                self.reading.report(element, _key(tag, name), f"is given twice, first on line {first}", remedy)
            else:
                found[name] = element
        return found

    def _connected(self, joints: dict[str, Element]) -> dict[str, Element]:
        """The joints whose links exist; of several joints with the same child, only the first."""
        connected: dict[str, Element] = {}
        joint_of_child: dict[str, str] = {}
        for name, joint in joints.items():
            key, problems = _key("joint", name), len(self.reading.problems)
            for end in ("parent", "child"):
                element = joint.first(end)
                link = _link(joint, end)
                if element is None or not link:
                    self.reading.report(joint, key, f"<{end} link=…> is missing", "Add it.")
                elif link not in self.links:
                    message, remedy = f"there is no link {quoted(link)}", nearest(link, self.links)
                    self.reading.report(element, f"{key}.{end}.link", message, remedy)
            if len(self.reading.problems) > problems:
                continue
            child = _link(joint, "child")
            if child in joint_of_child:
                message = f"the link {quoted(child)} is already the child of joint {quoted(joint_of_child[child])}"
                remedy = "URDF describes trees: close loops in a mechanism file with 'urdf:' and a joint of its own."
                self.reading.report(joint, f"{key}.child.link", message, remedy)
                continue
            joint_of_child[child] = name
            connected[name] = joint
        return connected

    def _root(self) -> str | None:
        children = {_link(joint, "child") for joint in self.joints.values()}
        roots = [name for name in self.links if name not in children]
        if len(roots) == 1 and len(self._below(roots[0])) == len(self.links):
            return roots[0]
        if self.reading.problems:
            return None  # of joints that are left out
        if not roots or len(roots) == 1:
            circle = [name for name in self.links if name not in (self._below(roots[0]) if roots else ())]
            message, at = f"the links form a loop: {listed(circle)}", self.links[circle[0]]
            self.reading.report(at, _key("link", circle[0]), message, "Remove one of its joints: URDF describes trees.")
        else:
            message = f"the robot is not connected: {len(roots)} links have no parent ({listed(roots)})"
            remedy = "Connect them with joints, or keep only one of these pieces."
            self.reading.report(self.links[roots[1]], _key("link", roots[1]), message, remedy)
        return None

    def _below(self, root: str) -> set[str]:
        children: dict[str, list[str]] = {}
        for joint in self.joints.values():
            children.setdefault(_link(joint, "parent"), []).append(_link(joint, "child"))
        found, waiting = {root}, [root]
        while waiting:
            for child in children.get(waiting.pop(), []):
                if child not in found:
                    found.add(child)
                    waiting.append(child)
        return found

    def _is_ground(self) -> bool:
        """Whether the root link stands for ground; a robot that is fixed to it cannot have a free base as well."""
        if self.root not in WORLDS or self.links[self.root].first("inertial"):
            return False
        if self.base == "free":
            key = _key("link", self.root)
            message, at = "stands for ground, to which the robot is fixed", self.links[self.root]
            remedy = "For a free base remove this link and its joint, or make that joint floating (free)."
            self.reading.report(at, key, message, remedy)
        return True

    def _base_joint(self) -> dict[str, Any]:
        assert self.root is not None
        name = unique_name(BASE, self.joint_names.values())
        origin = self.reading.origin(self.links[self.root], _key("link", self.root))
        self.origins[("joints", name)] = origin
        return {name: {"type": self.base, "between": [GROUND, reference(self.part_names[self.root])]}}

    def _colors(self) -> dict[str, str]:
        """The colors of the materials of the whole robot, by name."""
        found: dict[str, str] = {}
        for material in [element for element in self.robot.walk() if element.tag == "material"]:
            name = material.attributes.get("name", "")
            problems = len(self.reading.problems)
            color = color_of(self.reading, material, _key("material", name))
            if material not in self.robot.children:
                del self.reading.problems[problems:]  # reported with the link that uses it
            if color and name:
                found.setdefault(name, color)
        return found

    def _part(self, link: Element, name: str, colors: dict[str, str]) -> dict[str, Any]:
        key, inner = _key("link", name), Origins()
        record = part_of(self.reading, link, key, colors, inner)
        self._add_origins(("parts", self.part_names[name]), self.reading.origin(link, key), inner)
        return record

    def _joint(self, name: str, joint: Element) -> tuple[dict[str, Any], dict[str, Any]]:
        key, inner, own = _key("joint", name), Origins(), self.joint_names[name]
        record, pose = joint_of(self.reading, joint, key, inner)
        self._add_origins(("joints", own), self.reading.origin(joint, key), inner)
        parent, child = (self.part_names[_link(joint, end)] for end in ("parent", "child"))
        point = "points", own
        self.origins[("ground", *point) if parent == GROUND else ("parts", parent, *point)] = self.reading.origin(
            joint.first("origin") or joint, f"{key}.origin"
        )
        between = [reference(parent, own if pose else ""), reference(child)]
        spring = self.springs.get(name, {})
        return {"type": record.pop("type"), "between": between, **record, **spring}, pose

    def _note_places(self, blocks: Sequence[Element]) -> None:
        """Note the lines of the `<ros2_control>` blocks, and of the joints and sensors in them."""
        self.origins[("ros2_control",)] = self.reading.origin(blocks[0], "ros2_control")
        for block in blocks:
            own = _key("ros2_control", block.attributes.get("name", ""))
            for element in block.children:
                if name := element.attributes.get("name", ""):
                    origin = self.reading.origin(element, f"{own}.{_key(element.tag, name)}")
                    self.origins[("ros2_control", name)] = origin

    def _couplings(self) -> dict[str, Any]:
        couplings: dict[str, Any] = {}
        for name, joint in self.joints.items():
            key = _key("joint", name)
            if (coupling := mimic_of(self.reading, joint, key, self.joint_names, self.kinds)) is not None:
                own = unique_name(f"{self.joint_names[name]}_mimic", couplings)
                couplings[own] = coupling
                self.origins[("constraints", own)] = self.reading.origin(joint, f"{key}.mimic")
        return couplings

    def _add_origins(self, location: Location, origin: Origin, inner: Origins) -> None:
        self.origins[location] = origin
        self.origins |= {(*location, *rest): origin for rest, origin in inner.items()}


def _key(tag: str, name: str) -> str:
    """How a link or joint is named in errors."""
    return f"{tag}[{name if name.isprintable() and len(name) <= LONGEST_NAME else quoted(name)}]"


def _link(joint: Element, end: str) -> str:
    """The link at an end of a joint, or ""."""
    element = joint.first(end)
    return element.attributes.get("link", "") if element else ""
