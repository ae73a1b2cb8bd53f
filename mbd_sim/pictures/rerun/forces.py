"""Springs, dampers, rods and ropes between points, forces as arrows, and couples as arcs.

A coil is logged once, one meter long; after that only the transform that stretches it is sent. The scale of arrows is
that of `loads`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

import numpy as np
import rerun as rr

from mbd_sim.base.geometry.pose import Array
from mbd_sim.pictures.rerun import paths
from mbd_sim.pictures.rerun.loads import ArrowScale, ShownLoad, loads
from mbd_sim.pictures.rerun.scene import (
    MIN_LENGTH,
    Entity,
    LoggedItems,
    PartPoses,
    Rows,
    SceneDescription,
    is_closed,
    line_transforms,
    transverse_direction,
)
from mbd_sim.pictures.shapes import palette, solids
from mbd_sim.pictures.shapes.primitives import Connector, connectors
from mbd_sim.pictures.shapes.solids import arc_arrow

LINE_RADIUS = -1.6  # negative: in points on the screen, which no transform stretches
ASPECT = 6.0  # length of a cylinder by its radius
FAINT = 0.6  # share of the background in the color of a rope that is slack


def connector_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All springs, dampers and actuators between points, rods and ropes."""
    poses = scene.start_poses
    for connector in connectors(scene.mechanism, scene.extent, poses):
        match connector.form:
            case "coil":
                yield _Coil(scene, connector)
            case "cylinder":
                yield _Cylinder(scene, connector)
            case "line":
                yield _StraightLine(scene, connector)
            case _:
                assert_never(connector.form)


class _Stretched:
    """A connector of two points, drawn along z and stretched by a transform."""

    def __init__(self, scene: SceneDescription, connector: Connector) -> None:
        self.path, self._connector = paths.in_world(connector.kind, connector.name), connector
        self._first, self._second = connector.points
        line = scene.at_start(self._second) - scene.at_start(self._first)
        self._transverse = transverse_direction(scene, line)

    def _line(self, poses: PartPoses) -> tuple[Array, Array, Array]:
        """The starts (n, 3), and the lengths (n,) and quaternions (n, 4) of `line_transforms`."""
        starts, stops = poses.point(self._first), poses.point(self._second)
        return starts, *line_transforms(starts, stops, self._transverse)

    def _stretched(self, path: str, starts: Array, lengths: Array, quaternions: Array) -> LoggedItems:
        """The transforms that stretch an object along z from 0 to 1 m to these lengths."""
        scale = np.column_stack([np.ones_like(lengths), np.ones_like(lengths), np.maximum(lengths, MIN_LENGTH)])
        yield path, rr.Transform3D.columns(translation=starts, quaternion=quaternions, scale=scale)


class _Coil(_Stretched):
    def static(self) -> LoggedItems:
        coil = solids.coil(self._connector.radius)
        yield f"{self.path}/coil", rr.LineStrips3D([coil], radii=[LINE_RADIUS], colors=[self._connector.color])

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from self._stretched(self.path, *self._line(poses))


class _Cylinder(_Stretched):
    """A rod through a cylinder of constant length."""

    def static(self) -> LoggedItems:
        rod = rr.LineStrips3D([[(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]], radii=[LINE_RADIUS], colors=[palette.SPRING])
        yield f"{self.path}/rod/line", rod
        radius, color = self._connector.radius, self._connector.color
        cylinder = rr.Cylinders3D(lengths=[ASPECT * radius], radii=[radius], colors=[color], fill_mode="solid")
        yield f"{self.path}/cylinder/body", cylinder

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        starts, lengths, quaternions = self._line(poses)
        yield from self._stretched(f"{self.path}/rod", starts, lengths, quaternions)
        middle = 0.5 * (starts + poses.point(self._second))
        yield f"{self.path}/cylinder", rr.Transform3D.columns(translation=middle, quaternion=quaternions)


class _StraightLine:
    """Straight lines from point to point, faint while they are slack."""

    def __init__(self, scene: SceneDescription, connector: Connector) -> None:
        self._path, self._connector, self._scene = paths.in_world(connector.kind, connector.name), connector, scene

    def static(self) -> LoggedItems:
        connector = self._connector
        fixed = None if connector.slackens else [connector.color]
        yield self._path, rr.LineStrips3D.from_fields(radii=[connector.radius], colors=fixed)
        ends = rr.Points3D.from_fields(radii=[1.8 * connector.radius], colors=[connector.color])
        yield f"{self._path}/ends", ends

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        connector = self._connector
        slices = np.stack([poses.point(at) for at in connector.points], axis=1)
        colors = None
        if connector.slackens:
            closed = is_closed(self._scene, (connector.kind, connector.name), rows)[:, None]
            faint = palette.mixed(connector.color, palette.BACKGROUND, FAINT)
            colors = np.where(closed, connector.color, faint).astype(np.uint8)
        yield self._path, rr.LineStrips3D.columns(strips=list(slices), colors=colors)
        ends = rr.Points3D.columns(positions=slices.reshape(-1, 3)).partition([len(connector.points)] * len(rows))
        yield f"{self._path}/ends", ends


def arrow_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All forces and couples that the samples contain."""
    for load in loads(scene):
        yield _Arrows(load)


class _Arrows:
    """The arrows and arcs of a load."""

    def __init__(self, load: ShownLoad) -> None:
        self._load = load
        self._styles = [ArrowStyle(paths.in_world(one.kind, one.name), one) for one in load.scales]

    def static(self) -> LoggedItems:
        for style in self._styles:
            yield from style.static()

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        for style, (at, vectors) in zip(self._styles, self._load.vectors(rows, poses), strict=True):
            yield from style.couple(at, vectors) if style.scale.couple else style.force(at, vectors)


class ArrowStyle:
    """Arrows or arcs at a path."""

    def __init__(self, path: str, scale: ArrowScale) -> None:
        self.path, self.scale = path, scale

    def static(self) -> LoggedItems:
        """The color and the width."""
        radius, color = 0.008 * self.scale.size, self.scale.color
        if self.scale.couple:
            yield f"{self.path}/couple", rr.LineStrips3D.from_fields(radii=[0.7 * radius], colors=[color])
        else:
            yield f"{self.path}/force", rr.Arrows3D.from_fields(radii=[radius], colors=[color])

    def force(self, origins: Array, vectors: Array, pushes: Array | None = None) -> LoggedItems:
        """Arrows at origins (n, 3), or k for each sample (n, k, 3), for vectors of the same shape in N.

        :param pushes: (k,) which of them end there instead.
        """
        samples, origins, vectors = len(vectors), origins.reshape(-1, 3), vectors.reshape(-1, 3)
        drawn, _ = self.scale.visible(vectors)
        counts = drawn.reshape(samples, -1).sum(axis=1)
        arrows = self.scale.arrows(vectors)
        if pushes is not None:
            origins = origins - np.tile(pushes, samples)[:, None] * arrows
        columns = rr.Arrows3D.columns(origins=origins[drawn].reshape(-1, 3), vectors=arrows[drawn].reshape(-1, 3))
        yield f"{self.path}/force", columns.partition(counts)

    def couple(self, centers: Array, vectors: Array) -> LoggedItems:
        """Arcs about centers (n, 3), for couples (n, 3) in N·m."""
        drawn, couples = self.scale.visible(vectors)
        strips = [
            arc_arrow(center, vector / couple, self.scale.sweep(couple), self.scale.radius * self.scale.size)
            for center, vector, couple in zip(centers[drawn], vectors[drawn], couples[drawn], strict=True)
        ]
        columns = rr.LineStrips3D.columns(strips=strips).partition(drawn.astype(int))
        yield f"{self.path}/couple", columns
