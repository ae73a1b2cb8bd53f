"""Mechanism files that extend a URDF, for example by loops and springs, which URDF cannot represent.

Entries of the same name are merged key by key; the keys of the file take precedence. If the file changes the type of a
joint, only its ends are kept from the URDF; if it adds a drive, also the axis. If it gives a part shapes with mass,
the mass properties of the URDF are dropped.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from mbd_sim.base.errors import InputError, MechanismError, nearest, quoted
from mbd_sim.files.text.library import PACKAGE_URI, argument_texts, digest_of, packaged, read_text, split_arguments
from mbd_sim.files.text.mesh_files import seen_from
from mbd_sim.files.text.xacro_files import expanded
from mbd_sim.files.text.xml import Base
from mbd_sim.files.urdf.reader import urdf_source
from mbd_sim.mechanism.values.source import Location, Source

BASES = get_args(Base)
SECTIONS = ("parts", "joints", "constraints")
INNER = ("points", "limits", "friction")  # keys that are merged key by key themselves


def with_urdf(source: Source, base: Base | None = None) -> Source:
    """The source merged with the URDF that it names; the source itself if it names none.

    :param base: whether the root link of the URDF is `fixed` or `free`; replaces the file's `base`.
    :raises MechanismError: the URDF cannot be read.
    """
    if not isinstance(source.data, dict):
        return source
    urdf, written = source.data.get("urdf"), source.data.get("base")
    if not isinstance(urdf, str):
        if urdf is None and (written or base):
            remedy = "Give 'urdf' too, or a joint of type free or fixed instead."
            source.problems.append(source.problem(("base",), "'base' needs a URDF, but 'urdf' is missing", remedy))
        if urdf is None and source.data.get("xacro"):
            message = "'xacro' has arguments for the file of 'urdf', which is missing"
            source.problems.append(source.problem(("xacro",), message, "Give 'urdf' too."))
        return source
    if written not in (None, *BASES):
        source.problems.append(source.problem(("base",), "unknown word", "Write fixed or free.", written))
        written = None
    urdf, arguments = split_arguments(urdf)
    arguments |= _arguments(source)
    path = _path(source, urdf)
    read = read_text(path)
    text = expanded(read, str(path), arguments)
    under = urdf_source(text, str(path), base or written)
    for part in under.data["parts"].values():
        hulls = (shape for shape in part.get("collisions", ()) if "file" in shape)
        for mesh in (*part.get("meshes", ()), *hulls):
            mesh["file"] = seen_from(mesh["file"], str(path), Path(source.file).parent)
    merged = overlaid(under, source)
    searched = text is not read or urdf.startswith(("~", PACKAGE_URI))
    merged.other_files = None if searched else {str(path): digest_of(text)}
    merged.comments = (f"From {Path(source.file).name} and {path.name}.", *merged.notes)
    return merged


def _arguments(source: Source) -> dict[str, str]:
    """The arguments of a xacro file: words, numbers and truth values, as xacro takes them."""
    given = source.data.get("xacro")
    if given is None:
        return {}
    if not isinstance(given, dict):
        remedy = "Write for example xacro: {name: left}."
        source.problems.append(source.problem(("xacro",), "must be a mapping of arguments", remedy, given))
        return {}
    found: dict[str, str] = {}
    for name, value in given.items():
        try:
            found |= argument_texts({name: value})
        except InputError as error:
            source.problems.append(
                source.problem(("xacro", name), "is not a value of an argument", error.remedy, value)
            )
    return found


def _path(source: Source, urdf: str) -> Path:
    """The file that `urdf` names.

    :raises MechanismError: there is none.
    """
    folder = Path(source.file).parent
    if urdf.startswith(PACKAGE_URI):
        try:
            return packaged(urdf, folder)
        except MechanismError as error:
            problem = error.problems[0]
            raise MechanismError([source.problem(("urdf",), problem.message, problem.remedy, urdf)]) from None
    path = folder / Path(urdf).expanduser()
    _check_path(source, path)
    return path


def _check_path(source: Source, path: Path) -> None:
    try:
        if path.is_file():
            return
        names = [near.name for near in path.parent.glob("*.urdf*")] if path.parent.is_dir() else []
    except (OSError, ValueError):  # a name too long, a NUL in it
        names = []
    remedy = nearest(path.name, names) or "Give its path from the folder of this file."
    raise MechanismError([source.problem(("urdf",), "there is no such file", remedy, str(path))])


def overlaid(under: Source, over: Source) -> Source:
    """The merged data of two sources; `over` takes precedence over `under`."""
    written = {
        key: value for key, value in over.data.items() if key not in ("urdf", "base", "xacro") and value is not None
    }
    origins = dict(under.origins)
    merged = Source(
        data={**under.data, **written},
        lines=over.lines,
        file=over.file,
        problems=[*over.problems, *under.problems],
        origins=origins,
        notes=under.notes,
        remarks=(*over.remarks, *under.remarks),
        format=under.format,
        repetitions=over.repetitions,
        shaping=over.shaping,
    )
    for section in SECTIONS:
        if isinstance(written.get(section), dict):
            merged.data[section] = _section(merged, section, under.data.get(section, {}), written[section])
    ground = written.get("ground")
    if isinstance(ground, dict) and isinstance(ground.get("points", {}), dict):
        points = {**under.data.get("ground", {}).get("points", {}), **ground.get("points", {})}
        merged.data["ground"] = {**ground, "points": points}
    return merged


def _section(merged: Source, section: str, under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    result = dict(under)
    for name, record in over.items():
        location = (section, name)
        if name not in under:
            if section == "joints" and isinstance(record, dict) and record.get("type") is None:
                message, remedy = f"the URDF has no joint {quoted(name)}, and 'type' is missing", nearest(name, under)
                merged.problems.append(merged.problem(location, message, remedy))
            else:
                result[name] = record
        elif isinstance(record, dict):
            result[name] = _record(merged, location, _remaining_keys(section, under[name], record), record)
        elif record is not None:
            result[name] = record
    return result


def _remaining_keys(section: str, under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """The keys that are kept from a URDF record, given the record of the file."""
    if section == "joints":
        if over.get("type") not in (None, under["type"]):
            return {"between": under["between"]}
        if over.get("drive") is not None:
            return {key: value for key, value in under.items() if key in ("type", "between", "axis")}
    if section == "constraints" and isinstance(terms := over.get("terms"), dict):
        fits = len(terms) == 2 and under.get("follower") in terms
        return under if fits else {key: value for key, value in under.items() if key != "follower"}
    if section == "parts" and (shapes := _shapes(over)):
        massive = any(shape.get("mass") or shape.get("density") for shape in shapes if isinstance(shape, dict))
        replaced = ("shapes", "mass", "center", "inertia", "inertia_check") if massive else ("shapes",)
        return {key: value for key, value in under.items() if key not in replaced}
    return under


def _shapes(part: dict[str, Any]) -> list[Any]:
    found = part.get("shapes")
    return [part["shape"]] if part.get("shape") is not None else found if isinstance(found, list) else []


def _record(merged: Source, location: Location, under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    result = dict(under)
    for key, value in over.items():
        here, below = (*location, key), under.get(key)
        if key in INNER and isinstance(value, dict) and isinstance(below, dict):
            result[key] = {**below, **value}
            continue
        result[key] = value
        for location in [location for location in merged.origins if location[: len(here)] == here]:
            del merged.origins[location]
    return result
