"""Who may move a state: one call of `step` at a time, and nothing else meanwhile."""

import threading
import time

import numpy as np
import pytest

from mbd_sim import CommandError, Ensemble, Simulation

SENSED = """
mechanism: sensed
parts: {rod: {mass: 1, shape: {type: rod, to: [1, 0, 0]}}}
joints: {pin: {type: revolute, between: [ground, rod], axis: [0, 1, 0], position: 0.3}}
sensors: {angle: {type: encoder, joint: pin, rate: 100 Hz, counts: 4096}}
integrator: {step: 1 ms}
"""
LONG = {"contacts": 2_000, "compiled": 50_000, "sensors": 50_000, "members": 50_000}  # steps that take some 10 ms
SIMULATIONS = {
    "compiled": lambda: Simulation.from_file("double_rod"),
    "contacts": lambda: Simulation.from_file("rocking"),
    "sensors": lambda: Simulation.from_text(SENSED),
    "members": lambda: Ensemble.from_file("double_rod", 4, threads=1),
}


@pytest.mark.parametrize("kind", SIMULATIONS)
def test_no_step_of_several_threads_is_lost(kind):
    """Two thirds were, silently: each thread began at the same state, and the last one won."""
    shared, alone, accepted, found = SIMULATIONS[kind](), SIMULATIONS[kind](), [], []

    def work():
        for _ in range(5):
            try:
                shared.step(LONG[kind])
                accepted.append(LONG[kind])
            except CommandError as error:
                found.append(error)
                time.sleep(0.002)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found, "the threads never met"
    assert {str(error) for error in found} == {
        "another thread is taking steps of this simulation. "
        "Let one thread step the simulation and change it, or take a lock around each call."
    }
    assert shared.steps == sum(accepted)
    for steps in accepted:
        alone.step(steps)
    assert np.array_equal(shared.state, alone.state)


CHANGES = {
    "step": lambda sim: sim.step(),
    "reset": lambda sim: sim.reset(),
    "restore": lambda sim: sim.restore(sim.state, 0),
    "set_state": lambda sim: sim.set_state(velocities={"tilt": 0.0}),
    "set_efforts": lambda sim: sim.set_efforts([1.0] * len(sim.efforts)),
    "set_wrench": lambda sim: sim.set_wrench("block", [1.0, 0.0, 0.0]),
    "set_live": lambda sim: sim.set_live({"gravity[2]": -1.0}),
    "snapshot": lambda sim: sim.snapshot(),
    "observe_contacts": lambda sim: sim.observe_contacts(None),
}


class Acting:
    """An observer that acts on the simulation at the first event, keeps the error, and may raise it."""

    def __init__(self, simulation, act, *, insists):
        self.simulation, self.act, self.insists, self.error = simulation, act, insists, None

    def impact(self, time, before, after):
        pass

    def event(self, event):
        if self.error is None:
            try:
                self.act(self.simulation)
            except CommandError as error:
                self.error = error
                if self.insists:
                    raise


@pytest.mark.parametrize("insists", [True, False])
@pytest.mark.parametrize("name", CHANGES)
def test_an_observer_cannot_act_within_the_steps_of_which_it_is_told(name, insists):
    """Its steps were undone without a word, as the steps of which it was told ended; so were its efforts or not."""
    options = {"wrenches": ["block"], "live": ["gravity[2]"]}
    acting, plain = (Simulation.from_file("rocking", **options) for _ in range(2))
    observer = Acting(acting, CHANGES[name], insists=insists)
    acting.observe_contacts(observer)
    if insists:
        with pytest.raises(CommandError, match=r"act on that when step\(\) has returned"):
            acting.step(1000)
        assert acting.steps == 0
    acting.step(1000)
    plain.step(1000)
    assert "an observer or listener asks for this while its simulation takes steps" in str(observer.error)
    assert acting.state.tobytes() == plain.state.tobytes()


def test_an_observer_cannot_act_while_the_modes_of_a_new_state_are_found_either():
    simulation = Simulation.from_file("bounce")
    observer = Acting(simulation, CHANGES["step"], insists=True)
    simulation.observe_contacts(observer)
    with pytest.raises(CommandError, match="an observer or listener asks for this"):
        simulation.reset(q=[0.0], u=[-1.0])
    assert simulation.steps == 0
    simulation.observe_contacts(None)
    simulation.step(3)
    assert simulation.steps == 3


def test_another_thread_cannot_change_a_state_that_is_being_moved():
    simulation, begun = Simulation.from_file("double_rod"), threading.Event()

    def work():
        begun.set()
        simulation.step(300_000)

    simulation.set_efforts([0.0, 0.0])  # compiled from here on
    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    time.sleep(0.01)
    for name in ("reset", "set_efforts", "snapshot"):
        with pytest.raises(CommandError, match="another thread is taking steps"):
            CHANGES[name](simulation)
    thread.join()
    assert simulation.steps == 300_000
    simulation.reset()


def test_a_step_that_was_kept_from_before_a_recording_is_recorded(tmp_path):
    """Such a function passed the recorder by: it recorded nothing but the first and the last state."""
    simulation = Simulation.from_file("double_rod")
    step, steps = simulation.step, []

    class Listener:
        def parts_of(self, count):
            steps.append(count)
            yield count

        def report(self, kind, payload=None):
            pass

    simulation.listen(Listener())
    step(3)
    step()
    simulation.listen(None)
    step(5)
    assert steps == [3, 1]
    assert simulation.steps == 9


@pytest.mark.parametrize("name", ["step", "members"])
def test_an_error_within_steps_leaves_the_simulation_usable(name):
    class Failing(Acting):
        def event(self, event):
            raise KeyboardInterrupt

    if name == "members":
        simulation = Ensemble.from_file("bounce", 1)
        simulation.observe_contacts([Failing(simulation, None, insists=True)])
    else:
        simulation = Simulation.from_file("bounce")
        simulation.observe_contacts(Failing(simulation, None, insists=True))
    with pytest.raises(KeyboardInterrupt):
        simulation.step(2000)
    simulation.step(1)
    assert simulation.steps == 1
