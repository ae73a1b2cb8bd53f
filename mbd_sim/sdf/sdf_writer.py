"""A mechanism as SDF, for Gazebo and other readers: a world with one model. Loops are closed by joints, as here.

Of a mechanism without loops, the links are where all coordinates are 0, so that the coordinates are the same. With
loops they are at the start, where the loops are closed, and the coordinates of SDF count from there.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.analysis.kinematics import Kinematics
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import to_quaternion
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.names import unique_name
from mbd_sim.mechanism.records import GROUND, Mechanism, Part, Shape
from mbd_sim.mjcf.mjcf_document import Written, number, text, written
from mbd_sim.sdf.frame_graph import WORLD
from mbd_sim.sdf.written_joints import Placement, WrittenAxis, WrittenJoint, written_chain, written_closing
from mbd_sim.urdf.joint_motions import mimics_of
from mbd_sim.urdf.urdf_writer import THICKNESS

Element = ElementTree.Element

VERSION = "1.11"
LEAST_MASS = 1e-9  # kg, of parts without mass, which SDF does not allow
LEAST_INERTIA = 1e-14  # kg·m², in place of moments of 0
AXES = ("axis", "axis2")
MOMENTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}


@dataclass(eq=False)
class Document:
    """An SDF as it is written: the world, the model, the names that are taken, and what is left out, by kind."""

    mechanism: Mechanism
    world: Element
    model: Element
    placement: Placement
    names: set[str]
    left_out: dict[str, list[str]] = field(default_factory=dict)
    joints: dict[str, str] = field(default_factory=dict)  # the names of joints, where those of links have them
    axes: dict[str, tuple[str, str]] = field(default_factory=dict)  # joint and axis by coordinate

    def leave_out(self, kind: str, names: Sequence[str]) -> None:
        """Note what is not written."""
        if names:
            self.left_out.setdefault(kind, []).extend(names)


def to_sdf(mechanism: Mechanism) -> Written:
    """The SDF of a mechanism; a comment in it lists what it does not contain.

    :raises MechanismError: the loops cannot be closed.
    """
    root = Element("sdf", version=VERSION)
    world = ElementTree.SubElement(root, "world", name=f"{mechanism.name}_world")
    _add(world, "gravity", text(mechanism.gravity))
    model = ElementTree.SubElement(world, "model", name=mechanism.name)
    document = Document(mechanism, world, model, _placement(mechanism), set(mechanism.parts))
    for part in mechanism.parts.values():
        _add_link(document, part)
    _add_joints(document)
    _add_frames(document)
    _note_rest(document)
    _rename(document, root)
    return written(root, document.left_out, declaration=True)


def _rename(document: Document, root: Element) -> None:
    """Replace the names that SDF reserves: `::` leads into models, and `__…__` are its own."""
    elements, new = list(root.iter()), dict[str, str]()
    used = {element.attrib["name"]: None for element in elements if "name" in element.attrib}
    for name in [name for name in used if "::" in name or re.fullmatch("__.*__", name)]:
        new[name] = unique_name(re.sub("::|^__|__$", "_", name), used)
        used[new[name]] = None
        document.leave_out("names that SDF reserves, as old → new", [f"{name} → {new[name]}"])
    for element in elements:
        for key in ("name", "attached_to", "joint"):
            if element.get(key) in new:
                element.set(key, new[element.attrib[key]])
        if element.tag in ("parent", "child") and element.text in new:
            element.text = new[element.text]


def _placement(mechanism: Mechanism) -> Placement:
    kinematics = Kinematics(mechanism)
    q, offsets = kinematics.start.copy(), dict[str, float]()
    for name, joint in mechanism.joints.items():
        place = kinematics.layout.q[name]
        if joint.drive:
            driven = (
                [joint.drive.start] if isinstance(joint.drive, CommandedDrive) else [x.at(0.0) for x in joint.drive]
            )
            offsets |= dict(zip(joint.motion_names, driven, strict=True))
        elif joint.kind.quaternion is None:
            if not mechanism.closures:
                q[place] = 0.0
            offsets |= {name: float(value) for name, value in zip(joint.motion_names, q[place], strict=True)}
        elif joint.type == "spherical" and not mechanism.closures:
            q[place] = [1.0, 0.0, 0.0, 0.0]
    return Placement(kinematics.poses(q), offsets)


def _add_link(document: Document, part: Part) -> None:
    link = ElementTree.SubElement(document.model, "link", name=part.name)
    _add_pose(link, document.placement.poses[part.name])
    mass, inertia = part.mass, part.inertia
    if not mass:
        mass = LEAST_MASS
        document.leave_out(f"parts without mass, here with {LEAST_MASS:g} kg", [part.name])
    least = float(np.linalg.eigvalsh(inertia)[0])
    if least < LEAST_INERTIA:
        inertia = inertia + (LEAST_INERTIA - min(least, 0.0)) * np.eye(3)
    inertial = ElementTree.SubElement(link, "inertial")
    _add_pose(inertial, Pose(part.center, np.eye(3)))
    _add(inertial, "mass", number(mass))
    tensor = ElementTree.SubElement(inertial, "inertia")
    for name, index in MOMENTS.items():
        _add(tensor, name, number(float(inertia[index])))
    for count, shape in enumerate((shape for shape in part.shapes if not shape.hole), start=1):
        _add_shape(link, f"{part.name}_shape_{count}", shape)
    document.leave_out("meshes", [f"{part.name}: {mesh.file}" for mesh in part.meshes])


def _add_shape(link: Element, name: str, shape: Shape) -> None:
    visual = ElementTree.SubElement(link, "visual", name=name)
    _add_pose(visual, shape.pose)
    geometry = ElementTree.SubElement(visual, "geometry")
    match shape.kind, shape.size:
        case ("block", size):
            _add(ElementTree.SubElement(geometry, "box"), "size", text(np.array(size)))
        case ("plate", (x, y)):
            sides = np.array([x, y, THICKNESS * max(x, y)])
            _add(ElementTree.SubElement(geometry, "box"), "size", text(sides))
        case ("rod", (length, radius)):
            _add_sizes(ElementTree.SubElement(geometry, "capsule"), radius, length)
        case ("cylinder", (length, radius)):
            _add_sizes(ElementTree.SubElement(geometry, "cylinder"), radius, length)
        case ("disc" | "ring", (radius,)):
            _add_sizes(ElementTree.SubElement(geometry, "cylinder"), radius, THICKNESS * radius)
        case ("sphere" | "particle", (radius,)):
            _add(ElementTree.SubElement(geometry, "sphere"), "radius", number(radius))
    if shape.color:
        color = np.array([*(int(shape.color[start : start + 2], 16) / 255.0 for start in (1, 3, 5)), 1.0])
        material = ElementTree.SubElement(visual, "material")
        _add(material, "diffuse", text(color))


def _add_sizes(form: Element, radius: float, length: float) -> None:
    _add(form, "radius", number(radius))
    _add(form, "length", number(length))


def _add_joints(document: Document) -> None:
    mechanism, mimics = document.mechanism, mimics_of(document.mechanism)
    joints: list[WrittenJoint] = []
    for joint in mechanism.joints.values():
        if joint.type == "free":
            if joint.inboard != GROUND:
                document.leave_out("free joints between parts, which move freely in the world", [joint.name])
            continue
        chain = written_chain(joint, document.placement, mimics)
        joints += chain.joints
        for name, pose in chain.links.items():
            document.names.add(name)
            zero = np.zeros(3)
            _add_link(_placed_at(document, name, pose), Part(name, 0.0, zero, np.zeros((3, 3))))
    for joint in mechanism.closing.values():
        if (written := written_closing(joint, document.placement)) is None:
            document.leave_out(f"{joint.type} joints that close loops", [joint.name])
        else:
            joints.append(written)
    for one in joints:
        name = unique_name(one.name, document.names)
        document.names.add(name)
        document.joints[one.name] = name
        document.axes |= {axis.coordinate: (name, tag) for tag, axis in zip(AXES, one.axes, strict=False)}
        if name != one.name:
            document.leave_out("joints renamed because a link has their name", [f"{one.name} → {name}"])
    for one in joints:
        _add_joint(document, one)


def _placed_at(document: Document, name: str, pose: Pose) -> Document:
    """The document, with the pose of a link that is no part."""
    poses = {**document.placement.poses, name: pose}
    document.placement = Placement(poses, document.placement.offsets)
    return document


def _add_joint(document: Document, joint: WrittenJoint) -> None:
    element = ElementTree.SubElement(document.model, "joint", name=document.joints[joint.name], type=joint.type)
    _add_pose(element, joint.frame)
    for tag, part in (("parent", joint.parent), ("child", joint.child)):
        _add(element, tag, WORLD if part == GROUND else part)
    for tag, axis in zip(AXES, joint.axes, strict=False):
        _add_axis(document, ElementTree.SubElement(element, tag), axis, joint)
    if joint.type == "screw":
        _add(element, "screw_thread_pitch", number(joint.lead))


def _add_axis(document: Document, element: Element, axis: WrittenAxis, joint: WrittenJoint) -> None:
    _add(element, "xyz", text(axis.direction))
    bounds = {"lower": axis.lower, "upper": axis.upper, "effort": joint.effort, "velocity": joint.velocity}
    limit = ElementTree.SubElement(element, "limit")
    unlimited = {"lower": "-inf", "upper": "inf"}
    for tag, value in bounds.items():
        if value is not None:
            _add(limit, tag, number(value))
        elif tag in unlimited:
            _add(limit, tag, unlimited[tag])
    forces = {"damping": axis.damping, "friction": axis.friction, "spring_stiffness": axis.stiffness}
    if any(forces.values()):
        dynamics = ElementTree.SubElement(element, "dynamics")
        for tag, value in forces.items():
            _add(dynamics, tag, number(value))
        _add(dynamics, "spring_reference", number(axis.rest if axis.stiffness else 0.0))
    if axis.mimic is not None:
        leader, tag = document.axes[axis.mimic.joint]
        mimic = ElementTree.SubElement(element, "mimic", joint=leader, axis=tag)
        for tag, value in (("multiplier", axis.mimic.multiplier), ("offset", axis.mimic.offset), ("reference", 0.0)):
            _add(mimic, tag, number(value))


def _add_frames(document: Document) -> None:
    for part, points in [(GROUND, document.mechanism.ground_points)] + [
        (part.name, part.points) for part in document.mechanism.parts.values()
    ]:
        for point, pose in points.items():
            name = unique_name(f"{part}_{point}", document.names)
            document.names.add(name)
            if part == GROUND:  # beside the model, because frames in it move with it
                frame = ElementTree.SubElement(document.world, "frame", name=name)
            else:
                frame = ElementTree.SubElement(document.model, "frame", name=name, attached_to=part)
            _add_pose(frame, pose)


def _note_rest(document: Document) -> None:
    mechanism = document.mechanism
    joints = mechanism.all_joints.values()
    mimicked = {mimic.constraint for mimic in mimics_of(mechanism).values()}
    constraints = [one.name for one in mechanism.constraints if one.name not in mimicked]
    balls = [joint for joint in joints if joint.kind.quaternion is not None]
    moving = [joint.name for joint in joints if joint.drive]
    started = [
        joint.name
        for joint in mechanism.joints.values()
        if np.any(joint.velocity)
        or (not mechanism.closures and joint.kind.quaternion is None and np.any(joint.position))
    ]
    elements = [*mechanism.two_point_elements, *mechanism.applied]
    laws = [joint.name for joint in joints if joint.spring is not None or joint.damper is not None]
    other_friction = [joint.name for joint in joints if joint.friction and not joint.friction.is_plain]
    for kind, names in (
        ("drives, whose joints move freely", moving),
        ("constraints", constraints),
        ("springs, dampers and forces", [element.name for element in elements]),
        (
            "efforts and potentials",
            [one.name for one in mechanism.efforts] + [one.name for one in mechanism.potentials],
        ),
        ("bushings, and springs of spherical and free joints", [one.name for one in mechanism.bushings]),
        ("dampers of spherical and free joints", [joint.name for joint in balls if np.any(joint.damping)]),
        ("nonlinear springs and dampers of joints", laws),
        ("friction other than Coulomb's", other_friction),
        ("positions and velocities at the start", started),
        ("coordinates, which count from the start", list(document.placement.offsets) if mechanism.closures else []),
        ("actuators", [actuator.name for actuator in mechanism.actuators]),
        ("contacts between shapes", [contact.name for contact in mechanism.contacts]),
        ("sensors", [sensor.name for sensor in mechanism.sensors]),
    ):
        document.leave_out(kind, names)


def _add(parent: Element, tag: str, content: str) -> None:
    ElementTree.SubElement(parent, tag).text = content


def _add_pose(parent: Element, pose: Pose) -> None:
    if not np.any(pose.position) and not np.any(pose.rotation != np.eye(3)):
        return
    w, x, y, z = to_quaternion(pose.rotation)
    values: Array = np.array([*pose.position, x, y, z, w])
    element = ElementTree.SubElement(parent, "pose", rotation_format="quat_xyzw")
    element.text = text(values)
