"""Efforts of a motion against the forward dynamics, on every kind of mechanism."""

import numpy as np
import pytest
from hypothesis import given, settings

from mbd_sim import Simulation, load_mechanism, parse_mechanism
from mbd_sim.analysis.mechanics.inverse_dynamics import InverseDynamics
from mbd_sim.dynamics.equations import derive
from test.generators.mechanisms import accelerations, consistent_state, random_state, random_trees

OPEN = [
    "double_pendulum", "six_axis_arm", "cart_pendulum_spring", "spherical_top", "universal_pendulum", "planar_puck",
    "tumbling", "moving_support_pendulum", "stick_slip", "snap_through", "quadratic_drag", "screw_press",
]  # fmt: skip


def relative(found, expected):
    return np.max(np.abs(found - expected)) / max(1.0, np.max(np.abs(expected)))


@pytest.mark.parametrize("name", OPEN)
def test_efforts_of_open_chains_come_back(name):
    mechanism, rng = load_mechanism(name), np.random.default_rng(5)
    equations, inverse = derive(mechanism), InverseDynamics(mechanism)
    for _ in range(10):
        q, u, efforts = random_state(mechanism, rng)
        wanted = accelerations(equations, q, u, efforts, 0.7)
        found = inverse(q, u, wanted, 0.7)
        assert relative(accelerations(equations, q, u, found, 0.7), wanted) < 1e-11
        if np.max(np.abs(wanted)) < 1e3:  # else the efforts are small beside the inertia forces
            assert relative(found, efforts) < 1e-10


@settings(max_examples=3)
@given(random_trees())
def test_efforts_of_random_trees_come_back(drawn):
    text, rng = drawn
    mechanism = parse_mechanism(text)
    q, u, efforts = random_state(mechanism, rng)
    if not len(u):
        return
    equations = derive(mechanism)
    wanted = accelerations(equations, q, u, efforts, 0.3)
    found = accelerations(equations, q, u, InverseDynamics(mechanism)(q, u, wanted, 0.3), 0.3)
    assert relative(found, wanted) < 1e-11


@pytest.mark.parametrize("name", ["four_bar", "rssr", "scissor_lift"])
def test_efforts_of_loops_give_the_accelerations_back(name):
    mechanism, rng = load_mechanism(name), np.random.default_rng(6)
    equations = derive(mechanism)
    inverse = InverseDynamics(mechanism, equations=equations)
    for _ in range(3):
        q, u, efforts = consistent_state(equations, rng, reach=0.3)
        wanted = accelerations(equations, q, u, efforts)
        found = inverse(q, u, wanted)
        assert relative(accelerations(equations, q, u, found), wanted) < 1e-9
        assert np.linalg.norm(found) <= np.linalg.norm(efforts) * (1.0 + 1e-6)


def test_one_motor_drives_a_four_bar():
    sim = Simulation.from_file("four_bar")
    inverse = InverseDynamics(sim.mechanism, ["crank_pivot"])
    sim.set_efforts({"crank_pivot": 3.0})
    wanted = accelerations(sim.model.equations, sim.q, sim.u, sim.efforts)
    assert inverse(sim.q, sim.u, wanted) == pytest.approx([3.0, 0.0, 0.0], abs=1e-10)


def test_the_efforts_of_rest_carry_the_weight():
    sim = Simulation.from_file("six_axis_arm")
    sim.set_efforts(InverseDynamics(sim.mechanism)(sim.q, sim.u, np.zeros(6)))
    q = sim.q.copy()
    sim.run(until=0.5)
    assert np.max(np.abs(sim.q - q)) < 1e-9


def test_impossible_accelerations_are_refused():
    with pytest.raises(ValueError, match=r"no efforts at rail give these accelerations: pin would have -?\d"):
        InverseDynamics(load_mechanism("cart_pendulum"), ["rail"])(np.zeros(2), np.zeros(2), np.array([1.0, 1.0]))
    sim = Simulation.from_file("four_bar")
    with pytest.raises(ValueError, match="that the constraints allow"):
        InverseDynamics(sim.mechanism)(sim.q, sim.u, np.array([1.0, 2.0, 3.0]))
    with pytest.raises(ValueError, match=r"no coordinate 'rial'\. Did you mean 'rail'"):
        InverseDynamics(load_mechanism("cart_pendulum"), ["rial"])


@pytest.mark.parametrize(
    ("name", "part", "changes"),
    [
        ("double_rod", "lower", {"gravity[2]": -3.0, "parameters.l": 0.7}),
        ("four_bar", "coupler", {"gravity[2]": -3.0, "parameters.density": 2.0}),
    ],
)
def test_live_values_and_wrenches_are_accounted_for(name, part, changes):
    """The efforts that the method returns give the accelerations that were asked for."""
    sim = Simulation.from_file(name, live=list(changes), wrenches=[part])
    sim.set_live(changes)
    sim.set_wrench(part, force=[3.0, 1.0, -2.0], couple=[0.1, 0.2, 0.3])
    sim.set_efforts([0.5] * len(sim.u))
    sim.step(100)
    nq, nv = len(sim.q), len(sim.u)

    def u_rates():
        rates = sim.model.equations.rates.call([sim.time, np.array(sim.y), np.array(sim.inputs)])[0]
        return np.array(rates).ravel()[nq : nq + nv]

    wanted = u_rates()
    sim.set_efforts([0.0] * nv)
    sim.set_efforts(sim.inverse_dynamics(wanted))
    assert relative(u_rates(), wanted) < 1e-10


@pytest.mark.parametrize(
    ("q", "rates", "words"),
    [
        (np.zeros(5), np.zeros(6), r"q must be a list of 6 values, not an array of shape \(5,\)"),
        (np.zeros((6, 2)), np.zeros(6), r"not an array of shape \(6, 2\)"),
        (0.0, np.zeros(6), r"not an array of shape \(\)"),
        (np.zeros(6), np.zeros(7), r"u_rates must be a list of 6 values, not an array of shape \(7,\)"),
    ],
)
def test_arguments_of_another_shape_are_refused(q, rates, words):
    """CasADi would repeat single numbers, and compute several states at once."""
    inverse = InverseDynamics(load_mechanism("six_axis_arm"))
    assert inverse([0] * 6, [0] * 6, [0] * 6).shape == (6,)
    with pytest.raises(ValueError, match=words):
        inverse(q, np.zeros(6), rates)


def test_a_single_actuated_coordinate_may_be_given_by_itself():
    assert InverseDynamics(load_mechanism("four_bar"), "crank_pivot").actuated == ("crank_pivot",)
