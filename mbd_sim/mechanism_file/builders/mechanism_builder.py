"""From the records of a file to a `Mechanism`: references resolved, masses computed, the spanning tree found."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from mbd_sim.errors import InputError, MechanismError, Problem, listed
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism import mass_properties
from mbd_sim.mechanism.attachments import end_of
from mbd_sim.mechanism.constraints import Constraint
from mbd_sim.mechanism.records import (
    GROUND,
    Joint,
    Mechanism,
    Mesh,
    Part,
)
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism.spanning_tree import spanning_tree
from mbd_sim.mechanism_file.builders import shape_builder
from mbd_sim.mechanism_file.builders.constraint_builder import constraint_records, coupled_joints
from mbd_sim.mechanism_file.builders.force_builder import ForceElements, force_elements
from mbd_sim.mechanism_file.builders.joint_builder import joint_of, parallel
from mbd_sim.mechanism_file.builders.rotation_builder import rotation_matrix
from mbd_sim.mechanism_file.schema import base_schema, file_schema
from mbd_sim.mechanism_file.schema.constraint_schema import AnyConstraintSpec
from mbd_sim.mechanism_file.schema.force_schema import AnyForceSpec
from mbd_sim.mechanism_file.schema.joint_schema import AnyJointSpec


def build(file: file_schema.MechanismFile, parameters: Mapping[str, float], source: Source) -> Mechanism:
    """The mechanism that a file describes.

    :raises MechanismError: with every reference, mass and connection that is wrong.
    """
    assembly = assemble(file.parts, file.joints, file.forces, file.constraints, file.ground, source)
    parts, joints, problems = assembly.parts, assembly.joints, assembly.problems
    if problems:
        raise MechanismError(in_order(problems))
    coupled = set(coupled_joints(assembly.constraints, joints))
    tree = spanning_tree(parts, joints.values(), *_preferences(joints.values(), coupled))
    problems += [problem for name in tree.closing for problem in _uncuttable(source, joints[name], coupled)]
    problems += [_needed(source, joint) for joint in joints.values() if joint.cut and joint.name in tree.outboard]
    problems += _unconnected(source, tree.unreached, joints.values())
    if not problems:
        problems += [_massless(source, joints[name]) for name in tree.massless(parts)]
    if problems:
        raise MechanismError(in_order(problems))
    in_tree = {
        name: dataclasses.replace(joint, reversed=name in tree.reversed_joints)
        for name, joint in joints.items()
        if name in tree.outboard
    }
    return Mechanism(
        name=file.mechanism,
        description=file.description.strip(),
        parts=parts,
        joints=in_tree,
        closing={name: joints[name] for name in tree.closing},
        tree=tree.joints,
        ground_points=assembly.ground_points,
        gravity=np.array(file.gravity),
        method=file.integrator.method,
        step=file.integrator.step,
        parameters=dict(parameters),
        source=source,
        springs=assembly.forces.springs,
        dampers=assembly.forces.dampers,
        applied=assembly.forces.applied,
        constraints=assembly.constraints,
    )


def in_order(problems: Iterable[Problem]) -> list[Problem]:
    """Each problem once, from the top of the file to its bottom."""
    return sorted(dict.fromkeys(problems), key=lambda problem: problem.line)


@dataclasses.dataclass(frozen=True)
class Assembly:
    """Parts with their masses, joints, forces and constraints with their ends, and what is wrong with them."""

    parts: dict[str, Part]
    joints: dict[str, Joint]
    forces: ForceElements
    constraints: tuple[Constraint, ...]
    ground_points: dict[str, Pose]
    problems: list[Problem]


def assemble(
    parts: Mapping[str, file_schema.PartSpec],
    joints: Mapping[str, AnyJointSpec],
    forces: Mapping[str, AnyForceSpec],
    constraints: Mapping[str, AnyConstraintSpec],
    ground: file_schema.GroundSpec,
    source: Source,
    unreadable: Collection[str] = (),
    all_joints: bool = True,
) -> Assembly:
    """Resolve everything that the records of a file refer to.

    :param unreadable: parts, or ground, that the file has but that cannot be read: any point of them may be named.
    :param all_joints: whether `joints` are all that the file has.
    """
    problems: list[Problem] = []
    if GROUND in parts:
        problems.append(source.problem(("parts", GROUND), "'ground' is always there", "Choose another name."))
    built = {name: _part(name, record, source, problems) for name, record in parts.items()}
    ground_points = _poses(ground.points)
    places: dict[str, Mapping[str, Pose] | None] = {name: part.points for name, part in built.items()}
    places |= {GROUND: ground_points} | dict.fromkeys(unreadable)
    joined = {name: _joint(name, record, places, source, problems) for name, record in joints.items()}
    acting = force_elements(forces, places, source, problems)
    known = joined if all_joints else {**joined, "": None}
    restricting = constraint_records(constraints, places, known, source, problems)
    found = {name: joint for name, joint in joined.items() if joint}
    return Assembly(built, found, acting, restricting, ground_points, problems)


def _poses(points: Mapping[str, Any]) -> dict[str, Pose]:
    return {
        name: Pose(np.array(point.at), rotation_matrix(point.rotate))
        if isinstance(point, base_schema.PointSpec)
        else Pose(np.array(point), np.eye(3))
        for name, point in points.items()
    }


def _part(name: str, record: file_schema.PartSpec, source: Source, problems: list[Problem]) -> Part:
    shapes = [record.shape] if record.shape is not None else list(record.shapes or [])
    mass, center, tensor = record.mass, np.zeros(3), np.zeros((3, 3))
    location: Location = ("parts", name)
    if record.inertia is not None or not shapes:
        center = np.array(record.center or (0.0, 0.0, 0.0))
        tensor = _tensor(record.inertia)
        if mass is None:
            remedy = "Add 'mass', or a shape with mass or density."
            problems.append(source.problem(location, "'mass' is missing", remedy))
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
            computed = shape_builder.of_shapes(shapes, mass)
            mass, center, tensor = computed.mass, computed.center, computed.inertia
        except InputError as error:
            problems.append(source.problem_of(location, error))
    given = record.inertia is not None
    if (why := mass_properties.defect(tensor)) is not None and (record.inertia_check or not given):
        remedy = "No rigid body has such an inertia: check its numbers." if given else "Keep the holes in the material."
        where = (*location, "inertia") if given else location
        problems.append(source.problem(where, f"the inertia {why}", remedy))
    if mass == 0.0 and np.any(tensor) and record.inertia_check:
        problems.append(source.problem(location, "has an inertia without mass", "Give the part a mass."))
    return Part(
        name=name,
        mass=mass or 0.0,
        center=center,
        inertia=tensor,
        points=_poses(record.points),
        shapes=tuple(shape_builder.drawn(shape) for shape in shapes),
        meshes=tuple(
            Mesh(mesh.file, Pose(np.array(mesh.at), rotation_matrix(mesh.rotate)), mesh.scale, mesh.color)
            for mesh in record.meshes
        ),
    )


def _tensor(record: file_schema.InertiaSpec | tuple[float, float, float] | None) -> Any:
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
    record: AnyJointSpec,
    places: Mapping[str, Mapping[str, Pose] | None],
    source: Source,
    problems: list[Problem],
) -> Joint | None:
    location: Location = ("joints", name)
    ends: list[tuple[str, Pose]] = []
    for index, text in enumerate(record.between):
        try:
            ends.append(end_of(text, places))
        except InputError as error:
            problems.append(source.problem_of((*location, "between", index), error))
    if len(ends) < 2:
        return None
    (parent, parent_pose), (child, child_pose) = ends
    if parent == child:
        remedy = "Name two different parts."
        problems.append(source.problem((*location, "between"), f"connects '{parent}' with itself", remedy))
        return None
    if record.type == "universal" and (why := parallel(*record.axes)):
        problems.append(source.problem((*location, "axes"), why, "Give two axes across each other."))
        return None
    if record.type == "planar" and record.x_axis and (why := parallel(record.axis, record.x_axis)):
        problems.append(source.problem((*location, "x_axis"), why, "Give a direction across the axis."))
        return None
    return joint_of(name, record, parent, parent_pose, child, child_pose)


def _preferences(joints: Collection[Joint], coupled: Collection[str]) -> tuple[list[str], set[str]]:
    """The joints that belong into the tree, those first that cannot do without a coordinate, and those to cut."""
    kept = [joint for joint in joints if not joint.cut]
    wanted = [joint.name for joint in kept if _needs(joint, coupled)]
    wanted += [joint.name for joint in kept if any(joint.fixed_in_assembly + joint.fixed_speeds)]
    wanted += [joint.name for joint in kept if joint.position.any()]
    return wanted, {joint.name for joint in joints if joint.cut}


def _needs(joint: Joint, coupled: Collection[str]) -> str:
    """What a joint has that refers to its coordinate."""
    has = {
        "a drive": bool(joint.drive),
        "stiffness": bool(joint.stiffness.any()),
        "damping": bool(joint.damping.any()),
        "a spring": joint.spring is not None,
        "a damper": joint.damper is not None,
        "friction": joint.friction is not None,
        "limits": joint.limits is not None,
        "an effort_limit": joint.effort_limit is not None,
        "a coupling": joint.name in coupled,
    }
    return listed([what for what, true in has.items() if true])


def _uncuttable(source: Source, joint: Joint, coupled: Collection[str]) -> Iterator[Problem]:
    where: Location = ("joints", joint.name)
    remedy = "Cut another joint of its loop, which needs no coordinate, with 'cut: true'."
    if what := _needs(joint, coupled):
        yield source.problem(where, f"closes a loop, and so has no coordinate, but has {what}", remedy)
    elif any(joint.fixed_in_assembly + joint.fixed_speeds):
        message = "closes a loop, and so has no coordinate whose start value could be given"
        yield source.problem(where, message, "Give it for the other joints of the loop, or write 'guess: true'.")
    elif joint.type == "free":
        yield source.problem(where, "a free joint restricts nothing: it cannot close a loop", "Remove it.")


def _needed(source: Source, joint: Joint) -> Problem:
    message = "cannot be cut: nothing else holds the parts beyond it, or its loop is cut already"
    return source.problem(("joints", joint.name, "cut"), message, "Remove 'cut', or cut one joint of each loop.")


def _unconnected(source: Source, names: Iterable[str], joints: Iterable[Joint]) -> Iterator[Problem]:
    used: dict[str, list[str]] = {}
    for joint in joints:
        for part in (joint.parent, joint.child):
            used.setdefault(part, []).append(joint.name)
    remedy = "Connect it with a joint; one that flies freely has a joint of type free, between ground and it."
    for name in names:
        by = f"is connected only by {listed(used[name])}, which does not lead to ground" if name in used else ""
        yield source.problem(("parts", name), by or "is in no joint", remedy)


def _massless(source: Source, joint: Joint) -> Problem:
    return source.problem(
        ("joints", joint.name),
        f"nothing that this joint moves has mass: '{joint.outboard}' is a massless chain end",
        "Give the part a mass, or fix it to a part that has one.",
    )
