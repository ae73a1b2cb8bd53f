"""The rows of slots: one function for all slots of a kind, of the motions of their two parts and of their numbers.

A slot has many numbers and few of them touch at a time, so its rows are not written out in the state. They are values
of a function that is evaluated only for slots in use. The wrench of a row acts on one or two parts, and what the
wrenches on a part do to the mechanism is the same for all rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca

from mbd_sim.dynamics.constraints.equations import ConstraintEquations
from mbd_sim.dynamics.constraints.rows import ConstraintRow, IteratedNormal
from mbd_sim.dynamics.contact.rows.pools import SlotPool
from mbd_sim.dynamics.kinematics.poses import BodySymbols, flat_pose, link_wrench, pose_rate, world_twist
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism

POSE, TWIST = 12, 6  # numbers of the motion of a part: its pose, its velocity, and the rate of that without u'
MOTION = POSE + 2 * TWIST


@dataclass(frozen=True, eq=False)
class PartMotions:
    """The motions (MOTION,) of the parts of some `links` in ground's axes, in the state.

    Symbols stand for them in the rows of slots, but not for what is constant across the plane of contacts of prisms,
    along the axis `still` of ground. Along all other components contacts exert wrenches, which a joint bears, and
    against which a drive works, also where the part does not move.
    """

    traced: TracedMechanism
    links: tuple[int, ...]
    still: int | None

    @cached_property
    def components(self) -> tuple[int, ...]:
        """The components of the wrenches that contacts exert."""
        if self.still is None:
            return tuple(range(TWIST))
        return tuple(sorted((self.still, *(3 + axis for axis in range(3) if axis != self.still))))

    def _is_across(self, place: int) -> bool:
        """Whether a number of a motion is across the plane of the contacts, so that their rows do not depend on it."""
        if self.still is None:
            return False
        if place < POSE:  # a position and a rotation
            return self.still in ((place,) if place < 3 else divmod(place - 3, 3))
        return (place - POSE) % TWIST not in self.components

    @cached_property
    def twists(self) -> list[ca.SX]:
        """The velocities (6,) of the parts."""
        traced = self.traced
        return [
            ca.densify(world_twist(traced.links[index], traced.motions[index], traced.poses[index]))
            for index in self.links
        ]

    @cached_property
    def values(self) -> list[ca.SX]:
        """The motions in the state."""
        return [
            ca.densify(ca.vertcat(flat_pose(self.traced.poses[index]), twist, self.traced.state.rate(twist)))
            for index, twist in zip(self.links, self.twists, strict=True)
        ]

    @cached_property
    def symbols(self) -> list[ca.SX]:
        """The symbols of the motions."""
        return [ca.SX.sym("motion", MOTION) for _ in self.links]

    @cached_property
    def entries(self) -> list[ca.SX]:
        """The symbols, with constants where the motions across the plane of the contacts are constant; sparse."""
        return [
            ca.sparsify(
                ca.vertcat(*(
                    value[k] if self._is_across(k) and value[k].is_constant() else symbol[k] for k in range(MOTION)
                ))
            )
            for value, symbol in zip(self.values, self.symbols, strict=True)
        ]  # fmt: skip

    def places(self, part: int) -> range:
        """The rows of a part among the `wrenches`."""
        count = len(self.components)
        return range(part * count, (part + 1) * count)

    @cached_property
    def wrenches(self) -> ConstraintEquations:
        """Unit wrenches along the `components`, part by part, as rows: only their gradients and wrenches."""
        traced, components = self.traced, list(self.components)
        count = len(components) * len(self.links)
        found = [ca.SX(6, count) for _ in traced.links]
        for part, index in enumerate(self.links):
            unit = link_wrench(traced.links[index], traced.poses[index], ca.SX.eye(6)[:, components])
            found[index][:, list(self.places(part))] = unit
        gradients = [ca.jacobian(twist[components], traced.state.u) for twist in self.twists]
        none = ca.SX(count, 1)
        return ConstraintEquations(
            rows=[ConstraintRow(("contacts", ""), "wrench")] * count,
            position=none,
            gradient=ca.sparsify(ca.vertcat(ca.SX(0, traced.layout.nv), *gradients)),
            velocity=none,
            bias=none,
            wrenches=[ca.sparsify(each) for each in found],
            driven_factors=dict.fromkeys(traced.mechanism.driven_names, none),
            own_rate=none,
            branch_checks=ca.SX(0, 1),
        )


@dataclass(frozen=True, eq=False)
class Slot:
    """The rows of a slot as expressions of the motions of its `parts`, by their indices among the `PartMotions`.

    All slots of a `kind` have the same expressions, of symbols for their `numbers`: the `features`.
    `position` is that of the first row; `velocity` and `bias` (k,) are of all, and `wrenches` (k, columns) for each
    part the factors of its unit wrenches. The parts of slots of a `pool` are those of its example only. The `place`
    (12,) of these is the point in m, the normal and the sides of the contact: see `ContactPlace`.
    """

    kind: tuple[int, ...]
    numbers: ca.SX
    features: ca.SX
    parts: tuple[int, ...]
    position: ca.SX
    velocity: ca.SX
    bias: ca.SX
    wrenches: Sequence[ca.SX]
    pool: SlotPool | None = None
    place: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    def select(self, rows: Sequence[int]) -> Slot:
        """The slot with some of its rows, of which the first one is always there."""
        kept = list(rows)
        own = [each[kept, :] for each in self.wrenches]
        kind = (*self.kind, *kept)
        return replace(self, kind=kind, velocity=self.velocity[kept], bias=self.bias[kept], wrenches=own)

    def gradient(self, motions: PartMotions) -> ca.SX:
        """The gradients (k, nv) of the rows."""
        found = ca.SX(self.velocity.shape[0], motions.traced.layout.nv)
        for part, own in zip(self.parts, self.wrenches, strict=True):
            found += own @ motions.wrenches.gradient[list(motions.places(part)), :]
        return ca.sparsify(found)

    @property
    def values(self) -> ca.SX:
        """All in one vector, the wrenches row by row."""
        by_row = ca.densify(ca.horzcat(*self.wrenches)).T
        return ca.densify(ca.vertcat(self.position, self.velocity, self.bias, ca.vec(by_row), self.place))

    def with_values(self, values: ca.SX) -> Slot:
        """The slot with symbols, or other expressions, in place of its values; what is zero remains so."""
        k, columns = self.velocity.shape[0], [each.shape[1] for each in self.wrenches]
        ends = [0, 1, 1 + k, 1 + 2 * k, 1 + (2 + sum(columns)) * k, values.shape[0]]
        position, velocity, bias, rest, _ = ca.vertsplit(values, ends)
        rows = ca.reshape(rest, sum(columns), k).T
        found, first = list[ca.SX](), 0
        for own, count in zip(self.wrenches, columns, strict=True):
            found.append(ca.SX(own.sparsity(), rows[:, first : first + count][own.sparsity()].nz[:]))
            first += count
        return replace(self, position=position, velocity=velocity, bias=bias, wrenches=found)


def written_slot(
    kind: int,
    rows: Sequence[ConstraintRow],
    numbers: ca.SX,
    parts: Sequence[int],
    motions: PartMotions,
    bodies: BodySymbols,
    time: ca.SX,
    place: ca.SX | None = None,
) -> Slot:
    """The rows of a slot, of which the first is its gap, in the motions of its parts.

    :param parts: their indices among the motions.
    :param place: see `Slot`; for slots of pools.
    """
    links, entries = [motions.links[part] for part in parts], [motions.entries[part] for part in parts]
    old = [ca.vertcat(bodies.poses[link], bodies.twists[link]) for link in links]
    known = [ca.densify(entry[: POSE + TWIST]) for entry in entries]

    def in_motions(expression: ca.SX | None) -> ca.SX:
        assert expression is not None
        return ca.sparsify(ca.substitute([expression], old, known)[0]) if links else ca.sparsify(expression)

    poses, twists = ca.SX(0, 1), ca.SX(0, 1)
    pose_rates, twist_rates = ca.SX(0, 1), ca.SX(0, 1)
    for part, entry in zip(parts, entries, strict=True):
        symbol = motions.symbols[part]
        poses, twists = ca.vertcat(poses, symbol[:POSE]), ca.vertcat(twists, symbol[POSE : POSE + TWIST])
        pose_rates = ca.vertcat(pose_rates, pose_rate(entry[:POSE], entry[POSE : POSE + TWIST]))
        twist_rates = ca.vertcat(twist_rates, entry[POSE + TWIST :])

    def rate(expression: ca.SX) -> ca.SX:
        """The rate of an expression of poses, or for one of velocities as well that without their rates."""
        by_time = ca.jacobian(expression, time)
        return ca.sparsify(ca.jtimes(expression, poses, ca.densify(pose_rates)) + by_time) if links else by_time

    normal = rows[0].normal
    position, slips = in_motions(rows[0].position), [row.velocity for row in rows[1:]]
    approach = rate(position) if normal is None else in_motions(rows[0].velocity)
    velocity = ca.sparsify(ca.vertcat(approach, *map(in_motions, slips)))
    bias = rate(velocity) + ca.jacobian(velocity, twists) @ twist_rates
    gradient = ca.sparsify(ca.jacobian(velocity, twists))
    if normal is not None:
        own = IteratedNormal(normal.symbols, in_motions(normal.value), in_motions(normal.step))
        bias += ca.jacobian(velocity, own.symbols) @ rate(own.step)
        position, velocity, bias, gradient = map(own.inserted, (position, velocity, bias, gradient))
    wrenches = [
        ca.sparsify(gradient[:, [TWIST * number + k for k in motions.components]]) for number in range(len(parts))
    ]
    known_place = ca.SX(0, 1) if place is None else in_motions(place)
    bias = ca.sparsify(bias)
    return Slot((kind,), numbers, numbers, tuple(parts), position, velocity, bias, wrenches, place=known_place)


@dataclass(frozen=True, eq=False)
class PoolCall:
    """How the values of the slots of a `pool` are found: as by a `SlotCall`, with the parts of a pair for each slot.

    `numbers` is where the numbers of the first slot begin among those of all slots, and `values` where its values do;
    those of other slots follow. The `pairs` are the parts of the pairs, among the motions; ground has a number beyond.
    """

    function: ca.Function
    pool: SlotPool
    numbers: int
    values: int
    pairs: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class SlotCall:
    """How the values of a slot are found: a function of t, the inputs, its numbers, and the motions of its parts.

    `numbers` is where its numbers begin among those of all slots, and `values` where its values do.
    """

    function: ca.Function
    numbers: int
    parts: tuple[int, ...]
    values: int


class Slots:
    """All slots of a mechanism, with the `calls` of their functions, those of `pools`, and symbols for their values.

    :param parts: the indices of the parts of pools among the motions, by their names.
    """

    def __init__(
        self, motions: PartMotions, slots: Sequence[Slot], time: ca.SX, unused: float, parts: Mapping[str, int]
    ) -> None:
        """:param unused: the position in m of slots that are not in use, all of whose numbers are zero."""
        self.motions, self.unused = motions, unused
        kinds: dict[str, ca.Function] = {}
        known: dict[tuple[int, ...], ca.Function] = {}
        calls, symbolic, symbols, first, number = list[SlotCall](), list[Slot](), list[ca.SX](), 0, 0
        pools: dict[SlotPool, PoolCall] = {}
        inputs = motions.traced.inputs
        for index, slot in enumerate(slots):
            if slot.kind not in known:
                given = [time, inputs, slot.features, *(motions.symbols[part] for part in slot.parts)]
                key = ca.Function("slot", given, [slot.values]).serialize()
                if key not in kinds:
                    kinds[key] = ca.Function(f"slot_{len(kinds)}", given, [slot.values], {"cse": True})
                known[slot.kind] = kinds[key]
            function = known[slot.kind]
            symbols.append(ca.SX.sym(f"slot_{index}", function.nnz_out(0)))
            if slot.pool is None:
                calls.append(SlotCall(function, number, slot.parts, first))
            elif slot.pool not in pools:
                pools[slot.pool] = PoolCall(function, slot.pool, number, first, _pairs(slot.pool, motions, parts))
            symbolic.append(slot.with_values(symbols[-1]))
            first, number = first + function.nnz_out(0), number + slot.numbers.shape[0]
        self.calls, self.slots, self.symbols = tuple(calls), tuple(symbolic), ca.vertcat(ca.SX(0, 1), *symbols)
        self.pools = tuple(pools.values())
        self._numbers, self._time = [slot.numbers for slot in slots], motions.traced.state.t

    @cached_property
    def values(self) -> ca.SX:
        """The values in the state."""
        found, inputs = [ca.SX(0, 1)], self.motions.traced.inputs
        for call, numbers in zip(self.calls, self._numbers, strict=False):
            motions = [self.motions.values[part] for part in call.parts]
            found += call.function.call([self._time, inputs, numbers, *motions])
        unknown = self.symbols.shape[0] - sum(each.shape[0] for each in found)
        return ca.vertcat(*found, ca.SX.nan(unknown, 1))  # of pools, which expressions in the state do not contain

    def written(self, expression: ca.SX) -> ca.SX:
        """An expression with the values in the state in place of their symbols."""
        return ca.sparsify(ca.substitute([expression], [self.symbols], [self.values])[0]) if self.calls else expression


def _pairs(pool: SlotPool, motions: PartMotions, parts: Mapping[str, int]) -> tuple[tuple[int, int], ...]:
    ground = len(motions.links)
    return tuple((parts.get(pair.first.at.part, ground), parts.get(pair.second.at.part, ground)) for pair in pool.pairs)
