"""The definitions of messages in a file: checked as strictly as by `rosbags`, and those of recorded runs repaired."""

from __future__ import annotations

from functools import cache, lru_cache
from typing import TYPE_CHECKING

import yaml
from mcap.records import (
    Schema,
)

from mbd_sim.recordings.mcap.contents import (
    Definitions,
)
from mbd_sim.recordings.messages.definitions import definition
from mbd_sim.recordings.messages.topics import PART, TOPICS

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

_TEXT = "ros2msg"
_ENCODINGS = (_TEXT, "ros2idl", "omgidl", "")  # that other ROS tools know; "" is a schema without a definition
_QOS_KEYS = {
    "history", "depth", "reliability", "durability", "deadline", "lifespan", "liveliness", "liveliness_lease_duration"
}  # fmt: skip


def definition_problem(definitions: Definitions) -> str:
    """Return which topic has no valid definition of its messages, or ""."""
    for channel in definitions.channels.values():
        if channel.schema_id not in definitions.schemas:
            return f"the definition of {channel.topic} is missing"
        if not _is_qos(channel.metadata.get("offered_qos_profiles", "")):
            return f"the QoS profiles of {channel.topic} cannot be read"
    found = (_schema_problem(one.name, one.encoding, one.data) for one in definitions.schemas.values())
    return next(filter(None, found), "")


@lru_cache(maxsize=256)  # all files of a run have the same definitions, which take longer to read than their messages
def _schema_problem(name: str, encoding: str, data: bytes) -> str:
    """Return what is wrong with a definition, or ""."""
    from rosbags.typesys import Stores, get_typestore

    if encoding not in _ENCODINGS:
        return f"the definition of {name} has the unknown encoding '{encoding}'"
    try:
        text = data.decode()
        if encoding == _TEXT:
            store = get_typestore(Stores.EMPTY)
            store.register(_parsed(text, name))
            store.hash_rihs01(name)  # needs the definitions of all types that it contains
    except KeyError as error:
        return f"the definition of {name} lacks that of {error}"
    except Exception as error:  # the parser raises errors of its own
        return f"the definition of {name} cannot be read ({error})"
    return ""


def repair_definitions(definitions: Definitions) -> str:
    """Replace the damaged schemas of a recorded run by the definitions of its topics; return what was damaged, or "".

    A schema is damaged if it is missing, or differs from the definition in more than comments. Topics whose names
    belong to none that `sim_node` records keep their schemas.
    """
    expected: dict[int, set[str]] = {}
    for channel in definitions.channels.values():
        if message_type := _recorded_type(channel.topic):
            expected.setdefault(channel.schema_id, set()).add(message_type)
    problem = ""
    for number, message_types in expected.items():
        schema, message_type = definitions.schemas.get(number), min(message_types)
        if len(message_types) == 1 and not (
            schema is not None and _defines(schema.name, schema.encoding, schema.data, message_type)
        ):
            text = definition(message_type).encode()
            definitions.schemas[number] = Schema(id=number, data=text, encoding=_TEXT, name=message_type)
            problem = problem or f"the definition of {message_type} is damaged"
    if problem:
        used = {channel.schema_id for channel in definitions.channels.values()}
        for number in definitions.schemas.keys() - used:
            del definitions.schemas[number]
    return problem


def _recorded_type(topic: str) -> str:
    """Return the type of a topic that `sim_node` records, in any namespace, by the last words of its name, or ""."""
    words = topic.split("/")[1:]
    for entry in TOPICS:
        own = entry.name.lstrip("~/").split("/")
        last = words[-len(own) :]
        if len(last) == len(own) and all(word in (one, PART) for one, word in zip(last, own, strict=True)):
            return entry.message_type
    return ""


@lru_cache(maxsize=256)
def _defines(name: str, encoding: str, data: bytes, message_type: str) -> bool:
    """Whether a schema is the definition of a type; comments may differ."""
    if (name, encoding) != (message_type, _TEXT):
        return False
    try:
        return _parsed(data.decode(), message_type) == _expected(message_type)
    except Exception:  # the parser raises errors of its own
        return False


@cache
def _expected(message_type: str) -> Typesdict:
    return _parsed(definition(message_type), message_type)


def _parsed(text: str, message_type: str) -> Typesdict:
    from rosbags.typesys import get_types_from_msg

    return get_types_from_msg(text, message_type)


@lru_cache(maxsize=256)
def _is_qos(text: str) -> bool:
    """Whether a text holds rosbag2's QoS profiles, or nothing."""
    try:
        profiles = yaml.safe_load(text) or []
    except yaml.YAMLError:
        return False
    return isinstance(profiles, list) and all(isinstance(one, dict) and one.keys() >= _QOS_KEYS for one in profiles)
