"""The reference of the nodes' parameters, from their declarations. It needs no ROS: its modules are replaced."""

from __future__ import annotations

from sphinx.ext.autodoc.mock import mock

from site_pages.command_line import _cells as cells

NAMES = ("sim_node", "replay_node")
HEADER = """# Parameters of the nodes

Each is given after `-p`, as in `ros2 run mbd_sim sim_node --ros-args -p mechanism:=four_bar`, or in a file of parameters; `sim_node --help`
prints the same list. Those marked *live* can be changed while the node runs: `ros2 param set /sim_node publish_rate 500.0`. The
mechanism's own numbers are parameters too: see [live values](../node.md#parameters).
"""


def pages() -> dict[str, str]:
    """The page by its name in `docs/generated/`."""
    lines = [HEADER]
    for name, specs in _declared().items():
        lines += [f"## {name}\n", "| parameter | default | range | | meaning |", "|---|---|---|---|---|"]
        for spec in specs:
            limits = f"{spec.low:g} … {spec.high:g}" if spec.low is not None and spec.high is not None else ""
            default = str(spec.default).lower() if isinstance(spec.default, bool) else str(spec.default)
            shown = f"`{default}`" if default else "empty"
            lines.append(
                f"| `{spec.name}` | {shown} | {limits} | {'live' if spec.live else ''} | {cells(spec.description)} |"
            )
        lines.append("")
    return {"parameters.md": "\n".join(lines)}


def _declared():
    packages = ["rclpy", "rcl_interfaces", "builtin_interfaces", "rosgraph_msgs", "std_msgs", "std_srvs", "sensor_msgs"]
    with mock(packages):
        from mbd_sim.ros.node import sim_parameters
        from mbd_sim.ros.replay import replay_node
    return {"sim_node": sim_parameters.PARAMETERS, "replay_node": replay_node.PARAMETERS}
