"""The file that its author probably meant: misspelled keys and types are mended, so that they hide no mistakes."""

from __future__ import annotations

import copy
import dataclasses
import difflib
from collections.abc import Collection, Sequence
from typing import Any, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from mbd_sim.base.errors import Problem
from mbd_sim.files.checks.json_schema import known_keys, known_types
from mbd_sim.files.checks.problems import CUTOFF, TYPE_SYNONYMS, in_file, problems_of
from mbd_sim.files.schema.fields import validator_of
from mbd_sim.files.schema.file import MechanismFile
from mbd_sim.files.text.parameters import Parameters
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
    return [problem for problem in best[0] if problem.message in in_all]


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
