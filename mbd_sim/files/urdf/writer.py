"""A mechanism's spanning tree as URDF, for robot_state_publisher, RViz, Rerun and every other reader of URDF.

A URDF link's frame is that of its inboard joint. If a part has another frame, a link named after the joint is
put between them, so that every part keeps its frame and its name. A joint with several coordinates becomes a chain of
joints with one coordinate each, named as in `joint_states`, with massless links between them.

The `<ros2_control>` block is for JointStateTopicSystem of joint_state_topic_hardware_interface. That system exchanges
commands and states of joints with a node over two topics of sensor_msgs/JointState. It names all joints of the block in
each message, and each array has an entry for each joint with a command interface of that name.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import listed
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import to_rpy
from mbd_sim.files.text import xml as xml_elements
from mbd_sim.files.urdf.gazebo import GAZEBO, SPRING
from mbd_sim.files.urdf.motions import Motion, mimics_of, motions_of, range_of
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.actuators import CoordinatePort
from mbd_sim.mechanism.elements.forces import Bushing
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import GROUND, Joint, Mesh, Part, Shape
from mbd_sim.mechanism.elements.sensors import FramelessSensor, FrameSensor, frame_id
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.touching import touching_pairs
from mbd_sim.mechanism.values.names import unique_name

ROS2_CONTROL = "ros2_control"  # a key of mechanism files, and a tag in URDF
PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
TOPIC_PLUGINS = (PLUGIN, "topic_based_ros2_control/TopicBasedSystem")
INTERFACES = ("position", "velocity", "effort")
ALWAYS = "-1"  # the threshold with which commands are sent in each cycle, so that they do not expire


@dataclass(frozen=True, slots=True)
class ControlTopics:
    """The absolute names of the topics of a node."""

    commands: str
    states: str


def ros2_control_block(
    mechanism: Mechanism, robot: ElementTree.Element, topics: ControlTopics
) -> ElementTree.Element | None:
    """The block for the coordinates of a mechanism that are joints of its URDF with one coordinate each.

    The URDF may have blocks already: joints that one of these has are left out. None if no joint is left.

    A joint with an actuator or a drive that follows commands has the command interfaces that this takes, other joints
    have `effort`; joints that follow the time or another joint have none. All have the states position, velocity and
    effort.

    :param robot: the URDF of the mechanism.
    """
    blocks = robot.findall(ROS2_CONTROL)
    name = unique_name(mechanism.name, [block.get("name", "") for block in blocks])
    named = {joint.get("name", "") for other in blocks for joint in other.iter("joint")}
    block = _block(name, topics)
    _add_interfaces(block, mechanism, robot, lambda joint: joint not in named)
    return None if named and block.find("joint") is None else block


def _served(
    written: xml_elements.Element, mechanism: Mechanism, robot: ElementTree.Element, topics: ControlTopics
) -> ElementTree.Element | None:
    """A block of the file with the hardware of this node, and the interfaces that it serves; None without joints.

    One whose hardware already exchanges topics with a node stays as it is.
    """
    plugins = [plugin.text for hardware in written.all("hardware") for plugin in hardware.all("plugin")]
    if any(plugin.strip() in TOPIC_PLUGINS for plugin in plugins):
        return xml_elements.as_tree(written)
    joints = {joint.attributes.get("name", "") for joint in written.all("joint")}
    block = _block(written.attributes.get("name", ""), topics)
    _add_interfaces(block, mechanism, robot, joints.__contains__)
    return None if block.find("joint") is None else block


def _block(name: str, topics: ControlTopics) -> ElementTree.Element:
    """A block without joints."""
    block = ElementTree.Element(ROS2_CONTROL, name=name, type="system")
    hardware = ElementTree.SubElement(block, "hardware")
    ElementTree.SubElement(hardware, "plugin").text = PLUGIN
    parameters = {
        "joint_commands_topic": topics.commands,
        "joint_states_topic": topics.states,
        "trigger_joint_command_threshold": ALWAYS,
    }
    for key, value in parameters.items():
        ElementTree.SubElement(hardware, "param", name=key).text = value
    return block


def _add_interfaces(
    block: ElementTree.Element, mechanism: Mechanism, robot: ElementTree.Element, has: Callable[[str], bool]
) -> None:
    """Add the joints that a block `has`, with their interfaces."""
    taken = _commands(mechanism)
    in_urdf = {joint.attrib["name"]: joint for joint in robot.findall("joint") if joint.find("axis") is not None}
    for name in (*mechanism.coordinate_names, *mechanism.driven_names):
        if name not in in_urdf or not has(name):
            continue
        joint = ElementTree.SubElement(block, "joint", name=name)
        follows = in_urdf[name].find("mimic") is not None or (name in mechanism.driven_names and name not in taken)
        for interface in () if follows else taken.get(name, ("effort",)):
            ElementTree.SubElement(joint, "command_interface", name=interface)
        for interface in INTERFACES:
            ElementTree.SubElement(joint, "state_interface", name=interface)


def _commands(mechanism: Mechanism) -> Mapping[str, Sequence[str]]:
    """The command interfaces of the joints with actuators, and of those with drives that follow commands."""
    found: dict[str, list[str]] = {name: list(drive.channels) for name, drive in commanded_drives(mechanism).items()}
    for actuator in mechanism.actuators:
        if isinstance(actuator.port, CoordinatePort):
            taken = found.setdefault(actuator.port.coordinate, [])
            taken += [channel for channel in actuator.channels if channel in INTERFACES and channel not in taken]
    return {name: [interface for interface in INTERFACES if interface in taken] for name, taken in found.items()}


Element = ElementTree.Element

UNLIMITED = 1e6  # URDF requires numbers where a mechanism has no limit
USUAL_GRAVITY = (0.0, 0.0, -9.81)  # in m/s², which a URDF read by itself has
THICKNESS = 0.01  # of flat shapes, relative to their size


def to_urdf(mechanism: Mechanism, control: ControlTopics | None = None) -> str:
    """The URDF of a mechanism; a comment in it names what URDF cannot represent.

    The `<ros2_control>` blocks of a URDF stay as they are. With topics of commands and states, one is added for the
    joints that they do not have, and blocks that act in this mechanism have the hardware that uses these topics.

    Gears, racks and couplings of two coordinates become `<mimic>`; a screw becomes a hinge and a slider that mimics it.
    A spherical joint, which URDF does not have, becomes `floating`. If a part has meshes, its shapes are the collision
    geometry.
    """
    robot = _robot(mechanism)
    if missing := left_out(mechanism):
        robot.insert(0, ElementTree.Comment(f" not in this file: {'; '.join(missing)} ".replace("--", "- -")))
    acting = control if mechanism.source.data.get("control") else None
    for written in control_blocks(mechanism):
        own = xml_elements.as_tree(written) if acting is None else _served(written, mechanism, robot, acting)
        robot.extend([] if own is None else [own])
    if control is not None and (block := ros2_control_block(mechanism, robot, control)) is not None:
        robot.append(block)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def control_blocks(mechanism: Mechanism) -> list[xml_elements.Element]:
    """The `<ros2_control>` elements of the URDF or the file of a mechanism."""
    written = mechanism.source.data.get(ROS2_CONTROL)
    return xml_elements.parse_elements(written, ROS2_CONTROL) if written else []


def _robot(mechanism: Mechanism) -> Element:
    robot = Element("robot", name=mechanism.name)
    mimics = mimics_of(mechanism)
    ElementTree.SubElement(robot, "link", name=GROUND)
    sensors = [one for one in mechanism.sensors if not isinstance(one, FramelessSensor) and not one.at.is_of_part]
    names = {GROUND, *mechanism.parts, *map(frame_id, sensors)}
    touching = {
        place[0]
        for pair in touching_pairs(mechanism)[0]
        for place in (pair.first, pair.second)
        if isinstance(place, tuple)
    }
    for joint in mechanism.tree_joints():
        if joint.splits:
            continue
        motions = [replace(motion, mimic=mimics.get(motion.name, motion.mimic)) for motion in motions_of(joint)]
        _add_joint(robot, joint, motions, names)
        _add_link(robot, mechanism.parts[joint.outboard], touching)
    for sensor in sensors:
        _add_sensor_frame(robot, sensor)
    return robot


def _add_sensor_frame(robot: Element, sensor: FrameSensor) -> None:
    """Add a link for the frame of a sensor, with the name that its messages have."""
    name = frame_id(sensor)
    ElementTree.SubElement(robot, "link", name=name)
    weld = ElementTree.SubElement(robot, "joint", name=f"{sensor.at.part}_to_{name}", type="fixed")
    _add_ends(weld, sensor.at.pose, sensor.at.part, name)


@dataclass(frozen=True, eq=False)
class FloatingJoint:
    """A `floating` joint of the exported URDF: its links, and the `pose` of its child link in the frame of `part`.

    robot_state_publisher publishes no transform for it, because `joint_states` has no position for it.
    """

    parent: str
    child: str
    part: str
    pose: Pose


def floating_joints(mechanism: Mechanism) -> list[FloatingJoint]:
    """The floating joints of `to_urdf`, from ground outwards."""
    found = []
    for element in _robot(mechanism).findall("joint[@type='floating']"):
        joint = mechanism.joints[element.attrib["name"]]
        parent, child = (element.find(end).attrib["link"] for end in ("parent", "child"))  # type: ignore[union-attr]
        pose = joint.parent_pose if joint.reversed else joint.child_pose
        found.append(FloatingJoint(parent, child, joint.outboard, pose))
    return found


def left_out(mechanism: Mechanism) -> tuple[str, ...]:
    """What `to_urdf` cannot represent: a sentence for each kind, with the names."""
    joints, mimicked = mechanism.joints.values(), {mimic.constraint for mimic in mimics_of(mechanism).values()}
    sprung = {bushing.name for bushing in mechanism.bushings if bushing.in_joint}
    elements = [one for one in mechanism.force_elements if not (isinstance(one, Bushing) and one.in_joint)]
    gravity = [] if np.array_equal(mechanism.gravity, USUAL_GRAVITY) else [str(mechanism.gravity.tolist())]
    found = {
        "gravity": gravity,
        "joints that close loops": [*mechanism.closures],
        "constraints": [one.name for one in mechanism.constraints if one.name not in mimicked],
        "springs, dampers and forces": [element.name for element in elements],
        "springs and dampers of joints": [joint.name for joint in joints if _has_law(joint) or joint.name in sprung],
        "friction other than Coulomb's": [
            joint.name for joint in joints if joint.friction and not joint.friction.is_plain
        ],
        "drives": [joint.name for joint in joints if joint.drive],
        "positions and velocities at the start": [joint.name for joint in joints if _starts_elsewhere(joint)],
        "spherical joints, here floating": [joint.name for joint in joints if joint.type == "spherical"],
        "actuators": [actuator.name for actuator in mechanism.actuators],
        "contacts, of which only the shapes are here": list(dict.fromkeys(one.name for one in mechanism.contacts)),
        "shapes that URDF does not have": [
            f"{part.name}: {shape.kind}"
            for part in mechanism.parts.values()
            for shape in part.shapes
            if not shape.hole and _form(shape) is None
        ],
    }
    return tuple(f"{kind}: {listed(names, max_count=1000)}" for kind, names in found.items() if names)


def _starts_elsewhere(joint: Joint) -> bool:
    """Whether a joint without a drive starts in motion, or not at zero."""
    if joint.drive:
        return False
    zero = np.zeros(joint.kind.nq)
    if joint.kind.quaternion is not None:
        zero[joint.kind.quaternion] = 1.0
    return bool(np.any(joint.velocity) or np.any(joint.position != zero))


def _has_law(joint: Joint) -> bool:
    stops = any(limits is not None and limits.stiffness is not None for limits in joint.limits)
    three_ways = joint.kind.quaternion is not None and (joint.damping.any() or joint.stiffness.any())
    return bool(joint.spring or joint.damper or stops or three_ways)


def _add_joint(robot: Element, joint: Joint, motions: list[Motion], names: set[str]) -> None:
    """Add the joints and the links between them; `names` are the links so far."""
    origin, outboard = joint.parent_pose, joint.child_pose
    if joint.reversed:
        origin, outboard = outboard, origin
    moved = bool(np.any(outboard.position) or np.any(outboard.rotation != np.eye(3)))
    parent = joint.inboard
    for motion in motions:
        last = motion is motions[-1]
        child = (
            joint.outboard if last and not moved else unique_name(f"{joint.name if last else motion.name}_frame", names)
        )
        names.add(child)
        _add_motion(robot, motion, joint, origin, parent, child)
        if child != joint.outboard:
            ElementTree.SubElement(robot, "link", name=child)
        origin, parent = identity_pose(), child
    if moved:
        weld = ElementTree.SubElement(robot, "joint", name=f"{parent}_to_{joint.outboard}", type="fixed")
        _add_ends(weld, outboard.inverse(), parent, joint.outboard)


def _add_motion(robot: Element, motion: Motion, joint: Joint, origin: Pose, parent: str, child: str) -> None:
    element = ElementTree.SubElement(robot, "joint", name=motion.name, type=motion.type)
    _add_ends(element, origin, parent, child)
    if motion.axis is None:
        return
    ElementTree.SubElement(element, "axis", xyz=_text(motion.axis))
    _add_limit(element, joint, motion)
    if motion.damping or motion.friction:
        coefficients = {"damping": motion.damping, "friction": motion.friction}
        ElementTree.SubElement(
            element, "dynamics", {key: _number(value) for key, value in coefficients.items() if value}
        )
    if motion.stiffness:
        values = {"stiffness": motion.stiffness, "rest": motion.rest}
        block = ElementTree.SubElement(robot, GAZEBO, reference=motion.name)
        for tag, key in SPRING.items():
            ElementTree.SubElement(block, tag).text = _number(values[key])
    if mimic := motion.mimic:
        law = {"multiplier": _number(mimic.multiplier), "offset": _number(mimic.offset)}
        ElementTree.SubElement(element, "mimic", {"joint": mimic.joint, **law})


def _add_ends(element: Element, origin: Pose, parent: str, child: str) -> None:
    _add_origin(element, origin)
    ElementTree.SubElement(element, "parent", link=parent)
    ElementTree.SubElement(element, "child", link=child)


def _add_limit(element: Element, joint: Joint, motion: Motion) -> None:
    speed, effort = _velocity_limit(joint), math.inf if joint.effort_limit is None else joint.effort_limit
    if motion.type == "continuous" and math.isinf(speed) and math.isinf(effort):
        return
    names = joint.motion_names
    lower, upper = range_of(joint, names.index(motion.name)) if motion.name in names else (-math.inf, math.inf)
    limit = ElementTree.SubElement(element, "limit", velocity=_limit(speed), effort=_limit(effort))
    if motion.type != "continuous":
        limit.set("lower", _limit(lower))
        limit.set("upper", _limit(upper))


def _velocity_limit(joint: Joint) -> float:
    if isinstance(joint.drive, CommandedDrive):
        return joint.drive.velocity_limit
    return math.inf if joint.velocity_limit is None else joint.velocity_limit


def _limit(value: float) -> str:
    """A number also where there is no limit."""
    return _number(min(max(value, -UNLIMITED), UNLIMITED))


def _add_link(robot: Element, part: Part, touching: Container[str]) -> None:
    """Add a link; the shapes of parts that are `touching` something are its collision elements too."""
    link = ElementTree.SubElement(robot, "link", name=part.name)
    if part.mass or np.any(part.inertia):
        inertial = ElementTree.SubElement(link, "inertial")
        _add_origin(inertial, Pose(part.center, np.eye(3)))
        ElementTree.SubElement(inertial, "mass", value=_number(part.mass))
        names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        moments = {name: _number(float(part.inertia[index])) for name, index in names.items()}
        ElementTree.SubElement(inertial, "inertia", moments)
    for mesh in part.meshes:
        geometry = _add_geometry(link, "visual", part, mesh)
        ElementTree.SubElement(geometry, "mesh", filename=mesh.file, scale=_text(np.array(mesh.scale)))
    touches = part.collisions is None and (bool(part.meshes) or part.name in touching)
    for tag, shapes in (
        ("visual", () if part.meshes else part.shapes),
        ("collision", part.shapes if touches else part.collisions or ()),
    ):
        for shape in shapes:
            if not shape.hole and (form := _form(shape)) is not None:
                ElementTree.SubElement(_add_geometry(link, tag, part, shape), *form)


def _add_geometry(link: Element, tag: str, part: Part, drawn: Shape | Mesh) -> Element:
    element = ElementTree.SubElement(link, tag)
    _add_origin(element, drawn.pose)
    geometry = ElementTree.SubElement(element, "geometry")
    if drawn.color and tag == "visual":
        red, green, blue = (int(drawn.color[start : start + 2], 16) / 255 for start in (1, 3, 5))
        material = ElementTree.SubElement(element, "material", name=f"{part.name}_{drawn.color[1:]}")
        ElementTree.SubElement(material, "color", rgba=_text(np.array([red, green, blue, 1.0])))
    return geometry


def _form(shape: Shape) -> tuple[str, dict[str, str]] | None:
    """The element that stands for a shape, with its attributes; None where URDF has none."""
    size = shape.size
    match shape.kind:
        case "block":
            return "box", {"size": _text(np.array(size))}
        case "plate":
            return "box", {"size": _text(np.array([*size, THICKNESS * max(size)]))}
        case "rod" | "cylinder" | "capsule":
            return "cylinder", {"length": _number(size[0]), "radius": _number(size[1])}
        case "disc" | "ring":
            return "cylinder", {"length": _number(THICKNESS * size[0]), "radius": _number(size[0])}
        case "sphere" | "particle":
            return "sphere", {"radius": _number(size[0])}
        case "cone" | "ellipsoid" | "hull" | "outline":
            return None
        case _:
            assert_never(shape.kind)


def _add_origin(element: Element, pose: Pose) -> None:
    ElementTree.SubElement(element, "origin", xyz=_text(pose.position), rpy=_text(np.array(to_rpy(pose.rotation))))


def _number(value: float) -> str:
    return repr(float(value) + 0.0) if math.isfinite(value) else _number(UNLIMITED)


def _text(values: Array) -> str:
    return " ".join(_number(value) for value in values)
