"""Where contacts are, and the forces that they exert there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.constraint_rows import ConstraintRow


@dataclass(frozen=True, eq=False)
class ContactPlace:
    """The place of a gap in ground's frame, all (3,): its `point` in m, its `normal`, and the `sides` of its slip rows.

    These are the directions of the forces that unit multipliers exert on the first part of the contact: that of the
    constrained point, of the wheel, or of the end of a rope.
    """

    point: ca.SX
    normal: ca.SX
    sides: tuple[ca.SX, ...] = ()


def placed_forces(
    places: Sequence[tuple[ContactPlace, Sequence[ConstraintRow]]],
    rows: Sequence[ConstraintRow],
    forces: ca.SX,
    in_state: Callable[[ca.SX], ca.SX],
) -> ca.SX:
    """The points in m and the forces in N (6, places), in ground's frame.

    :param places: each with the row of its gap, and those of its slip.
    :param rows: those that have multipliers; other slip cannot occur.
    :param forces: the multipliers λ (rows,).
    :param in_state: expresses expressions of the parts' poses in the state.
    """
    index, columns = {row: number for number, row in enumerate(rows)}, []
    for place, own in places:
        force = ca.SX(3, 1)
        for row, direction in zip(own, (place.normal, *place.sides), strict=False):
            if row in index:
                force += forces[index[row]] * in_state(direction)
        columns.append(ca.vertcat(in_state(place.point), force))
    return ca.horzcat(ca.SX(6, 0), *columns)
