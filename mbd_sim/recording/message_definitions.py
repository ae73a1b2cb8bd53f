"""Message definitions for recordings, read from the installed ROS packages."""

from __future__ import annotations

import importlib
import json
import re
from functools import cache
from pathlib import Path

_SEPARATOR = "=" * 80
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_/]*)")
_PRIMITIVES = {
    "bool", "byte", "char", "float32", "float64", "string", "wstring",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}  # fmt: skip


def definition(message_type: str) -> str:
    """The text that a `ros2msg` schema holds: the definition of a type such as `std_msgs/msg/String`, then all it uses.

    :raises FileNotFoundError: the package's definitions are not installed.
    """
    package, _, name = message_type.split("/")
    found: dict[str, str] = {}
    waiting = [f"{package}/{name}"]
    while waiting:
        short = waiting.pop(0)
        if short in found:
            continue
        found[short] = _text(*short.split("/"))
        waiting += _used(found[short], short.split("/")[0])
    (_, first), *others = found.items()
    return "\n".join([first, *(f"{_SEPARATOR}\nMSG: {short}\n{text}" for short, text in others)])


@cache
def type_hash(message_type: str) -> str:
    """The REP 2011 hash of a type, or "" where it is not installed."""
    package, _, name = message_type.split("/")
    try:
        described = json.loads((_share(package) / "msg" / f"{name}.json").read_text(encoding="utf-8"))
        hashes = {entry["type_name"]: entry["hash_string"] for entry in described["type_hashes"]}
        return str(hashes.get(message_type, ""))
    except (OSError, ValueError, KeyError):
        return ""


def _used(text: str, package: str) -> list[str]:
    used = []
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line)
        if match and match[1] not in _PRIMITIVES:
            used.append(match[1] if "/" in match[1] else f"{package}/{match[1]}")
    return used


@cache
def _text(package: str, name: str) -> str:
    return (_share(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")


@cache
def _share(package: str) -> Path:
    """The package's share folder: beside its Python module's `lib`, in a ROS installation and in the wheels alike."""
    module = importlib.import_module(package)
    for folder in Path(str(module.__file__)).resolve().parents:
        share = folder / "share" / package
        if share.is_dir():
            return share
    raise FileNotFoundError(f"no message definitions of '{package}' beside {module.__file__}")
