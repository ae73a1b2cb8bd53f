"""A mechanism's spanning tree as URDF, for robot_state_publisher, RViz and Rerun.

A URDF link's frame is that of its inboard joint. Where a part's own frame is another one, a link named after the
joint stands between them, so that every part keeps its frame and its name.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

import numpy as np

from mbd_sim.mechanism.model import GROUND, Array, Joint, Mechanism, Part, Pose, Shape
from mbd_sim.mechanism.rotation import to_rpy

Element = ElementTree.Element

UNLIMITED = 1e6  # URDF demands numbers where a mechanism has no limit
THICKNESS = 0.01  # of flat shapes, as a share of their size


def to_urdf(mechanism: Mechanism) -> str:
    """The URDF of a mechanism; joints for which URDF has no word become `floating`."""
    robot = Element("robot", name=mechanism.name)
    ElementTree.SubElement(robot, "link", name=GROUND)
    for joint in mechanism.tree_joints():
        _add_joint(robot, joint)
        _add_link(robot, mechanism.parts[joint.outboard])
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def _add_joint(robot: Element, joint: Joint) -> None:
    inboard, outboard, axis = joint.parent_pose, joint.child_pose, joint.axis
    if joint.reversed:
        inboard, outboard, axis = outboard, inboard, -axis
    kind = {"fixed": "fixed", "prismatic": "prismatic", "planar": "planar"}.get(joint.type, "floating")
    if joint.type == "revolute":
        kind = "revolute" if joint.limits else "continuous"
    element = ElementTree.SubElement(robot, "joint", name=joint.name, type=kind)
    _add_origin(element, inboard)
    ElementTree.SubElement(element, "parent", link=joint.inboard)
    moved = bool(np.any(outboard.position) or np.any(outboard.rotation != np.eye(3)))
    ElementTree.SubElement(element, "child", link=f"{joint.name}_frame" if moved else joint.outboard)
    if joint.type in ("revolute", "prismatic"):
        ElementTree.SubElement(element, "axis", xyz=_text(axis))
        _add_limit(element, joint)
        if joint.damping[0]:
            ElementTree.SubElement(element, "dynamics", damping=_number(joint.damping[0]))
    if moved:
        ElementTree.SubElement(robot, "link", name=f"{joint.name}_frame")
        weld = ElementTree.SubElement(robot, "joint", name=f"{joint.name}_frame_to_{joint.outboard}", type="fixed")
        _add_origin(weld, outboard.inverse())
        ElementTree.SubElement(weld, "parent", link=f"{joint.name}_frame")
        ElementTree.SubElement(weld, "child", link=joint.outboard)


def _add_limit(element: Element, joint: Joint) -> None:
    limit = ElementTree.SubElement(element, "limit", velocity=_number(UNLIMITED))
    limit.set("effort", _number(UNLIMITED if joint.effort_limit is None else joint.effort_limit))
    if joint.limits or joint.type == "prismatic":
        limit.set("lower", _number(joint.limits.lower if joint.limits else -UNLIMITED))
        limit.set("upper", _number(joint.limits.upper if joint.limits else UNLIMITED))


def _add_link(robot: Element, part: Part) -> None:
    link = ElementTree.SubElement(robot, "link", name=part.name)
    if part.mass:
        inertial = ElementTree.SubElement(link, "inertial")
        _add_origin(inertial, Pose(part.center, np.eye(3)))
        ElementTree.SubElement(inertial, "mass", value=_number(part.mass))
        names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        moments = {name: _number(float(part.inertia[place])) for name, place in names.items()}
        ElementTree.SubElement(inertial, "inertia", moments)
    for shape in part.shapes:
        if not shape.hole:
            _add_visual(link, part, shape)


def _add_visual(link: Element, part: Part, shape: Shape) -> None:
    visual = ElementTree.SubElement(link, "visual")
    _add_origin(visual, shape.pose)
    geometry = ElementTree.SubElement(visual, "geometry")
    match shape.kind, shape.size:
        case ("block", size):
            ElementTree.SubElement(geometry, "box", size=_text(np.array(size)))
        case ("plate", (x, y)):
            ElementTree.SubElement(geometry, "box", size=_text(np.array([x, y, THICKNESS * max(x, y)])))
        case ("rod" | "cylinder", (length, radius)):
            ElementTree.SubElement(geometry, "cylinder", length=_number(length), radius=_number(radius))
        case ("disc" | "ring", (radius,)):
            thickness = _number(THICKNESS * radius)
            ElementTree.SubElement(geometry, "cylinder", length=thickness, radius=_number(radius))
        case ("sphere" | "particle", (radius,)):
            ElementTree.SubElement(geometry, "sphere", radius=_number(radius))
    if shape.color:
        red, green, blue = (int(shape.color[place : place + 2], 16) / 255 for place in (1, 3, 5))
        material = ElementTree.SubElement(visual, "material", name=f"{part.name}_{shape.color[1:]}")
        ElementTree.SubElement(material, "color", rgba=_text(np.array([red, green, blue, 1.0])))


def _add_origin(element: Element, pose: Pose) -> None:
    ElementTree.SubElement(element, "origin", xyz=_text(pose.position), rpy=_text(np.array(to_rpy(pose.rotation))))


def _number(value: float) -> str:
    return repr(float(value) + 0.0) if math.isfinite(value) else _number(UNLIMITED)


def _text(values: Array) -> str:
    return " ".join(_number(value) for value in values)
