"""What a topic needs to be recorded: its name, its message definition, and its quality of service.

Message definitions come from the installed ROS packages, or else from `rosbags`, which needs no ROS. The quality of
service that a topic offers is represented as in rosbag2, without ROS too. In the names of topics of parts, ROS allows
only letters, digits and underscores.
"""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_SEPARATOR = "=" * 80
_FIELD_TYPE = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_/]*)")
_PRIMITIVES = {
    "bool", "byte", "char", "float32", "float64", "string", "wstring",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}  # fmt: skip


@cache
def definition(message_type: str) -> str:
    """Return the text of a `ros2msg` schema: the definition of a type such as `std_msgs/msg/String` and all it uses.

    Without ROS, only the packages of ROS 2 Jazzy itself are known, and their comments are left out.

    :raises FileNotFoundError: the definitions of a package are not installed.
    """
    package, _, name = message_type.split("/")
    try:
        return _installed_definition(package, name)
    except ImportError:
        return _jazzy_definition(message_type)


def _installed_definition(package: str, name: str) -> str:
    texts: dict[str, str] = {}
    pending = [f"{package}/{name}"]
    while pending:
        short_name = pending.pop(0)
        if short_name in texts:
            continue
        texts[short_name] = _text(*short_name.split("/"))
        pending += _used_types(texts[short_name], short_name.split("/")[0])
    (_, first), *others = texts.items()
    return "\n".join([first, *(f"{_SEPARATOR}\nMSG: {short_name}\n{text}" for short_name, text in others)])


@cache
def type_hash(message_type: str) -> str:
    """Return the REP 2011 hash of a type, or "" if it is unknown."""
    package, _, name = message_type.split("/")
    try:
        description = json.loads((_share_folder(package) / "msg" / f"{name}.json").read_text(encoding="utf-8"))
        hashes = {entry["type_name"]: entry["hash_string"] for entry in description["type_hashes"]}
        return str(hashes.get(message_type, ""))
    except ImportError:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_JAZZY)
        return store.hash_rihs01(message_type) if message_type in store.fielddefs else ""
    except (OSError, ValueError, KeyError):
        return ""


def _jazzy_definition(message_type: str) -> str:
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type not in store.fielddefs:
        raise FileNotFoundError(f"there is no message definition of '{message_type}' here")
    return store.generate_msgdef(message_type, ros_version=2)[0]


def _used_types(text: str, package: str) -> list[str]:
    used = []
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line)
        if match and match[1] not in _PRIMITIVES:
            used.append(match[1] if "/" in match[1] else f"{package}/{match[1]}")
    return used


@cache
def _text(package: str, name: str) -> str:
    return (_share_folder(package) / "msg" / f"{name}.msg").read_text(encoding="utf-8")


@cache
def _share_folder(package: str) -> Path:
    """Return the package's share folder: beside the `lib` of its Python module, in an installation and in wheels."""
    module = importlib.import_module(package)
    for folder in Path(str(module.__file__)).resolve().parents:
        share = folder / "share" / package
        if share.is_dir():
            return share
    raise FileNotFoundError(f"there are no message definitions of '{package}' near {module.__file__}")


@dataclass(frozen=True)
class Topic:
    """A topic to be recorded: its absolute name, type such as `std_msgs/msg/String`, and offered QoS in rosbag2's YAML.

    Messages of a `vital` topic are needed to recompute the run and are never dropped.
    """

    name: str
    type: str
    qos: str
    vital: bool = False

    @property
    def definition(self) -> str:
        """The definition of the type, as a `ros2msg` schema contains it."""
        return definition(self.type)

    @property
    def hash(self) -> str:
        """The REP 2011 hash of the type, or ""."""
        return type_hash(self.type)


_INFINITE = "{sec: 9223372036, nsec: 854775807}"


@dataclass(frozen=True)
class OfferedQos:
    """The profile that a publisher offers; policies that are not listed have their defaults.

    A `latched` topic is transient local: late subscribers receive its last messages.
    """

    depth: int
    latched: bool = False
    reliable: bool = True
    keep_all: bool = False


STATE = OfferedQos(depth=10)
CLOCK = OfferedQos(depth=1)
LATCHED = OfferedQos(depth=1, latched=True)
COMMAND = OfferedQos(depth=10)
LATCHED_COMMAND = OfferedQos(depth=10, latched=True)  # a late subscriber of depth 1 receives the last one


def offered_qos_profiles(offered: OfferedQos) -> str:
    """A profile as rosbag2 (Jazzy, metadata version 9) stores it in a channel's metadata, in YAML."""
    lines = [
        f"history: {'keep_all' if offered.keep_all else 'keep_last'}",
        f"depth: {offered.depth}",
        f"reliability: {'reliable' if offered.reliable else 'best_effort'}",
        f"durability: {'transient_local' if offered.latched else 'volatile'}",
        f"deadline: {_INFINITE}",
        f"lifespan: {_INFINITE}",
        "liveliness: automatic",
        f"liveliness_lease_duration: {_INFINITE}",
        "avoid_ros_namespace_conventions: false",
    ]
    return "- " + "\n  ".join(lines)


LONGEST = 100  # of a token: a topic has at most 247 characters


def topic_names(names: Iterable[str]) -> dict[str, str]:
    """A valid and unique topic token for each name: the name itself if it is valid.

    >>> topic_names(["rod", "bob-1", "bob.1", "2nd"])
    {'rod': 'rod', 'bob-1': 'bob_1', 'bob.1': 'bob_1_2', '2nd': '_2nd'}
    """
    names = list(names)
    tokens: dict[str, str] = {}
    for name in sorted(names, key=lambda name: _token(name) != name):  # valid names first: they stay as they are
        token, count = _token(name), 1
        while token in tokens.values():
            count += 1
            token = f"{_token(name)}_{count}"
        tokens[name] = token
    return {name: tokens[name] for name in names}


def names_by_topic(names: Iterable[str]) -> dict[str, str]:
    """The names of parts or sensors by the words that stand for them in topics."""
    return {token: name for name, token in topic_names(names).items()}


def _token(name: str) -> str:
    token = re.sub(r"_{2,}", "_", re.sub(r"[^A-Za-z0-9_]", "_", name))[:LONGEST] or "_"
    return f"_{token}" if token[0].isdigit() else token
