"""Where the packages are that `package://` URIs and xacro's `$(find …)` name.

A package is searched for in AMENT_PREFIX_PATH, then in ROS_PACKAGE_PATH, and then among the folders that contain the
file that names it, and beside these. A folder is a package by its own name, or by the name in its `package.xml`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

_NAME = re.compile(r"<name>\s*([\w.-]+)\s*</name>")
_MOST_BESIDE = 200  # folders that are looked into beside one that contains the file
_MOST_LEVELS = 8


def installed_folders(package: str) -> Iterator[Path]:
    """Where the ROS 2 environment would have the shared files of a package."""
    for prefix in _listed("AMENT_PREFIX_PATH"):
        yield prefix / "share" / package


def package_folders(package: str, folder: Path) -> Iterator[Path]:
    """Folders that may be a package, the most likely one first; that of the environment may be missing.

    :param folder: the one of the file that names it.
    """
    if not package:
        return
    yield from installed_folders(package)
    around = (*_listed("ROS_PACKAGE_PATH"), folder, *folder.parents)
    for root in around:
        yield root / package
        if root.name == package:
            yield root
    for root in around[:_MOST_LEVELS]:
        yield from (found for found in _with_manifest(root) if manifest_name(found) == package)


def manifest_name(folder: Path) -> str:
    """The name in the `package.xml` of a folder; empty if there is none."""
    try:
        with (folder / "package.xml").open(encoding="utf-8", errors="replace") as stream:
            found = _NAME.search(stream.read(10_000))
    except OSError:
        return ""
    return found[1] if found else ""


def _with_manifest(root: Path) -> Iterator[Path]:
    """The folder itself, those in it, and in `src`, the folder of a workspace, those in these, with a `package.xml`."""
    beside = _folders_in(root)
    if root.name == "src":
        beside += [inner for path in beside for inner in _folders_in(path)]
    yield from (path for path in (root, *beside) if _is_file(path / "package.xml"))


def _folders_in(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir())[:_MOST_BESIDE]
    except OSError:
        return []


def _listed(variable: str) -> list[Path]:
    return [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, a NUL in it
        return False
