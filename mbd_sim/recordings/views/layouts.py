"""Layouts for Foxglove and PlotJuggler with the joints, energies and sensors of a mechanism.

Foxglove's are JSON, PlotJuggler's XML. Curves are named as in the topics of the node and in its recordings.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from mbd_sim.base.errors import InputError
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages.topics import absolute_name, for_each_sensor
from mbd_sim.recordings.views.table import coordinate_units
from mbd_sim.simulation.model.state_records import Energies

FOXGLOVE, PLOTJUGGLER = ".json", ".xml"
SUFFIXES = (FOXGLOVE, PLOTJUGGLER)
COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2", "#17becf")
SHOWN = ("kinetic", "potential", "total", "residual")
_FIELDS = {  # of messages of sensors that are numbers: fields, as in both programs
    "sensor_msgs/msg/Imu": ("angular_velocity", "linear_acceleration"),
    "geometry_msgs/msg/WrenchStamped": ("wrench.force", "wrench.torque"),
    "geometry_msgs/msg/PoseStamped": ("pose.position",),
    "geometry_msgs/msg/TwistStamped": ("twist.linear", "twist.angular"),
    "sensor_msgs/msg/Range": ("range",),
}


@dataclass(frozen=True)
class _Curve:
    """A curve: its label, and its names in Foxglove and in PlotJuggler."""

    label: str
    foxglove: str
    plotjuggler: str


@dataclass(frozen=True)
class _PlotPanel:
    title: str
    curves: tuple[_Curve, ...]


def layout(mechanism: Mechanism, suffix: str, namespace: str = "", node: str = "sim_node") -> str:
    """The text of a layout.

    :param suffix: `.json` for Foxglove, `.xml` for PlotJuggler.
    :param namespace: that of the node, if it has one, such as `/left` or `left`.
    :param node: its name, which is in the topics of sensors.
    :raises InputError: there is no layout of another suffix.
    """
    namespace = f"/{namespace.strip('/')}".rstrip("/")
    found = _panels(mechanism, namespace, node)
    if suffix == FOXGLOVE:
        return json.dumps(_foxglove(found, namespace), indent=2) + "\n"
    if suffix == PLOTJUGGLER:
        return _plotjuggler(mechanism.name, found)
    raise InputError(f"there is no layout '{suffix}'", "Write a .json file for Foxglove, or .xml for PlotJuggler.")


def write_layout(path: Path, mechanism: Mechanism, namespace: str = "", node: str = "sim_node") -> None:
    """Write a layout by the suffix of its file."""
    path.write_text(layout(mechanism, path.suffix, namespace, node), encoding="utf-8")


def _panels(mechanism: Mechanism, namespace: str, node: str) -> list[_PlotPanel]:
    """Positions and velocities of angles and displacements, efforts, energies, and measurements."""
    units, order = coordinate_units(mechanism), [*mechanism.coordinate_names, *mechanism.driven_names]
    topic = f"{namespace}/joint_states"

    def joints(field: str, unit: str) -> tuple[_Curve, ...]:
        return tuple(
            _Curve(name, f"{topic}.{field}[{index}]", f"{topic}/{name}/{field}")
            for index, name in enumerate(order)
            if units[name] == unit
        )

    found = []
    for field, title, suffix in (
        ("position", "Positions", ""),
        ("velocity", "Velocities", "/s"),
        ("effort", "Efforts", ""),
    ):
        for unit in ("rad", "m"):
            shown = {"rad": "N·m", "m": "N"}[unit] if field == "effort" else unit + suffix
            if curves := joints(field, unit):
                found.append(_PlotPanel(f"{title} ({shown})", curves))
    energies = [*Energies._fields]
    for title, names in (("Energies (J)", SHOWN[:3]), ("Energy residual (J)", SHOWN[3:])):
        curves = tuple(
            _Curve(
                name, f"{namespace}/energies.data[{energies.index(name)}]", f"{namespace}/energy_values/{name}/position"
            )
            for name in names
        )
        found.append(_PlotPanel(title, curves))
    for one in for_each_sensor(mechanism.sensors):
        name = f"{namespace}{absolute_name(one)}".replace("/sim_node/", f"/{node}/")
        for field in _FIELDS.get(one.message_type, ()):
            ends = ("",) if field == "range" else (".x", ".y", ".z")
            curves = tuple(
                _Curve(f"{field}{end}", f"{name}.{field}{end}", f"{name}/{(field + end).replace('.', '/')}")
                for end in ends
            )
            found.append(_PlotPanel(f"{name.rpartition('/')[2]}: {field.replace('_', ' ')}", curves))
    return found


def _foxglove(panels: Sequence[_PlotPanel], namespace: str) -> dict[str, Any]:
    scene = {"topics": {f"{namespace}/markers": {"visible": True}}, "followTf": "ground", "scene": {},
             "cameraState": {"distance": 5, "phi": 75, "thetaOffset": 0, "target": [0, 0, 0]}}  # fmt: skip
    configured: dict[str, Any] = {"3D!mechanism": scene}
    for number, panel in enumerate(panels):
        stamped = "headerStamp" if "energies" not in panel.curves[0].foxglove else "receiveTime"
        configured[f"Plot!p{number}"] = {
            "title": panel.title,
            "paths": [
                {"value": one.foxglove, "enabled": True, "timestampMethod": stamped, "label": one.label}
                for one in panel.curves
            ],
            "showLegend": True,
            "isSynced": True,
            "showXAxisLabels": True,
            "showYAxisLabels": True,
            "legendDisplay": "floating",
            "sidebarDimension": 240,
            "xAxisVal": "timestamp",
        }
    column = _stacked([name for name in configured if name.startswith("Plot!")])
    return {
        "configById": configured,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": "3D!mechanism", "second": column, "splitPercentage": 45},
    }


def _stacked(names: Sequence[str]) -> Any:
    """Panels of the same height below each other."""
    if len(names) == 1:
        return names[0]
    first, rest = names[0], _stacked(names[1:])
    return {"direction": "column", "first": first, "second": rest, "splitPercentage": 100.0 / len(names)}


def _plotjuggler(title: str, panels: Sequence[_PlotPanel]) -> str:
    sizes = ";".join([f"{1.0 / len(panels):.6g}"] * len(panels))
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        "<root>",
        ' <tabbed_widget parent="main_window" name="Main Window">',
        f'  <Tab tab_name={quoteattr(title)} containers="1">',
        "   <Container>",
        f'   <DockSplitter orientation="-" count="{len(panels)}" sizes="{sizes}">',
    ]
    for panel in panels:
        lines += [
            f"    <DockArea name={quoteattr(panel.title)}>",
            '     <plot mode="TimeSeries" style="Lines" flip_x="false" flip_y="false">',
        ]
        lines += [
            f'      <curve name={quoteattr(one.plotjuggler)} color="{COLORS[number % len(COLORS)]}"/>'
            for number, one in enumerate(panel.curves)
        ]
        lines += ["     </plot>", "    </DockArea>"]
    lines += [
        "   </DockSplitter>",
        "   </Container>",
        "  </Tab>",
        '  <currentTabIndex index="0"/>',
        " </tabbed_widget>",
        ' <use_relative_time_offset enabled="1"/>',
        "</root>",
    ]
    return "\n".join(lines) + "\n"
