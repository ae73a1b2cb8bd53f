"""Assignments that a kernel would not see are refused, and the error names the call that has the intended effect."""

import pickle

import numpy as np
import pytest

from mbd_sim import CommandError, Ensemble, Simulation

REMEDIES = {
    "q": "reset(q=", "u": "reset(q=", "y": "restore(", "state": "restore(", "t": "reset()", "time": "reset()",
    "steps": "reset()", "efforts": "set_efforts(", "inputs": "set_wrench(", "live": "set_live(", "step_size": "Build",
    "mechanism": "Build", "model": "Build",
}  # fmt: skip


@pytest.fixture(scope="module")
def sim():
    return Simulation.from_file("double_rod")


@pytest.mark.parametrize("name", REMEDIES)
def test_attributes_that_the_kernel_does_not_read_cannot_be_assigned(sim, name):
    before = {key: value for key, value in vars(sim).items() if key != "step"}
    with pytest.raises(AttributeError) as error:
        setattr(sim, name, [1.0, 2.0])
    assert f"'{name}'" in str(error.value) and REMEDIES[name] in str(error.value)
    assert {key: value for key, value in vars(sim).items() if key != "step"}.keys() == before.keys()


@pytest.mark.parametrize("name", ["q", "u", "y", "efforts", "inputs"])
def test_writes_in_place_name_the_calls(sim, name):
    view, before = getattr(sim, name), getattr(sim, name).copy()

    def add(view):
        view += 1.0

    def assign(view):
        view[0] = 1.0

    def assign_slice(view):
        view[:1][:] = 1.0

    def write_out(view):
        np.add(view, 1.0, out=view)

    for write in (assign, assign_slice, add, write_out):
        with pytest.raises(ValueError, match=r"read-only.*reset\(q=.*set_efforts"):
            write(view)
    assert np.array_equal(getattr(sim, name), before)


def test_a_subclass_has_attributes_and_a_step_of_its_own():
    class Counted(Simulation):
        def __init__(self, *given, **options):
            super().__init__(*given, **options)
            self.calls = 0

        def step(self, n=1):
            self.calls += 1
            super().step(n)

    counted = Counted.from_file("double_rod")
    counted.run(0.1)
    assert counted.calls == 1 and counted.steps == 100
    with pytest.raises(AttributeError, match="'q' of a Counted"):
        counted.q = [0.0, 0.0]


def test_copies_and_results_are_ordinary_arrays(sim):
    for array in (
        sim.q.copy(),
        2.0 * sim.q,
        np.sin(sim.q),
        sim.q + sim.u,
        np.array(sim.q),
        pickle.loads(pickle.dumps(sim.q)),
    ):
        assert type(array) is np.ndarray
        array[0] = 7.0
    assert isinstance(sim.q.sum(), float) and isinstance(sim.q @ sim.u, float)


def test_members_of_an_ensemble_cannot_be_written():
    rods = Ensemble.from_file("double_rod", 2)
    with pytest.raises(ValueError, match=r"read-only.*reset\(q="):
        rods.q[0, 0] = 1.0
    for name in ("q", "u", "state", "steps", "time", "t", "alive", "step_size", "mechanism", "model"):
        with pytest.raises(AttributeError, match=f"'{name}' of a Ensemble cannot be assigned. "):
            setattr(rods, name, 1.0)


STOP = """
mechanism: stop
parameters: {k: 3}
parts: {a: {mass: 1}}
joints:
  a: {type: prismatic, between: [ground, a], axis: [1, 0, 0], stiffness: k, limits: {lower: -1, upper: 1, restitution: 0.5}}
"""


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda sim: sim.set_state({"a": "5 cm"}), "the position of a is not a number ('5 cm' is a text). Give a number"),
        (lambda sim: sim.set_state(velocities={"a": None}), "the velocity of a is not a number"),
        (lambda sim: sim.set_state({"a": [0.1, 0.2]}), "the position of a is not a number"),
        (lambda sim: sim.reset(q={"a": "0.1"}), "the position of a is not a number"),
        (lambda sim: sim.set_state([0.1]), "the positions and velocities are not given by name: [0.1]. Give them as {"),
        (lambda sim: sim.set_state(np.array([0.1])), "the positions and velocities are not given by name"),
        (lambda sim: sim.set_live([("k", 1.0)]), "the live values are not given by name"),
        (lambda sim: sim.set_live(None), "the live values are not given by name: None"),
        (lambda sim: sim.set_wrench("b", force=[1, 0, 0]), "there is no part 'b'. Valid: a."),
    ],
)  # fmt: skip
def test_what_is_not_given_by_name_or_no_number_is_refused_by_the_name_of_what_it_is(stopped, call, message):
    """Python's own errors said `must be real number, not str`, or that a tuple has no attribute, without the name."""
    y = stopped.y.copy()
    with pytest.raises(CommandError) as error:
        call(stopped)
    assert message in str(error.value)
    assert np.array_equal(stopped.y, y)


@pytest.mark.parametrize("observer", [print, "text", object(), lambda event: None])
def test_an_observer_of_contacts_without_its_methods_is_refused_at_once(stopped, observer):
    """The first impact ended the run otherwise, in the middle of a step."""
    with pytest.raises(ValueError, match=r"no method impact, event\. Give an object with the methods impact\(time"):
        stopped.observe_contacts(observer)
    stopped.set_state(velocities={"a": 9.0})
    stopped.step(200)


@pytest.fixture(scope="module")
def stopped():
    return Simulation.from_text(STOP, live=["k"])
