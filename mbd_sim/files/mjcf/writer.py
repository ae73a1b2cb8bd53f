"""A mechanism as MJCF, for MuJoCo: the spanning tree as bodies, loops as equalities, springs as tendons.

MuJoCo's equalities are soft: they are written with the largest stiffness that its solver allows for the time step. The
start of the mechanism becomes a keyframe.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_quaternion, to_quaternion
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.files.mjcf.written.bodies import (
    Element,
    MjcfDocument,
    MjcfJoint,
    Written,
    WrittenBody,
    add_element,
    number,
    placed,
    text,
    written,
    written_bodies,
)
from mbd_sim.files.mjcf.written.contacts import add_contacts
from mbd_sim.files.mjcf.written.elements import add_actuators, add_constraints, add_elements, add_loops, attached_parts
from mbd_sim.files.urdf.writer import THICKNESS, control_blocks
from mbd_sim.mechanism.elements.parts import GROUND, Part, Shape
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.names import unique_name


def add_start(document: MjcfDocument) -> None:
    """Write the assembled start as the keyframe `start`, unless the mechanism has no equations of motion."""
    try:
        equations = derive(document.mechanism)
    except MechanismError:
        document.leave_out("start", "there are no equations of motion")
        return
    q, u, layout = equations.start.q, equations.start.u, equations.layout
    positions, speeds = [], []
    for body in document.bodies.values():
        for each in body.joints:
            name = each.joint.name
            if each.joint.drive:
                position, speed = np.zeros(_size(each)), np.zeros(_size(each) - (not each.single))
            else:
                position, speed = _values(each, q[layout.q[name]], u[layout.u[name]])
            positions.append(position)
            speeds.append(speed)
    if positions:
        values = {"qpos": text(np.concatenate(positions)), "qvel": text(np.concatenate(speeds))}
        if commands := _commands(document, equations):
            values["ctrl"] = text(np.array(commands))
        add_element(document.section("keyframe"), "key", {"name": "start", **values})


def _commands(document: MjcfDocument, equations: Equations) -> list[float]:
    """The first command of each actuator that is written, before others arrive."""
    inputs, span = equations.inputs_without_commands, equations.inputs.commands
    first, found = span.start, {}
    for taker in document.mechanism.commanded:
        found[taker.name] = float(inputs[first])
        first += len(taker.channels)
    return [found[element.attrib["name"]] for element in document.root.findall("actuator/*")]


def _size(each: MjcfJoint) -> int:
    return {"ball": 4, "free": 7}.get(each.kind, 1)


def _values(each: MjcfJoint, q: Array, u: Array) -> tuple[Array, Array]:
    """qpos and qvel of a joint of MuJoCo, from the coordinates and speeds of ours."""
    joint = each.joint
    if each.single:
        factor = joint.travel if each.name == f"{joint.name}.travel" else 1.0
        index = each.index
        return factor * q[index : index + 1], factor * u[index : index + 1]
    turn, spin = from_quaternion(q[-4:]), u[-3:]
    if joint.reversed:
        turn, spin = turn.T, -turn @ spin
    axes = each.frame.rotation
    if each.kind == "ball":
        return to_quaternion(axes @ turn @ axes.T), axes @ spin
    inner = each.frame.inverse()  # the body in the second frame of the joint
    base = joint.parent_pose
    pose = base @ Pose(q[:3], turn) @ inner
    velocity = base.rotation @ (u[:3] + turn @ np.cross(spin, inner.position))
    return np.concatenate([pose.position, to_quaternion(pose.rotation)]), np.concatenate([velocity, axes @ spin])


WORLD = "world"  # the name of the body that is ground
LEAST_INERTIA = 1e-14  # kg·m²; MuJoCo refuses moments of 0
CONE_CORNERS = 48  # of the base of a cone, which MJCF does not have
LEAST_MASS = 1e-9  # kg, of bodies that move and have no mass here


def to_mjcf(mechanism: Mechanism) -> Written:
    """The MJCF of a mechanism; a comment in it lists what it does not contain.

    Joints with several coordinates become several joints of one body, with their names in `joint_states`. The start is
    written as the keyframe `start`.
    """
    root = ElementTree.Element("mujoco", model=mechanism.name)
    add_element(root, "compiler", {"angle": "radian", "boundinertia": number(LEAST_INERTIA)})
    add_element(root, "option", {"timestep": number(mechanism.step), "gravity": text(mechanism.gravity)})
    bodies, merged = written_bodies(mechanism, attached_parts(mechanism))
    document = MjcfDocument(mechanism, root, bodies, {GROUND: add_element(root, "worldbody", {})})
    for name in merged:
        document.leave_out("parts without mass, merged with the next part", name)
    geoms = _add_bodies(document)
    add_loops(document)
    add_constraints(document)
    add_elements(document)
    add_actuators(document)
    add_contacts(document, geoms)
    _note_rest(document)
    add_start(document)
    return written(root, document.left_out)


def _add_bodies(document: MjcfDocument) -> dict[tuple[str, int], str]:
    """Write the bodies; the names of the geoms that can touch, by the places of their shapes."""
    geoms: dict[tuple[str, int], str] = {}
    for point, pose in document.mechanism.ground_points.items():
        document.site(GROUND, pose, f"{GROUND}.{point}")
    for name, body in document.bodies.items():
        written_name = unique_name(name, {WORLD, *document.bodies}) if name == WORLD else name
        if written_name != name:
            document.leave_out("names that MJCF reserves, as old → new", f"{name} → {written_name}")
        frame = add_element(document.frames[body.parent], "body", {"name": written_name, **placed(body.pose)})
        document.frames[name] = frame
        for joint in body.joints:
            _add_joint(document, frame, joint)
        _add_inertial(document, frame, body)
        geoms |= _add_geoms(document, frame, body.part)
        for point, pose in body.part.points.items():
            document.site(name, pose, f"{name}.{point}")
        for mesh in body.part.meshes:
            document.leave_out("meshes", f"{name}: {mesh.file}")
    return geoms


def _add_geoms(document: MjcfDocument, frame: Element, part: Part) -> dict[tuple[str, int], str]:
    """Write the shapes that are drawn and those that touch, which are not drawn if they are others."""
    found: dict[tuple[str, int], str] = {}
    for place, shape in enumerate((*part.shapes, *(part.collisions or ()))):
        if shape.kind == "outline":
            document.leave_out("outlines", part.name)
        elif not shape.hole:
            is_drawn = place < len(part.shapes)
            touches = not is_drawn or part.collisions is None
            wanted = shape.name or f"{part.name}_{shape.kind}_{place + 1}"
            name = unique_name(wanted, document.geoms)
            document.geoms.append(name)
            _add_geom(document, frame, shape, name, hidden=not is_drawn)
            if touches:
                found[part.name, place - (0 if is_drawn else len(part.shapes))] = name
    return found


def _add_joint(document: MjcfDocument, frame: Element, written: MjcfJoint) -> None:
    joint = written.joint
    if written.kind == "free":
        attributes: dict[str, str] = {}
    else:
        attributes = {"pos": text(written.frame.position)}
    if written.axis is not None:
        attributes["axis"] = text(written.frame.rotation @ written.axis)
    element = add_element(frame, "joint", {"name": written.name, "type": written.kind, **attributes})
    if joint.drive:
        document.leave_out("drives, whose joints move freely", joint.name)
        return
    if not written.single:
        _add_ball_forces(document, element, written)
        return
    if written.name.endswith(".travel"):
        return  # of a screw: the forces are those of its angle
    _add_forces(document, element, written)


def _add_forces(document: MjcfDocument, element: Element, written: MjcfJoint) -> None:
    joint, index = written.joint, written.index
    if stiffness := float(joint.stiffness[index]):
        element.set("stiffness", number(stiffness))
        element.set("springref", number(joint.rest[index]))
    viscous = joint.friction.viscous if joint.friction else 0.0
    if damping := float(joint.damping[index]) + viscous:
        element.set("damping", number(damping))
    if joint.friction and joint.friction.coulomb:
        element.set("frictionloss", number(joint.friction.coulomb))
    if joint.friction and (joint.friction.static > joint.friction.coulomb or joint.friction.coefficient):
        document.leave_out("static friction, and friction by load", joint.name)
    if (limits := written.limits) is not None:
        acts = limits.stiffness is not None or limits.restitution is not None
        element.set("limited", "true" if acts else "false")
        element.set("range", text(np.array([limits.lower, limits.upper])))
        if acts:
            document.leave_out("stiffness, damping and restitution of stops", written.name)
    if joint.spring is not None or joint.damper is not None:
        document.leave_out("nonlinear springs and dampers of joints", joint.name)
    if joint.effort_limit is not None:
        document.leave_out("effort limits of joints", joint.name)


def _add_ball_forces(document: MjcfDocument, element: Element, written: MjcfJoint) -> None:
    """Springs and dampers of a ball or a free joint, which are the same in all directions in MuJoCo."""
    joint = written.joint
    if joint.name in {bushing.name for bushing in document.mechanism.bushings if bushing.in_joint}:
        document.leave_out("springs of spherical and free joints", joint.name)
    damping = joint.damping[-3:] if written.kind == "ball" else joint.damping
    if np.any(damping) and np.all(damping == damping[0]):
        element.set("damping", number(damping[0]))
    elif np.any(damping):
        document.leave_out("dampers that differ by direction", joint.name)


def _add_inertial(document: MjcfDocument, frame: Element, body: WrittenBody) -> None:
    part = body.part
    mass, inertia = part.mass, part.inertia
    if not mass and body.joints:
        mass = LEAST_MASS
        document.leave_out(f"parts without mass that move, here with {LEAST_MASS:g} kg", part.name)
    elif not mass and not np.any(inertia):
        return
    upper = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    moments = {"fullinertia": text(upper)} if np.any(upper[3:]) else {"diaginertia": text(upper[:3])}
    add_element(frame, "inertial", {"pos": text(part.center), "mass": number(mass), **moments})


def _add_geom(document: MjcfDocument, frame: Element, shape: Shape, name: str, *, hidden: bool) -> None:
    """A shape without mass, which touches only in explicit pairs. A `hidden` one is in a group that is not drawn.

    A cone or a hull is a mesh of its corners, of this name.
    """
    form = _geom(shape)
    if isinstance(form, tuple):
        attributes = {"type": form[0], "size": text(np.array(form[1]))}
    else:
        assets = document.root.find("asset")
        assets = add_element(document.root, "asset", {}) if assets is None else assets
        add_element(assets, "mesh", {"name": name, "vertex": text(form.ravel())})
        attributes = {"type": "mesh", "mesh": name}
    attributes |= {"name": name, "mass": "0", "contype": "0", "conaffinity": "0"} | ({"group": "3"} if hidden else {})
    if shape.color:
        color = [int(shape.color[start : start + 2], 16) / 255.0 for start in (1, 3, 5)]
        attributes["rgba"] = text(np.array([*color, 1.0]))
    add_element(frame, "geom", attributes | placed(shape.pose))


def _geom(shape: Shape) -> tuple[str, list[float]] | Array:
    """Type and half sizes of a shape, or the corners (n, 3) of one that MJCF does not have."""
    size = shape.size
    match shape.kind:
        case "block":
            return "box", [0.5 * side for side in size]
        case "plate":
            return "box", [0.5 * size[0], 0.5 * size[1], 0.5 * THICKNESS * max(size)]
        case "rod" | "capsule":
            return "capsule", [size[1], 0.5 * size[0]]
        case "cylinder":
            return "cylinder", [size[1], 0.5 * size[0]]
        case "disc" | "ring":
            return "cylinder", [size[0], 0.5 * THICKNESS * size[0]]
        case "sphere" | "particle":
            return "sphere", [size[0]]
        case "ellipsoid":
            return "ellipsoid", [*size]
        case "cone":
            angles = np.arange(CONE_CORNERS) * (2.0 * np.pi / CONE_CORNERS)
            heights = np.full(CONE_CORNERS, -0.5 * size[0])
            rim = np.column_stack([size[1] * np.cos(angles), size[1] * np.sin(angles), heights])
            return np.vstack([rim, [0.0, 0.0, 0.5 * size[0]]])
        case "hull":
            assert shape.hull is not None
            return np.array(shape.hull.corners)
        case "outline":
            raise ValueError("MJCF has no outlines")
        case _:
            assert_never(shape.kind)


def _note_rest(document: MjcfDocument) -> None:
    mechanism = document.mechanism
    for kind, names in (
        ("sensors", [sensor.name for sensor in mechanism.sensors]),
        ("bases on wheels", [base.name for base in mechanism.bases]),
        ("<ros2_control> blocks", [block.attributes.get("name", "") for block in control_blocks(mechanism)]),
    ):
        for name in names:
            document.leave_out(kind, name)
