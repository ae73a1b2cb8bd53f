"""The compiled `step`: it behaves like an ordinary Python method, including errors, and leaks nothing."""

import contextlib
import copy
import gc
import signal
import sys
import threading
import time
import weakref

import numpy as np
import pytest

from mbd_sim import DivergedError, Simulation

UNSTABLE = """
mechanism: unstable
parts: {mass: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], stiffness: 1e12, position: 1}}
integrator: {method: rk4, step: 1}
"""


def state(simulation):
    return simulation.state.tobytes(), simulation.steps


def test_it_is_the_plain_method_bit_for_bit():
    compiled, plain = Simulation.from_file("double_rod"), Simulation.from_file("double_rod")
    method = Simulation.step.__get__(plain)
    for count in (1, 3, 0, 15, 16, 1000):
        compiled.step(count)
        method(count)
        assert state(compiled) == state(plain)
    assert compiled.steps == 1035


def test_it_takes_what_the_method_takes():
    simulation = Simulation.from_file("rod_pendulum")
    simulation.step()
    simulation.step(n=2)
    simulation.step(np.int64(3))
    simulation.step(True)
    assert simulation.steps == 7


@pytest.mark.parametrize(
    ("arguments", "keywords", "error", "words"),
    [
        ((-1,), {}, ValueError, "must lie between 0 and 9007199254740992, not -1"),
        ((2**53 + 1,), {}, ValueError, "must lie between 0 and 9007199254740992, not 9007199254740993"),
        ((2**70,), {}, ValueError, "must lie between 0 and 9007199254740992"),
        ((1.5,), {}, TypeError, "float"),
        (("3",), {}, TypeError, "str"),
        ((None,), {}, TypeError, "NoneType"),
        ((1, 2), {}, TypeError, "positional"),
        ((), {"m": 1}, TypeError, "'m'"),
    ],
)
def test_it_says_what_is_wrong(arguments, keywords, error, words):
    simulation = Simulation.from_file("rod_pendulum")
    before = state(simulation)
    with pytest.raises(error, match=words):
        simulation.step(*arguments, **keywords)
    assert state(simulation) == before
    simulation.step()
    assert simulation.steps == 1


def test_what_a_number_raises_comes_through():
    class Odd:
        def __index__(self):
            raise RuntimeError("no number today")

    with pytest.raises(RuntimeError, match="no number today"):
        Simulation.from_file("rod_pendulum").step(Odd())


@pytest.mark.parametrize("count", [5, 100])
def test_divergence_leaves_the_last_state(count):
    simulation = Simulation.from_text(UNSTABLE)
    before = state(simulation)
    with pytest.raises(DivergedError, match="became infinite"):
        for _ in range(100):
            before = state(simulation)
            simulation.step(count)
    assert state(simulation) == before


def test_long_runs_release_the_interpreter():
    simulation, counts = Simulation.from_file("double_rod"), []
    for steps in (300_000, 3_000_000, 30_000_000):  # the longer ones where this thread has to wait for a processor
        thread = threading.Thread(target=simulation.step, args=(steps,))
        thread.start()
        counts.append(0)
        while thread.is_alive():
            time.sleep(0.0)  # gives the lock to the other thread, which then holds it or not
            counts[-1] += 1
        if counts[-1] > 100:
            break
    assert counts[-1] > 100


def test_a_simulation_is_collected_with_its_callable():
    simulation = Simulation.from_file("rod_pendulum")
    step, gone = simulation.step, weakref.ref(simulation)
    step(3)
    del simulation
    assert gone() is not None  # the callable keeps what it steps
    step(3)
    del step
    gc.collect(1)
    assert gone() is None


def test_it_leaks_no_references():
    simulation, many = Simulation.from_file("rod_pendulum"), 12345
    simulation.step(many)
    gc.collect(1)
    before = sys.getrefcount(None), sys.getrefcount(many), sys.getrefcount(simulation)
    for _ in range(300):
        simulation.step(many % 3)
        with contextlib.suppress(ValueError):
            simulation.step(-many)
    gc.collect(1)
    after = sys.getrefcount(None), sys.getrefcount(many), sys.getrefcount(simulation)
    assert all(abs(now - then) < 100 for now, then in zip(after, before, strict=True))


def test_copies_step_their_own_state():
    simulation = Simulation.from_file("rod_pendulum")
    copied, before = copy.deepcopy(simulation), simulation.state
    copied.step(5)
    assert simulation.state.tobytes() == before.tobytes() != copied.state.tobytes()


class Counting(Simulation):
    """A simulation that counts its calls of `step`."""

    calls = 0

    def step(self, n=1):
        self.calls += 1
        super().step(n)


def test_a_subclass_may_override_step():
    simulation, plain = Counting.from_file("double_rod"), Simulation.from_file("double_rod")
    simulation.step(3)
    simulation.run(until=0.1)
    plain.run(until=0.1)
    assert simulation.calls == 2
    assert state(simulation) == state(plain)


def test_a_subclass_without_a_step_keeps_the_compiled_one():
    class Named(Simulation):
        name = "named"

    simulation = Named.from_file("rod_pendulum")
    simulation.step(2)
    assert simulation.steps == 2
    assert type(simulation.step) is type(Simulation.from_file("rod_pendulum").step) is type(len)


@pytest.mark.parametrize("name", ["double_rod", "bounce"])
def test_one_call_of_many_steps_can_be_interrupted(name):
    """A cell of a notebook with a zero too many could not be stopped, but by ending its kernel."""

    def interrupt(*_):
        raise KeyboardInterrupt

    simulation, again = Simulation.from_file(name), Simulation.from_file(name)
    handler = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    try:
        with pytest.raises(KeyboardInterrupt):
            simulation.step(10**9)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
    assert simulation.steps < 10**8
    again.step(simulation.steps)
    assert state(simulation) == state(again)
    simulation.step(20_001)
    again.step(20_001)
    assert state(simulation) == state(again)
