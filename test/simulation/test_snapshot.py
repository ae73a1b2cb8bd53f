"""A run continues from a snapshot bit for bit, whatever was commanded before it."""

import pickle

import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation

OPTIONS = {"live": ["gravity[2]", "joints.*.damping"], "wrenches": ["lower"]}


@pytest.fixture(scope="module")
def builds():
    return [Simulation.from_file("double_rod", **OPTIONS) for _ in range(2)]


def everything(sim):
    found = sim.state.tobytes(), sim.inputs.tobytes(), sim.steps, sim.time, sim.energies, sim.error_estimate
    return *found, sim.live, sim.efforts.tolist()


def disturbed(sim):
    sim.reset()
    sim.set_live({"gravity[2]": -9.81, "joints.elbow.damping": 0.0})
    sim.set_efforts([0.3, -0.2])
    sim.set_wrench("lower", force=[1.0, 2.0, -1.0], at=[0.0, 0.0, -0.3])
    sim.step(103)
    sim.set_live({"gravity[2]": -3.0, "joints.elbow.damping": 0.4})
    sim.step(40)


def test_a_run_continues_bit_for_bit_in_the_same_and_in_another_simulation(builds):
    sim, other = builds
    disturbed(sim)
    snapshot, before = pickle.loads(pickle.dumps(sim.snapshot())), everything(sim)
    sim.step(77)
    expected = everything(sim)
    sim.set_live({"gravity[2]": -1.0})
    sim.set_efforts([9.0, 9.0])
    sim.reset(q=[0.1, 0.2])
    for each in (sim, other):
        each.restore(snapshot)
        assert everything(each) == before
        each.step(77)
        assert everything(each) == expected
    other.set_live({"joints.elbow.damping": 0.1})  # the other live values are those of the snapshot
    assert other.live["gravity[2]"] == -3.0


def test_a_snapshot_does_not_follow_the_run(builds):
    sim = builds[0]
    disturbed(sim)
    snapshot, state = sim.snapshot(), sim.state
    sim.step(10)
    assert np.array_equal(snapshot.state, state) and snapshot.steps == sim.steps - 10


@pytest.mark.parametrize(
    ("options", "difference"),
    [
        ({"step": 2e-3}, "step in s: 0.001 instead of 0.002"),
        ({"wrenches": []}, "parts that accept wrenches"),
        ({"live": ["gravity[2]"]}, "live values"),
    ],
)
def test_a_snapshot_of_another_run_is_refused(builds, options, difference):
    other = Simulation.from_file("double_rod", **{**OPTIONS, **options})
    before = everything(other)
    with pytest.raises(ValueError, match=difference):
        other.restore(builds[0].snapshot())
    assert everything(other) == before


def test_a_state_alone_needs_its_time(builds):
    sim = builds[0]
    disturbed(sim)
    before, state = everything(sim), sim.state
    with pytest.raises(ValueError, match=r"restore\(state, steps=…\), or restore a snapshot"):
        sim.restore(state)
    with pytest.raises(TypeError, match="as a whole"):
        sim.restore(sim.snapshot(), steps=0)
    assert everything(sim) == before
    sim.restore(state, steps=12)
    assert sim.steps == 12 and sim.state.tobytes() == state.tobytes()


def test_an_ensemble_continues_bit_for_bit():
    rods = Ensemble.from_file("double_rod", [{"l": 0.5}, {"l": 1.0}, {"l": 2.0}])
    rods.set_efforts({"elbow": [0.1, 0.2, 0.3]})
    rods.step(50)
    snapshot = pickle.loads(pickle.dumps(rods.snapshot()))
    rods.step(30)

    def everything():
        numbers = rods.state, rods.error_estimates, rods.alive, rods.energies.residual
        return *(array.tobytes() for array in numbers), rods.steps, rods.time

    expected = everything()
    rods.reset()
    rods.restore(snapshot)
    assert rods.steps == 50
    rods.step(30)
    assert everything() == expected
    with pytest.raises(ValueError, match="members: 3 instead of 1"):
        Ensemble.from_file("double_rod", 1).restore(snapshot)
