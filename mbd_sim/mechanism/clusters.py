"""Corners, balls and rims of a part against a plane that share slots, because few of them touch it at a time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.convex_hull import convex_hull
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.mechanism.elements.contacts import Ball, Cluster, Contact, Rim
from mbd_sim.mechanism.elements.parts import Attachment, Joint
from mbd_sim.mechanism.touching import welded

ALONE = 16  # corners of a shape that have rows of their own: with 20 of them, the first start takes 20 s
MOST_SLOTS = 8  # of a cluster
RIM_SLOTS = 6  # of a rim, see `shapes.POINTS`
CORNERS = 1000  # at most, of the hull of a part


def clustered(contacts: Sequence[Contact], joints: Iterable[Joint], *, welds: bool) -> list[Contact]:
    """The contacts with a plane, with clusters in place of many contacts that belong together.

    :param welds: everything that is welded together belongs together, and what can never touch first is left out;
        otherwise each shape for itself.
    """
    groups = welded(joints) if welds else {}
    together: dict[str, list[Contact]] = {}
    for contact in contacts:
        together.setdefault(_place(contact, groups)[0] if welds else contact.names[0], []).append(contact)
    found: list[Contact] = []
    for first, several in together.items():
        if not welds and len(several) <= ALONE:
            found += several
            continue
        kept = _outermost(several, [_placed(contact, groups) for contact in several])
        owners = dict.fromkeys(contact.first.at.part for contact in kept)
        own = groups if len(owners) > 1 else {}
        bodies = [body for contact in kept if (body := _placed(contact, own)) is not None]
        slots, count = _slots(bodies), sum(RIM_SLOTS if isinstance(body, Rim) else 1 for body in bodies)
        if count <= slots:
            found += kept
            continue
        part, plane = (first if len(owners) > 1 else next(iter(owners))), kept[0].names[1]
        names = dict.fromkeys(contact.names[0] for contact in kept if isinstance(contact.first, Ball | Rim))
        name = kept[0].names[0] if len({contact.names for contact in kept}) == 1 else part
        found.append(
            replace(
                kept[0],
                quantity=f"{name} on {plane}".replace(".", "_"),
                names=(name, plane),
                first=Cluster(Attachment(part, np.zeros(3)), tuple(bodies), tuple(names)),
                slots=slots,
            )
        )
        found += [contact for contact in kept if not isinstance(contact.first, Ball | Rim)]
    return found


def _place(contact: Contact, groups: dict[str, tuple[str, Pose]]) -> tuple[str, Pose]:
    part = contact.first.at.part
    return groups.get(part, (part, identity_pose()))


def _placed(contact: Contact, groups: dict[str, tuple[str, Pose]]) -> Ball | Rim | None:
    """The ball or rim of a contact in the frame of the first part of its group; None for other bodies."""
    body, (part, pose) = contact.first, _place(contact, groups)
    if not isinstance(body, Ball | Rim):
        return None
    at = Attachment(part, pose.position + product(pose.rotation, body.at.point))
    return (
        replace(body, at=at) if isinstance(body, Ball) else replace(body, at=at, axis=product(pose.rotation, body.axis))
    )


def _outermost(contacts: Sequence[Contact], bodies: Sequence[Ball | Rim | None]) -> list[Contact]:
    """Without points inside balls, or inside the hull of other points: no plane touches them first."""
    balls = [body for body in bodies if isinstance(body, Ball)]
    points = np.array([body.at.point for body in balls if not body.radius]).reshape(-1, 3)
    corners = {tuple(points[index].tolist()) for index in _corners(points)}

    def is_hidden(body: Ball | Rim | None) -> bool:
        if not isinstance(body, Ball):
            return False
        if not body.radius and tuple(body.at.point.tolist()) not in corners:
            return True
        return any(
            other.radius > body.radius and norm(other.at.point - body.at.point) + body.radius <= other.radius
            for other in balls
        )

    return [contact for contact, body in zip(contacts, bodies, strict=True) if not is_hidden(body)]


def _corners(points: Array) -> Iterable[int]:
    """The places of the points that are corners of their hull; all, if they lie in a plane."""
    try:
        return convex_hull(points, CORNERS).corners if len(points) > 3 else range(len(points))
    except InputError:
        return range(len(points))


def _slots(bodies: Iterable[Ball | Rim]) -> int:
    """How many of the bodies can touch a plane at once, at most `MOST_SLOTS`."""
    balls = [body for body in bodies if isinstance(body, Ball)]
    rims = sum(isinstance(body, Rim) for body in bodies)
    points = np.array([body.at.point for body in balls if not body.radius]).reshape(-1, 3)
    try:
        flat = max(map(len, convex_hull(points, CORNERS).faces), default=0) if len(points) > 3 else len(points)
    except InputError:
        flat = len(points)
    return min(MOST_SLOTS, flat + sum(body.radius > 0.0 for body in balls) + RIM_SLOTS * (rims > 0))
