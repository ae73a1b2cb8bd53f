"""The `repr` of public objects says in one line what they are."""

import pytest

from mbd_sim import Ensemble, Simulation, load_mechanism
from mbd_sim.kinematic_analysis import driven_motion


@pytest.fixture(scope="module")
def simulation():
    simulation = Simulation(load_mechanism("four_bar"))
    simulation.run(until=0.5)
    return simulation


def test_records_and_simulations(simulation):
    mechanism = simulation.mechanism
    assert repr(mechanism) == (
        "<Mechanism four_bar: 3 parts, 4 joints; coordinates crank_pivot, crank_pin, rocker_pivot>"
    )
    assert repr(mechanism.parts["crank"]) == "<Part crank: 0.5 kg, 1 point>"
    assert repr(mechanism.joints["crank_pivot"]) == "<Joint crank_pivot: revolute, ground – crank>"
    assert repr(mechanism.source).endswith("four_bar.yaml>")
    assert repr(simulation) == "<Simulation four_bar at t = 0.5 s: method adams11, step 0.001 s>"
    assert repr(simulation.model) == "<Model four_bar: method adams11>"


def test_studies(simulation):
    ensemble = Ensemble(simulation.mechanism, 3)
    assert repr(ensemble).startswith("<Ensemble of 3 × four_bar at t = 0 s: method ")
    motion = driven_motion(simulation.mechanism, {"crank_pivot": (0.0, 1.0)}, 5)
    assert repr(motion) == "<DrivenMotion of four_bar: 5 positions of crank_pivot, speed 1>"
    system = simulation.state_space()
    assert repr(system).startswith(f"<StateSpace: states {system.states[0]}, ")
