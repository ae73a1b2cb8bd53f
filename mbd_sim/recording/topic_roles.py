"""The topics of a recorded run that are recomputed, and those that carry its commands."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from mbd_sim.recording.cdr import JOINT_STATE, MULTI_ARRAY, STRING
from mbd_sim.recording.recorded_file import RecordedTopic


class TopicRole(StrEnum):
    """The kinds of data that topics carry: the last word of the topic's name, or `sensors` before that of a sensor."""

    JOINT_STATES = "joint_states"
    ENERGIES = "energies"
    CONSTRAINT_VIOLATION = "constraint_violation"
    ACCELERATIONS = "accelerations"
    SENSORS = "sensors"  # the word before the last, which names the sensor
    APPLIED_EFFORTS = "applied_efforts"
    APPLIED_COMMANDS = "applied_commands"
    APPLIED_WRENCHES = "applied_wrenches"
    LIVE_VALUES = "live_values"
    EVENTS = "events"
    NEW_STATES = "new_states"


COMMANDS = frozenset(
    {
        TopicRole.APPLIED_EFFORTS,
        TopicRole.APPLIED_COMMANDS,
        TopicRole.APPLIED_WRENCHES,
        TopicRole.LIVE_VALUES,
        TopicRole.EVENTS,
        TopicRole.NEW_STATES,
    }
)
_TYPES = {TopicRole.JOINT_STATES: JOINT_STATE, TopicRole.EVENTS: STRING}  # all others are multi-arrays
_ROLES = {role.value: role for role in TopicRole}


def topic_roles(topics: Mapping[str, RecordedTopic]) -> dict[str, TopicRole]:
    """Return the roles of topics by the last word of their names and their types, in any namespace.

    If no topic has the name of joint states, the only one of their type is taken: it may have been remapped.
    """
    found = {name: TopicRole.SENSORS for name, topic in topics.items() if _is_sensor(name) and topic.encoding == "cdr"}
    found |= {
        name: role
        for name, topic in topics.items()
        if not _is_sensor(name)
        and (role := _ROLES.get(name.rsplit("/", 1)[-1])) is not None
        and topic.type == _TYPES.get(role, MULTI_ARRAY)
        and topic.encoding == "cdr"
    }
    candidates = [name for name, topic in topics.items() if topic.type == JOINT_STATE and not _is_sensor(name)]
    if TopicRole.JOINT_STATES not in found.values() and len(candidates) == 1:
        found[candidates[0]] = TopicRole.JOINT_STATES
    return found


def _is_sensor(name: str) -> bool:
    return name.split("/")[-2:-1] == [TopicRole.SENSORS.value]
