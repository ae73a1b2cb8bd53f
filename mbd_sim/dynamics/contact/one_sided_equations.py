"""The one-sided rows in generalized coordinates, and how their modes make them active, sliding or absent."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError
from mbd_sim.dynamics.constraints.assembly import CLOSED
from mbd_sim.dynamics.constraints.equations import ConstraintEquations, equations_of_rows, expressed_in_state
from mbd_sim.dynamics.constraints.functions import constraint_functions
from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.dynamics.constraints.start import given_start, later_times
from mbd_sim.dynamics.contact.one_sided_rows import Gap, one_sided_rows, placed_forces
from mbd_sim.dynamics.contact.planar.plane import places_along, plane_normal, still_axis, trial_poses, with_circles
from mbd_sim.dynamics.contact.rows.combined_rows import CombinedRows, combined_rows
from mbd_sim.dynamics.contact.rows.pools import MOST_ROWS
from mbd_sim.dynamics.contact.rows.slots import PartMotions, Slot, Slots, written_slot
from mbd_sim.dynamics.kinematics.poses import BodySymbols
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.layouts.one_sided import OneSidedLayout
from mbd_sim.dynamics.math.rank import row_is_zero
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import NaturalUnits, natural_units

Result = TypeVar("Result")

UNIT = 1e-13  # by which the square of a unit vector may differ from 1
SLIDING = 1.0 - 1e-11  # square of the length of a direction from which on it is one of sliding
HELD = 1.0 - 2e-11  # length of the direction of friction that is at its limit at rest
RELEASED = 1e-200  # direction of a clutch without slip and capacity: without effect, but its guard is evaluated
SLOW = 1e-12  # of the natural speed, slip below which the direction of sliding is the stored one


@dataclass(frozen=True, eq=False)
class FrictionElement:
    """Friction along one or two `rows`, with a load: that of the gap with this index, that of a `joint`, or none.

    With a load `sliding` and `static` are the coefficients μ and μ_s; otherwise they are forces, in N or N·m. The load
    of a joint depends on friction itself, so its row is active while it slides as well.
    """

    rows: tuple[int, ...]
    gap: int | None
    sliding: Callable[[ca.SX], ca.SX]
    static: ca.SX
    joint: Joint | None = None


@dataclass(frozen=True, eq=False)
class OneSidedEquations:
    """The one-sided rows of a mechanism: `gaps`, their friction and all other sticking friction.

    `numbers` are the symbols of the contact inputs, see `OneSidedLayout`. `places` (6, placed gaps) are the points and
    the forces of those gaps that have a place. `are_lengths` (rows,) says of each row whether its position is in m.
    """

    gaps: tuple[Gap, ...]
    frictions: tuple[FrictionElement, ...]
    combined: CombinedRows
    layout: OneSidedLayout
    numbers: ca.SX
    places: ca.SX
    units: NaturalUnits
    are_lengths: tuple[bool, ...]

    @property
    def equations(self) -> ConstraintEquations:
        """The rows, with symbols for the values of slots."""
        return self.combined.equations

    @property
    def lengths(self) -> tuple[float, ...]:
        """The natural units (rows,) of the rows' positions."""
        return tuple(self.units.length if is_length else 1.0 for is_length in self.are_lengths)

    @property
    def speeds(self) -> tuple[float, ...]:
        """The natural units (rows,) of the rows' rates."""
        return tuple(length * self.units.rate for length in self.lengths)

    @property
    def gap_units(self) -> tuple[float, ...]:
        """The natural units (gaps,) of the gaps: of clutches those of their speeds."""
        pairs = zip(self.gaps, self.lengths, self.speeds, strict=False)
        return tuple(speed if gap.clutch else length for gap, length, speed in pairs)

    @property
    def slow(self) -> float:
        """The speed in m/s up to which slip along two rows has no direction."""
        return SLOW * self.units.speed

    @property
    def active(self) -> ca.SX:
        """Which rows (rows,) are solved for."""
        return self.numbers[self.layout.active] != 0.0

    @property
    def closed(self) -> ca.SX:
        """Which gaps (gaps,) are closed."""
        return self.numbers[self.layout.closed]

    @property
    def given_forces(self) -> ca.SX:
        """λ (rows,) among the inputs."""
        return self.numbers[self.layout.given]

    def stored_direction(self, element: FrictionElement) -> ca.SX:
        """The stored direction of sliding (1,) or (2,)."""
        first = self.layout.direction.start - self.layout.gaps
        return ca.vertcat(*(self.numbers[first + row] for row in element.rows))

    def direction(self, element: FrictionElement) -> ca.SX:
        """The direction of sliding, zero without sliding. In two dimensions it follows the slip velocity.

        It does not reverse with that, so that motion is smooth where it stops. A direction that is not quite a unit
        vector stays as it is.
        """
        stored = self.stored_direction(element)
        if len(element.rows) == 1:
            return stored
        slip = ca.vertcat(*(self.equations.velocity[row] for row in element.rows))
        speed = ca.sqrt(ca.dot(slip, slip))
        slides, moves = ca.fabs(ca.dot(stored, stored) - 1.0) < UNIT, speed > self.slow
        forward = ca.if_else(ca.dot(stored, slip) < 0.0, -1.0, 1.0)
        return ca.if_else(slides * moves, forward * slip / ca.fmax(speed, self.slow), stored)

    def forces(self, solved: ca.SX) -> ca.SX:
        """The multipliers λ (rows,) of all rows, with the friction of sliding.

        :param solved: the forces (rows,) of the active rows; others are not used.
        """
        forces = ca.SX(self.active * solved)
        for element in self.frictions:
            if element.joint is not None:
                continue
            direction = self.direction(element)
            for index, row in enumerate(element.rows):
                size = element.sliding(self.equations.velocity[row])
                if not (size - element.static).is_zero():
                    stored = self.stored_direction(element)
                    size = ca.if_else(ca.dot(stored, stored) > SLIDING, size, element.static)
                load = ca.SX(1) if element.gap is None else forces[element.gap]
                forces[row] = forces[row] - size * load * direction[index]
        return forces

    def friction_power(self, forces: ca.SX) -> ca.SX:
        """The power in W that friction dissipates."""
        rows = [row for element in self.frictions for row in element.rows]
        return -ca.dot(forces[rows], self.equations.velocity[rows]) if rows else ca.SX(1, 1)


def one_sided_equations(traced: TracedMechanism) -> OneSidedEquations:
    """Write the one-sided rows of a mechanism. Slip that cannot occur, as across a plane mechanism, has no row."""
    bodies, time = BodySymbols(traced.links), ca.SX.sym("time")
    units = natural_units(traced.numeric, traced.step)
    still = still_axis(traced.poses)
    poses = trial_poses(traced)
    rotations = {part: pose.rotation for part, pose in poses[0].items()} if poses else {}
    frames = places_along(traced, still), rotations
    mechanism = with_circles(traced, poses)
    gaps, sticking = one_sided_rows(
        mechanism, bodies, time, traced.state.t, units.length, still, plane_normal(traced, still), *frames
    )
    _require_few_slots(traced.numeric, gaps)
    slips = [(index, row) for index, gap in enumerate(gaps) for row in gap.slip]
    rows = [*(gap.row for gap in gaps), *(row for _, row in slips), *(friction.row for friction in sticking)]
    measured = [*(gap.row for gap in gaps), *(gaps[index].row for index, _ in slips), *(one.row for one in sticking)]
    own = {index: [index] for index in range(len(gaps))}  # the rows of each gap
    for number, (index, _) in enumerate(slips):
        own[index].append(len(gaps) + number)
    motions, slots = _written_slots(
        traced, bodies, time, {index: [rows[row] for row in own[index]] for index in own}, gaps
    )
    in_slots = {row for index in slots for row in own[index]}
    plain = [row for row in range(len(rows)) if row not in in_slots]
    equations = equations_of_rows(traced, bodies, time, [rows[row] for row in plain])
    unable = {plain[place] for place in _unable_to_act(traced, equations, len(gaps) - len(slots), len(sticking))}
    of_pairs = {index: slot for index, slot in slots.items() if slot.pool is None}
    unable |= {own[index][place] for index, idle in _of_each(of_pairs, partial(_idle, motions)) for place in idle}
    unable |= {row for index in own if index in unable for row in own[index]}
    if still is None:
        gradients = dict(zip(plain, ca.vertsplit(equations.gradient), strict=True))
        for index, of_rows in _of_each(of_pairs, partial(_gradients_somewhere, motions)):
            gradients |= dict(zip(own[index], of_rows, strict=True))
        slip_rows = [row for index in own for row in own[index][1:] if row not in unable and row in gradients]
        unable |= _never_moved(traced, equations, {row: gradients[row] for row in slip_rows})
    kept = [row for row in range(len(rows)) if row not in unable]
    new_index = {row: index for index, row in enumerate(kept)}
    frictions = _frictions(gaps, {index: [new_index[row] for row in own[index] if row in new_index] for index in own})
    for number, friction in enumerate(sticking):
        row = new_index[len(gaps) + len(slips) + number]
        frictions.append(FrictionElement((row,), None, friction.sliding, friction.static, friction.joint))
    places = {index: [place for place, row in enumerate(own[index]) if row in new_index] for index in slots}
    slots = {index: slot.select(places[index]) for index, slot in slots.items() if index in new_index}
    gaps = [gap for index, gap in enumerate(gaps) if index in new_index]
    layout, inputs = _contact_inputs(gaps, len(kept), sum(one.joint is not None for one in frictions), motions)
    remaining = [place for place, row in enumerate(plain) if row in new_index]
    combined = combined_rows(
        equations.select(remaining),
        [new_index[plain[place]] for place in remaining],
        Slots(motions, [*slots.values()], time, units.length, _places_of_parts(motions)),
        [[new_index[row] for row in own[index] if row in new_index] for index in slots],
        [rows[row] for row in kept],
    )
    placed = [(gap.place, (gap.row, *gap.slip)) for gap in gaps if gap.place is not None and gap.pool is None]
    in_state = expressed_in_state(traced, bodies, time)
    points = placed_forces(placed, combined.equations.rows, inputs[layout.given], in_state)
    are_lengths = tuple(_is_length(traced.numeric, measured[row]) for row in kept)  # slip as the gap that presses
    return OneSidedEquations(tuple(gaps), tuple(frictions), combined, layout, inputs, points, units, are_lengths)


def _contact_inputs(
    gaps: Sequence[Gap], rows: int, loads: int, motions: PartMotions
) -> tuple[OneSidedLayout, ca.SX]:  # fmt: skip
    """The layout of the contact inputs, and their symbols."""
    numbers = [gap.numbers for gap in gaps if gap.numbers is not None]
    pooled = sum(gap.pool is not None for gap in gaps)
    parts = len(motions.links) if pooled else 0
    layout = OneSidedLayout(len(gaps), rows, loads, sum(each.shape[0] for each in numbers), pooled, parts)
    of_pools = ca.SX.sym("pools", layout.size - layout.features.stop)
    return layout, ca.vertcat(ca.SX.sym("contact", layout.features.start), *numbers, of_pools)


def _places_of_parts(motions: PartMotions) -> dict[str, int]:
    """The indices of parts among the motions."""
    return {motions.traced.links[link].joint.outboard: index for index, link in enumerate(motions.links)}


def _frictions(gaps: Sequence[Gap], rows: Mapping[int, Sequence[int]]) -> list[FrictionElement]:
    """The friction of gaps, from the rows that are left of each: of the gap itself, and then of its slip."""
    found = []
    for index, gap in enumerate(gaps):
        if len(rows[index]) > 1:
            sliding, static = ca.SX(gap.law.friction), ca.SX(gap.law.static_friction)
            slip, sizes = tuple(rows[index][1:]), partial(_of_any_speed, sliding)
            found.append(FrictionElement(slip, rows[index][0], sizes, static))
    return found


def _written_slots(
    traced: TracedMechanism,
    bodies: BodySymbols,
    time: ca.SX,
    rows: Mapping[int, Sequence[ConstraintRow]],
    gaps: Sequence[Gap],
) -> tuple[PartMotions, dict[int, Slot]]:
    """The slots by the indices of their `gaps`, which have these `rows`, and the motions of their parts."""
    slotted = {index: gap.contact for index, gap in enumerate(gaps) if gap.numbers is not None and gap.contact}
    links = {index: bodies.moving(contact.first.at.part, contact.second.at.part) for index, contact in slotted.items()}
    axes = {contact.still for contact in slotted.values()}
    pools = dict.fromkeys(gap.pool for gap in gaps if gap.pool is not None)
    of_pools = {link for pool in pools for link in bodies.moving(*pool.parts)}
    moving = tuple(sorted({link for own in links.values() for link in own} | of_pools))
    motions = PartMotions(traced, moving, axes.pop() if len(axes) == 1 else None)
    found, first = dict[int, Slot](), dict[int, Slot]()
    for index, contact in slotted.items():
        numbers, parts, gap = gaps[index].numbers, [motions.links.index(link) for link in links[index]], gaps[index]
        assert numbers is not None and gap.place is not None
        if id(contact) not in first:
            place = None if gap.pool is None else gap.place.in_one_vector
            first[id(contact)] = written_slot(index, rows[index], numbers, parts, motions, bodies, time, place)
        found[index] = replace(first[id(contact)], numbers=numbers, pool=gap.pool)
    return motions, found


def _of_each(slots: Mapping[int, Slot], function: Callable[[Slot], Result]) -> Iterator[tuple[int, Result]]:
    """The indices of slots, each with the result of a function that is the same for all of a kind."""
    found: dict[tuple[int, ...], Result] = {}
    for index, slot in slots.items():
        if slot.kind not in found:
            found[slot.kind] = function(slot)
        yield index, found[slot.kind]


def _idle(motions: PartMotions, slot: Slot) -> list[int]:
    """The rows of a slot that no coordinate changes; but not a gap that changes nevertheless: only drives change it."""
    gradient = slot.gradient(motions)
    idle = [row for row in range(gradient.shape[0]) if not gradient[row, :].nnz()]
    return [row for row in idle if row or not slot.velocity[0].nnz()]


def _require_few_slots(mechanism: Mechanism, gaps: Sequence[Gap]) -> None:
    """Refuse what would take minutes to compile: the rows of all slots are solved for together.

    Those of pools, which are bounded, do not count.
    """
    own: dict[str, int] = {}
    for gap in gaps:
        if gap.contact is not None and gap.pool is None:
            own[gap.contact.name] = own.get(gap.contact.name, 0) + 1 + len(gap.slip)
    if (total := sum(own.values())) <= MOST_ROWS:
        return
    largest = max(own, key=lambda name: own[name])
    message = (
        f"contacts of blocks, plates, rods and hulls have {total} rows, {own[largest]} of them here; up to {MOST_ROWS} "
        "are possible"
    )
    remedy = "Name only the pairs that can meet with 'between'; planes and spheres have fewer rows."
    raise MechanismError([mechanism.source.problem(("contacts", largest), message, remedy)])


def _is_length(mechanism: Mechanism, row: ConstraintRow) -> bool:
    """Whether the position of a row is in m; a sum of coordinates is if one of them is."""
    if row.unit:
        return row.unit == "m"
    return any(not mechanism.coordinate(name).rotation for name in row.factors)


def _unable_to_act(traced: TracedMechanism, equations: ConstraintEquations, gaps: int, sticking: int) -> set[int]:
    """The rows of gaps that no coordinate changes and that are not negative, such as between welded parts; idle slip.

    The gaps come first, and sticking friction last. Of those that only drives or time change, the gradients become
    exactly zero: no force opens them once they close.
    """
    slips = range(gaps, len(equations.rows) - sticking)
    unable, prescribed = _unchanged(traced, equations.select(range(gaps))) if gaps else (set[int](), list[int]())
    for row in prescribed:
        equations.gradient[row, :] = 0.0  # without round-off, by which forces would be divided
    return unable | {row for row in slips if not equations.gradient[row, :].nnz()}


def _unchanged(traced: TracedMechanism, equations: ConstraintEquations) -> tuple[set[int], list[int]]:
    """The gaps that no coordinate changes: those that are constant, and those that are not."""
    functions, random = constraint_functions(traced, equations), np.random.default_rng(4)
    start, scales = given_start(traced.numeric, traced.layout)[0], functions.scales
    driven = [index for states in traced.layout.drives.values() for index in range(states.start, states.stop)]
    least = CLOSED * functions.row_sizes(0.0, start)
    zero, unchanged = functions.position(0.0, start) >= -least, np.full(len(least), True)
    for time in (0.0, *later_times(traced.numeric)):
        q = functions.displaced(start, scales * random.normal(size=len(scales)))
        q[driven] += random.normal(size=len(driven))
        values = functions.values + random.normal(size=len(functions.values)) * functions.size
        other = functions.with_values(values)
        unchanged &= abs(other.position(time, q) - other.position(0.0, start)) <= least
        zero &= row_is_zero(other.scaled_gradient(time, q))
    still = [row for row in range(len(equations.rows)) if zero[row]]
    return {row for row in still if unchanged[row]}, [row for row in still if not unchanged[row]]


def _gradients_somewhere(motions: PartMotions, slot: Slot) -> list[ca.SX]:
    """The gradients (1, nv) of the rows of a slot in the state, with numbers drawn for its features."""
    numbers = np.random.default_rng(5).normal(size=slot.features.shape[0])
    symbols, values = [slot.features, *motions.symbols], [ca.SX(ca.DM(numbers)), *motions.values]
    return ca.vertsplit(ca.substitute([slot.gradient(motions)], symbols, values)[0])


def _never_moved(traced: TracedMechanism, equations: ConstraintEquations, gradients: Mapping[int, ca.SX]) -> set[int]:
    """The rows of some gradients (1, nv) that are round-off in any configuration, by which forces would be divided.

    That is slip across the plane of a mechanism that is not one of the planes of ground's axes.
    """
    if not gradients:
        return set()
    functions, random = constraint_functions(traced, equations), np.random.default_rng(5)
    given = [traced.state.t, traced.state.q, traced.parameters.symbols]
    read = ca.Function("gradients", given, [ca.densify(ca.vertcat(*gradients.values()))], {"cse": True})
    start, scales = given_start(traced.numeric, traced.layout)[0], functions.scales
    zero = np.full(len(gradients), True)
    for time in (0.0, *later_times(traced.numeric)):
        q = functions.displaced(start, scales * random.normal(size=len(scales)))
        zero &= row_is_zero(np.array(read(time, q, functions.values)) * scales / functions.size)
    return {row for row, never in zip(gradients, zero, strict=True) if never}


def _of_any_speed(size: ca.SX, speed: ca.SX) -> ca.SX:
    return size


def with_one_sided_inputs(traced: TracedMechanism, one_sided: OneSidedEquations) -> TracedMechanism:
    """Add the contact numbers to the inputs of a mechanism."""
    return replace(
        traced,
        inputs=ca.vertcat(traced.inputs, one_sided.numbers),
        input_layout=replace(traced.input_layout, one_sided_count=one_sided.layout.size),
    )
