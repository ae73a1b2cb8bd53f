"""The curves in the plots, and the layout of the window around them.

The plots show joints, the energy account, and its residual. The window has the scene on the left, plots on the right,
and the log at the bottom.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.constraints import Rolling
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.constraints import floor_of
from mbd_sim.pictures.rerun.scene import Entity, LoggedItems, PartPoses, Rows, SceneDescription, coordinates
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.extent import Extent
from mbd_sim.pictures.shapes.palette import Color, residual_magnitude

WIDTH = 1.6


@dataclass(frozen=True)
class PlottedCurves:
    """The curves of one plot: their entity, names and colors; a `stepped` curve is constant between samples."""

    path: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    stepped: bool = False

    def style(self) -> LoggedItems:
        """Their names, colors and widths."""
        mode = rr.components.InterpolationMode.StepAfter if self.stepped else None
        count = len(self.names)
        style = rr.SeriesLines(
            names=list(self.names), colors=list(self.colors), widths=[WIDTH] * count, interpolation_mode=mode
        )
        yield self.path, style

    def values(self, values: Array) -> LoggedItems:
        """Their values, a row of k numbers for each sample, (n, k)."""
        yield self.path, scalars(values)


def scalars(values: Array) -> Any:
    """Columns of rows with several numbers each, (n, k)."""
    return rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel()).partition([values.shape[1]] * len(values))


def plot_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All plots."""
    if scene.mechanism.coordinate_names or scene.mechanism.driven_names:
        yield _JointPlots(scene)
    yield _EnergyPlots(bool(scene.mechanism.driven_names))
    if scene.options.reactions:
        yield _ReactionPlots(scene)


class _JointPlots:
    """Positions, velocities and efforts, angles apart from displacements; the driven coordinates come last."""

    def __init__(self, scene: SceneDescription) -> None:
        self._scene = scene
        mechanism = scene.mechanism
        names = [*mechanism.coordinate_names, *mechanism.driven_names]
        kinds = [_kind(mechanism, name) for name in names]
        colors = [*palette.series_colors(mechanism), *[palette.DRIVEN] * len(mechanism.driven_names)]
        self._series: list[tuple[int, list[int], PlottedCurves]] = []
        for kind in (paths.ANGULAR, paths.LINEAR):
            own = [index for index, other in enumerate(kinds) if other == kind]
            for row, path in enumerate((paths.POSITION, paths.VELOCITY, paths.EFFORT)):
                series = PlottedCurves(
                    f"{path}/{kind}",
                    tuple(names[index] for index in own),
                    tuple(colors[index] for index in own),
                    stepped=path == paths.EFFORT and not mechanism.driven_names,
                )
                if own:
                    self._series.append((row, own, series))

    def static(self) -> LoggedItems:
        for _, _, series in self._series:
            yield from series.style()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        scene = self._scene
        speeds = rows.of("y")[:, scene.nq : scene.nq + scene.nv]
        free = (coordinates(scene, rows), speeds, rows.of("inputs")[:, : scene.nv])
        driven = np.split(rows.of("drives"), 3, axis=1)
        values = [np.hstack(pair) for pair in zip(free, driven, strict=True)]
        for row, own, series in self._series:
            yield from series.values(values[row][:, own])


STACK = PlottedCurves(
    paths.STACK,
    ("potential", "+ kinetic", "+ dissipated", "\N{MINUS SIGN} work: stays at the initial energy"),
    (palette.POTENTIAL, palette.KINETIC, palette.DISSIPATED, palette.TOTAL),
)
RESIDUAL = PlottedCurves(
    paths.RESIDUAL, ("log\N{SUBSCRIPT ONE}\N{SUBSCRIPT ZERO} |residual / J|",), (palette.RESIDUAL,)
)
RESIDUAL_PJ = PlottedCurves(paths.RESIDUAL_PJ, ("residual",), (palette.RESIDUAL,))


class _EnergyPlots:
    """The energy account, as curves and as a stack, and its residual; the work of drives only if there are any."""

    def __init__(self, driven: bool) -> None:
        lines = [("kinetic", palette.KINETIC), ("potential", palette.POTENTIAL), ("total", palette.TOTAL)]
        lines += [("dissipated", palette.DISSIPATED), ("work of forces", palette.WORK_APPLIED)]
        lines += [("work of drives", palette.WORK_DRIVES)] if driven else []
        names, colors = zip(*lines, strict=True)
        self._account = PlottedCurves(paths.ACCOUNT, names, colors)

    def static(self) -> LoggedItems:
        for series in (self._account, STACK, RESIDUAL, RESIDUAL_PJ):
            yield from series.style()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        kinetic, potential, dissipated, applied, drives, total, residual = rows.of("energies").T
        account = np.column_stack([kinetic, potential, total, dissipated, applied, drives])
        yield from self._account.values(account[:, : len(self._account.names)])
        spent = total + dissipated
        yield from STACK.values(np.column_stack([potential, total, spent, spent - applied - drives]))
        yield from RESIDUAL.values(np.log10(residual_magnitude(rows.of("energies")))[:, None])
        yield from RESIDUAL_PJ.values(residual[:, None] / paths.PICO)


class _ReactionPlots:
    """The magnitudes of the forces through the joints."""

    def __init__(self, scene: SceneDescription) -> None:
        names = tuple(scene.mechanism.all_joints)
        colors = [palette.PARTS[index % len(palette.PARTS)] for index in range(len(names))]
        self._series = PlottedCurves(paths.REACTION, names, tuple(colors))

    def static(self) -> LoggedItems:
        yield from self._series.style()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        forces = rows.of("reactions").reshape(len(rows), -1, 6)[:, :, :3]
        yield from self._series.values(np.linalg.norm(forces, axis=2))


def _kind(mechanism: Mechanism, coordinate: str) -> str:
    return paths.ANGULAR if mechanism.coordinate(coordinate).rotation else paths.LINEAR


def sensor_series(sensor: str, quantity: str, components: int) -> PlottedCurves:
    """The components of a quantity that a sensor measures; a quaternion is in the order of ROS."""
    names = {1: (sensor,), 3: ("x", "y", "z"), 4: ("qx", "qy", "qz", "qw")}[components]
    colors = tuple(palette.PARTS[index % len(palette.PARTS)] for index in range(components))
    return PlottedCurves(paths.sensor(sensor, quantity), names, colors, stepped=True)


def units(entities: Sequence[str]) -> str:
    """Of entities of joints, as a list."""
    return ", ".join(paths.UNITS[path] for path in entities)


LIVE_TIME = 30.0  # s that plots show of a live run, rather than all of it
FIELD_OF_VIEW = np.radians(55.0)  # Rerun's own, vertical
PANEL_ASPECT = 1.2  # width by height of the scene in a window of usual shape


def make_blueprint(scene: SceneDescription, *, live: bool) -> rrb.Blueprint:
    """The layout for a mechanism; with `live` it follows the incoming data, otherwise it plays them in a loop."""
    upper = rrb.Horizontal(_scene_view(scene), _plots(scene, live), column_shares=[3, 2])
    log = rrb.TextLogView(
        origin=paths.EVENTS,
        name="Events",
        columns=rrb.TextLogColumns(timeline_columns=[paths.TIMELINE], text_log_columns=["LogLevel", "Body"]),
    )
    lanes = rrb.StateTimelineView(origin=paths.STATES, name="States")
    about = rrb.TextDocumentView(origin=paths.ABOUT, name="About")
    lower = rrb.Horizontal(rrb.Tabs(log, about), lanes, column_shares=[3, 2])
    return rrb.Blueprint(
        rrb.Vertical(upper, lower, row_shares=[10, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=paths.TIMELINE,
            play_state="following" if live else "playing",
            loop_mode=None if live else "all",  # a loop would end following
        ),
        auto_views=False,
        auto_layout=False,
    )


def eye(extent: Extent) -> tuple[Array, Array, Array]:
    """Position, target and up direction (3,) of the eye in ground's frame.

    Planar mechanisms are viewed along the normal of their plane, slightly from above and from the side, with x to the
    right; spatial ones obliquely.
    """
    up = np.array([0.0, 0.0, 1.0])
    if extent.toward is None:
        direction = np.array([0.55, -1.0, 0.5])
    else:
        out = extent.toward
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


def _scene_view(scene: SceneDescription) -> rrb.Spatial3DView:
    extent = scene.extent
    position, target, up = eye(extent)
    start = rr.TimeRangeBoundary.cursor_relative(seconds=-scene.options.trace_time)
    recent = rrb.VisibleTimeRanges(timeline=paths.TIMELINE, start=start, end=rr.TimeRangeBoundary.cursor_relative())
    rolling = [record.name for record in scene.mechanism.constraints if isinstance(record, Rolling)]
    return rrb.Spatial3DView(
        origin=paths.WORLD,
        name=scene.mechanism.name,
        background=rrb.Background(color=palette.BACKGROUND, kind=rrb.BackgroundKind.SolidColor),
        line_grid=_floor(scene),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, eye_up=up, speed=extent.size
        ),
        overrides={paths.trace(name): recent for name in (*scene.traces, *rolling)},
    )


def _floor(scene: SceneDescription) -> rrb.LineGrid3D:
    """A grid with lines at 1, 2 or 5 times a power of ten meters.

    It lies in the plane that something rolls or slides on, or else level, a little below the lowest point.
    """
    extent = scene.extent
    coarse = extent.size / 4.0
    power = 10.0 ** np.floor(np.log10(coarse))
    spacing = float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= coarse * (1.0 + 1e-9)))
    point, normal = floor_of(scene) or (
        np.array([0.0, 0.0, extent.lower[2] - 0.1 * extent.size]),
        np.array([0.0, 0.0, 1.0]),
    )
    return rrb.LineGrid3D(
        visible=True,
        plane=rr.encodings.Plane3D(normal, float(point @ normal)),
        spacing=spacing,
        stroke_width=1.0,
        color=(*palette.GRID, 70),
    )


def _plots(scene: SceneDescription, live: bool) -> Any:
    mechanism = scene.mechanism
    kinds = {_kind(mechanism, name) for name in (*mechanism.coordinate_names, *mechanism.driven_names)}
    joints = [
        [
            _plot(live, f"{path}/{kind}", f"{title} ({paths.UNITS[f'{path}/{kind}']})")
            for kind in (paths.ANGULAR, paths.LINEAR)
            if kind in kinds
        ]
        for path, title in (
            (paths.POSITION, "Position"),
            (paths.VELOCITY, "Velocity"),
            (paths.EFFORT, "Effort"),
        )
    ]
    positions, velocities, efforts = joints
    forces = [_plot(live, paths.REACTION, "Forces through joints (N)")] if scene.options.reactions else []
    account = rrb.Tabs(_plot(live, paths.ACCOUNT, "Energy account (J)"), _plot(live, paths.STACK, "Energy stack (J)"))
    left_over = rrb.Tabs(
        _plot(live, paths.RESIDUAL, "Energy residual (log\N{SUBSCRIPT ONE}\N{SUBSCRIPT ZERO} J)"),
        _plot(live, paths.RESIDUAL_PJ, "Energy residual (pJ)"),
    )
    upper = [rrb.Tabs(*positions), rrb.Tabs(*velocities, *efforts, *forces)] if kinds else []
    measured = [
        _plot(
            live,
            paths.sensor(sensor.name, one.name),
            f"{sensor.name}: {one.name.replace('_', ' ')} ({one.unit})",
        )
        for sensor in (mechanism.sensors if scene.options.measurements else ())
        for one in sensor.quantities
    ]
    return rrb.Vertical(*upper, *([rrb.Tabs(*measured)] if measured else []), account, left_over)


def _plot(live: bool, path: str, name: str) -> rrb.TimeSeriesView:
    start = rr.TimeRangeBoundary.cursor_relative(seconds=-LIVE_TIME)
    latest = rrb.VisibleTimeRanges(timeline=paths.TIMELINE, start=start, end=rr.TimeRangeBoundary.cursor_relative())
    return rrb.TimeSeriesView(
        origin=path,
        name=name,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        time_ranges=latest if live else None,
    )
