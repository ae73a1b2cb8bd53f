"""Steps of time stepping by compiled code and by the code for all contacts, from the same states."""

import numpy as np
import pytest

from mbd_sim.simulation.contact.compiled.step import DONE, HARD


class Both:
    """A simulation of which each step is taken in both ways; it goes on from what the code for all contacts gives."""

    def __init__(self, simulation):
        self.stepper, self.memory = simulation._memory.stepper, simulation._memory
        self.model = simulation.model.one_sided
        self.compiled = self.left = self.acting = 0

    def step(self):
        """The states and modes after a step, of compiled code and of the code for all contacts; None if it is left."""
        memory, stepper, estimate = self.memory, self.stepper, np.zeros(1)
        at, start = (memory.steps, memory.step_size), (memory.y.copy(), memory.inputs.copy())
        own, other = (tuple(array.copy() for array in start) for _ in range(2))
        _, status = stepper._contacts.advance_by_time_stepping(*own, *at, 1, estimate)
        stepper._note_compiled()
        events = [list(stepper._new)]
        stepper._new.clear()
        stepper._take(*other, *at, estimate)
        events.append(list(stepper._new))
        stepper._new.clear()
        memory.y[:], memory.inputs[:] = other
        memory._counter[0] += 1
        if status == HARD:
            assert all(np.array_equal(*pair) for pair in zip(own, start, strict=True))
            self.left += 1
            return None
        assert status == DONE
        self.compiled += 1
        self.acting += bool(np.any(self.model.modes(other[1])[: self.model.layout.signs.start])) or len(events[1]) > 0
        return own, other, events

    def compare(self, steps):
        """Take steps, and compare each."""
        layout = self.model.layout
        for _ in range(steps):
            if (found := self.step()) is None:
                continue
            (y, inputs), (other, other_inputs), events = found
            assert y == pytest.approx(other, rel=1e-10, abs=1e-11)
            modes, others = self.model.modes(inputs), self.model.modes(other_inputs)
            for part in (layout.closed, layout.active, layout.signs, layout.features):
                assert modes[part] == pytest.approx(others[part], rel=1e-12, abs=1e-12)
            assert modes[layout.direction] == pytest.approx(others[layout.direction], abs=1e-5)  # of a slip near zero
            forces = np.max(np.abs(others[layout.given]), initial=1.0)
            assert modes[layout.given] == pytest.approx(others[layout.given], abs=1e-7 * forces)
            assert [event.text for event in events[0]] == [event.text for event in events[1]]
