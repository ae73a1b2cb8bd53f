"""Assignments that a kernel would not see are refused, and the error names the call that has the intended effect."""

import pickle

import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation

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
