"""Builds a `Mechanism` from the records of a file: resolves references, computes masses, finds the spanning tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbd_sim.errors import MechanismError, Problem
from mbd_sim.exact_geometry.snapping import with_exact_loops
from mbd_sim.geometry.batch import array
from mbd_sim.mechanism.attachments import PointsByPart
from mbd_sim.mechanism.records import GROUND, Joint, Mechanism
from mbd_sim.mechanism.source import Source
from mbd_sim.mechanism.spanning_tree import SpanningTree
from mbd_sim.mechanism_file.builders.build_context import BuildContext
from mbd_sim.mechanism_file.builders.elements import ForceElements, MechanismElements
from mbd_sim.mechanism_file.builders.joint_builder import build_joint, joint_bushing
from mbd_sim.mechanism_file.builders.optional_sections import (
    actuated_joints,
    build_actuators,
    build_bases,
    build_constraints,
    build_contacts,
    build_force_elements,
    build_sensors,
    coupled_joints,
    measured_joints,
)
from mbd_sim.mechanism_file.builders.part_builder import build_part, point_poses
from mbd_sim.mechanism_file.builders.tree_builder import build_tree
from mbd_sim.mechanism_file.coordinate_names import POSITION, VELOCITY

if TYPE_CHECKING:
    from mbd_sim.mechanism.force_elements import ForceElement
    from mbd_sim.mechanism_file.schema.actuator_schema import AnyActuatorSpec
    from mbd_sim.mechanism_file.schema.constraint_schema import AnyConstraintSpec
    from mbd_sim.mechanism_file.schema.contact_schema import ContactSpec
    from mbd_sim.mechanism_file.schema.file_schema import GroundSpec, MechanismFile, PartSpec
    from mbd_sim.mechanism_file.schema.force_schema import AnyForceSpec
    from mbd_sim.mechanism_file.schema.joint_schema import AnyJointSpec
    from mbd_sim.mechanism_file.schema.sensor_schema import AnySensorSpec
    from mbd_sim.mechanism_file.schema.wheeled_base_schema import AnyBaseSpec


def build(file: MechanismFile, parameters: Mapping[str, float], source: Source) -> Mechanism:
    """The mechanism that a file describes.

    :raises MechanismError: with every invalid reference, mass and connection.
    """
    elements = build_elements(
        file.parts,
        file.joints,
        file.forces,
        file.constraints,
        file.contacts,
        file.actuators,
        file.ground,
        source,
        sensors=file.sensors,
        bases=file.bases,
        step=file.integrator.step,
    )
    if elements.problems:
        raise MechanismError(in_order(elements.problems))
    joints = elements.joints
    coupled = {*coupled_joints(elements.constraints, joints), *actuated_joints(elements.actuators, joints)}
    massive = {end.part for spring in elements.forces.springs if spring.mass for end in (spring.first, spring.second)}
    measured = measured_joints(elements.sensors, joints)
    tree, problems = build_tree(elements.parts, joints, coupled, _named_joints(elements), measured, massive, source)
    if problems:
        raise MechanismError(in_order(problems))
    mechanism = Mechanism(
        name=file.mechanism,
        description=file.description.strip(),
        parts=elements.parts,
        joints=_joints_of(tree, joints),
        closing={name: joints[name] for name in tree.closing if name not in tree.split},
        tree=(*tree.joints, *tree.split),
        ground_points=elements.ground_points,
        gravity=array(file.gravity),
        method=file.integrator.method,
        step=file.integrator.step,
        rest_speed=file.integrator.rest_speed,
        parameters=dict(parameters),
        source=source,
        springs=elements.forces.springs,
        dampers=elements.forces.dampers,
        applied=elements.forces.applied,
        efforts=elements.forces.efforts,
        potentials=elements.forces.potentials,
        bushings=elements.forces.bushings + elements.joint_bushings,
        constraints=elements.constraints,
        contacts=elements.contacts,
        actuators=elements.actuators,
        sensors=elements.sensors,
        bases=elements.bases,
        sensor_seed=round(file.sensor_seed),
    )
    return with_exact_loops(mechanism, file.tolerance)


def _require_different_coordinates(joints: Mapping[str, Joint], context: BuildContext) -> None:
    """Report joints of which a coordinate, its position or its speed has the name of another one: `a.x` beside `a`."""
    found: dict[str, str] = {}
    for joint in joints.values():
        names = [name + suffix for name in joint.motion_names for suffix in ("", POSITION, VELOCITY)]
        if other := next((found[name] for name in names if name in found), None):
            message = f"a coordinate has the same name as one of '{other}'"
            context.report(("joints", joint.name), message, "Rename one of the two joints.")
        found |= dict.fromkeys(names, joint.name)


def _joints_of(tree: SpanningTree, joints: Mapping[str, Joint]) -> dict[str, Joint]:
    """The joints with coordinates, with their direction in the tree."""
    outboard = {**tree.outboard, **tree.split}
    return {
        name: dataclasses.replace(joint, reversed=outboard[name] == joint.parent, splits=name in tree.split)
        for name, joint in joints.items()
        if name in outboard
    }


def _named_joints(elements: MechanismElements) -> set[str]:
    """The joints on whose motion a force depends, or along whose coordinates one acts; and free joints with springs."""
    forces = elements.forces
    sprung = {bushing.name for bushing in elements.joint_bushings if elements.joints[bushing.name].type == "free"}
    if forces == ForceElements() and not any(joint.spring for joint in elements.joints.values()):
        return sprung
    from mbd_sim.mechanism.force_expressions import force_expressions

    with_expressions: tuple[ForceElement, ...] = (*forces.springs, *forces.applied, *forces.efforts, *forces.potentials)
    found = force_expressions(elements.joints.values(), with_expressions)
    names = {state.coordinate for one in found for state in one.expression.state}
    names |= {effort.coordinate for effort in forces.efforts}
    return {joint.name for joint in elements.joints.values() if names & set(joint.motion_names)} | sprung


def in_order(problems: Iterable[Problem]) -> list[Problem]:
    """Each problem once, from the top of the file to its bottom; the same one of several repetitions as one."""
    groups: dict[Problem, list[Problem]] = {}
    for problem in dict.fromkeys(problems):
        template = dataclasses.replace(problem, key="", repetition="") if problem.repetition else problem
        groups.setdefault(template, []).append(problem)
    return sorted((_merged(group) for group in groups.values()), key=lambda problem: problem.line)


def _merged(group: Sequence[Problem]) -> Problem:
    first = group[0]
    if len(group) == 1:
        return first
    return dataclasses.replace(first, repetition=f"{first.repetition}, and {len(group) - 1} more")


def build_elements(
    parts: Mapping[str, PartSpec],
    joints: Mapping[str, AnyJointSpec],
    forces: Mapping[str, AnyForceSpec],
    constraints: Mapping[str, AnyConstraintSpec],
    contacts: Mapping[str, ContactSpec],
    actuators: Mapping[str, AnyActuatorSpec],
    ground: GroundSpec,
    source: Source,
    unreadable: Collection[str] = (),
    refused_joints: Collection[str] = (),
    sensors: Mapping[str, AnySensorSpec] = MappingProxyType({}),
    bases: Mapping[str, AnyBaseSpec] = MappingProxyType({}),
    step: float | None = None,
) -> MechanismElements:
    """Build everything that the records of a file describe; invalid elements are left out and reported.

    :param unreadable: parts, or ground, that the schema refused; references to any point of them are accepted.
    :param refused_joints: joints that the schema refused, and "" for those without a name; references to their
        coordinates are accepted.
    :param step: in s, of which the periods of sensors are multiples; None: it is unknown.
    """
    problems: list[Problem] = []
    if GROUND in parts:
        problems.append(source.problem(("parts", GROUND), "'ground' always exists", "Choose another name."))
    built_parts = {name: build_part(name, spec, source, problems) for name, spec in parts.items()}
    ground_points = point_poses(ground.points)
    points: PointsByPart = {
        **{name: part.points for name, part in built_parts.items()},
        GROUND: ground_points,
        **dict.fromkeys(unreadable),
    }
    context = BuildContext(points, source, problems)
    built_joints = {name: build_joint(name, spec, context) for name, spec in joints.items()}
    known_joints = {**built_joints, **dict.fromkeys(refused_joints)}
    built_forces = build_force_elements(forces, known_joints, context)
    built_constraints = build_constraints(constraints, known_joints, context)
    built_contacts = build_contacts(contacts, parts, context)
    built_actuators = build_actuators(actuators, known_joints, context)
    built_sensors = build_sensors(sensors, known_joints, built_actuators, step, context)
    valid_joints = {name: joint for name, joint in built_joints.items() if joint}
    _require_different_coordinates(valid_joints, context)
    found = (joint_bushing(joint, joints[name]) for name, joint in valid_joints.items())
    bushings = tuple(bushing for bushing in found if bushing)
    built_bases = () if problems else build_bases(bases, valid_joints, built_actuators, context)
    return MechanismElements(
        parts=built_parts,
        joints=valid_joints,
        forces=built_forces,
        constraints=built_constraints,
        contacts=built_contacts,
        actuators=built_actuators,
        sensors=built_sensors,
        bases=built_bases,
        joint_bushings=bushings,
        ground_points=ground_points,
        problems=context.problems,
    )
