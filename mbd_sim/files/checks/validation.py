"""Checks the data of a mechanism file against the schema and reports every problem at once, with line and remedy."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.files.builders.mechanism import build_elements, in_order
from mbd_sim.files.checks.problems import problem_of
from mbd_sim.files.schema.actuators import AnyActuatorSpec
from mbd_sim.files.schema.base import validator_of
from mbd_sim.files.schema.constraints import AnyConstraintSpec
from mbd_sim.files.schema.contacts import ContactSpec
from mbd_sim.files.schema.file import GroundSpec, MechanismFile, PartSpec
from mbd_sim.files.schema.forces import AnyForceSpec
from mbd_sim.files.schema.joints import AnyJointSpec
from mbd_sim.files.schema.laws import TableSpec
from mbd_sim.files.schema.sensors import AnySensorSpec
from mbd_sim.files.text.library import SUFFIXES
from mbd_sim.files.text.parameters import Parameters, coordinate_names, resolve_parameters
from mbd_sim.files.text.spelling import synonym
from mbd_sim.mechanism.values.source import Source

REQUIRED = ("mechanism", "parts", "joints", "urdf")
MANY = 1000  # problems beyond which no further ones are searched for


def validate(source: Source) -> tuple[MechanismFile, dict[str, float]]:
    """The file's records and the values of its parameters in SI units.

    :raises MechanismError: with everything that the schema refuses. The parts, joints, forces, constraints,
        contacts and actuators that it accepts are then checked too, so that one run reports all problems (of a file
        with fewer than a thousand).
    """
    _require_mechanism(source)
    parameters = _all_names(source)
    problems = source.problems + parameters.problems
    file = None
    try:
        file = validator_of(MechanismFile).validate_python(source.data, context=parameters)
    except ValidationError as error:
        problems += [problem_of(source, details) for details in error.errors(include_url=False)]
    if len(problems) > MANY:
        raise MechanismError(in_order(problems))
    if problems or file is None:
        raise MechanismError(in_order(problems + _reference_problems(source, parameters)))
    return file, parameters.values


def _require_mechanism(source: Source) -> None:
    """Refuse a file that describes something else.

    :raises MechanismError: with its only problem.
    """
    data, remedy = source.data, "Begin with a line such as 'mechanism: pendulum'."
    if isinstance(data, dict):
        if any(key in data or any(synonym(str(word), [key]) for word in data) for key in REQUIRED):
            return
        message = f"this is not a mechanism file: it has none of {listed([f'{key!r}' for key in REQUIRED])}"
        if any(isinstance(entry, dict) and "ros__parameters" in entry for entry in data.values()):
            remedy = "These are parameters of ROS nodes: start a node with --params-file and this file."
        raise MechanismError([source.problem((), message, f"Its keys are {listed(list(map(str, data)))}. {remedy}")])
    if isinstance(data, str) and data.endswith(SUFFIXES):
        remedy = "This is a path: load_mechanism reads files, parse_mechanism parses text."
    message = "a mechanism file is a mapping with 'mechanism', 'parts' and 'joints'"
    message = f"the file is empty, but {message}" if data is None else message
    raise MechanismError([source.problem((), message, remedy, data)])


def _all_names(source: Source) -> Parameters:
    """The parameters of a file, with the names of tables and coordinates that its expressions can use."""
    parameters = resolve_parameters(source)
    parameters.coordinates = coordinate_names(source.data.get("joints"))
    written = source.data.get("tables")
    valid = _accepted(written, TableSpec, parameters)
    parameters.tables = {name: spec.table for name, spec in valid.items()}
    parameters.unreadable_tables = set(written or ()) - valid.keys() if isinstance(written, dict) else set()
    return parameters


def _reference_problems(source: Source, parameters: Parameters) -> list[Problem]:
    """The problems with the parts, joints, forces and constraints that the schema accepts, in a file that it refuses.

    Of joints and forces that it refuses, the ends are checked.
    """
    keys = ("parts", "joints", "forces", "ground")
    written_parts, written_joints, written_forces, ground = map(source.data.get, keys)
    grounds = _accepted({"ground": {} if ground is None else ground}, GroundSpec, parameters)
    parts = _accepted(written_parts, PartSpec, parameters)
    joints: dict[str, Any] = {}
    forces: dict[str, Any] = {}
    unreadable, refused = [] if grounds else ["ground"], [""]
    if isinstance(written_parts, dict) and isinstance(written_joints, dict):
        unreadable += [name for name in written_parts if name not in parts]
        ends = {name: joint.get("between") for name, joint in written_joints.items() if isinstance(joint, dict)}
        welds = {name: {"type": "fixed", "between": between} for name, between in ends.items()}
        as_written = _accepted(written_joints, AnyJointSpec, parameters)
        joints = _accepted(welds, AnyJointSpec, parameters) | as_written
        refused = [name for name in written_joints if name not in as_written]
        refused += [""] if refused else []
    if isinstance(written_forces, dict):
        ends_only = {name: _ends_only(force) for name, force in written_forces.items() if isinstance(force, dict)}
        for records in (ends_only, written_forces):
            forces |= _accepted(records, AnyForceSpec, parameters)
    constraints = _accepted(source.data.get("constraints"), AnyConstraintSpec, parameters)
    contacts = _accepted(source.data.get("contacts"), ContactSpec, parameters)
    actuators = _accepted(source.data.get("actuators"), AnyActuatorSpec, parameters)
    sensors = _accepted(source.data.get("sensors"), AnySensorSpec, parameters)
    frame = grounds.get("ground") or GroundSpec()
    built = build_elements(
        parts, joints, forces, constraints, contacts, actuators, frame, source, unreadable, refused, sensors=sensors
    )
    return built.problems


def _ends_only(written: dict[str, Any]) -> dict[str, Any]:
    """A valid force element with only the ends of the one in the file."""
    if "between" in written:
        return {"type": "spring", "between": written["between"], "stiffness": 1}
    if "energy" in written:
        return {"type": "potential", "energy": 0}
    if "coordinate" in written:
        return {"type": "effort", "coordinate": written["coordinate"], "effort": 0}
    kind, key = ("couple", "on") if "on" in written else ("force", "at")
    return {"type": kind, key: written.get(key), "vector": [0, 0, 0]}


def _accepted(records: object, kind: Any, parameters: Parameters) -> dict[str, Any]:
    """Those of the records that the schema of a kind accepts."""
    accepted = {}
    for name, record in records.items() if isinstance(records, dict) else ():
        try:
            accepted[name] = validator_of(kind).validate_python(record, context=parameters)
        except ValidationError:
            continue  # reported already
    return accepted
