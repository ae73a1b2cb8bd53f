"""Steps of the members of an ensemble, in the subset of Python that is compiled."""

from __future__ import annotations

from typing import cast

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts
from mbd_sim.simulation.contact.compiled.step import CAPACITY, DONE, FIELDS, NOT_FINITE, advance
from mbd_sim.simulation.contact.compiled.time_stepping import advance_by_time_stepping


def advance_members(
    contacts: Integers, slots: int, y: Array, inputs: Array, inputs_size: int, estimates: Array, alive: Array,
    members: Integers, count: int, first: int, h: float, steps: int, left: Integers,
) -> int:  # fmt: skip
    """Take steps of some members; the number of those that are `left`, because a step of theirs is not simple.

    These are restored, and so are those whose state does not stay finite, which are no longer `alive`.

    :param contacts: one record (`slots`,) after the other.
    :param y: and the other arrays have one row for each member.
    :param members: the indices of these members.
    """
    size, found = cast("Contacts", contacts).size, 0
    kept, saved = zeros(size), zeros(inputs_size)
    events, counts = zeros(CAPACITY * FIELDS), integers(2)
    for position in range(count):
        member = members[position]
        if alive[member] == 0.0:
            continue
        c = cast("Contacts", contacts[member * slots :])
        own, given = y[member * size :], inputs[member * inputs_size :]
        for i in range(size):
            kept[i] = own[i]
        for i in range(inputs_size):
            saved[i] = given[i]
        if c.time_stepping:
            advance_by_time_stepping(c, own, given, first, h, steps, estimates[member:], events, counts)
        else:
            advance(c, own, given, first, h, steps, estimates[member:], events, counts)
        if counts[1] == DONE:
            continue
        for i in range(size):
            own[i] = kept[i]
        for i in range(inputs_size):
            given[i] = saved[i]
        if counts[1] == NOT_FINITE:
            alive[member] = 0.0
        else:
            left[found] = member
            found += 1
    return found
