"""From the records of a file to a `Mechanism`: references resolved, masses computed, the spanning tree found."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from mbd_sim.errors import MechanismError, Problem, listed, nearest
from mbd_sim.mechanism import inertia, schema
from mbd_sim.mechanism import rotation as rot
from mbd_sim.mechanism.model import GROUND, Joint, Limits, Mechanism, Part, Pose, identity_pose
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism.tree import spanning_tree


def build(file: schema.MechanismFile, parameters: Mapping[str, float], source: Source) -> Mechanism:
    """The mechanism that a file describes.

    :raises MechanismError: with every reference, mass and connection that is wrong.
    """
    problems: list[Problem] = []
    if GROUND in file.parts:
        problems.append(source.problem(("parts", GROUND), "'ground' is always there", "Choose another name."))
    parts = {name: _part(name, record, source, problems) for name, record in file.parts.items()}
    ground_points = _poses(file.ground.points)
    places = {name: part.points for name, part in parts.items()} | {GROUND: ground_points}
    joints = {
        name: joint
        for name, record in file.joints.items()
        if (joint := _joint(name, record, places, source, problems)) is not None
    }
    if problems:
        raise MechanismError(problems)
    tree = spanning_tree(parts, joints.values())
    problems += [_loop(source, name) for name in tree.closing]
    problems += [_unconnected(source, name, joints.values()) for name in tree.unreached]
    if not problems:
        problems += [_massless(source, joints[name]) for name in tree.massless(parts)]
    if problems:
        raise MechanismError(sorted(problems, key=lambda problem: problem.line))
    joints = {name: dataclasses.replace(joint, reversed=name in tree.reversed_joints) for name, joint in joints.items()}
    return Mechanism(
        name=file.mechanism,
        description=file.description.strip(),
        parts=parts,
        joints=joints,
        tree=tree.joints,
        ground_points=ground_points,
        gravity=np.array(file.gravity),
        method=file.integrator.method,
        step=file.integrator.step,
        parameters=dict(parameters),
        source=source,
    )


def _poses(points: Mapping[str, Any]) -> dict[str, Pose]:
    return {
        name: Pose(np.array(point.at), rot.of_record(point.rotate))
        if isinstance(point, schema.Point)
        else Pose(np.array(point), np.eye(3))
        for name, point in points.items()
    }


def _part(name: str, record: schema.Part, source: Source, problems: list[Problem]) -> Part:
    shapes = [record.shape] if record.shape is not None else list(record.shapes or [])
    mass, center, tensor = record.mass, np.zeros(3), np.zeros((3, 3))
    location: Location = ("parts", name)
    if record.inertia is not None or not shapes:
        center = np.array(record.center or (0.0, 0.0, 0.0))
        tensor = _tensor(record.inertia)
        if mass is None:
            problems.append(
                source.problem(location, "'mass' is missing", "Add 'mass', or a shape with mass or density.")
            )
        for index, shape in enumerate(shapes):
            if shape.mass is not None or getattr(shape, "density", None) is not None:
                where = (*location, "shape") if record.shape else (*location, "shapes", index)
                remedy = "Remove the shape's mass: beside a given inertia, shapes are only drawn."
                problems.append(source.problem(where, "gives a mass although the part gives its inertia", remedy))
    else:
        if record.center is not None:
            remedy = "Remove 'center', or give 'inertia' as well."
            problems.append(source.problem((*location, "center"), "is computed from the shapes", remedy))
        try:
            computed = inertia.of_shapes(shapes, mass)
            mass, center, tensor = computed.mass, computed.center, computed.inertia
        except ValueError as error:
            problems.append(source.problem(location, str(error)))
    if (why := inertia.defect(tensor)) is not None:
        where = (*location, "inertia") if record.inertia is not None else location
        problems.append(source.problem(where, f"the inertia {why}", "No rigid body has such an inertia."))
    if not mass and np.any(tensor):
        problems.append(source.problem(location, "has an inertia without mass", "Give the part a mass."))
    return Part(
        name=name,
        mass=mass or 0.0,
        center=center,
        inertia=tensor,
        points=_poses(record.points),
        shapes=tuple(inertia.drawn(shape) for shape in shapes),
    )


def _tensor(record: schema.Inertia | tuple[float, float, float] | None) -> Any:
    if record is None:
        return np.zeros((3, 3))
    if isinstance(record, tuple):
        return np.diag(record)
    return np.array(
        [
            [record.xx, record.xy, record.xz],
            [record.xy, record.yy, record.yz],
            [record.xz, record.yz, record.zz],
        ]
    )


def _joint(
    name: str,
    record: schema.AnyJoint,
    places: Mapping[str, Mapping[str, Pose]],
    source: Source,
    problems: list[Problem],
) -> Joint | None:
    location: Location = ("joints", name)
    ends: list[tuple[str, Pose]] = []
    for index, text in enumerate(record.between):
        try:
            ends.append(_end(text, places))
        except LookupError as error:
            message, remedy = error.args
            problems.append(source.problem((*location, "between", index), message, remedy))
    if len(ends) < 2:
        return None
    (parent, parent_pose), (child, child_pose) = ends
    if parent == child:
        problems.append(source.problem((*location, "between"), f"connects '{parent}' with itself", "Name two parts."))
        return None
    fields: dict[str, Any] = {"axis": np.zeros(3), "position": np.zeros(0), "velocity": np.zeros(0)}
    match record:
        case schema.RevoluteJoint() | schema.PrismaticJoint():
            limits = record.limits
            fields |= {
                "axis": rot.unit(record.axis),
                "position": np.array([record.position]),
                "velocity": np.array([record.velocity]),
                "stiffness": record.stiffness,
                "rest": record.rest,
                "damping": record.damping,
                "limits": Limits(limits.lower, limits.upper, limits.stiffness) if limits else None,
                "effort_limit": record.effort_limit,
            }
        case schema.FreeJoint():
            quaternion = rot.to_quaternion(rot.of_record(record.orientation))
            fields["position"] = np.concatenate([np.array(record.position), quaternion])
            fields["velocity"] = np.array([*record.velocity, *record.angular_velocity])
    return Joint(
        name=name,
        type=record.type,
        parent=parent,
        child=child,
        parent_pose=parent_pose,
        child_pose=child_pose,
        **fields,
    )


def _end(text: str, places: Mapping[str, Mapping[str, Pose]]) -> tuple[str, Pose]:
    part, dot, point = text.partition(".")
    if part not in places:
        raise LookupError(f"there is no part '{part}'", nearest(part, places))
    if not dot:
        return part, identity_pose()
    if point not in places[part]:
        known = nearest(point, places[part]) or f"'{part}' has no points: add one under its 'points'."
        raise LookupError(f"'{part}' has no point '{point}'", known)
    return part, places[part][point]


def _loop(source: Source, name: str) -> Problem:
    return source.problem(
        ("joints", name),
        "this joint closes a loop, and this version runs open chains only",
        "Remove it, or one of the joints of its loop.",
    )


def _unconnected(source: Source, name: str, joints: Any) -> Problem:
    used = [joint.name for joint in joints if name in (joint.parent, joint.child)]
    where = f"is connected only by {listed(used)}, which does not lead to ground" if used else "is in no joint"
    return source.problem(("parts", name), where, "Connect it; a part that flies freely has a joint of type free.")


def _massless(source: Source, joint: Joint) -> Problem:
    return source.problem(
        ("joints", joint.name),
        f"nothing that this joint moves has mass: '{joint.outboard}' is a massless chain end",
        "Give the part a mass or fix it to one that has.",
    )
