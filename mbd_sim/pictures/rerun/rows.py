"""What the simulation's process and the viewer's send each other: samples as rows of numbers, and other messages.

A message has a kind, a length, and bytes. To the viewer go first the scene description and the sink, pickled; then rows
of samples as raw numbers (one row for each sample of a motion), events and measurements of sensors as JSON, and
numbered requests to flush what was sent before. Lines of JSON come back.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import IO, TYPE_CHECKING

import numpy as np

from mbd_sim.base.geometry.pose import Array, unpack_poses

if TYPE_CHECKING:
    from mbd_sim.simulation.model.model import Model
    from mbd_sim.simulation.model.state_records import Energies


ENERGY_NUMBERS = 7  # numbers of `Energies`
FIELDS = ("times", "energies", "y", "inputs", "poses", "drives", "contacts", "reactions")


@dataclass(frozen=True)
class RowLayout:
    """The layout of a row; SI units throughout.

    `times` are the time on the timeline and the mechanism's own; `energies` the fields of `Energies`; `poses` the
    position and the rotation matrix, column by column, of each of `parts`; `drives` the positions, speeds and forces of
    the driven coordinates; `contacts` the point and the force of each contact that has a place; `reactions` the force
    and moment through each joint, those of the tree first.
    """

    state: int
    inputs: int
    parts: int
    driven: int
    contacts: int
    joints: int

    @cached_property
    def slices(self) -> Mapping[str, slice]:
        """The slice of a row that each of `FIELDS` occupies."""
        sizes = (
            *(2, ENERGY_NUMBERS, self.state, self.inputs, 12 * self.parts),
            *(3 * self.driven, 6 * self.contacts, 6 * self.joints),
        )
        stops = np.cumsum(sizes).tolist()
        return {name: slice(stop - size, stop) for name, size, stop in zip(FIELDS, sizes, stops, strict=True)}

    @cached_property
    def width(self) -> int:
        """The number of columns."""
        return int(self.slices[FIELDS[-1]].stop)


class RowWriter:
    """Makes rows from the states of a model with as little work as possible: the simulation may be waiting."""

    def __init__(self, model: Model, reactions: bool = False) -> None:
        joints = len(model.mechanism.all_joints) if reactions else 0
        contacts = len(model.contact_readings.placed)
        self.layout = RowLayout(
            len(model.start), len(model.inputs), len(model.part_names), len(model.driven_names), contacts, joints
        )
        self._model, self._reactions = model, reactions
        self._energies, self._y, self._inputs, self._poses, self._drives, self._contacts, self._forces = (
            self.layout.slices[name] for name in FIELDS[1:]
        )

    def row(self, time: float, motion_time: float, y: Array, inputs: Array, energies: Energies) -> Array:
        """A row (width,); `inputs` may end after the efforts where nothing else is commanded."""
        model, row = self._model, np.empty(self.layout.width)
        if len(inputs) < len(model.inputs):
            inputs = np.concatenate([inputs, model.inputs[len(inputs) :]])
        row[0], row[1] = time, motion_time
        row[self._energies] = energies
        row[self._y], row[self._inputs] = y, inputs
        row[self._poses] = model.pose_array(motion_time, y, inputs).ravel()
        if self.layout.driven:
            row[self._drives] = model.drives(motion_time, y, inputs).ravel()
        if self.layout.contacts:
            row[self._contacts] = model.contact_readings.places(motion_time, y, inputs).ravel()
        if self._reactions:
            found = model.reactions(motion_time, y, inputs).values()
            row[self._forces] = np.concatenate([part for reaction in found for part in reaction])
        return row


class Rows:
    """Samples (n, width), accessed by field."""

    def __init__(self, layout: RowLayout, values: Array) -> None:
        self._layout, self.values = layout, values

    def __len__(self) -> int:
        return len(self.values)

    def of(self, field: str) -> Array:
        """A field, (n, its size)."""
        return self.values[:, self._layout.slices[field]]

    @property
    def times(self) -> Array:
        """The times on the timeline, (n,), s."""
        return self.values[:, 0]

    @property
    def motion_times(self) -> Array:
        """The mechanism's own times, (n,), s."""
        return self.values[:, 1]

    @cached_property
    def positions(self) -> Array:
        """The positions of the parts in ground's frame, (n, parts, 3), m."""
        return unpack_poses(self.of("poses").reshape(len(self), -1, 12))[0]

    @cached_property
    def rotations(self) -> Array:
        """The rotation matrices of the parts in ground's frame, (n, parts, 3, 3)."""
        return unpack_poses(self.of("poses").reshape(len(self), -1, 12))[1]


HEADER = struct.Struct("<cQ")
SCENE, ROWS, EVENTS, MEASUREMENTS, FLUSH = b"S", b"R", b"E", b"M", b"F"


def pack(kind: bytes, payload: bytes) -> bytes:
    """A message as bytes."""
    return HEADER.pack(kind, len(payload)) + payload


def read(stream: IO[bytes]) -> tuple[bytes, bytes] | None:
    """The next message; None at the end of the stream, or when it ends within a message."""
    header = stream.read(HEADER.size)
    if len(header) < HEADER.size:
        return None
    kind, size = HEADER.unpack(header)
    payload = stream.read(size)
    return (kind, payload) if len(payload) == size else None
