"""Builds a `Mechanism` from the records of a file: resolves references, computes masses, finds the spanning tree.

Many files do not have all sections: the builder of such a section is imported only if the section is not empty.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbd_sim.base.errors import MechanismError, Problem
from mbd_sim.base.geometry.batch import array
from mbd_sim.files.builders.context import BuildContext, ForceElements, MechanismElements
from mbd_sim.files.builders.joints import build_joint, joint_bushing
from mbd_sim.files.builders.parts import build_part, point_poses
from mbd_sim.files.builders.tree import build_tree
from mbd_sim.files.text.parameters import POSITION, VELOCITY
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.exact_geometry.snapping import with_exact_loops
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import PointsByPart, SpanningTree
from mbd_sim.mechanism.values.source import Source

if TYPE_CHECKING:
    from mbd_sim.files.schema.actuators import AnyActuatorSpec, AnyBaseSpec
    from mbd_sim.files.schema.constraints import AnyConstraintSpec
    from mbd_sim.files.schema.contacts import ContactSpec
    from mbd_sim.files.schema.file import GroundSpec, MechanismFile, PartSpec
    from mbd_sim.files.schema.forces import AnyForceSpec
    from mbd_sim.files.schema.joints import AnyJointSpec
    from mbd_sim.files.schema.sensors import AnySensorSpec
    from mbd_sim.mechanism.elements.actuators import Actuator, Base
    from mbd_sim.mechanism.elements.constraints import Constraint
    from mbd_sim.mechanism.elements.contacts import Contact
    from mbd_sim.mechanism.elements.forces import ForceElement
    from mbd_sim.mechanism.elements.sensors import AnySensor


def build_force_elements(
    specs: Mapping[str, AnyForceSpec], joints: Mapping[str, Joint | None], context: BuildContext
) -> ForceElements:
    """As in `mbd_sim.files.builders.forces`, which is imported only where a file has them."""
    if not specs:
        return ForceElements()
    from mbd_sim.files.builders import forces

    return forces.build_force_elements(specs, joints, context)


def build_constraints(
    specs: Mapping[str, AnyConstraintSpec], joints: Mapping[str, Joint | None], context: BuildContext
) -> tuple[Constraint, ...]:
    """As in `mbd_sim.files.builders.constraints`, which is imported only where a file has them."""
    if not specs:
        return ()
    from mbd_sim.files.builders import constraints as constraint_builder

    return constraint_builder.build_constraints(specs, joints, context)


def coupled_joints(constraints: Sequence[Constraint], joints: Mapping[str, Joint]) -> list[str]:
    """As in `mbd_sim.files.builders.constraints`, which is imported only where a file has them."""
    if not constraints:
        return []
    from mbd_sim.files.builders import constraints as constraint_builder

    return constraint_builder.coupled_joints(constraints, joints)


def build_contacts(
    specs: Mapping[str, ContactSpec], parts: Mapping[str, PartSpec], context: BuildContext
) -> tuple[Contact, ...]:
    """As in `mbd_sim.files.builders.contacts`, which is imported only where a file has them."""
    if not specs:
        return ()
    from mbd_sim.files.builders import contacts

    return contacts.build_contacts(specs, parts, context)


def build_actuators(
    specs: Mapping[str, AnyActuatorSpec], joints: Mapping[str, Joint | None], context: BuildContext
) -> tuple[Actuator, ...]:
    """As in `mbd_sim.files.builders.actuators`, which is imported only where a file has them."""
    if not specs:
        return ()
    from mbd_sim.files.builders import actuators as actuator_builder

    return actuator_builder.build_actuators(specs, joints, context)


def actuated_joints(actuators: tuple[Actuator, ...], joints: Mapping[str, Joint]) -> list[str]:
    """As in `mbd_sim.files.builders.actuators`, which is imported only where a file has them."""
    if not actuators:
        return []
    from mbd_sim.files.builders import actuators as actuator_builder

    return actuator_builder.actuated_joints(actuators, joints)


def build_sensors(
    specs: Mapping[str, AnySensorSpec],
    joints: Mapping[str, Joint | None],
    actuators: Sequence[Actuator],
    step: float | None,
    context: BuildContext,
) -> tuple[AnySensor, ...]:
    """As in `mbd_sim.files.builders.sensors`, which is imported only where a file has them."""
    if not specs:
        return ()
    from mbd_sim.files.builders import sensors as sensor_builder

    return sensor_builder.build_sensors(specs, joints, actuators, step, context)


def measured_joints(sensors: Sequence[AnySensor], joints: Mapping[str, Joint]) -> set[str]:
    """As in `mbd_sim.files.builders.sensors`, which is imported only where a file has them."""
    if not sensors:
        return set()
    from mbd_sim.files.builders import sensors as sensor_builder

    return sensor_builder.measured_joints(sensors, joints)


def build_bases(
    specs: Mapping[str, AnyBaseSpec], joints: Mapping[str, Joint], actuators: Sequence[Actuator], context: BuildContext
) -> tuple[Base, ...]:
    """As in `mbd_sim.files.builders.actuators`, which is imported only where a file has them."""
    if not specs:
        return ()
    from mbd_sim.files.builders import actuators as actuator_builder

    return actuator_builder.build_bases(specs, joints, actuators, context)


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

    of_all_kinds: chain[ForceElement] = chain.from_iterable(vars(forces).values())
    found = force_expressions(elements.joints.values(), of_all_kinds)
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
