"""A recorded topic."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.recording.message_definitions import definition, type_hash


@dataclass(frozen=True)
class Topic:
    """A recorded topic: its absolute name, type such as `std_msgs/msg/String`, and offered QoS in rosbag2's YAML.

    Messages of a `vital` topic are never dropped: what is needed to compute the run again.
    """

    name: str
    type: str
    qos: str
    vital: bool = False

    @property
    def definition(self) -> str:
        """What a `ros2msg` schema holds."""
        return definition(self.type)

    @property
    def hash(self) -> str:
        """The REP 2011 hash of the type, or ""."""
        return type_hash(self.type)
