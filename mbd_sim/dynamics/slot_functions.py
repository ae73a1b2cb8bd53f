"""The functions of slots: their values from the motions of parts, and what else functions of the rows take of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from mbd_sim.base.errors import InputError
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
from mbd_sim.dynamics.contact.rows.slots import MOTION, PoolCall, SlotCall
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism


@dataclass(frozen=True, eq=False)
class SlotVector:
    """The symbols of the vector that functions take: the `values` of slots, then what only compiled code knows.

    With pools that is the `wrenches` (6 parts, 2) of their forces and of what follows the forces in the solution. The
    `mobility` (rows,) is what readings with factors take: the diagonal of A without friction, for rows of sliding
    friction.
    """

    values: ca.SX
    wrenches: ca.SX
    more_wrenches: ca.SX
    mobility: ca.SX

    @cached_property
    def whole(self) -> ca.SX:
        """All of it."""
        return ca.vertcat(self.values, self.wrenches, self.more_wrenches, self.mobility)


def slot_vector(one_sided: OneSidedEquations) -> SlotVector:
    """New symbols for what follows the values of the slots of a mechanism."""
    parts, rows = 6 * one_sided.layout.parts, one_sided.layout.rows
    wrenches, more, mobility = (
        ca.SX.sym("wrenches", parts),
        ca.SX.sym("more_wrenches", parts),
        ca.SX.sym("mobility", rows),
    )
    return SlotVector(one_sided.combined.slots.symbols, wrenches, more, mobility)


@dataclass(frozen=True, eq=False)
class SlotFunctions:
    """The values of slots: `motions(t, y, inputs)` gives those of parts, of which each of the `calls` takes some.

    The vector of `size` components has more behind the values, see `SlotVector`. The first value of a slot that
    is not in use is the length `unused` in m, and all others are zero. The numbers of the pairs of the slots of `pools`
    are among the inputs from `first_holder` on; each of these slots has some of the `rows_of_pools`.
    """

    motions: ca.Function
    calls: tuple[SlotCall, ...]
    pools: tuple[PoolCall, ...]
    rows_of_pools: tuple[tuple[int, ...], ...]
    first_holder: int
    size: int
    unused: float
    first_number: int

    def values(self, t: ca.SX, y: ca.SX, inputs: ca.SX) -> ca.SX:
        """The vector as an expression, with zeros behind the values."""
        if self.pools:
            pool = self.pools[0].pool
            pairs = f"contacts '{pool.name}': the {len(pool.pairs)} pairs share their slots"
            message = f"{pairs}, so that their rows are not known as equations"
            raise InputError(message, "Name the pairs that matter with 'between'.")
        motions = ca.vertsplit(self.motions.call([t, y, inputs])[0], MOTION)
        found, given = [ca.SX(0, 1)], inputs[: self.calls[0].function.nnz_in(1)] if self.calls else inputs
        for call in self.calls:
            first = self.first_number + call.numbers
            numbers = inputs[first : first + call.function.nnz_in(2)]
            found += call.function.call([t, given, numbers, *(motions[part] for part in call.parts)])
        values = ca.vertcat(*found)
        return ca.densify(ca.vertcat(values, ca.SX(self.size - values.shape[0], 1)))


def slot_functions(traced: TracedMechanism, one_sided: OneSidedEquations, size: int) -> SlotFunctions:
    """The functions of the slots of a mechanism.

    :param size: of the vector.
    """
    slots, layout, start = one_sided.combined.slots, one_sided.layout, traced.input_layout.one_sided.start
    motions = ca.vertcat(ca.SX(0, 1), *slots.motions.values) if slots.slots else ca.SX(0, 1)
    inputs = [traced.state.t, traced.y, traced.inputs]
    return SlotFunctions(
        motions=ca.Function("part_motions", inputs, [ca.densify(motions)], {"cse": True}),
        calls=slots.calls,
        pools=slots.pools,
        rows_of_pools=tuple(rows_of_pools(one_sided)),
        first_holder=start + layout.holders.start,
        size=size,
        unused=slots.unused,
        first_number=start + layout.features.start,
    )


def rows_of_pools(one_sided: OneSidedEquations) -> list[tuple[int, ...]]:
    """The rows of each slot of the pools: its gap, and its slip."""
    slips = {element.gap: element.rows for element in one_sided.frictions}
    gaps = [index for index, gap in enumerate(one_sided.gaps) if gap.pool is not None]
    return [(gap, *slips.get(gap, ())) for gap in gaps]


def with_wrenches(forces: ca.SX, wrenches: ca.SX) -> ca.SX:
    """Forces of a basis of rows, with wrenches on the parts of its first columns."""
    rest = forces.shape[0] - wrenches.shape[0]
    return forces + ca.vertcat(wrenches, ca.SX(rest, 1)) if wrenches.shape[0] else forces
