"""Quality of service of the topics, and its representation in rosbag2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

STATE = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.RELIABLE)
CLOCK = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
COMMAND = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.RELIABLE)

_INFINITE = "{sec: 9223372036, nsec: 854775807}"


def offered_qos_profiles(profile: QoSProfile) -> str:
    """A profile as rosbag2 (Jazzy, metadata version 9) stores it in a channel's metadata, in YAML."""
    history = "keep_all" if profile.history == QoSHistoryPolicy.KEEP_ALL else "keep_last"
    reliability = "best_effort" if profile.reliability == QoSReliabilityPolicy.BEST_EFFORT else "reliable"
    durability = "transient_local" if profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL else "volatile"
    lines = [
        f"history: {history}",
        f"depth: {profile.depth}",
        f"reliability: {reliability}",
        f"durability: {durability}",
        f"deadline: {_INFINITE}",
        f"lifespan: {_INFINITE}",
        "liveliness: automatic",
        f"liveliness_lease_duration: {_INFINITE}",
        "avoid_ros_namespace_conventions: false",
    ]
    return "- " + "\n  ".join(lines)


def profile_of(text: str) -> QoSProfile:
    """The profile to offer for a recorded topic, from the profiles of its publishers in rosbag2's YAML.

    Values may be words or numbers. Of several publishers the strongest offer counts, which suits every subscription.
    Unknown values, such as the history over DDS, become: ten messages, reliable, volatile.
    """
    offers = [offer for offer in _load_offers(text) if isinstance(offer, Mapping)]
    first: Mapping[str, Any] = offers[0] if offers else {}
    best_effort = bool(offers) and all(offer.get("reliability") in ("best_effort", 2) for offer in offers)
    latched = any(offer.get("durability") in ("transient_local", 1) for offer in offers)
    depths = [depth for offer in offers if isinstance(depth := offer.get("depth"), int) and depth > 0]
    profile = QoSProfile(
        depth=max(depths, default=STATE.depth),
        history=QoSHistoryPolicy.KEEP_ALL if first.get("history") in ("keep_all", 2) else QoSHistoryPolicy.KEEP_LAST,
        reliability=QoSReliabilityPolicy.BEST_EFFORT if best_effort else QoSReliabilityPolicy.RELIABLE,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if latched else QoSDurabilityPolicy.VOLATILE,
    )
    for name in ("deadline", "lifespan"):
        if (duration := _duration(first.get(name))) is not None:
            setattr(profile, name, duration)
    return profile


def _load_offers(text: str) -> list[Any]:
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError:
        return []
    return found if isinstance(found, list) else []


def _duration(value: Any) -> Duration | None:
    """A finite, positive duration; None for zero, infinity and anything else."""
    if not isinstance(value, Mapping):
        return None
    seconds, nanoseconds = value.get("sec", 0), value.get("nsec", 0)
    if (
        not (isinstance(seconds, int) and isinstance(nanoseconds, int))
        or seconds >= 1 << 31
        or seconds + nanoseconds <= 0
    ):
        return None
    return Duration(seconds=seconds, nanoseconds=nanoseconds)
