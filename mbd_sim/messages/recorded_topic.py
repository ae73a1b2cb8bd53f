"""A topic to be recorded."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.messages.message_definitions import definition, type_hash


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
