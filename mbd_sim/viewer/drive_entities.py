"""Motors on joints, and bushings."""

from __future__ import annotations

from collections.abc import Iterator

from mbd_sim.appearance import palette
from mbd_sim.appearance.drives import Housing, bushing_ring, driven_coordinates, motor_housing, shown_bushings
from mbd_sim.viewer import entity_paths, rerun_shapes
from mbd_sim.viewer.entity import Entity, LoggedItems
from mbd_sim.viewer.part_poses import PartPoses
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription


def drive_entities(scene: SceneDescription) -> Iterator[Entity]:
    """A housing on the axis of each coordinate with a motor or an effort, and a ring for each bushing."""
    mechanism, size = scene.mechanism, scene.extent.size
    for name, joint, coordinate in driven_coordinates(mechanism):
        yield _HousingEntity("actuators", name, motor_housing(mechanism, joint, coordinate, size), palette.DRIVEN)
    for bushing in shown_bushings(mechanism):
        yield _HousingEntity("bushings", bushing.name, bushing_ring(bushing, size), palette.DAMPER)


class _HousingEntity:
    """A cylinder in the frame of the part that carries it: only the part moves."""

    def __init__(self, kind: str, name: str, housing: Housing, color: palette.Color) -> None:
        self._path = f"{entity_paths.part(housing.part)}/{kind}/{entity_paths.word(name)}"
        self._housing, self._color = housing, color

    def static(self) -> LoggedItems:
        housing = self._housing
        yield self._path, rerun_shapes.cylinder(housing.pose, housing.length, housing.radius, self._color)

    def columns(self, rows: Rows, poses: PartPoses) -> LoggedItems:
        yield from ()
