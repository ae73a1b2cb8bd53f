"""The curves in the plots: joints, the energy account, and its residual."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.appearance.palette import Color
from mbd_sim.appearance.residual_scale import residual_magnitude
from mbd_sim.geometry.pose import Array
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.joint_coordinates import coordinates
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription

WIDTH = 1.6


@dataclass(frozen=True)
class Series:
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
        kinds = [*entity_paths.free_kinds(mechanism), *entity_paths.driven_kinds(mechanism)]
        names = [*mechanism.coordinate_names, *mechanism.driven_names]
        colors = [*palette.series_colors(mechanism), *[palette.DRIVEN] * len(mechanism.driven_names)]
        self._series: list[tuple[int, list[int], Series]] = []
        for kind in (entity_paths.ANGULAR, entity_paths.LINEAR):
            own = [index for index, other in enumerate(kinds) if other == kind]
            for row, path in enumerate((entity_paths.POSITION, entity_paths.VELOCITY, entity_paths.EFFORT)):
                series = Series(
                    f"{path}/{kind}",
                    tuple(names[index] for index in own),
                    tuple(colors[index] for index in own),
                    stepped=path == entity_paths.EFFORT and not mechanism.driven_names,
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


STACK = Series(
    entity_paths.STACK,
    ("potential", "+ kinetic", "+ dissipated", "\N{MINUS SIGN} work: stays at the initial energy"),
    (palette.POTENTIAL, palette.KINETIC, palette.DISSIPATED, palette.TOTAL),
)
RESIDUAL = Series(
    entity_paths.RESIDUAL, ("log\N{SUBSCRIPT ONE}\N{SUBSCRIPT ZERO} |residual / J|",), (palette.RESIDUAL,)
)
RESIDUAL_PJ = Series(entity_paths.RESIDUAL_PJ, ("residual",), (palette.RESIDUAL,))


class _EnergyPlots:
    """The energy account, as curves and as a stack, and its residual; the work of drives only if there are any."""

    def __init__(self, driven: bool) -> None:
        lines = [("kinetic", palette.KINETIC), ("potential", palette.POTENTIAL), ("total", palette.TOTAL)]
        lines += [("dissipated", palette.DISSIPATED), ("work of forces", palette.WORK_APPLIED)]
        lines += [("work of drives", palette.WORK_DRIVES)] if driven else []
        names, colors = zip(*lines, strict=True)
        self._account = Series(entity_paths.ACCOUNT, names, colors)

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
        yield from RESIDUAL_PJ.values(residual[:, None] / entity_paths.PICO)


class _ReactionPlots:
    """The magnitudes of the forces through the joints."""

    def __init__(self, scene: SceneDescription) -> None:
        names = tuple(scene.mechanism.all_joints)
        colors = [palette.PARTS[index % len(palette.PARTS)] for index in range(len(names))]
        self._series = Series(entity_paths.REACTION, names, tuple(colors))

    def static(self) -> LoggedItems:
        yield from self._series.style()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        forces = rows.of("reactions").reshape(len(rows), -1, 6)[:, :, :3]
        yield from self._series.values(np.linalg.norm(forces, axis=2))


def sensor_series(sensor: str, quantity: str, components: int) -> Series:
    """The components of a quantity that a sensor measures; a quaternion is in the order of ROS."""
    names = {1: (sensor,), 3: ("x", "y", "z"), 4: ("qx", "qy", "qz", "qw")}[components]
    colors = tuple(palette.PARTS[index % len(palette.PARTS)] for index in range(components))
    return Series(entity_paths.sensor(sensor, quantity), names, colors, stepped=True)


def units(entities: Sequence[str]) -> str:
    """Of entities of joints, as a list."""
    return ", ".join(entity_paths.UNITS[path] for path in entities)
