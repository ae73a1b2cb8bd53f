"""Quantities of a run by name, for all runs of a sweep at once: of their states at one time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from operator import attrgetter

import numpy as np

from mbd_sim.errors import MbdSimError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.contact_records import ContactChange, ContactEvent
from mbd_sim.simulation.ensemble import Ensemble
from mbd_sim.simulation.state_records import EnsembleDrive, EnsembleEnergies, EnsembleMotion, Losses, Reaction

AXES = ("x", "y", "z")
EVENTS = "events."


class EventCounts:
    """Counts the events at the contacts of one run."""

    def __init__(self) -> None:
        self.of: Counter[ContactChange] = Counter()

    def impact(self, time: float, before: float, after: float) -> None:
        """Nothing: the impulses of an impact come as events."""

    def event(self, event: ContactEvent) -> None:
        """Count an event."""
        self.of[event.change] += 1


class Sample:
    """The states of all runs at one time; what several quantities need is computed once."""

    def __init__(self, ensemble: Ensemble, counts: Sequence[EventCounts]) -> None:
        self._ensemble, self._counts = ensemble, counts
        self._motions: dict[str, EnsembleMotion] = {}

    @cached_property
    def positions(self) -> Array:
        """The coordinates (runs, nv): see `Model.coordinates`."""
        return coordinates(self._ensemble)

    @cached_property
    def velocities(self) -> Array:
        """The generalized speeds (runs, nv)."""
        return np.asarray(self._ensemble.u)

    @cached_property
    def energies(self) -> EnsembleEnergies:
        """The energy audit."""
        return self._ensemble.energies

    @cached_property
    def losses(self) -> Losses:
        """The energies that impacts and dry friction have dissipated."""
        return self._ensemble.losses()

    @cached_property
    def drives(self) -> Mapping[str, EnsembleDrive]:
        """The driven coordinates."""
        return self._ensemble.drives()

    @cached_property
    def reactions(self) -> Mapping[str, Reaction]:
        """The loads of the joints."""
        return self._ensemble.reactions()

    def motion(self, frame: str) -> EnsembleMotion:
        """The motion of a part or of one of its points."""
        if frame not in self._motions:
            self._motions[frame] = self._ensemble.motion(frame)
        return self._motions[frame]

    def events(self, change: ContactChange) -> Array:
        """The number (runs,) of events of a kind so far."""
        return np.array([float(counts.of[change]) for counts in self._counts])


Quantity = Callable[[Sample], Array]


def coordinates(ensemble: Ensemble) -> Array:
    """The coordinates (members, nv): see `Model.coordinates`."""
    if not ensemble.model.quaternions:
        return np.asarray(ensemble.q)
    return np.array([ensemble.model.coordinates(y) for y in ensemble.state])


def quantities(mechanism: Mechanism) -> dict[str, Quantity]:
    """Every quantity of a mechanism that a sweep can sample, by its name; in SI units, vectors in ground's axes."""
    found: dict[str, Quantity] = {}
    for index, name in enumerate(mechanism.coordinate_names):
        found[f"positions.{name}"] = partial(_coordinate, index)
        found[f"velocities.{name}"] = partial(_speed, index)
    for record in (("energies", EnsembleEnergies), ("losses", Losses)):
        found |= {f"{record[0]}.{entry}": attrgetter(f"{record[0]}.{entry}") for entry in record[1]._fields}
    for name in mechanism.driven_names:
        found |= {f"drives.{name}.{entry}": partial(_drive, name, entry) for entry in EnsembleDrive._fields}
    for joint in (*mechanism.joints, *mechanism.closing):
        for vector in Reaction._fields:
            found[f"reactions.{joint}.{vector}"] = partial(_reaction, joint, vector, None)
            for axis, letter in enumerate(AXES):
                found[f"reactions.{joint}.{vector}.{letter}"] = partial(_reaction, joint, vector, axis)
    for part, body in mechanism.parts.items():
        for frame in (part, *(f"{part}.{point}" for point in body.points)):
            found |= {f"points.{frame}.{letter}": partial(_place, frame, axis) for axis, letter in enumerate(AXES)}
            found[f"points.{frame}.speed"] = partial(_size, frame, "velocity")
            found[f"points.{frame}.acceleration"] = partial(_size, frame, "acceleration")
    return found | {f"{EVENTS}{change.name.lower()}": partial(_events, change) for change in ContactChange}


def named_quantities(mechanism: Mechanism, names: Sequence[str]) -> dict[str, Quantity]:
    """The quantities of these names.

    :raises MbdSimError: there is no such quantity; the nearest name is suggested.
    """
    known = quantities(mechanism)
    for name in names:
        if name not in known:
            raise MbdSimError(
                f"there is no quantity '{name}'. {nearest(name, known)} Quantities are positions.…, velocities.…, "
                "energies.…, losses.…, drives.…, reactions.…, points.… and events.…."
            )
    return {name: known[name] for name in names}


def _coordinate(index: int, sample: Sample) -> Array:
    return sample.positions[:, index]


def _speed(index: int, sample: Sample) -> Array:
    return sample.velocities[:, index]


def _drive(name: str, entry: str, sample: Sample) -> Array:
    values: Array = getattr(sample.drives[name], entry)
    return values


def _reaction(joint: str, vector: str, axis: int | None, sample: Sample) -> Array:
    """A component of the load of a joint, or its absolute value."""
    values: Array = getattr(sample.reactions[joint], vector)
    return _lengths(values) if axis is None else values[:, axis]


def _place(frame: str, axis: int, sample: Sample) -> Array:
    return sample.motion(frame).position[:, axis]


def _size(frame: str, vector: str, sample: Sample) -> Array:
    values: Array = getattr(sample.motion(frame), vector)
    return _lengths(values)


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _events(change: ContactChange, sample: Sample) -> Array:
    return sample.events(change)
