"""The layout of the window: the scene on the left, plots on the right, the log at the bottom."""

from __future__ import annotations

from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mbd_sim.mechanism.model import Array, Mechanism
from mbd_sim.viewer import palette, paths
from mbd_sim.viewer.extent import Extent

TRACE_TIME = 1.0  # s
FIELD_OF_VIEW = np.radians(55.0)  # Rerun's own, vertical
PANEL_ASPECT = 1.2  # width by height of the scene in a window of common shape


def make_blueprint(mechanism: Mechanism, extent: Extent, *, live: bool) -> rrb.Blueprint:
    """The layout for a mechanism; `live` follows what comes in, otherwise it plays again and again."""
    upper = rrb.Horizontal(_scene(mechanism, extent), _plots(mechanism), column_shares=[3, 2])
    events = rrb.TextLogView(
        origin=paths.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=[paths.TIMELINE], text_log_columns=["Body"]),
    )
    return rrb.Blueprint(
        rrb.Vertical(upper, events, row_shares=[11, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=paths.TIMELINE,
            play_state="following" if live else "playing",
            loop_mode=None if live else "all",  # a loop would end the following
        ),
        auto_views=False,
        auto_layout=False,
    )


def eye(extent: Extent) -> tuple[Array, Array, Array]:
    """Position, target and up direction (3,) of the eye in ground's frame.

    Planar mechanisms are looked at along the normal of their plane, slightly from above and from the side, so
    that x goes to the right; spatial ones from a corner.
    """
    up = np.array([0.0, 0.0, 1.0])
    if extent.normal is None:
        direction = np.array([0.55, -1.0, 0.5])
    else:
        out = extent.normal * (1.0 if extent.normal @ np.array([1.0, -1.3, 1.1]) > 0.0 else -1.0)
        if abs(float(out @ up)) > 0.9:
            up = np.array([0.0, 1.0, 0.0])
        direction = out + 0.18 * up + 0.14 * np.cross(up, out)
    direction /= np.linalg.norm(direction)
    right = np.cross(up, direction)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(direction, right), direction])
    half = np.abs(axes) @ (extent.upper - extent.lower) / 2.0
    distance = half[2] + 1.2 * max(half[1], half[0] / PANEL_ASPECT, 0.2 * extent.size) / np.tan(FIELD_OF_VIEW / 2.0)
    return extent.center + distance * direction, extent.center, up


def _scene(mechanism: Mechanism, extent: Extent) -> rrb.Spatial3DView:
    position, target, up = eye(extent)
    start, end = (rr.TimeRangeBoundary.cursor_relative(seconds=-TRACE_TIME), rr.TimeRangeBoundary.cursor_relative())
    recent = rrb.VisibleTimeRanges(timeline=paths.TIMELINE, start=start, end=end)
    return rrb.Spatial3DView(
        origin=paths.WORLD,
        name=mechanism.name,
        background=rrb.Background(color=palette.BACKGROUND, kind=rrb.BackgroundKind.SolidColor),
        line_grid=_floor(extent),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=up, speed=extent.size
        ),
        overrides={paths.trace(name): recent for name in paths.ends(mechanism)},
    )


def _floor(extent: Extent) -> rrb.LineGrid3D:
    """A horizontal grid a little below the lowest point, with lines at 1, 2 or 5 times a power of ten metres."""
    coarse = extent.size / 4.0
    power = 10.0 ** np.floor(np.log10(coarse))
    spacing = float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= coarse * (1.0 + 1e-9)))
    height = float(extent.lower[2] - 0.1 * extent.size)
    return rrb.LineGrid3D(
        visible=True,
        plane=rr.encodings.Plane3D([0.0, 0.0, 1.0], height),
        spacing=spacing,
        stroke_width=1.0,
        color=(*palette.GRID, 70),
    )


def _plots(mechanism: Mechanism) -> Any:
    units = sorted({unit for joint in mechanism.joints.values() for unit in paths.units(joint)})
    efforts = [{"rad": "N·m", "m": "N"}[unit] for unit in units]
    energy = _plot(paths.BALANCE, "Energy", ["J"])
    exchange = _plot(paths.EXCHANGE, "Work and dissipation", ["J"])
    if not mechanism.coordinate_names:
        return rrb.Vertical(energy, exchange, _plot(paths.RESIDUAL, "Energy residual", ["pJ"]))
    return rrb.Vertical(
        _plot(paths.POSITION, "Joint positions", units),
        rrb.Tabs(
            _plot(paths.VELOCITY, "Joint velocities", [f"{unit}/s" for unit in units]),
            _plot(paths.EFFORT, "Efforts", efforts),
        ),
        rrb.Tabs(energy, exchange),
        _plot(paths.RESIDUAL, "Energy residual", ["pJ"]),
    )


def _plot(entity: str, name: str, units: list[str]) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=entity,
        name=f"{name} ({', '.join(units)})",
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
    )
