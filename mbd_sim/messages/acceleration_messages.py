"""The message of accelerations: of the coordinates, and of parts and their points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.errors import InputError
from mbd_sim.geometry.pose import Array, Pose, unpack_poses
from mbd_sim.mechanism.names import readings, reference
from mbd_sim.mechanism.records import GROUND, Mechanism
from mbd_sim.mechanism_file.override import with_values
from mbd_sim.messages.snapshot import Snapshot
from mbd_sim.messages.state_messages import StateWriter, labeled_array
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.joint_state_layout import joint_state_names
from mbd_sim.simulation.part_motion import named_frame
from mbd_sim.simulation.state_records import Energies

COORDINATES = "coordinates"  # stands for all coordinates
ALL = "*"


class Accelerations:
    """The accelerations that are requested, as labels and numbers.

    With `coordinates` in the request, those of the joint states come first, in their order, m/s² or rad/s². The
    acceleration of each frame has three numbers, in m/s² and ground's axes.
    """

    def __init__(self, model: Model, requested: Sequence[str]) -> None:
        """Find what the names stand for: `coordinates`, parts, points as `part.point`; `*` are all of them.

        :raises InputError: there is no such part or point.
        """
        names = [COORDINATES, *_frames(model.mechanism)] if ALL in requested else list(dict.fromkeys(requested))
        self._model = model
        self.coordinates = joint_state_names(model) if COORDINATES in names else ()
        self._frames = [name for name in names if name != COORDINATES]
        self._live: Mapping[str, float] = {}
        self._place_frames(model.mechanism)

    @property
    def labels(self) -> tuple[str, ...]:
        """A label for each coordinate and each frame."""
        return (*self.coordinates, *self._frames)

    @property
    def sizes(self) -> list[int]:
        """How many numbers each label stands for."""
        return [1] * len(self.coordinates) + [3] * len(self._frames)

    def _place_frames(self, mechanism: Mechanism) -> None:
        """Find the number of each frame's part, and its origin (3,) in that part."""
        frames = [_moving_frame(mechanism, name) for name in self._frames]
        self._parts = [self._model.part_names.index(part) for part, _ in frames]
        self._origins = np.array([pose.position for _, pose in frames]).reshape(-1, 3)

    def write(self, values: Array, time: float, y: Array, inputs: Array, live: Mapping[str, float]) -> None:
        """Write the accelerations (n,) in a state; the places of points follow the live values by key."""
        if self._frames and live != self._live:
            self._live = live
            self._place_frames(with_values(self._model.mechanism, live))
        first = len(self.coordinates)
        if first:
            values[:first] = self._model.accelerations(time, y, inputs)
        if self._frames:
            _, rotations = unpack_poses(self._model.pose_array(time, y, inputs)[self._parts])
            arms = np.einsum("nij,nj->ni", rotations, self._origins)
            _, turning, acceleration, angular = self._model.motion_rows(time, y, inputs)[self._parts].swapaxes(0, 1)
            found = acceleration + _cross(angular, arms) + _cross(turning, _cross(turning, arms))
            values[first:] = found.reshape(-1)


def accelerations(model: Model, requested: Sequence[str]) -> StateWriter:
    """The requested accelerations, labeled: see `Accelerations`.

    :raises InputError: there is no such part or point.
    """
    source = Accelerations(model, requested)
    message, values = labeled_array(source.labels, source.sizes)

    def write(snapshot: Snapshot, energies: Energies) -> None:
        source.write(values, snapshot.time, snapshot.point.state, snapshot.point.inputs, snapshot.point.live)

    return StateWriter(message, write)


def requested_by(model: Model, labels: Sequence[str]) -> list[str]:
    """The names that give a message these labels."""
    coordinates = joint_state_names(model)
    if labels and tuple(labels[: len(coordinates)]) == coordinates:
        return [COORDINATES, *labels[len(coordinates) :]]
    return list(labels)


def _cross(first: Array, second: Array) -> Array:
    """The cross products of rows (n, 3); `np.cross` takes several times as long for few rows."""
    after, last = [1, 2, 0], [2, 0, 1]
    found: Array = first[:, after] * second[:, last] - first[:, last] * second[:, after]
    return found


def _frames(mechanism: Mechanism) -> list[str]:
    return [
        name
        for part in mechanism.parts.values()
        for name in (reference(part.name), *(reference(part.name, point) for point in part.points))
    ]


def _moving_frame(mechanism: Mechanism, name: str) -> tuple[str, Pose]:
    named = [first for first, _ in readings(name)]
    if any(one in mechanism.all_joints for one in named) and not any(one in mechanism.parts for one in named):
        raise InputError(f"'{name}' is a joint", f"Write '{COORDINATES}' for the accelerations of all joints.")
    part, pose = named_frame(mechanism, name)
    if part == GROUND:
        raise InputError(f"'{name}' is on ground, which does not move", "Name a part, or a point of one.")
    return part, pose
