"""Pydantic's errors about a mechanism file as problems, worded in terms of the file."""

from __future__ import annotations

import re
from typing import Any

from pydantic_core import ErrorDetails

from mbd_sim.errors import InputError, Problem, counted, listed, nearest, quoted
from mbd_sim.mechanism.expression import QUOTE_COMMAS, is_cut
from mbd_sim.mechanism.names import LONGEST_NAME, PLAIN_PATTERN
from mbd_sim.mechanism.source import Location, Source
from mbd_sim.mechanism_file.json_schema import PydanticLocation, known_keys, known_types, list_length
from mbd_sim.mechanism_file.key_synonyms import synonym
from mbd_sim.mechanism_file.likely_mistakes import remedy_for_key, remedy_for_lone_key, remedy_for_type
from mbd_sim.mechanism_file.spelling import as_written

# Other words that users may write for a type: the first of the types that is valid at this place.
_SYNONYMS = {
    "hinge": ("revolute",), "pin": ("revolute",), "rotation": ("revolute",), "continuous": ("revolute",),
    "rotary": ("revolute",), "rotational": ("revolute",), "slider": ("prismatic",), "translation": ("prismatic",),
    "slide": ("prismatic",), "linear": ("prismatic", "spring"), "translational": ("prismatic",), "weld": ("fixed",),
    "rigid": ("fixed",), "floating": ("free",), "ball": ("spherical", "sphere"), "socket": ("spherical",),
    "cardan": ("universal",), "hooke": ("universal",), "helical": ("screw",), "lead_screw": ("screw",),
    "bar": ("rod",), "capsule": ("cylinder",), "disk": ("disc",), "wheel": ("disc",), "hoop": ("ring",),
    "box": ("block",), "cuboid": ("block",), "cube": ("block",), "point": ("particle",), "point_mass": ("particle",),
    "mass": ("particle",), "rectangle": ("plate",), "rope": ("cable",), "link": ("distance", "rod"),
    "pulley": ("cable",), "gears": ("gear",), "mimic": ("coupling",), "roll": ("rolling",),
}  # fmt: skip


def problem_of(source: Source, details: ErrorDetails) -> Problem:
    """The problem that one of pydantic's errors describes."""
    loc, kind, context = details["loc"], details["type"], details.get("ctx", {})
    location, value = _in_file(source, loc)
    if isinstance(error := context.get("error"), InputError):
        return source.problem_of(location, error)
    leaf = str(loc[-1]) if loc else ""
    match kind:
        case "extra_forbidden":
            known = known_keys(loc[:-1])
            remedy = value is None and remedy_for_lone_key(leaf, known)
            remedy = remedy or remedy_for_key(location, known) or nearest(leaf, known)
            return source.problem(location, f"unknown key {quoted(leaf)}", remedy)
        case "missing" | "too_long" if isinstance(value, list):
            where = loc[:-1] if kind == "missing" else loc
            message = f"has {counted(len(value), 'value')}, not {list_length(where)}"
            cut = any(isinstance(entry, str) and is_cut(entry) for entry in value)
            return source.problem(location, message, QUOTE_COMMAS if cut else _list_form(where), value)
        case "missing" if value is None:
            return source.problem(location, "has no value", "Give it a value.")
        case "missing":
            return source.problem(location, f"'{leaf}' is missing", _in_place_of(value, leaf))
        case "union_tag_not_found":
            return source.problem(location, "'type' is missing", nearest("", known_types(loc)))
        case "union_tag_invalid":
            return _unknown_type(source, location, loc, value)
        case "literal_error":
            return source.problem(location, "unknown word", f"Write {context['expected']}.".replace("'", ""), value)
    message, remedy = _wording(kind, loc, value)
    if "[key]" in loc or kind == "too_short":
        value = None
    elif value is None:
        message, remedy = "has no value", remedy or "Give it a value."
    return source.problem(location, message or details["msg"], remedy, value)


def _in_place_of(value: Any, key: str) -> str:
    """What to do about a missing key of a mapping: perhaps another word stands in its place."""
    words = [str(word) for word in value] if isinstance(value, dict) else []
    return next((f"Write it in place of '{word}'." for word in words if synonym(word, [key])), "Add it.")


def _unknown_type(source: Source, location: Location, loc: PydanticLocation, value: object) -> Problem:
    where, types = (*location, "type"), known_types(loc)
    tag = value.get("type") if isinstance(value, dict) else None
    if tag is None:
        return source.problem(where, "has no value", nearest("", types))
    remedy = remedy_for_type(location, str(tag)) or nearest(str(tag), types)
    if meant := [word for word in _SYNONYMS.get(str(tag), ()) if word in types]:
        remedy = f"Did you mean '{meant[0]}'? Valid: {listed(types)}."
    return source.problem(where, f"unknown type {quoted(tag)}", remedy)


def _wording(kind: str, loc: PydanticLocation, value: object) -> tuple[str, str]:
    """A message and a remedy for a kind of error; both empty for kinds that cannot occur."""
    match kind:
        case "string_pattern_mismatch" if "color" in loc[-1:]:
            return "not a color", "Write it in quotes, as '#1f77b4'."
        case "string_pattern_mismatch" | "string_too_long":
            text = str(loc[-2] if loc[-1:] == ("[key]",) else value)
            if "{" in text:
                return "not a valid name", "An index in braces needs for: {i: 1..6} in the entry."
            if loc[:1] in (("parameters",), ("tables",)):
                valid = re.sub(r"[^A-Za-z0-9_]+", "_", text).strip("_")
                example = f", for example {valid}" if len(valid) <= 60 and re.match(PLAIN_PATTERN, valid) else ""
                return "not a valid name", f"Use at most 60 letters, digits and underscores, a letter first{example}."
            form = f"Use at most {LONGEST_NAME} characters without line ends, and none of {{ }}."
            return "not a valid name", form
        case "string_type":
            between = "Write the name of a part, or part.point." if "between" in loc[-2:] else "Put it in quotes."
            return "must be text", between
        case "bool_type" | "bool_parsing":
            return "must be true or false", "Write true or false."
        case "tuple_type" | "list_type":
            return "must be a list", _list_form(loc)
        case "model_type" | "model_attributes_type" | "dict_type" if loc[-1:] == ("mapping",):
            return "must be a list or a mapping", _list_form((*loc[:-1], "list"))
        case "model_type" | "model_attributes_type" | "dict_type" if loc[:1] == ("actuators",) and loc[-1] == "command":
            return "must be a mapping of channels to values", "Write for example '{position: 0.5}' or '{effort: 2}'."
        case "model_type" | "model_attributes_type" | "dict_type":
            if isinstance(value, list) and len(loc) == 1:
                return (
                    "must be a mapping of keys to values",
                    "Write each entry with its name: 'rod: {mass: 1}'.",
                )
            keys = known_keys(loc)
            remedy = f"Its keys: {listed(keys)}." if keys else "Write 'name: value'."
            return "must be a mapping of keys to values", remedy
        case "too_short":
            return "needs at least one entry", "Add one below it."
    return "", ""


def _list_form(loc: PydanticLocation) -> str:
    """How to write the list at a location."""
    if loc[-1:] == ("between",):
        return "Write it as [ground, part] or [part.point, part.point]."
    if loc[-1:] == ("table",):
        return "Write it as [[elongation, force], [elongation, force]]."
    if "table" in loc[-2:]:
        return "Write it as [elongation, force]."
    if "inertia" in loc[-2:]:
        return "Write it as [I_xx, I_yy, I_zz] or {xx: …, yy: …, zz: …, xy: …}."
    letters = {2: "x, y", 3: "x, y, z", 4: "w, x, y, z"}.get(list_length(loc))
    return f"Write it as [{letters}]." if letters else "Begin each entry with '- '."


def _in_file(source: Source, loc: PydanticLocation) -> tuple[Location, Any]:
    """A pydantic location without the tags of unions, and the value there."""
    location: Location = ()
    value, entered = source.data, False
    for step in loc:
        if entered and isinstance(value, dict) and step == value.get("type"):
            entered = False  # the tag of a union, which may also be one of the keys
            continue
        if isinstance(value, list) and isinstance(step, int) and step < len(value):
            value, entered = value[step], True
        elif isinstance(value, dict) and (written := as_written(step, value)) in value:
            step, value, entered = written, value[written], True
        else:
            continue  # the tag of a union, or a missing key
        location += (step,)
    return location, value
