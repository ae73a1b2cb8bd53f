"""Several mechanisms in one program: a node for each, in a namespace of its own, all on the clock of the first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from mbd_sim.messages.topic_names import topic_names

# Of the nodes that follow: what belongs to a clock is decided by the leader.
OF_THE_LEADER: dict[str, Any] = {
    "use_sim_time": True,
    "real_time_factor": 1.0,
    "reset_rewinds_clock": False,
    "start_paused": False,
}


@dataclass(frozen=True, slots=True)
class Member:
    """A mechanism, and the namespace of its node within that of the program."""

    namespace: str
    mechanism: str


def members(text: str) -> list[Member]:
    """The entries of the parameter `mechanisms`: `namespace=mechanism`, or a mechanism that gives its name to both.

    :raises ValueError: two entries have the same namespace, or one is not a valid namespace.
    """
    found: list[Member] = []
    for entry in filter(None, (entry.strip() for entry in text.split(","))):
        namespace, equals, mechanism = (part.strip() for part in entry.partition("="))
        member = Member(namespace, mechanism if equals else namespace)
        if (equals and not mechanism) or topic_names([namespace])[namespace] != namespace:
            raise ValueError(
                f"mechanisms: '{entry}' gives no valid namespace and mechanism. "
                "Write NAMESPACE=MECHANISM, with letters, digits and underscores in the namespace."
            )
        if namespace in [other.namespace for other in found]:
            raise ValueError(f"mechanisms: the namespace '{namespace}' is given twice. Write NAMESPACE=MECHANISM.")
        found.append(member)
    return found


def node_options() -> list[dict[str, Any]]:
    """The options of each node of the program, the leader's first, as the parameter `mechanisms` asks.

    :raises ValueError: see `members`.
    """
    probe = Node("sim_node", start_parameter_services=False, enable_rosout=False)
    try:
        group = members(str(probe.declare_parameter("mechanisms", "").value))
        base = probe.get_namespace().rstrip("/")
        given = probe._parameter_overrides
        prefix = str(given["frame_prefix"].value) if "frame_prefix" in given else ""
    finally:
        probe.destroy_node()
    if not group:
        return [{}]
    options = []
    for number, member in enumerate(group):
        values = {"mechanism": member.mechanism, "frame_prefix": f"{prefix}{member.namespace}/"}
        values |= OF_THE_LEADER if number else {}
        options.append(
            {
                "cli_args": ["--ros-args", "-r", f"__ns:={base}/{member.namespace}"],
                "parameter_overrides": [Parameter(name, value=value) for name, value in values.items()],
            }
        )
    return options
