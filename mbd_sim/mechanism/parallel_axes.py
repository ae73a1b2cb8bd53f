"""How bodies with axes lie to each other in contact, as some configurations of a mechanism show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.mechanism.elements.contacts import Barrel, Cam, Contact
from mbd_sim.mechanism.elements.parts import GROUND

PARALLEL = 1e-5  # rad, and of their sizes, by which axes may tilt and ends move: the digits that people write

Poses = Mapping[str, Pose]  # of the parts, and of ground


def axes_and_offset(contact: Contact, poses: Poses) -> tuple[Array, Array, float]:
    """The axes (3,) of both bodies, and how far in m the first is along the second's."""
    first, second = contact.first, contact.second
    frames = [poses[body.at.part] for body in (first, second)]
    places = [
        frame.position + product(frame.rotation, body.at.point)
        for frame, body in zip(frames, (first, second), strict=True)
    ]
    other = second.axes[:, 2] if isinstance(second, Cam) else second.axis if isinstance(second, Barrel) else np.zeros(3)
    axes = [
        product(frames[0].rotation, first.axis if isinstance(first, Barrel) else other),
        product(frames[1].rotation, other),
    ]
    return axes[0], axes[1], float(product(axes[1], places[0] - places[1]))


def are_thin_barrels(contact: Contact) -> bool:
    """Whether both bodies are discs or rings, without thickness."""
    return all(isinstance(body, Barrel) and body.length == 0.0 for body in (contact.first, contact.second))


def stay_in_a_plane(contact: Contact, trials: Sequence[Poses]) -> bool:
    """Whether two discs or rings stay in one plane, of any direction."""
    placed = [axes_and_offset(contact, poses) for poses in trials]
    tilt = max(norm(np.cross(one, other)) for one, other, _ in placed)
    radius: float = getattr(contact.second, "radius", 0.0)
    return tilt <= PARALLEL and max(abs(along) for _, _, along in placed) <= PARALLEL * radius


def with_ground(poses: Poses) -> Poses:
    """The poses, and that of ground."""
    return {GROUND: Pose(np.zeros(3), np.eye(3)), **poses}
