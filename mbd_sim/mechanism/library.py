"""The mechanisms that ship with the package, found by name."""

from __future__ import annotations

import functools
import sys
from pathlib import Path

from mbd_sim.errors import MechanismError, Problem, nearest

_PACKAGE = Path(__file__).resolve().parent.parent


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


def find(mechanism: str | Path) -> Path:
    """The file of a mechanism given as a path or as a shipped name.

    :raises MechanismError: neither; the remedy lists what ships, the nearest name first.
    """
    path = Path(mechanism).expanduser()
    if path.suffix in (".yaml", ".yml") or path.parent != Path():
        if path.is_file():
            return path
        names = [str(near) for near in path.parent.glob("*.y*ml")] if path.parent.is_dir() else []
        remedy = nearest(str(path), names) or "Check the path."
        raise MechanismError(
            [Problem(message="there is no such file", remedy=remedy, key="mechanism", value=str(path))]
        )
    ships = shipped()
    if path.name in ships:
        return ships[path.name]
    remedy = nearest(path.name, ships) + " Or give the path of a .yaml file."
    raise MechanismError(
        [Problem(message="no mechanism of this name ships", remedy=remedy, key="mechanism", value=repr(str(mechanism)))]
    )
