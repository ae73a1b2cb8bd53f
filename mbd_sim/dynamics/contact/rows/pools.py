"""Pools of slots, for groups of many bodies that can all touch each other.

Of n bodies, n (n - 1) / 2 pairs can touch, and each at several points; but few do at a time. Pairs of solids have one
expression for all of their slots. So a slot needs no pair of its own: it belongs to the pair whose number is among the
inputs, and this pair is known when the slot's values are computed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbd_sim.base.errors import Problem, counted, listed, quoted
from mbd_sim.dynamics.math.spatial import is_absent, is_symbolic
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import Ball, Contact, ContactBody, Solid
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.source import Source

MOST_ROWS = 1200  # of slots, of gaps and friction together: of those of all pairs, and again of all pools
OWN_ROWS = 200  # of the pairs of an entry of the file, up to which each pair has slots of its own
BALLS, SOLIDS = 4, 8  # slots of a pool for each body: a heap of balls has some three contacts for each ball


@dataclass(frozen=True, eq=False)
class SlotPool:
    """The `slots` that the `pairs` of solids share; all have the same law.

    `lacking` is what is wrong where bodies touch in more points.
    """

    pairs: tuple[Contact, ...]
    slots: int
    lacking: Problem

    @property
    def name(self) -> str:
        """That of the entry of the file."""
        return self.pairs[0].name

    @property
    def parts(self) -> tuple[str, ...]:
        """The parts of the pairs other than ground, each once."""
        found = dict.fromkeys(body.at.part for pair in self.pairs for body in (pair.first, pair.second))
        return tuple(part for part in found if part != GROUND)

    @property
    def example(self) -> Contact:
        """A pair of which both parts move, with the rows of all."""
        return next(pair for pair in self.pairs if GROUND not in _parts(pair))


def pooled(contacts: Iterable[Contact], mechanism: Mechanism) -> tuple[list[Contact], list[SlotPool]]:
    """Rigid contacts that have rows of their own, and the pools of the others.

    Pools are for bodies that move freely in space: between them no direction of slip can be missing.
    """
    kept, shared = list[Contact](), list[list[Contact]]()
    by_name: dict[str, list[Contact]] = {}
    for contact in contacts:
        by_name.setdefault(contact.name, []).append(contact)
    loaded = any(_has_loaded_friction(joint) for joint in mechanism.joints.values())
    free = {joint.outboard for joint in mechanism.joints.values() if joint.type == "free" and not joint.drive}
    for own in by_name.values():
        pairs = [_of_solids(contact) for contact in own if _can_share(contact, free)]
        rows = sum(max(pair.slots, 1) for pair in pairs) * _rows_of_a_slot(own[0])
        if rows <= OWN_ROWS or loaded or all(GROUND in _parts(pair) for pair in pairs):
            kept += own
            continue
        kept += [contact for contact in own if not _can_share(contact, free)]
        shared.append(pairs)
    return kept, _pools(shared, mechanism.source)


def _pools(groups: Sequence[Sequence[Contact]], source: Source) -> list[SlotPool]:
    """The pools of groups of pairs; where they would have too many rows together, each has its share of these."""
    wanted = [_wanted_slots(pairs) for pairs in groups]
    rows = sum(slots * _rows_of_a_slot(pairs[0]) for slots, pairs in zip(wanted, groups, strict=True))
    names = listed([quoted(pairs[0].name) for pairs in groups])
    together = f", and the slots that the pairs of {names} share may have {MOST_ROWS} rows together"
    pools = []
    for pairs, slots in zip(groups, wanted, strict=True):
        own = slots if rows <= MOST_ROWS else max(1, slots * MOST_ROWS // rows)
        message = f"bodies touch in more than {counted(own, 'point')} at once{together if own < slots else ''}"
        remedy = "Name the pairs that matter with 'between'."
        problem = source.problem(("contacts", pairs[0].name), message, remedy)
        pools.append(SlotPool(tuple(pairs), own, problem))
    return pools


def _wanted_slots(pairs: Sequence[Contact]) -> int:
    bodies = [body for pair in pairs for body in (pair.first, pair.second) if isinstance(body, Solid)]
    for_each = BALLS if all(len(body.vertices) == 1 for body in bodies) else SOLIDS
    return min(for_each * len({body.at.part for body in bodies}), sum(pair.slots for pair in pairs))


def _rows_of_a_slot(contact: Contact) -> int:
    assert isinstance(contact.law, ContactLaw)
    return 1 if is_absent(contact.law.static_friction) else 3


def _parts(contact: Contact) -> tuple[str, str]:
    return contact.first.at.part, contact.second.at.part


def _can_share(contact: Contact, free: set[str]) -> bool:
    """Whether both bodies are solids or balls of numbers, on parts that move freely or on ground."""
    bodies = contact.first, contact.second
    if (
        contact.inside
        or contact.still is not None
        or not all(part in free or part == GROUND for part in _parts(contact))
    ):
        return False
    return all(isinstance(body, Solid) or (isinstance(body, Ball) and not _is_live(body)) for body in bodies)


def _has_loaded_friction(joint: Joint) -> bool:
    law = joint.friction
    return law is not None and law.sticks and not is_absent(law.static_coefficient)


def _is_live(ball: Ball) -> bool:
    return bool(is_symbolic(ball.at.point, ball.radius))


def _of_solids(contact: Contact) -> Contact:
    """The contact with balls as solids of one vertex."""
    bodies = _solid(contact.first), _solid(contact.second)
    return replace(contact, first=bodies[0], second=bodies[1], slots=max(contact.slots, 1))


def _solid(body: ContactBody) -> ContactBody:
    if not isinstance(body, Ball):
        return body
    at = Attachment(body.at.part, np.zeros(3))
    return Solid(at, np.array([body.at.point], dtype=float), (), body.radius)
