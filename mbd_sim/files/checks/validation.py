"""Checks the data of a mechanism file against the schema and reports every problem at once, with line and remedy.

Misspelled keys and types are mended first, to those that the author probably meant, so that they hide no mistakes.
"""

from __future__ import annotations

import copy
import dataclasses
import difflib
import math
from collections.abc import Collection, Sequence
from typing import Any, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from mbd_sim.base.errors import MechanismError, Problem, listed
from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.files.builders.mechanism import Refused, build_elements, in_order, problems_of_ranges
from mbd_sim.files.checks.json_schema import known_keys, known_types
from mbd_sim.files.checks.problems import CUTOFF, TYPE_SYNONYMS, in_file, problems_of
from mbd_sim.files.schema.fields import validator_of
from mbd_sim.files.schema.file import GroundSpec, IntegrationSpec, MechanismFile
from mbd_sim.files.schema.laws import TableSpec
from mbd_sim.files.text.library import SUFFIXES
from mbd_sim.files.text.parameters import Parameters, coordinate_names, resolve_parameters
from mbd_sim.files.text.spelling import synonym
from mbd_sim.mechanism.values.source import Location, Source, value_at

SECTIONS = ("parts", "joints", "constraints", "contacts", "forces", "actuators", "bases", "sensors")
ENTRIES = {section: get_args(MechanismFile.model_fields[section].annotation)[1] for section in SECTIONS}


def as_meant(source: Source, errors: Sequence[ErrorDetails]) -> Source:
    """The source with the keys and types that were probably meant; itself if nothing is mended.

    Problems with mended values are shown with the line and the key of the file.
    """
    meant = dataclasses.replace(source, data=copy.deepcopy(source.data), origins=dict(source.origins))
    mended = False
    for details in errors:
        loc = details["loc"]
        location, value = in_file(source, loc)
        match details["type"]:
            case "extra_forbidden":
                word, known = str(loc[-1]), known_keys(loc[:-1])
                key = _similar(word, known) or ("" if location[:-1] else synonym(word, known))
                mended |= _rename(meant, location[:-1], word, key)
            case "union_tag_not_found" if isinstance(value, dict):
                word = _similar("type", [key for key in value if isinstance(key, str)])
                mended |= _rename(meant, location, word, "type")
            case "union_tag_invalid":
                word, types = str(value.get("type")), known_types(loc)
                words = [kind for kind in TYPE_SYNONYMS.get(word, ()) if kind in types]
                if kind := next(iter(words), "") or _similar(word, types):
                    value_at(meant.data, location)["type"] = kind
                    mended = True
    return meant if mended else source


def problems_of_any_type(source: Source, details: ErrorDetails, parameters: Parameters) -> list[Problem]:
    """What is wrong with an entry of an unknown type, whichever of the types that fit best is meant.

    :param details: the error about the type.
    """
    location, _ = in_file(source, details["loc"])
    found = [_problems_as(source, location, kind, parameters) for kind in known_types(details["loc"])]
    best = [problems for problems in found if len(problems) == min(map(len, found))]
    in_all = set.intersection(*({problem.message for problem in problems} for problems in best))
    agreed = [
        dataclasses.replace(problem, remedy=_OF_TYPE)
        if any(_says_otherwise(problem, problems) for problems in best)
        else problem
        for problem in best[0]
    ]
    return [problem for problem in agreed if problem.message in in_all]


_OF_TYPE = "What to write depends on the type."


def _says_otherwise(problem: Problem, problems: Sequence[Problem]) -> bool:
    """Whether the same problem has another remedy among others."""
    return any(other.message == problem.message and other.remedy != problem.remedy for other in problems)


def _problems_as(source: Source, location: Location, kind: str, parameters: Parameters) -> list[Problem]:
    """What the schema refuses in an entry at a location if it has a type."""
    section, name = str(location[0]), location[1]
    data = {**source.data, section: {**source.data[section], name: copy.deepcopy(source.data[section][name])}}
    value_at(data, location)["type"] = kind
    tried = dataclasses.replace(source, data=data)
    try:
        validator_of(ENTRIES[section]).validate_python(data[section][name], context=parameters)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        for details in errors:
            details["loc"] = (section, name, *details["loc"])
        inside = [details for details in errors if in_file(tried, details["loc"])[0][: len(location)] == location]
        return problems_of(tried, inside)
    return []


def _similar(word: str, known: Collection[str]) -> str:
    """The known word of which another one is a misspelling; "" if there is none."""
    return next(iter(difflib.get_close_matches(word[:100], known, n=1, cutoff=CUTOFF)), "")


def _rename(source: Source, location: Location, word: str, key: str) -> bool:
    """Write a key of the mapping at a location in place of a word; False if that is not possible."""
    mapping: dict[Any, Any] = value_at(source.data, location)
    if not key or key in mapping or word not in mapping:
        return False
    entries = [(key if other == word else other, value) for other, value in mapping.items()]
    mapping.clear()
    mapping.update(entries)
    written, here = (*location, word), (*location, key)
    for other in (other for other in [*source.lines, *source.origins] if other[: len(written)] == written):
        source.origins[here + other[len(written) :]] = source.origin(other)
    return True


ROUNDS = 4  # of mending misspelled words, each of which may hide others
REQUIRED = ("mechanism", "parts", "joints", "urdf")
MANY = 1000  # problems beyond which no further ones are searched for


def validate(source: Source) -> tuple[MechanismFile, dict[str, float]]:
    """The file's records and the values of its parameters in SI units.

    :raises MechanismError: with everything that the schema refuses, and, so that one run reports all problems (of a
        file with fewer than a thousand), with what else is wrong if the misspelled words are those that were meant.
    """
    _require_mechanism(source)
    parameters = _all_names(source)
    problems = source.problems + parameters.problems
    file, errors = _read(source, parameters)
    if file is not None and not problems:
        return file, parameters.values
    problems += problems_of(source, errors)
    if len(problems) <= MANY:
        problems += _hidden_problems(source, errors)
    raise MechanismError(in_order(problems))


def _read(source: Source, parameters: Parameters) -> tuple[MechanismFile | None, list[ErrorDetails]]:
    """The records of the whole file, None if the schema refuses some, and its errors."""
    try:
        return validator_of(MechanismFile).validate_python(source.data, context=parameters), []
    except ValidationError as error:
        return None, error.errors(include_url=False)


def _hidden_problems(source: Source, errors: list[ErrorDetails]) -> list[Problem]:
    """The problems that those of the schema hide: in misspelled entries, and of what the builders check."""
    problems: list[Problem] = []
    for _ in range(ROUNDS):
        meant = as_meant(source, errors)
        if meant is source:
            break
        source, parameters = meant, _all_names(meant)
        errors = _read(source, parameters)[1]
        problems += parameters.problems + problems_of(source, errors)
    if not isinstance(source.data.get("parts"), dict):
        return problems  # without any parts, no reference is right
    parameters = _all_names(source)
    for details in errors:
        if details["type"] == "union_tag_invalid":
            problems += problems_of_any_type(source, details, parameters)
    _, of_each = get_args(MechanismFile.model_fields["ranges"].annotation)
    ranges = _accepted(source.data.get("ranges"), of_each, parameters)
    problems += problems_of_ranges(ranges, parameters.values, source)
    return problems + _reference_problems(source, dataclasses.replace(parameters, lenient=True))


def _reference_problems(source: Source, parameters: Parameters) -> list[Problem]:
    """What the builders find in the entries that the schema accepts, and the wrong references of the others."""
    accepted: dict[str, Any] = {}
    refused: dict[tuple[str, str], Any] = {}
    for section, kind in ENTRIES.items():
        written = source.data.get(section)
        entries = written if isinstance(written, dict) else {}
        accepted[section] = _accepted(entries, kind, parameters)
        refused |= {(section, name): entry for name, entry in entries.items() if name not in accepted[section]}
    ground, integrator = (source.data.get(key) or {} for key in ("ground", "integrator"))
    accepted |= _accepted({"ground": ground}, GroundSpec, parameters)
    accepted |= _accepted({"integrator": integrator}, IntegrationSpec, parameters)
    accepted.setdefault("integrator", IntegrationSpec.model_construct(step=math.nan))
    parts = {name: _points(part) for (section, name), part in refused.items() if section == "parts"}
    parts |= {} if "ground" in accepted else {"ground": _points(ground)}
    joints = [name for section, name in refused if section == "joints"]
    known = joints if isinstance(source.data.get("joints"), dict) else None
    return build_elements(MechanismFile.model_construct(**accepted), source, Refused(parts, known, refused)).problems


def _points(written: object) -> dict[str, Pose] | None:
    """The points of a refused part, of which only the names are known; None if not even these are."""
    points = written.get("points") if isinstance(written, dict) else None
    return dict.fromkeys(points, identity_pose()) if isinstance(points, dict) else None


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


def _accepted(records: object, kind: Any, parameters: Parameters) -> dict[str, Any]:
    """Those of the records that the schema of a kind accepts."""
    accepted = {}
    for name, record in records.items() if isinstance(records, dict) else ():
        try:
            accepted[name] = validator_of(kind).validate_python(record, context=parameters)
        except ValidationError:
            continue  # reported already
    return accepted
