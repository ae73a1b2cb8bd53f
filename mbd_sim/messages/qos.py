"""Quality of service that topics offer, and its representation in rosbag2; needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

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
