"""The contacts of a mechanism for the functions that are compiled once for all mechanisms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.ir.python_kinds import packed
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.simulation.contact.compiled import search, step
from mbd_sim.simulation.contact.compiled.contacts import Contacts
from mbd_sim.simulation.contact.compiled.library import library
from mbd_sim.simulation.contact.one_sided_model import OneSidedModel
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent

CHANGES = {
    step.CLOSED: ContactChange.CLOSED,
    step.OPENED: ContactChange.OPENED,
    step.STICKS: ContactChange.STICKS,
    step.SLIDES: ContactChange.SLIDES,
    step.IMPACT: ContactChange.IMPACT,
}


@dataclass(frozen=True)
class EnergiesAtImpacts:
    """The total energies in J before and after an impact, which precede its events."""

    time: float
    before: float
    after: float


class CompiledContacts:
    """The contacts of a mechanism for the compiled functions, with memory for their results.

    Where energies are needed that the kernel does not read alone, only the search for events is compiled.
    """

    def __init__(
        self,
        model: OneSidedModel,
        kernel: Kernel,
        state_size: int,
        speeds: slice,
        first_loss: int,
        rest_speed: float,
        tolerance: float,
        driven: bool,
    ) -> None:
        self._model, self._kernel, layout = model, kernel, model.layout
        self._observable = "elongations" not in kernel.readers  # whether the kernel reads all energies
        self._contacts = Contacts(
            simple=False,
            advance=kernel.code.address("advance_to_event"),
            part_step=kernel.code.address("part_step"),
            readings=kernel.code.address("read_contacts"),
            terms=kernel.reader_address("contact_terms"),
            response=kernel.reader_address("contact_response"),
            restitution=kernel.reader_address("restitution"),
            joint_loads=kernel.reader_address("joint_loads") if model.loaded else 0,
            energies=0,
            energies_take_inputs=kernel.reads_inputs["energies"],
            driven=driven,
            size=state_size,
            gaps=layout.gaps,
            rows=layout.rows,
            frictions=len(model.frictions),
            guards=model.guard_count,
            pairs=len(model.pairs),
            first_mode=model.span.start,
            modes=layout.size,
            first_feature=layout.features.start,
            first_speed=speeds.start,
            speeds=speeds.stop - speeds.start,
            first_loss=first_loss,
            rest_speed=rest_speed,
            tolerance=tolerance,
            unit_speed=model.units.speed,
            unit_rate=model.units.rate,
            unit_force=model.units.force,
            **_friction(model),
            clutches=model.clutches.astype(np.int64),
            slots=model.slots.astype(np.int64),
            row_speeds=model.speeds,
            row_loads=model.loads,
            gap_units=model.gap_units,
        )
        self.observe(False)

    @cached_property
    def _results(self) -> tuple[Array, NDArray[np.int64]]:
        """Memory of the events and their counts; most members of ensembles never need it."""
        return np.zeros((step.CAPACITY, step.FIELDS)), self.marks(2)

    def observe(self, observed: bool) -> None:
        """Say whether energies at impacts have to be known to others."""
        needed = observed or self._contacts.driven
        energies = self._kernel.reader_address("energies") if needed else 0
        simple = self._observable or not needed
        self._contacts = replace(self._contacts, energies=energies, simple=simple)
        self.packed = packed(self._contacts)
        self._address = self.packed.ctypes.data

    def advance(self, y: Array, inputs: Array, first: int, h: float, n: int, estimate: Array) -> tuple[int, int]:
        """The number of steps that were taken, and why they have ended: see `step.advance`."""
        addresses, (events, counts) = (y.ctypes.data, inputs.ctypes.data), self._results
        results = estimate.ctypes.data, events.ctypes.data, counts.ctypes.data
        done = library().advance(self._address, *addresses, first, h, n, *results)
        return done, int(counts[1])

    def switch(
        self, time: float, y: Array, inputs: Array, old: Array, opening: NDArray[np.int64],
        yielding: NDArray[np.int64], elastic: bool, reached: NDArray[np.int64],
    ) -> int:  # fmt: skip
        """See `step.switch`; y and the modes among the inputs are to be restored where it is not simple."""
        events, counts = self._results
        counts[0] = 0
        marks = opening.ctypes.data, yielding.ctypes.data
        addresses = y.ctypes.data, inputs.ctypes.data, old.ctypes.data
        results = reached.ctypes.data, events.ctypes.data, counts.ctypes.data
        return int(library().switch(self._address, time, *addresses, *marks, elastic, *results))

    @staticmethod
    def marks(n: int) -> NDArray[np.int64]:
        """New marks, all 0."""
        return np.zeros(n, dtype=np.int64)

    def first_event(
        self, motion: tuple[Array, Array, float], length: float, first: float | None, left_out: NDArray[np.int64]
    ) -> tuple[float | None, int]:
        """The first event of a motion from a state, with its inputs, and a time on; and the guard that it is of, or -1.

        See `search.first_event`.

        :raises FloatingPointError: the state does not stay finite.
        """
        cause, (y, inputs, t) = self.marks(1), motion
        addresses = y.ctypes.data, inputs.ctypes.data
        marks = left_out.ctypes.data, cause.ctypes.data
        given = search.NONE if first is None else first
        found = library().first_event(self._address, *addresses, t, length, given, *marks)
        if found == search.DIVERGED:
            raise FloatingPointError
        return None if found < 0.0 else found, int(cause[0])

    def stage(self, y: Array, inputs: Array, t: float, length: float, ignored: NDArray[np.int64]) -> tuple[float, bool]:
        """Change y to the end of the next part of a step; its length, and whether that is an event: see `search.stage`.

        :raises FloatingPointError: the state does not stay finite.
        """
        found = np.empty(1)
        addresses = y.ctypes.data, inputs.ctypes.data
        status = library().stage(self._address, *addresses, t, length, ignored.ctypes.data, found.ctypes.data)
        if status < 0:
            raise FloatingPointError
        return float(found[0]), status == 1

    def events(self) -> list[ContactEvent | EnergiesAtImpacts]:
        """What happened in the last call."""
        found: list[ContactEvent | EnergiesAtImpacts] = []
        model, (events, counts) = self._model, self._results
        for time, change, index, *numbers in events[: int(counts[0])].tolist():
            if change == step.ENERGIES:
                found.append(EnergiesAtImpacts(time, *numbers))
            else:
                is_friction = change in (step.STICKS, step.SLIDES)
                name = model.friction_name(int(index)) if is_friction else model.names[int(index)]
                found.append(ContactEvent(time, name, CHANGES[change], *numbers))
        return found


def _friction(model: OneSidedModel) -> dict[str, Any]:
    """The fields of `Contacts` for friction and for the loads of joints."""
    components = np.array(model.load_components, dtype=np.int64)
    ends = np.cumsum(components * (1 + model.layout.rows))
    loads = {element: number for number, element in enumerate(model.loaded)}

    def integers(values: Iterable[int]) -> NDArray[np.int64]:
        return np.array([*values], dtype=np.int64)

    return {
        "friction_rows": integers(row for rows, _ in model.frictions for row in (*rows, -1)[:2]),
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

    :param contacts: of all members (k, slots), see `CompiledContacts.packed`.
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
