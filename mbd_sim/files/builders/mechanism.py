"""Builds a `Mechanism` from the records of a file: resolves references, computes masses, finds the spanning tree.

The records of a file that the schema refuses in part are built as well, for the problems of their references.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from mbd_sim.base.errors import InputError, MechanismError, Problem, listed, nearest
from mbd_sim.base.geometry.batch import array
from mbd_sim.files.builders.actuators import actuated_joints, build_actuators, build_bases
from mbd_sim.files.builders.bodies.parts import build_part, point_poses
from mbd_sim.files.builders.constraints import build_constraints, coupled_joints
from mbd_sim.files.builders.contacts import build_contacts
from mbd_sim.files.builders.context import BuildContext, ForceElements, MechanismElements
from mbd_sim.files.builders.forces import build_force_elements
from mbd_sim.files.builders.joints import build_joint, joint_bushing, with_stops
from mbd_sim.files.builders.sensors import build_sensors, measured_joints
from mbd_sim.files.builders.tree import build_tree, unconnected
from mbd_sim.files.schema.file import MechanismFile
from mbd_sim.files.text.parameters import POSITION, VELOCITY
from mbd_sim.files.text.units import factor, is_number, split_unit
from mbd_sim.mechanism.contents import coordinates_acted_on, force_expressions
from mbd_sim.mechanism.elements.forces import ForceElement
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.exact_geometry.snapping import inexact, with_exact_loops
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import PointsByPart, SpanningTree
from mbd_sim.mechanism.values.names import unique_name
from mbd_sim.mechanism.values.source import Location, Source


def build(
    file: MechanismFile, parameters: Mapping[str, float], source: Source, *, mend_loops: bool = True
) -> Mechanism:
    """The mechanism that a file describes.

    :param mend_loops: whether loops that are exact only to the digits of the file are made exact.
    :raises MechanismError: with every invalid reference, mass and connection.
    """
    elements = build_elements(file, source)
    if found := [*elements.problems, *problems_of_ranges(file.ranges, parameters, source)]:
        raise MechanismError(in_order(found))
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
        joints=_joints_of(tree, joints, elements.parts),
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
        ranges=file.ranges,
    )
    if not mend_loops:
        return mechanism
    return with_exact_loops(mechanism, file.tolerance) if file.tolerance else _as_written(mechanism, file)


def problems_of_ranges(
    ranges: Mapping[str, tuple[float, float]], parameters: Mapping[str, float], source: Source
) -> Iterator[Problem]:
    """Ranges of no parameter, of one that follows others, in other units, upside down, or without its value.

    Those of parameters of the file that have no value, because it is wrong, are left out.
    """
    written = source.data.get("parameters")
    unknown = set(written if isinstance(written, dict) else ()) - parameters.keys()
    for name, ends in ranges.items():
        if name in unknown:
            continue
        try:
            _require_range(name, ends, parameters, source)
        except InputError as error:
            yield source.problem(("ranges", name), error.message, error.remedy, source.data["ranges"][name])


def _require_range(name: str, ends: tuple[float, float], parameters: Mapping[str, float], source: Source) -> None:
    """Refuse a range that does not fit its parameter. A value that was changed after reading may be outside.

    :raises InputError: why.
    """
    if name not in parameters:
        raise InputError("there is no such parameter", nearest(name, parameters) or "Define it under 'parameters'.")
    written = source.data["parameters"][name]
    number, unit = split_unit(written) if isinstance(written, str) else ("0", "")
    if not is_number(number):
        raise InputError("the parameter follows from an expression", "Give the ranges of what it depends on.")
    for end in source.data["ranges"][name]:
        if unit and isinstance(end, str) and (other := split_unit(end)[1]):
            factor(other, unit)
    low, high = ends
    if not low < high:
        raise InputError("the first end must be less than the second", "Exchange the ends, or write different ones.")
    changed = {name, f"parameters.{name}"} & source.changes.keys()
    if not changed and not low <= parameters[name] <= high:
        message = f"the parameter's value, {written}, is outside"
        raise InputError(message, "Widen the range, or change the value.")


def _as_written(mechanism: Mechanism, file: MechanismFile) -> Mechanism:
    """The mechanism, with a remark where axes or points of loops are nearly exact only."""
    names = inexact(mechanism, type(file).model_fields["tolerance"].default)
    if not names:
        return mechanism
    text = (
        f"tolerance: 0 keeps {listed([repr(name) for name in names])} as written, though axes or points of loops "
        "differ only in the last digits from exact ones. Such loops can have fewer degrees of freedom, or none. Leave "
        "tolerance out to make them exact."
    )
    source = mechanism.source
    return dataclasses.replace(mechanism, source=dataclasses.replace(source, remarks=(*source.remarks, text)))


def _require_different_coordinates(joints: Mapping[str, Joint], context: BuildContext) -> None:
    """Report joints of which a coordinate, its position or its speed has the name of another one: `a.x` beside `a`."""
    found: dict[str, str] = {}
    for joint in joints.values():
        names = [name + suffix for name in joint.motion_names for suffix in ("", POSITION, VELOCITY)]
        if other := next((found[name] for name in names if name in found), None):
            message = f"a coordinate has the same name as one of '{other}'"
            context.report(("joints", joint.name), message, "Rename one of the two joints.")
        found |= dict.fromkeys(names, joint.name)


def _joints_of(tree: SpanningTree, joints: Mapping[str, Joint], parts: Collection[str]) -> dict[str, Joint]:
    """The joints with coordinates, with their direction in the tree."""
    outboard, bodies = {**tree.outboard, **tree.split}, set(parts)
    found = {}
    for name in (name for name in joints if name in outboard):
        piece = unique_name(f"{outboard[name]}/{name}", bodies) if name in tree.split else ""
        bodies.add(piece)
        found[name] = dataclasses.replace(joints[name], reversed=outboard[name] == joints[name].parent, piece=piece)
    return found


def _named_joints(elements: MechanismElements) -> set[str]:
    """The joints on whose motion a force depends, or along whose coordinates one acts; and free joints with springs."""
    forces = elements.forces
    sprung = {bushing.name for bushing in elements.joint_bushings if elements.joints[bushing.name].type == "free"}
    if forces == ForceElements() and not any(joint.spring for joint in elements.joints.values()):
        return sprung
    names = {
        state.coordinate for one in force_expressions(elements.joints.values(), ()) for state in one.expression.state
    }
    of_all_kinds: chain[ForceElement] = chain.from_iterable(vars(forces).values())
    names |= set[str]().union(*map(coordinates_acted_on, of_all_kinds))
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


@dataclass(frozen=True)
class Refused:
    """What the schema refuses of a file, of which references to parts and joints are checked all the same.

    `parts`, which may be ground, have their points, or None if any are accepted. Any coordinates of the `joints` are
    accepted, and those of any joint if these are None. `entries` are as written, by location.
    """

    parts: PointsByPart
    joints: Collection[str] | None
    entries: Mapping[tuple[str, str], Any]


FRAME_KEYS = ("at", "on", "point", "plane", "line", "frame", "wheel", "cam", "through")
COORDINATE_KEYS = ("joint", "joints", "coordinate", "pinion", "rack", "terms", "slip")


def _check_references(entries: Mapping[tuple[str, str], Any], context: BuildContext) -> None:
    """Report the references of refused entries to parts, points and coordinates that do not exist."""
    for location, entry in entries.items():
        for key, value in entry.items() if isinstance(entry, dict) else ():
            where: Location = (*location, key)
            names = [(where, value)] if isinstance(value, str) else []
            if isinstance(value, list | dict):
                names = [((*where, index), name) for index, name in enumerate(value) if isinstance(name, str)]
            if key == "between" and len(names) == 2 and location[0] != "contacts":
                context.attachments(where, [name for _, name in names])
            for place, name in names:
                if key in FRAME_KEYS and location[0] != "joints" and (isinstance(value, str) or key == "through"):
                    context.frame(place, name)
                elif key in COORDINATE_KEYS:
                    context.require_joint(where if isinstance(value, dict) else place, name)


def build_elements(file: MechanismFile, source: Source, refused: Refused | None = None) -> MechanismElements:
    """Build everything that the records of a file describe; invalid elements are left out and reported.

    :param refused: what the schema does not accept of a file, for which others are built to find their problems.
    """
    problems: list[Problem] = []
    if GROUND in file.parts:
        problems.append(source.problem(("parts", GROUND), "'ground' always exists", "Choose another name."))
    parts = {name: build_part(name, spec, source, problems, file.materials) for name, spec in file.parts.items()}
    ground_points = point_poses(file.ground.points)
    points: PointsByPart = {
        **{name: part.points for name, part in parts.items()},
        GROUND: ground_points,
        **(refused.parts if refused else {}),
    }
    context = BuildContext(points, source, problems, complete=refused is None)
    built = {name: build_joint(name, spec, context) for name, spec in file.joints.items()}
    if file.limits == "stops":
        built = {name: joint and with_stops(joint) for name, joint in built.items()}
    if refused is None or refused.joints is not None:
        context.joints = built | dict.fromkeys(refused.joints or () if refused else ())
    joints = context.valid_joints
    if refused is not None:
        _check_references(refused.entries, context)
    forces = build_force_elements(file.forces, context)
    constraints = build_constraints(file.constraints, context)
    contacts = build_contacts(file.contacts, file.parts, context)
    actuators = build_actuators(file.actuators, context)
    sensors = build_sensors(file.sensors, actuators, file.integrator.step, context)
    _require_different_coordinates(joints, context)
    all_known = refused is None or (refused.joints == [] and not refused.parts)
    if all_known and len(joints) == len(file.joints) and (refused or problems):  # otherwise with the tree
        problems += unconnected(parts, joints, source)
    found = (joint_bushing(joint, file.joints[name]) for name, joint in joints.items())
    return MechanismElements(
        parts=parts,
        joints=joints,
        forces=forces,
        constraints=constraints,
        contacts=contacts,
        actuators=actuators,
        sensors=sensors,
        bases=build_bases(file.bases, actuators, context),
        joint_bushings=tuple(bushing for bushing in found if bushing),
        ground_points=ground_points,
        problems=context.problems,
    )
