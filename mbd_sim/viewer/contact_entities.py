"""Contacts: the points where they touch, and their forces, while they are closed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.appearance.force_scale import pulls
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.source import Location
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.arrow_entities import ArrowStyle, weight
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription

POINT_RADIUS = 0.014  # relative to the mechanism's size


def contact_entities(scene: SceneDescription) -> Iterator[Entity]:
    """All contacts that have a place."""
    if scene.contacts:
        yield _Contacts(scene)


def is_closed(scene: SceneDescription, owner: Location, rows: Rows) -> Array:
    """In which of the n samples (n,) the contact of an element is closed; always if it is not one-sided."""
    own = [index for other, index in scene.contacts if other == owner and index is not None]
    if not own:
        return np.ones(len(rows), dtype=bool)
    return np.asarray((rows.of("inputs")[:, own] > 0.0).any(axis=1))


class _Contacts:
    """The closed contacts, as points and arrows. All share two entities, so that many contacts cost little."""

    def __init__(self, scene: SceneDescription) -> None:
        self._size = scene.extent.size
        self._inputs = [-1 if index is None else index for _, index in scene.contacts]
        self._compliant = np.array([index is None for _, index in scene.contacts], dtype=bool)
        self._pushes = np.array([not pulls(scene.mechanism, owner) for owner, _ in scene.contacts], dtype=bool)
        self._style = ArrowStyle(entity_paths.CONTACTS, palette.CONTACT, self._size, weight(scene))

    def static(self) -> LoggedItems:
        points = rr.Points3D.from_fields(radii=[POINT_RADIUS * self._size], colors=[palette.CONTACT])
        yield f"{entity_paths.CONTACTS}/points", points
        yield from self._style.static(couple=False)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        places = rows.of("contacts").reshape(len(rows), -1, 2, 3)
        points, forces = places[:, :, 0], places[:, :, 1]
        closed = np.where(self._compliant, forces.any(axis=2), rows.of("inputs")[:, self._inputs] > 0.0)
        columns = rr.Points3D.columns(positions=points[closed].reshape(-1, 3))
        yield f"{entity_paths.CONTACTS}/points", columns.partition(closed.sum(axis=1))
        yield from self._style.force(points, forces, self._pushes)
