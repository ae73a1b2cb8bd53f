"""Quality of service of the topics, and how rosbag2 writes it down."""

from __future__ import annotations

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

STATE = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.RELIABLE)
CLOCK = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
COMMAND = QoSProfile(depth=10, reliability=QoSReliabilityPolicy.RELIABLE)

_INFINITE = "{sec: 9223372036, nsec: 854775807}"


def offered_qos_profiles(profile: QoSProfile) -> str:
    """A profile as rosbag2 (Jazzy, metadata version 9) stores it in a channel's metadata."""
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
