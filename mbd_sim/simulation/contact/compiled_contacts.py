"""The contacts of a mechanism for the functions that are compiled once for all mechanisms."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.operating_system import keep_freed_memory
from mbd_sim.base.rounded import radau
from mbd_sim.compiler.ir.python_kinds import address_of, packed, prototype
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout
from mbd_sim.simulation.contact.compiled import step
from mbd_sim.simulation.contact.compiled.instant.contacts import DECIDE, Contacts, Stepping
from mbd_sim.simulation.contact.compiled.instant.sliding import STAGES
from mbd_sim.simulation.contact.compiled.library import library
from mbd_sim.simulation.contact.one_sided_model import OneSidedModel, address
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent

Marks: TypeAlias = NDArray[np.int64]

CHANGES = {
    step.CLOSED: ContactChange.CLOSED,
    step.OPENED: ContactChange.OPENED,
    step.STICKS: ContactChange.STICKS,
    step.SLIDES: ContactChange.SLIDES,
    step.IMPACT: ContactChange.IMPACT,
    step.BOUND: ContactChange.BOUND,
}

Decide: TypeAlias = Callable[[float, Marks, Array, Marks, Marks, bool, float], int]


@dataclass(frozen=True)
class EnergiesAtImpacts:
    """The total energies in J before and after an impact, which precede its events."""

    time: float
    before: float
    after: float


class CompiledContacts:
    """The contacts of a mechanism for the compiled functions, with memory for their results.

    Where energies are needed that the kernel does not read alone, only the search for events is compiled. An exception
    of functions that compiled code calls is raised when that ends.
    """

    def __init__(
        self,
        model: OneSidedModel,
        kernel: Kernel,
        state_size: int,
        coordinates: CoordinateLayout,
        first_loss: int,
        rest_speed: float,
        tolerance: float,
        driven: bool,
        held: Sequence[int],
        sizes: tuple[int, int, int],
        time_stepping: bool,
    ) -> None:
        """:param held: the components of y that change between steps only.

        :param sizes: `inputs`, `history` and `kept_inputs` of `Contacts`.
        :param time_stepping: contacts act once in each step, and the kernel is made for that.
        """
        self._model, self._kernel, layout = model, kernel, model.layout
        self._failures = list[BaseException]()
        self._observable = "elongations" not in kernel.readers  # whether the kernel reads all energies
        self._contacts = Contacts(
            simple=False,
            time_stepping=time_stepping,
            stepping=_stepping(model, kernel, coordinates) if time_stepping else NO_STEPPING,
            **_addresses(model, kernel, time_stepping=time_stepping),
            energies=0,
            energies_take_inputs=kernel.reads_inputs["energies"],
            driven=driven,
            size=state_size,
            gaps=layout.gaps,
            rows=layout.rows,
            frictions=len(model.frictions),
            guards=model.guard_count,
            pairs=len(model.pairs),
            radau=_radau(),
            decide=0,
            note=0,
            **self._bodies(),
            inputs=sizes[0],
            history=sizes[1],
            kept_inputs=sizes[2],
            held_count=len(held),
            held=np.array(held, dtype=np.int64),
            slow=model.slow,
            first_mode=model.span.start,
            modes=layout.size,
            first_speed=coordinates.nq,
            speeds=coordinates.nv,
            first_loss=first_loss,
            rest_speed=rest_speed,
            tolerance=tolerance,
            **_units(model),
            **_friction(model),
            clutches=model.clutches.astype(np.int64),
            **_slots(model),
        )
        self.observe(False)

    def _bodies(self) -> dict[str, Any]:
        """The fields of `Contacts` for bodies with slots."""
        features = self._model.features
        if features is None:
            return {
                "places": 0,
                "poses": 0,
                "poses_take_inputs": False,
                "body_pairs": 0,
                "bodies": np.zeros(0, dtype=np.int64),
                "lacking": np.zeros(1, dtype=np.int64),
                **_travels(0, np.zeros(0)),
                "accuracy": 0.0,
            }
        lacking = np.zeros(1, dtype=np.int64)
        self._pairs = features.compiled(self._failures, lacking)
        return {
            "places": features.places,
            "poses": self._kernel.reader_address("poses"),
            "poses_take_inputs": self._kernel.reads_inputs["poses"],
            "body_pairs": len(self._pairs),
            "bodies": np.concatenate([packed(pair) for pair, _ in self._pairs]),
            "lacking": lacking,
            **_travels(features.places, features.reaches),
            "accuracy": features.tolerance,
        }

    @cached_property
    def _results(self) -> tuple[Array, Marks]:
        """Memory of the events and their counts; most members of ensembles never need it."""
        return np.zeros((step.CAPACITY, step.FIELDS)), np.zeros(2, dtype=np.int64)

    def connect(self, decide: Decide, note: Callable[[], None]) -> None:
        """Say what makes the changes of events that are not simple, and what takes the events."""
        model = self._model

        def decided(time: float, reached: int, old: int, opening: int, yielding: int, elastic: int, rest: float) -> int:
            marks = (
                _view(ctypes.c_int64, opening, model.layout.gaps),
                _view(ctypes.c_int64, yielding, len(model.frictions)),
            )
            into, modes = (
                _view(ctypes.c_int64, reached, model.guard_count),
                _view(ctypes.c_double, old, model.layout.size),
            )
            try:
                return decide(time, into, modes, *marks, bool(elastic), rest)
            except BaseException as error:  # which must not pass through compiled code
                self._failures.append(error)
                return step.NO_SOLUTION

        def noted() -> None:
            try:
                if not self._failures:
                    note()
            except BaseException as error:
                self._failures.append(error)

        self._callbacks = prototype(DECIDE.result, DECIDE.arguments)(decided), prototype("None", ())(noted)
        first, second = map(address_of, self._callbacks)
        self._contacts = replace(self._contacts, decide=first, note=second)
        self._address = packed(self._contacts).ctypes.data

    @property
    def for_members(self) -> Marks:
        """The record for `advance_members`, which leaves steps with events that are not simple."""
        self._of_member = replace(self._contacts, decide=0, note=0)
        return packed(self._of_member)

    def observe(self, observed: bool) -> None:
        """Say whether energies at impacts have to be known to others."""
        needed = observed or self._contacts.driven
        energies = self._kernel.reader_address("energies") if needed else 0
        simple = self._observable or not (needed or self._contacts.time_stepping)  # the bits must not depend on it
        self._contacts = replace(self._contacts, energies=energies, simple=simple)
        self._address = packed(self._contacts).ctypes.data

    def advance(self, y: Array, inputs: Array, first: int, h: float, n: int, estimate: Array) -> bool:
        """Take n steps; False where the state would not stay finite.

        :raises BaseException: what was raised by functions that compiled code calls.
        """
        events, counts = self._results
        addresses = (address(each) for each in (estimate, events, counts))
        library().advance(self._address, address(y), address(inputs), first, h, n, *addresses)
        self.check()
        return bool(counts[1] == step.DONE)

    def advance_by_time_stepping(
        self, y: Array, inputs: Array, first: int, h: float, n: int, estimate: Array
    ) -> tuple[int, int]:
        """Take up to n steps; how many were taken, and why not more: see `compiled.step`.

        :raises BaseException: what was raised by functions that compiled code calls.
        """
        events, counts = self._results
        addresses = (address(each) for each in (estimate, events, counts))
        taken = library().advance_by_time_stepping(self._address, address(y), address(inputs), first, h, n, *addresses)
        self.check()
        return taken, int(counts[1])

    def renew(self, time: float, y: Array, inputs: Array) -> None:
        """Find the features of all slots at a state."""
        library().renew(self._address, time, y.ctypes.data, inputs.ctypes.data)
        self.check()

    def end_step(self, time: float, y: Array, inputs: Array) -> None:
        """After a step: see `compiled.touching.end_step`."""
        library().end_step(self._address, time, y.ctypes.data, inputs.ctypes.data)
        self.check()

    @property
    def held(self) -> Marks:
        """The components of y that change between steps only."""
        return np.asarray(self._contacts.held)

    def check(self) -> None:
        """Raise what was raised by functions that compiled code calls."""
        if self._failures:
            error = self._failures[0]
            self._failures.clear()
            self._contacts.lacking[0] = 0
            raise error

    def events(self) -> list[ContactEvent | EnergiesAtImpacts]:
        """What has happened since they were asked for the last time."""
        found: list[ContactEvent | EnergiesAtImpacts] = []
        model, (events, counts) = self._model, self._results
        count, counts[0] = int(counts[0]), 0
        for time, change, index, *numbers in events[:count].tolist():
            if change == step.ENERGIES:
                found.append(EnergiesAtImpacts(time, *numbers))
            elif change == step.BOUND:
                found.append(ContactEvent(time, "contacts", CHANGES[change]))
            else:
                pair, element = divmod(int(index), step.OF_PAIR)
                is_friction = change in (step.STICKS, step.SLIDES)
                gap = model.frictions[element][1] if is_friction else element
                name = model.friction_name(element) if is_friction else model.names[element]
                if pair and gap is not None:
                    name = model.name_of_pair(gap, pair - 1)
                found.append(ContactEvent(time, name, CHANGES[change], *numbers))
        return found


def _view(kind: Any, at: int, count: int) -> Any:
    """Numbers in memory as an array."""
    return np.frombuffer((kind * count).from_address(at), np.dtype(kind))


def _addresses(model: OneSidedModel, kernel: Kernel, *, time_stepping: bool) -> dict[str, Any]:
    """The fields of `Contacts` for the functions of the kernel."""
    code = kernel.code
    return {
        "advance": code.address("estimating_advance" if time_stepping else "advance_to_event"),
        "part_step": code.address("part_step"),
        "start": 0 if time_stepping else code.address("start_contacts"),
        "project": 0 if time_stepping else code.address("project_contacts"),
        "readings": code.address("read_contacts"),
        "gaps_and_rates": kernel.reader_address("gaps_and_rates") if time_stepping or model.pairs else 0,
        "terms": kernel.reader_address("contact_terms"),
        "response": kernel.reader_address("contact_response"),
        "restitution": kernel.reader_address("restitution"),
        "joint_loads": kernel.reader_address("joint_loads") if model.loaded else 0,
    }


KEPT = 1 << 28  # bytes of all arrays of a step
NO_STEPPING = Stepping(0, 0, 0, 0, 0, np.zeros(0, dtype=np.int64), np.zeros(0))  # of steps from event to event


def _stepping(model: OneSidedModel, kernel: Kernel, layout: CoordinateLayout) -> Stepping:
    """The fields of `Contacts` for time stepping, of which a step takes up and frees large arrays."""
    keep_freed_memory(KEPT)
    places = [(layout.q[joint], layout.u[joint]) for joint in layout.u]
    return Stepping(
        kernel.code.address("project"),
        kernel.reader_address("marked_terms"),
        kernel.reader_address("displaced"),
        kernel.reader_address("powers"),
        len(places),
        np.array([(q.start, q.stop, u.start, u.stop) for q, u in places], dtype=np.int64).ravel(),
        model.compliance,
    )


def _travels(places: int, reaches: Array) -> dict[str, Any]:
    """The memory among the fields of `Contacts`."""
    return {
        "held_slots": np.zeros(1, dtype=np.int64),
        "reaches": reaches,
        "latest": np.zeros(places),
        "stepped": np.zeros(len(reaches)),
        "travelled": np.zeros(len(reaches)),
    }


def _slots(model: OneSidedModel) -> dict[str, Any]:
    """The fields of `Contacts` for slots."""
    layout = model.layout
    return {
        "slots": model.slots.astype(np.int64),
        "first_feature": layout.features.start,
        "first_pooled": layout.gaps - layout.pooled,
        "first_holder": layout.holders.start,
    }


def _units(model: OneSidedModel) -> dict[str, Any]:
    """The natural units among the fields of `Contacts`."""
    return {
        "unit_speed": model.units.speed,
        "unit_rate": model.units.rate,
        "unit_force": model.units.force,
        "row_speeds": model.speeds,
        "row_loads": model.loads,
        "gap_units": model.gap_units,
    }


def _radau() -> Array:
    """The nodes of collocation, after 0, and its coefficients."""
    nodes, rows = radau(STAGES)
    return np.array([0.0, *nodes, *(value for row in rows for value in row)])


def _friction(model: OneSidedModel) -> dict[str, Any]:
    """The fields of `Contacts` for friction and for the loads of joints."""
    components = np.array(model.load_components, dtype=np.int64)
    ends = np.cumsum(components * (1 + model.layout.rows))
    loads = {element: number for number, element in enumerate(model.loaded)}
    pairs = {element: number for number, element in enumerate(model.pairs)}

    def integers(values: Iterable[int]) -> NDArray[np.int64]:
        return np.array([*values], dtype=np.int64)

    return {
        "friction_rows": integers(row for rows, _ in model.frictions for row in (*rows, -1)[:2]),
        "pair_places": integers(pairs.get(element, -1) for element in range(len(model.frictions))),
        "friction_gaps": integers(-1 if gap is None else gap for _, gap in model.frictions),
        "loaded": len(loads),
        "loads_size": int(ends[-1]) if loads else 0,
        "friction_loads": integers(loads.get(element, -1) for element in range(len(model.frictions))),
        "load_elements": integers(model.loaded),
        "load_components": components,
        "load_offsets": ends - components * (1 + model.layout.rows),
        "singles": int(np.sum(components == 1)),
        "single_loads": np.flatnonzero(components == 1),
    }


def advance_members(
    contacts: NDArray[np.int64],
    arrays: Mapping[str, Array],
    members: NDArray[np.int64],
    first: int,
    h: float,
    steps: int,
) -> list[int]:
    """Take steps of some members in place, without the interpreter's lock; those that are left to others.

    :param contacts: of all members (k, slots), see `CompiledContacts.for_members`.
    :param arrays: `y` (k, n), `inputs` (k, m), `estimates` (k,) and `alive` (k,) of all members.
    """
    left = np.zeros(len(members), dtype=np.int64)
    y, inputs, estimates, alive = (arrays[name] for name in ("y", "inputs", "estimates", "alive"))
    count = library().advance_members(
        contacts.ctypes.data,
        contacts.shape[1],
        y.ctypes.data,
        inputs.ctypes.data,
        inputs.shape[1],
        estimates.ctypes.data,
        alive.ctypes.data,
        members.ctypes.data,
        len(members),
        first,
        h,
        steps,
        left.ctypes.data,
    )
    return [int(member) for member in left[:count].tolist()]
