"""Part of a step that is tried from a state on, in the subset of Python that is compiled."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.simulation.contact.compiled.contacts import PART_STEP, Contacts, read, read_poses

NONE = -1.0  # in place of the length up to an event


@dataclass(frozen=True)
class TrialPart:
    """The motion from a state on, for up to a length in s, which is `span[0]`.

    `before` are the readings at its start, `end` and `after` the state and the readings after this length, and `state`
    and `out` those after the `latest` other length that was tried. The poses of the parts in mechanisms with slots are
    `places_before`, `places_after` and `places`. `offset[0]` is added to a distance of which a zero is sought. `failed`
    is 1 if a state was not finite.
    """

    y: Array
    inputs: Array
    t: float
    span: Array
    before: Array
    end: Array
    after: Array
    latest: Array
    state: Array
    out: Array
    places_before: Array
    places_after: Array
    places: Array
    offset: Array
    failed: Integers


def begin(c: Contacts, m: TrialPart, length: float) -> None:
    """Find the state after a length, and the readings at both ends."""
    read(c, m.t, m.y, m.inputs, m.before)
    read_poses(c, m.t, m.y, m.inputs, m.places_before)
    m.latest[0] = NONE
    finish(c, m, length)


def finish(c: Contacts, m: TrialPart, length: float) -> None:
    """Let the motion end after another length."""
    m.span[0] = length
    try_length(c, m, length, m.end, m.after, m.places_after)


def try_length(c: Contacts, m: TrialPart, length: float, state: Array, out: Array, places: Array) -> None:
    """The state, the readings and the poses after a length in s."""
    for i in range(c.size):
        state[i] = m.y[i]
    if length != 0.0 and PART_STEP(c.part_step, state, m.inputs, m.t, length) < 0:
        m.failed[0] = 1
    read(c, m.t + length, state, m.inputs, out)
    read_poses(c, m.t + length, state, m.inputs, places)


def readings_at(c: Contacts, m: TrialPart, length: float) -> Array:
    """The readings after a length in s."""
    if length == 0.0:
        return m.before
    if length == m.span[0]:
        return m.after
    if length != m.latest[0]:
        m.latest[0] = length
        try_length(c, m, length, m.state, m.out, m.places)
    return m.out


def places_at(c: Contacts, m: TrialPart, length: float) -> Array:
    """The poses of all parts after a length in s."""
    readings_at(c, m, length)
    if length == 0.0:
        return m.places_before
    return m.places_after if length == m.span[0] else m.places


def has_failed(m: TrialPart) -> bool:
    """Whether a state was not finite."""
    return m.failed[0] != 0
