"""The one-sided rows of a mechanism in numbers: their readings, and the terms of their events, at one state.

The system that the compiler makes steps of is put together here as well.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.base.short_repr import short_repr
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.compiler.rows.pooled_rows import TWIST, CompiledPool, PooledRows
from mbd_sim.compiler.rows.slot_values import CompiledSlot, SlotSystem
from mbd_sim.compiler.steps.active_rows import FactoredSystem, Load, OneSidedSystem
from mbd_sim.dynamics.contact.one_sided_equations import SLIDING, OneSidedEquations
from mbd_sim.dynamics.contact.rows.slots import MOTION
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.layouts.one_sided import OneSidedLayout
from mbd_sim.dynamics.layouts.vectors import InputLayout
from mbd_sim.dynamics.one_sided_functions import OneSidedFunctions, SolvedPair
from mbd_sim.mechanism.elements.contacts import Contact
from mbd_sim.simulation.contact.features.pairs import FeaturePairs
from mbd_sim.simulation.contact.features.pools import PoolReadings
from mbd_sim.simulation.contact.records import ContactState, with_friction

Mask: TypeAlias = NDArray[np.bool_]

LOAD_ROUND_OFF = 1e-10  # of a load, relative to its parts


@dataclass(slots=True, eq=False)  # a frozen one is made four times as slowly, and the search for events makes many
class OneSidedReadings:
    """The gaps (gaps,), rates (rows,), forces λ (rows,) and guards (gaps + frictions,) of a state.

    `turning` are the rates in 1/s at which friction along two directions may turn its slip.
    """

    gaps: Array
    rates: Array
    forces: Array
    guards: Array
    turning: Array


@dataclass(frozen=True, eq=False)
class OneSidedTerms:
    """A (rows, rows), the rows' accelerations (rows,) without contact forces, and friction's sizes (frictions, 2).

    `loads` are the forces of joints with loads, without contact forces (k,) and by these (k, rows), by the friction
    element.
    """

    matrix: Array
    free: Array
    sizes: Array
    loads: Mapping[int, tuple[Array, Array]]

    def load_vector(self, element: int, forces: Array) -> Array:
        """The force (k,) in N on whose size the friction of an element depends."""
        unloaded, by_force = self.loads[element]
        total = unloaded.copy()
        for row, force in enumerate(forces.tolist()):
            total += by_force[:, row] * force
        return total

    def load(self, element: int, forces: Array) -> float:
        """The size of `load_vector` in N."""
        total = self.load_vector(element, forces)
        return math.sqrt(added((total * total).tolist()))


class OneSidedModel:
    """The functions of a model's one-sided rows, evaluated in numbers. It holds no state.

    `frictions` are the rows of each friction element and the gap that loads it, or None; `friction_rows` (frictions, 2)
    are these rows, the first one twice where there is only one. `names` are those of the gaps
    and then of the friction elements. `placed` are the indices of the gaps that have a place. `compliance` (rows,) is
    that of equal elastic supports, see `ContactProblem`. `units` are the natural ones, with those of the rows' rates,
    `speeds` (rows,), of their forces and moments, `loads` (rows,), and of the gaps, `gap_units` (gaps,). `loaded` are
    the indices of the friction elements that depend on the load of a joint, which have some `load_components`.
    `slots` (gaps,) says which gaps are slots; these belong to the pairs of `features`. Some may belong to `pools`.
    """

    __repr__ = short_repr

    def __init__(
        self,
        functions: OneSidedFunctions,
        inputs: InputLayout,
        kernel: Kernel,
        size: float,
        part_names: Sequence[str],
        tolerance: float,
    ) -> None:
        """:param size: of the mechanism in m.

        :param part_names: in the order of the kernel's poses.
        :param tolerance: how negative a guard may be by round-off.
        """
        assert kernel.one_sided is not None
        one_sided = functions.equations
        self._functions, self.kernel, self.span = functions, kernel.one_sided, inputs.one_sided
        self._readers = kernel.readers
        self.layout: OneSidedLayout = one_sided.layout
        self.frictions: Sequence[tuple[tuple[int, ...], int | None]] = [
            (element.rows, element.gap) for element in one_sided.frictions
        ]
        self.friction_rows = np.array([(*rows, rows[0])[:2] for rows, _ in self.frictions], dtype=int).reshape(-1, 2)
        self.placed = tuple(index for index, gap in enumerate(one_sided.gaps) if gap.place is not None)
        self.compliance = _compliance(one_sided, size)
        self.units, self.slow = one_sided.units, one_sided.slow
        self.speeds, self.gap_units = np.array(one_sided.speeds), np.array(one_sided.gap_units)
        self.loads = one_sided.units.force * one_sided.units.length / np.array(one_sided.lengths)
        self.clutches = np.array([gap.clutch for gap in one_sided.gaps], dtype=bool)
        self.row_names = _row_names(one_sided)
        self.names = self.row_names[: self.layout.gaps]
        self.owners = tuple(one_sided.equations.rows[index].owner for index in range(self.layout.rows))
        self.pairs = [index for index, (rows, _) in enumerate(self.frictions) if len(rows) == 2]
        self.loaded = [index for index, element in enumerate(one_sided.frictions) if element.joint is not None]
        self.slots = np.array([gap.numbers is not None for gap in one_sided.gaps], dtype=bool)
        self.features: FeaturePairs | None = None
        if np.any(self.slots):
            features, accuracy = self.span.start + self.layout.features.start, tolerance * one_sided.units.length
            self.features = FeaturePairs(one_sided, features, kernel, part_names, accuracy)
        self.pools = PoolReadings(functions) if functions.slots.pools else None
        self.load_components = functions.load_components
        self._single = [number for number, components in enumerate(self.load_components) if components == 1]
        self.guard_count = self.layout.gaps + len(self.frictions) + len(self._single)
        counts = 1, self.layout.gaps, self.layout.rows, self.layout.rows, self.guard_count, len(self.pairs)
        ends = list(accumulate(counts))  # of the time and of all readings
        self._size, self._parts = ends[-1], [slice(*pair) for pair in pairwise(ends)]

    @property
    def placed_inputs(self) -> tuple[int, ...]:
        """The indices of the inputs that are 1 while the gaps `placed` are closed."""
        return tuple(self.span.start + self.layout.closed.start + gap for gap in self.placed)

    def modes(self, inputs: Array) -> Array:
        """A view of the modes among the inputs, see `OneSidedLayout`."""
        return inputs[self.span]

    def sliding(self, modes: Array) -> list[int]:
        """The friction elements that slide."""
        squares = modes[self.layout.direction.start - self.layout.gaps + self.friction_rows] ** 2
        squares[:, 1] *= self.friction_rows[:, 1] != self.friction_rows[:, 0]
        found: list[int] = np.flatnonzero(squares[:, 0] + squares[:, 1] > SLIDING).tolist()
        return found

    def name_in(self, modes: Array, gap: int) -> str:
        """The name of a gap; of one of a pool, that of the pair which has it in some modes."""
        if gap < self.layout.gaps - self.layout.pooled:
            return self.names[gap]
        return self.name_of_pair(gap, self._holder(modes, gap))

    def name_of_pair(self, gap: int, number: int) -> str:
        """The name of a pair of the pool to which a gap belongs."""
        pair = self._pair(gap, number)
        return f"{pair.name}.{_in_names(pair.quantity)}"

    def _pair(self, gap: int, number: int) -> Contact:
        pool = self._functions.equations.gaps[gap].pool
        assert pool is not None
        return pool.pairs[number]

    def _holder(self, modes: Array, gap: int) -> int:
        """The number of the pair that has a gap of a pool."""
        return int(modes[self.layout.holders.start + gap - (self.layout.gaps - self.layout.pooled)])

    def friction_name(self, element: int) -> str:
        """The name of a friction element: that of its gap, if it has one."""
        rows, gap = self.frictions[element]
        return self.row_names[rows[0]] if gap is None else self.names[gap]

    def readings(self, time: float, y: Array, inputs: Array) -> OneSidedReadings:
        """Gaps, rates, forces and guards."""
        return self.readings_at(time, address(y), address(inputs))

    def readings_at(self, time: float, y: int, inputs: int) -> OneSidedReadings:
        """`readings` with the addresses of a state and the inputs."""
        out = np.empty(self._size)
        out[0] = time
        first = address(out)
        self.kernel.readings(first, y, inputs, first + out.itemsize)
        return OneSidedReadings(*[out[part] for part in self._parts])

    def with_forces(self, time: float, y: Array, inputs: Array) -> Array:
        """A copy of the inputs with the forces λ of all rows."""
        filled, forces = inputs.copy(), self.readings(time, y, inputs).forces
        modes = filled[self.span]
        modes[self.layout.given] = forces
        if self.pools is not None:
            modes[self.layout.wrenches] = self.pools.wrenches(self._slot_values(time, y, inputs), modes, forces)
        return filled

    def _slot_values(self, time: float, y: Array, inputs: Array) -> Array:
        return self._read("slot_values", self._functions.slots.size, np.array([time]), y, inputs)

    def places_of_pools(self, time: float, y: Array, inputs: Array) -> Array:
        """The points in m, the forces in N and the normals (pooled, 3, 3) of the gaps of pools, in ground's frame."""
        if self.pools is None:
            return np.empty((0, 3, 3))
        forces = self.readings(time, y, inputs).forces
        return self.pools.places(self._slot_values(time, y, inputs), self.modes(inputs), forces)

    def states(self, time: float, y: Array, inputs: Array, places: Array | None = None) -> dict[str, ContactState]:
        """Each gap and each friction element without one, by name.

        :param places: the points, forces and normals (placed, 3, 3), see `ContactReadings.places`; without them None.
        """
        placed = {} if places is None else dict(zip(self.placed, places, strict=True))
        modes, read = self.modes(inputs), self.readings(time, y, inputs)
        sliding = self.sliding(modes)
        friction = {gap: index for index, (_, gap) in enumerate(self.frictions) if gap is not None}

        def state(element: int) -> tuple[str, Array, Array]:
            rows = list(self.frictions[element][0])
            return "slides" if element in sliding else "sticks", read.forces[rows], read.rates[rows]

        first_pooled = self.layout.gaps - self.layout.pooled
        apart = {} if self.features is None else self.features.distances(time, y, inputs)
        found: dict[str, ContactState] = {}
        for gap, name in enumerate(self.names):
            how, forces, slip = state(friction[gap]) if gap in friction else ("closed", np.zeros(0), np.zeros(0))
            how = how if modes[gap] else "open"
            is_open_slot = gap in apart and not modes[gap]
            point, force, direction = (None,) * 3 if is_open_slot else placed.get(gap, (None,) * 3)
            bodies = None if is_open_slot or gap < first_pooled else self._pair(gap, self._holder(modes, gap)).names
            size = apart[gap] if is_open_slot else read.gaps[gap]
            found[name] = ContactState(
                how, size, read.rates[gap], read.forces[gap], forces, slip, point, force, direction, bodies
            )
        for index, (rows, load) in enumerate(self.frictions):
            if load is None:
                how, forces, slip = state(index)
                found[self.row_names[rows[0]]] = ContactState(how, 0.0, 0.0, 0.0, forces, slip)
        return found

    def entry_names(self) -> list[str]:
        """The names of the `entries`, such as `floor`, `floor.friction_1`, `floor.friction_2`."""
        friction = {gap: rows for rows, gap in self.frictions if gap is not None}
        names = []
        for gap, name in enumerate(self.names):
            names += with_friction(name, len(friction.get(gap, ())))
        return names + [self.row_names[rows[0]] for rows, gap in self.frictions if gap is None]

    def entries(self, time: float, y: Array, inputs: Array) -> list[tuple[float, float, float]]:
        """For each gap its size, rate and force; after it, for each direction of friction, sliding, slip and force."""
        found: list[tuple[float, float, float]] = []
        states = list(self.states(time, y, inputs).values())
        for number, state in enumerate(states):
            if number < self.layout.gaps:
                found.append((state.gap, state.rate, state.normal))
            found += state.friction_entries
        return found

    def terms(self, time: float, y: Array, inputs: Array) -> OneSidedTerms:
        """The terms of the equations for forces and impulses."""
        n, frictions = self.layout.rows, len(self.frictions)
        found = self._read("contact_terms", n * (n + 1) + 2 * frictions, np.array([time]), y, inputs)
        matrix, free, sizes = np.split(found, [n * n, n * (n + 1)])
        loads, first = dict[int, tuple[Array, Array]](), 0
        numbers = self._read("joint_loads", sum(self.load_components) * (1 + n), np.array([time]), y, inputs)
        for index, k in zip(self.loaded, self.load_components, strict=True):
            unloaded, by_force = np.split(numbers[first : first + k * (1 + n)], [k])
            loads[index], first = (unloaded, by_force.reshape(n, k).T), first + k * (1 + n)
        return OneSidedTerms(matrix.reshape(n, n).T, free, sizes.reshape(2, frictions).T, loads)

    def set_signs(self, terms: OneSidedTerms, forces: Array, modes: Array) -> None:
        """Write the signs of loads with one component into the modes; those that are zero keep theirs."""
        for number, index in enumerate(self.loaded):
            unloaded, by_force = terms.loads[index]
            if not len(unloaded):
                continue  # nothing loads this joint
            parts = [float(unloaded[0]), *(by_force[0] * forces).tolist()]
            value, position = added(parts), self.layout.signs.start + number
            if abs(value) > LOAD_ROUND_OFF * (self.units.force + added(map(abs, parts))):
                modes[position] = -1.0 if value < 0.0 else 1.0
            elif modes[position] == 0.0:
                modes[position] = 1.0

    def flip_signs(self, modes: Array, reached: Mask) -> None:
        """Change the signs of those loads whose guards, the last ones, have been reached."""
        for number, at_zero in zip(self._single, reached[len(reached) - len(self._single) :], strict=True):
            if at_zero:
                modes[self.layout.signs.start + number] *= -1.0

    def response(self, time: float, y: Array, inputs: Array, impulses: Array) -> Array:
        """The change of u (nv,) by impulses (rows,)."""
        size = self._functions.response.nnz_out(0)
        return self._read("contact_response", size, np.array([time]), y, inputs, impulses)

    def restitution(self, inputs: Array) -> Array:
        """e (gaps,)."""
        return self._read("restitution", self.layout.gaps, inputs)

    def _read(self, name: str, size: int, *arguments: Array) -> Array:
        out = np.zeros(size)  # what slots of pools that are not in use would be is not written
        self._readers[name](*(argument.ctypes.data for argument in arguments), out.ctypes.data)
        return out


def _compliance(one_sided: OneSidedEquations, size: float) -> Array:
    """1 for rows in m; those of angles count as forces at the lever `size`."""
    lever = size or 1.0
    return np.array([1.0 if is_length else lever**-2 for is_length in one_sided.are_lengths])


def _row_names(one_sided: OneSidedEquations) -> tuple[str, ...]:
    """The name of each row: that of its element, with the constrained quantity where the element has several gaps."""
    rows = one_sided.equations.rows
    owners = [row.owner for row in rows[: one_sided.layout.gaps]]
    names = []
    for index, row in enumerate(rows):
        several = owners.count(row.owner) > 1 or (index >= one_sided.layout.gaps and row.owner[0] == "joints")
        names.append(f"{row.owner[1]}.{_in_names(row.quantity)}" if several else str(row.owner[1]))
    return tuple(names)


def _in_names(quantity: str) -> str:
    return quantity.replace(" ", "_").replace(",", "")


def address(array: NDArray[Any]) -> int:
    """The address of an array; of one that can be written to in a quarter of the time of `array.ctypes.data`."""
    if not array.flags.writeable:
        return array.ctypes.data
    return ctypes.addressof(ctypes.c_char.from_buffer(array.data))


GUARD_TOLERANCE = 1e-13  # of guards in natural units, for a mechanism of up to the natural length


def guard_tolerance(equations: Equations) -> float:
    """How negative a guard may be by round-off."""
    assert equations.one_sided is not None
    return GUARD_TOLERANCE * max(1.0, equations.constraints.size / equations.one_sided.equations.units.length)


def one_sided_system(
    equations: Equations, functions: OneSidedFunctions, *, time_stepping: bool = False
) -> OneSidedSystem:
    """The system for `compile_kernel`, from the functions of the one-sided rows among the equations."""
    layout = functions.equations.layout
    rows = [element.rows[0] for element in functions.equations.frictions if element.joint is not None]
    loads = tuple(Load(row, k) for row, k in zip(rows, functions.load_components, strict=True))
    slips = [element.rows for element in functions.equations.frictions if len(element.rows) == 2]
    single_loads = sum(load.components == 1 for load in loads)

    def pair(solved: SolvedPair) -> tuple[FactoredSystem, ca.Function]:
        return FactoredSystem(solved.system, solved.factors), solved.result

    return OneSidedSystem(
        gaps=layout.gaps,
        rows=layout.rows,
        guards=layout.gaps + len(functions.equations.frictions) + single_loads,
        rates=pair(functions.rates),
        project=pair(functions.project),
        readings=functions.readings,
        open_start=functions.open_start,
        event_readers={
            "contact_response": functions.response,
            "restitution": functions.restitution,
            "joint_loads": functions.loads,
            **({"gaps_and_rates": functions.gaps_and_rates} if time_stepping or slips else {}),
        },
        terms=FactoredSystem(functions.terms, functions.terms_factors),
        first_mode=equations.inputs.one_sided.start,
        modes=2 * layout.rows,
        first_given=equations.inputs.one_sided.start + layout.given.start,
        slots=_slot_system(functions),
        farthest=functions.farthest,
        loads=loads,
        slips=tuple((rows[0], rows[1]) for rows in slips),
        tolerance=guard_tolerance(equations),
        gap_units=functions.equations.gap_units,
        slow=functions.equations.slow,
        time_stepping=time_stepping,
    )


def _slot_system(functions: OneSidedFunctions) -> SlotSystem:
    slots = functions.slots
    calls = [
        CompiledSlot(
            call.function,
            slots.first_number + call.numbers,
            tuple(MOTION * part for part in call.parts),
            call.values,
        )
        for call in slots.calls
    ]
    return SlotSystem(slots.motions, calls, slots.size, slots.unused, _pooled_rows(functions))


def _pooled_rows(functions: OneSidedFunctions) -> PooledRows | None:
    """The rows of the pools, if there are any."""
    slots, layout, pools, first = functions.slots, functions.equations.layout, list[CompiledPool](), 0
    for call in slots.pools:
        rows = slots.rows_of_pools[first : first + call.pool.slots]
        at = slots.first_number + call.numbers, slots.first_holder + first
        pools.append(CompiledPool(call.function, *at, call.values, rows, call.pairs))
        first += call.pool.slots
    if not pools:
        return None
    return PooledRows(tuple(pools), layout.parts, slots.size - layout.rows - 2 * TWIST * layout.parts)
