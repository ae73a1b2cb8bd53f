"""Loads mechanism files, URDF, MJCF and SDF as `Mechanism` records, from a cache on disk if they were read before.

A mechanism is found there by its text and the name of its file, without the schema and its libraries. It is stored with
the digests of the other files that it depends on, such as a URDF that it extends, and is read again if one of these has
changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mbd_sim.base.disk_cache import cached
from mbd_sim.base.errors import MechanismError, Problem, few_suggestions, quoted
from mbd_sim.files.text.library import (
    XACRO_SUFFIX,
    ArgumentValue,
    argument_texts,
    digest_of_file,
    find,
    read_text,
    split_arguments,
)
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.files.text.xml import Base
    from mbd_sim.files.urdf.control import Interface
    from mbd_sim.mechanism.values.source import Source


def load_mechanism(
    mechanism: str | Path,
    base: Base | None = None,
    *,
    floor: bool = False,
    limits: Literal["stops"] | None = None,
    hulls: bool = False,
    xacro: Mapping[str, ArgumentValue] | None = None,
    control: Interface | None = None,
    set: Mapping[str, Any] | None = None,  # as in `Simulation.from_file`
) -> Mechanism:
    """Load a mechanism file, a URDF, an MJCF or an SDF, given by its path, or a shipped mechanism by its name.

    A xacro file is expanded; arguments may also stand after its path: `robot.urdf.xacro name:=left`.

    :param base: whether the root link of a URDF is `fixed` to ground, the default, or `free`; the same for models of an
        SDF that are not attached to the world, and are free by default.
    :param floor: whether it stands on a floor, see `on_floor`.
    :param limits: `stops` makes the limits of joints rigid stops.
    :param hulls: whether meshes of `<collision>` and of geoms touch as their hulls also where the file has no contacts.
    :param xacro: values of the arguments of a xacro file: words, numbers, or True and False.
    :param control: makes the `<ros2_control>` blocks of the robot act: the command interface that a joint serves which
        has several of them.
    :param set: values of the file to replace, by key: `{"l": 0.8, "joints.elbow.position": "30 deg"}`, numbers in SI
        units.
    :raises MechanismError: with every problem of the file, each with its line and a remedy.
    """
    named, arguments = split_arguments(str(mechanism))
    path = find(named)
    arguments |= argument_texts(xacro or {})
    found = parse_mechanism(read_text(path), str(path), base, hulls=hulls or floor, xacro=arguments, control=control)
    return set_up(found, ({"limits": limits} if limits else {}) | dict(set or {}), floor=floor)


def set_up(mechanism: Mechanism, changes: Mapping[str, Any], *, floor: bool) -> Mechanism:
    """The mechanism with other values, see `with_values`, and perhaps on a floor, see `on_floor`.

    :raises MechanismError: a value is not valid, or nothing can stand on a floor.
    """
    if floor:
        from mbd_sim.files.on_floor import on_floor  # computes positions

        return on_floor(mechanism, changes)
    if not changes:
        return mechanism
    from mbd_sim.files.checks.override import with_values

    return with_values(mechanism, changes)


def parse_mechanism(
    text: str,
    file: str = "<text>",
    base: Base | None = None,
    *,
    hulls: bool = False,
    xacro: Mapping[str, ArgumentValue] | None = None,
    control: Interface | None = None,
) -> Mechanism:
    """The mechanism that the text of a mechanism file, a URDF, an MJCF or an SDF describes.

    :param file: its name in errors; the file that `urdf` names is searched for in the same folder.
    :param base: see `load_mechanism`; the same for `hulls`, `xacro` and `control`.
    :raises MechanismError: see `load_mechanism`.
    """
    way = " ".join(word for word in (base, "with hulls" if hulls else "", control and f"control {control}") if word)
    plain, arguments = text, dict[str, str]()
    if xacro or "xacro" in text or file.endswith(XACRO_SUFFIX):
        from mbd_sim.files.text.xacro_files import expanded

        arguments = argument_texts(xacro or {})
        plain = expanded(text, file, arguments)
    mechanism = cached_mechanism(plain, file, way, lambda: _parsed(plain, file, base, hulls, control))
    if plain is not text:
        mechanism.source.xacro = arguments  # the text is found in the cache whichever arguments wrote it
    return mechanism


def _parsed(text: str, file: str, base: Base | None, hulls: bool, control: Interface | None) -> Mechanism:
    with few_suggestions():
        # Imported here because the schema takes most of the time of a start, and is not needed for a file read before.
        from mbd_sim.files.builders.mechanism import build
        from mbd_sim.files.checks.validation import validate

        source = _source(text, file, base, hulls)
        if control or "control" in (source.data if isinstance(source.data, dict) else ()):
            from mbd_sim.files.urdf.control import with_control

            source = with_control(source, control)
        source.base, source.control = base, control
        records, parameters = validate(source)
        return build(records, parameters, source)


def _source(text: str, file: str, base: Base | None, hulls: bool) -> Source:
    """The data of a file in either format, merged with those of the URDF that it names."""
    if "<" in text:  # the readers of URDF are imported only for files that may need them
        from mbd_sim.files.text.xml import is_xml

        if is_xml(text):
            return _with_hulls(_xml_source(text, file, base), hulls)
    from mbd_sim.files.checks.repetition import expanded
    from mbd_sim.files.text.yaml_text import parse_source

    source = expanded(parse_source(text, file))
    if base is not None or (isinstance(source.data, dict) and {"urdf", "base"} & source.data.keys()):
        from mbd_sim.files.urdf.overlay import with_urdf

        source = with_urdf(source, base)
    if "dxf" in text:
        from mbd_sim.files.dxf.source import with_dxf

        source = with_dxf(source)
    if not any(word in text for word in ("mesh", "hull")) and source.text is not None:
        return source
    from mbd_sim.files.text.mesh_solids import with_mesh_solids

    return with_mesh_solids(_with_hulls(source, hulls))


def _with_hulls(source: Source, hulls: bool) -> Source:
    from mbd_sim.files.text.mesh_files import with_mesh_hulls

    return with_mesh_hulls(source, hulls or bool(isinstance(source.data, dict) and source.data.get("contacts")))


def _xml_source(text: str, file: str, base: Base | None) -> Source:
    """The data of a URDF, an MJCF or an SDF, by the root element."""
    from mbd_sim.files.text.xml import parse_xml, root_tag

    tag = root_tag(text)
    if tag in ("mujoco", "mujocoinclude"):
        from mbd_sim.files.mjcf.reader import mjcf_source

        if base is not None:
            parse_xml(text, file)  # which may raise the first of the two errors
            message = "an MJCF says itself how its bodies are attached to the world"
            raise MechanismError([Problem(message, "Leave out the base.", key="base", value=quoted(base), file=file)])
        return mjcf_source(text, file)
    if tag == "sdf":
        from mbd_sim.files.sdf.reader import sdf_source

        return sdf_source(text, file, base)
    from mbd_sim.files.urdf.reader import urdf_source

    return urdf_source(text, file, base)


def cached_mechanism(text: str, file: str, base: str | None, parse: Callable[[], Mechanism]) -> Mechanism:
    """The mechanism that `parse` returns, or an equal one from the cache.

    :param text: all that `parse` reads, unless the file names another one; `file` and `base` as in `parse_mechanism`.
    """
    return cached(parse, "mechanism", text, file, base or "", keep=_is_found_again, fits=_is_unchanged)


def _is_found_again(mechanism: Mechanism) -> bool:
    return mechanism.source.other_files is not None


def _is_unchanged(mechanism: Mechanism) -> bool:
    """Whether the other files that a mechanism depends on are those that were read for it."""
    read = mechanism.source.other_files or {}
    return all(digest_of_file(Path(path)) == digest for path, digest in read.items())
