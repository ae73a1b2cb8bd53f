"""A mechanism as SDF, for Gazebo and other readers: a world with one model. Loops are closed by joints, as here.

A joint of an SDF has a frame on its child, and its coordinate is 0 where the file places the links. Without loops, the
links are placed where all coordinates of the mechanism are 0, so that the coordinates are the same. With loops they are
placed at the start, where the loops are closed, and the coordinates of the mechanism are `offsets` more than those of
the SDF.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import assert_never

import numpy as np

from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import to_quaternion
from mbd_sim.files.mjcf.written.bodies import Written, number, text, written
from mbd_sim.files.sdf.scopes import WORLD
from mbd_sim.files.sdf.written_joints import LinkPoses, SdfJoint, WrittenAxis, written_chain, written_closing
from mbd_sim.files.urdf.motions import mimics_of
from mbd_sim.files.urdf.writer import THICKNESS, control_blocks
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import Face
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import GROUND, Part, Shape
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.touching import shape_at, touching_pairs
from mbd_sim.mechanism.values.names import unique_name

Element = ElementTree.Element

VERSION = "1.11"
LEAST_MASS = 1e-9  # kg, of parts without mass, which SDF does not allow
LEAST_INERTIA = 1e-14  # kg·m², in place of moments of 0
AXES = ("axis", "axis2")
MOMENTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}


@dataclass(eq=False)
class SdfDocument:
    """An SDF as it is written: the world, the model, the names that are taken, and what is left out, by kind."""

    mechanism: Mechanism
    world: Element
    model: Element
    placement: LinkPoses
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
    document = SdfDocument(mechanism, world, model, _placement(mechanism), set(mechanism.parts))
    for part in mechanism.parts.values():
        _add_link(document, part)
    _add_joints(document)
    _add_frames(document)
    _add_contacts(document)
    _note_rest(document)
    _rename(document, root)
    return written(root, document.left_out, declaration=True)


def _rename(document: SdfDocument, root: Element) -> None:
    """Replace the names that SDF reserves: `::` leads into models, `__…__` and `world` (ground) are its own."""
    elements, new = list(root.iter()), {GROUND: WORLD}
    used = {element.attrib["name"]: None for element in elements if "name" in element.attrib}
    for name in [name for name in used if "::" in name or re.fullmatch("__.*__|world", name)]:
        new[name] = unique_name(re.sub("::|^__|__$", "_", name), used)
        used[new[name]] = None
        document.leave_out("names that SDF reserves, as old → new", [f"{name} → {new[name]}"])
    for element in elements:
        for key in ("name", "attached_to", "joint"):
            if element.get(key) in new and element.get(key) != GROUND:  # which no part is named, but perhaps a joint
                element.set(key, new[element.attrib[key]])
        if element.tag in ("parent", "child") and element.text in new:
            element.text = new[element.text]


def _placement(mechanism: Mechanism) -> LinkPoses:
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
    return LinkPoses(kinematics.poses(q), offsets)


def _add_link(document: SdfDocument, part: Part) -> None:
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
        if (form := _form(shape)) is None:
            document.leave_out("shapes that SDF does not have", [f"{part.name}: {shape.kind}"])
        else:
            visual = _add_form(link, "visual", f"{part.name}_shape_{count}", shape.pose, *form)
            if shape.color:
                color = np.array([*(int(shape.color[start : start + 2], 16) / 255.0 for start in (1, 3, 5)), 1.0])
                material = ElementTree.SubElement(visual, "material")
                _add(material, "diffuse", text(color))
    document.leave_out("meshes", [f"{part.name}: {mesh.file}" for mesh in part.meshes])


def _form(shape: Shape) -> tuple[str, dict[str, str]] | None:
    """The element that stands for a shape, with what is in it; None where the written version of SDF has none."""
    size = shape.size
    match shape.kind:
        case "block":
            return "box", {"size": text(np.array(size))}
        case "plate":
            return "box", {"size": text(np.array([*size, THICKNESS * max(size)]))}
        case "rod" | "capsule":
            return "capsule", {"radius": number(size[1]), "length": number(size[0])}
        case "cylinder":
            return "cylinder", {"radius": number(size[1]), "length": number(size[0])}
        case "disc" | "ring":
            return "cylinder", {"radius": number(size[0]), "length": number(THICKNESS * size[0])}
        case "sphere" | "particle":
            return "sphere", {"radius": number(size[0])}
        case "ellipsoid":
            return "ellipsoid", {"radii": text(np.array(size))}
        case "cone" | "hull" | "outline":
            return None
        case _:
            assert_never(shape.kind)


def _add_form(link: Element, tag: str, name: str, pose: Pose, form: str, sizes: Mapping[str, str]) -> Element:
    """Add a visual or a collision element."""
    element = ElementTree.SubElement(link, tag, name=name)
    _add_pose(element, pose)
    drawn = ElementTree.SubElement(ElementTree.SubElement(element, "geometry"), form)
    for key, size in sizes.items():
        _add(drawn, key, size)
    return element


def _add_contacts(document: SdfDocument) -> None:
    """Write shapes that touch planes of ground as collision elements, and each plane as a static model."""
    pairs, others = touching_pairs(document.mechanism)
    document.leave_out("contacts of points, cams and enclosing parts", others)
    links = {element.attrib["name"]: element for element in document.model.findall("link")}
    surfaces: dict[tuple[str, int], ContactLaw] = {}
    planes: dict[Face, tuple[str, ContactLaw]] = {}
    for pair in pairs:
        contact, plane, law = pair.contact, pair.second, pair.contact.law
        shape = shape_at(document.mechanism, pair.first)
        if not isinstance(plane, Face) or plane.at.part != GROUND or not isinstance(law, ContactLaw):
            document.leave_out(
                "contacts of bodies with each other, with planes that move, and compliant ones", [contact.name]
            )
        elif (form := _form(shape)) is None:
            document.leave_out("contacts of shapes that SDF does not have", [contact.name])
        elif (known := surfaces.setdefault(pair.first, law)) is not law and known != law:
            document.leave_out("other coefficients of a shape with several planes", [contact.name])
        else:
            planes.setdefault(plane, (contact.name, law))
            name = unique_name(shape.name or f"{pair.first[0]}_collision_{pair.first[1] + 1}", document.names)
            document.names.add(name)
            _add_surface(_add_form(links[pair.first[0]], "collision", name, shape.pose, *form), law)
        if isinstance(law, ContactLaw) and law.static_friction != law.friction:
            document.leave_out("static friction of contacts", [contact.name])
    for plane, (name, law) in planes.items():
        model = ElementTree.SubElement(document.world, "model", name=unique_name(name, {document.mechanism.name}))
        _add(model, "static", "true")
        link = ElementTree.SubElement(model, "link", name="link")
        sizes = {"normal": text(plane.normal), "size": "100 100"}
        _add_surface(_add_form(link, "collision", "plane", Pose(plane.at.point, np.eye(3)), "plane", sizes), law)


def _add_surface(collision: Element, law: ContactLaw) -> None:
    surface = ElementTree.SubElement(collision, "surface")
    ode = ElementTree.SubElement(ElementTree.SubElement(surface, "friction"), "ode")
    _add(ode, "mu", number(law.friction))
    _add(ode, "mu2", number(law.friction))
    if law.restitution:
        _add(ElementTree.SubElement(surface, "bounce"), "restitution_coefficient", number(law.restitution))


def _add_joints(document: SdfDocument) -> None:
    mechanism, mimics = document.mechanism, mimics_of(document.mechanism)
    joints: list[SdfJoint] = []
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


def _placed_at(document: SdfDocument, name: str, pose: Pose) -> SdfDocument:
    """The document, with the pose of a link that is not a part."""
    poses = {**document.placement.poses, name: pose}
    document.placement = LinkPoses(poses, document.placement.offsets)
    return document


def _add_joint(document: SdfDocument, joint: SdfJoint) -> None:
    element = ElementTree.SubElement(document.model, "joint", name=document.joints[joint.name], type=joint.type)
    _add_pose(element, joint.frame)
    for tag, part in (("parent", joint.parent), ("child", joint.child)):
        _add(element, tag, part)  # ground is renamed with the others
    for tag, axis in zip(AXES, joint.axes, strict=False):
        _add_axis(document, ElementTree.SubElement(element, tag), axis, joint)
    if joint.type == "screw":
        _add(element, "screw_thread_pitch", number(joint.lead))


def _add_axis(document: SdfDocument, element: Element, axis: WrittenAxis, joint: SdfJoint) -> None:
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


def _add_frames(document: SdfDocument) -> None:
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


def _note_rest(document: SdfDocument) -> None:
    mechanism = document.mechanism
    joints = mechanism.all_joints.values()
    mimicked = {mimic.constraint for mimic in mimics_of(mechanism).values()}
    constraints = [one.name for one in mechanism.constraints if one.name not in mimicked]
    balls = [joint for joint in joints if joint.kind.quaternion is not None]
    moving = [joint.name for joint in joints if joint.drive]
    accelerated = [
        drive.name for drive in commanded_drives(mechanism).values() if not math.isinf(drive.acceleration_limit)
    ]
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
        ("limits on the acceleration of drives", accelerated),
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
        ("sensors", [sensor.name for sensor in mechanism.sensors]),
        ("bases on wheels", [base.name for base in mechanism.bases]),
        ("<ros2_control> blocks", [block.attributes.get("name", "") for block in control_blocks(mechanism)]),
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
