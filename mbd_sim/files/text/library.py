"""Files of mechanisms: those that ship with the package, by name, and how large any may be.

The limits keep a file from exhausting memory or time.
"""

from __future__ import annotations

import functools
import hashlib
import re
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path

from mbd_sim.base.errors import InputError, MechanismError, Problem, nearest, quoted
from mbd_sim.files.text.ros_packages import package_folders

READ_SUFFIXES = (".yaml", ".yml", ".urdf", ".xml", ".mjcf", ".sdf", ".world")
XACRO_SUFFIX = ".xacro"
SUFFIXES = (*READ_SUFFIXES, XACRO_SUFFIX)
CAD_SUFFIXES = (".step", ".stp", ".p21")  # of STEP, which is imported
_ARGUMENT = re.compile(r"(?:^|\s+)([A-Za-z_][\w.-]*):=")

NO_PACKAGE = "Source the workspace that has it, put its folder beside this one, or its parent into ROS_PACKAGE_PATH."
_PACKAGE = Path(__file__).resolve().parents[2]


@functools.cache
def config_directory() -> Path | None:
    """The folder `config/` of a source tree, of an ament install space, or of a pip install."""
    above = [parent / "share" / "mbd_sim" / "config" for parent in _PACKAGE.parents]
    for folder in [_PACKAGE.parent / "config", *above, Path(sys.prefix) / "share" / "mbd_sim" / "config"]:
        if folder.is_dir():
            return folder
    return None


def shipped() -> dict[str, Path]:
    """The shipped mechanisms, by name."""
    folder = config_directory()
    return {path.stem: path for path in sorted(folder.rglob("*.yaml"))} if folder else {}


ArgumentValue = str | float | bool  # of a xacro file


def split_arguments(mechanism: str) -> tuple[str, dict[str, str]]:
    """The file, and the arguments after it: `robot.urdf.xacro name:=left size:=2`, as the program xacro takes them.

    A value extends to the next argument, so that it may contain blanks.
    """
    found = list(_ARGUMENT.finditer(mechanism))
    if not found or not found[0].start():
        return mechanism, {}
    ends = [match.start() for match in found[1:]] + [len(mechanism)]
    return mechanism[: found[0].start()], {
        match[1]: mechanism[match.end() : end].strip() for match, end in zip(found, ends, strict=True)
    }


def argument_texts(given: Mapping[str, object]) -> dict[str, str]:
    """The values of the arguments of a xacro file as texts: words, numbers and truth values, as xacro takes them.

    :raises InputError: a value is none of these.
    """
    found = {}
    for name, value in given.items():
        if not isinstance(value, str | int | float):
            remedy = "Give a word, a number, true or false."
            raise InputError(f"the argument {name} cannot be {quoted(value)}", remedy)
        found[str(name)] = str(value).lower() if isinstance(value, bool) else str(value)
    return found


def find(mechanism: str | Path) -> Path:
    """The file of a mechanism given as a path, as a `package://` URI or as a shipped name.

    :raises MechanismError: it is neither; the remedy lists the shipped names, the most similar one first.
    """
    try:
        if str(mechanism).startswith(PACKAGE_URI):
            return packaged(str(mechanism), Path())
        path = Path(mechanism).expanduser()
        if str(mechanism) and path == Path():  # which has no name, as if none were given
            raise MechanismError([_folder(path)])
        return _found(path)
    except (OSError, ValueError, RuntimeError) as error:  # a name too long, a NUL in it, no such home directory
        why = getattr(error, "strerror", None) or str(error)
        raise MechanismError(
            [
                Problem(
                    f"cannot be searched for: {why}", "Check the path.", key="mechanism", value=quoted(str(mechanism))
                )
            ]
        ) from error


PACKAGE_URI = "package://"


def packaged(uri: str, folder: Path) -> Path:
    """The file of a `package://` URI.

    :param folder: the one of the file that has it.
    :raises MechanismError: there is no such package, or it has no such file.
    """
    package, _, inner = uri.removeprefix(PACKAGE_URI).partition("/")
    folders = [path for path in package_folders(package, folder.absolute()) if path.is_dir()]
    if found := next((path / inner for path in folders if (path / inner).is_file()), None):
        return found
    message = f"{folders[0]} has no file {quoted(inner)}" if folders else f"there is no package {quoted(package)}"
    remedy = "Check the path." if folders else NO_PACKAGE
    raise MechanismError([Problem(message, remedy, key="mechanism", value=quoted(uri))])


def _found(path: Path) -> Path:
    if path.suffix in SUFFIXES or path.parent != Path():
        if path.is_file():
            if path.suffix.lower() in CAD_SUFFIXES:
                raise MechanismError([_cad(path)])
            return path
        if path.is_dir():
            raise MechanismError([_folder(path)])
        raise MechanismError([_missing(path)])
    ships = shipped()
    if path.name in ships:
        return ships[path.name]
    if path.is_file() and path.suffix.lower() in CAD_SUFFIXES:
        raise MechanismError([_cad(path)])
    if path.is_file():
        message = "a file of this name is here, but its ending is not that of a mechanism"
        remedy = f"Rename it, for example to '{path.stem}.yaml'."
        raise MechanismError([Problem(message, remedy, key="mechanism", value=quoted(str(path)))])
    if path.name and path.is_dir():
        raise MechanismError([_folder(path)])
    if path.suffix:  # which names of shipped mechanisms do not have
        raise MechanismError([_missing(path)])
    remedy = nearest(path.name, ships) + " Or give the path of a .yaml, .urdf, .xacro, .xml or .sdf file."
    raise MechanismError(
        [
            Problem(
                message="there is no shipped mechanism of this name",
                remedy=remedy,
                key="mechanism",
                value=quoted(path.name),
            )
        ]
    )


def _cad(path: Path) -> Problem:
    remedy = f"Import it: mbd_sim import {shlex.quote(str(path))} --density steel --lab"
    return Problem("is an assembly of a CAD program", remedy, key="mechanism", value=quoted(str(path)))


def _folder(path: Path) -> Problem:
    return Problem("is a folder", "Give a mechanism file in it.", key="mechanism", value=quoted(str(path)))


def _missing(path: Path) -> Problem:
    """The problem with a path at which there is no regular file."""
    if path.exists():
        message, remedy = "is not a regular file", "Copy what it contains into a file."
    elif path.is_symlink():
        message, remedy = f"is a link to '{path.readlink()}', where there is no file", "Correct the link."
    else:
        beside = path.parent.iterdir() if path.parent.is_dir() else ()
        names = [str(near) for near in beside if near.suffix in SUFFIXES]
        message, remedy = "there is no such file", nearest(str(path), names) or "Check the path."
    return Problem(message, remedy, key="mechanism", value=quoted(str(path)))


MAX_BYTES = 1_000_000
MAX_DEPTH = 40
MAX_VALUES = 60_000


def file_error(file: str, line: int, message: str, remedy: str, key: str = "", value: str = "") -> MechanismError:
    """The error for a file that cannot be read any further."""
    return MechanismError([Problem(message, remedy, key=key, value=value, file=file, line=line)])


def too_deep(file: str, line: int) -> MechanismError:
    """The error for a value that is nested deeper than `MAX_DEPTH`."""
    return file_error(file, line, f"nested deeper than {MAX_DEPTH} levels", "Flatten the file.")


def read_text(path: Path) -> str:
    """The text of a file.

    :raises MechanismError: the file cannot be read, is too large, or is not UTF-8.
    """
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise file_error(
                str(path), 1, f"the file is larger than {MAX_BYTES} bytes", "A mechanism file normally has a few kB."
            )
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise file_error(str(path), line, f"not UTF-8 text: {error.reason}", "Save the file as UTF-8.") from error
    except OSError as error:
        raise file_error(str(path), 0, f"cannot read the file: {error.strerror}", "Check its permissions.") from error
    return text


def digest_of_file(path: Path) -> str:
    """A digest of the content of a file, which is that of its text; empty if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def digest_of(text: str) -> str:
    """A digest of the text of a file, by which it is found to have changed."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
