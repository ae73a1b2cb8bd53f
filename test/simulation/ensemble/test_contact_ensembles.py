"""Ensembles of mechanisms with one-sided elements: each member goes through its own events, as a single simulation."""

import pickle

import numpy as np
import pytest

from mbd_sim import CommandError, DivergedError, Ensemble, MechanismError, Simulation
from mbd_sim.files.load import load_mechanism, parse_mechanism
from mbd_sim.simulation.contact.stepper import EventError

NAMES = {
    "belt": "tsitouras8",
    "elbow_stop": "rk4",
    "rocking": "gauss4",
    "slider_crank_friction": "tsitouras8",
}

DRIVEN_INTO_THE_FLOOR = """
mechanism: press
parameters: {v: 0.1}
parts:
  ram: {shape: {type: particle, mass: 1}}
  ball: {shape: {type: particle, mass: 1}}
joints:
  ram: {type: prismatic, between: [ground, ram], axis: [0, 0, 1], drive: 0.05 - v*t}
  ball: {type: prismatic, between: [ground, ball], axis: [0, 0, 1], position: 1}
constraints:
  floor: {type: on_plane, point: ram, bound: at_least}
  catch: {type: on_plane, point: ball, bound: at_least, restitution: 0.5}
"""


@pytest.mark.parametrize(("name", "method"), NAMES.items())
def test_members_move_as_single_simulations_bit_for_bit(name, method):
    random = np.random.default_rng(5)
    ensemble = Ensemble.from_file(name, 4, method=method, threads=2)
    u = ensemble.u + 0.3 * random.normal(size=ensemble.u.shape)
    efforts = random.normal(size=ensemble.u.shape)
    ensemble.reset(u=u, nearest_speeds=True)
    ensemble.set_efforts(efforts)
    ensemble.step(37)
    ensemble.step(900)
    single = Simulation.from_file(name, method=method)
    for member in range(4):
        single.reset(u=u[member], nearest_speeds=True)
        single.set_efforts(efforts[member])
        single.step(937)
        assert np.array_equal(ensemble.state[member], single.state)
        assert ensemble.energies.residual[member] == single.energies.residual
        assert ensemble.error_estimates[member] == single.error_estimate
    assert ensemble.alive.all()


def test_members_have_coefficients_and_rest_speeds_of_their_own():
    text = load_mechanism("bounce").source.text + "integrator: {rest_speed: 1e-5}\n"
    changes = [{"e": 0.3}, {"e": 0.8}, {"e": 0.8, "integrator.rest_speed": 3.0}]
    ensemble = Ensemble(parse_mechanism(text), changes)
    ensemble.run(1.9)
    for member, change in enumerate(changes):
        rest_speed = {name: value for name, value in change.items() if name != "e"}
        single = Simulation.from_text(text, live=["parameters.e"], set=rest_speed)
        single.set_live({"parameters.e": change["e"]})
        single.reset()
        single.run(1.9)
        assert np.array_equal(ensemble.state[member], single.state)
    assert len({state.tobytes() for state in ensemble.state}) == 3


def test_start_states_are_settled_member_by_member():
    ensemble = Ensemble.from_file("bounce", [{"h": 0.0}, {"h": 1.0}, {"h": 0.0, "joints.height.velocity": -1.0}])
    assert ensemble.u[:, 0].tolist() == [0.0, 0.0, 0.8]
    start = ensemble.energies
    assert start.dissipated[2] == pytest.approx(0.5 * (1.0 - 0.8**2), abs=1e-15)
    assert np.abs(start.residual).max() < 1e-15
    ensemble.run(0.1)
    assert ensemble.q[0, 0] == 0.0
    assert np.abs(ensemble.energies.residual).max() < 1e-13


def test_a_snapshot_holds_which_contacts_are_closed():
    ensemble = Ensemble.from_file("belt", [{"vb": 0.2}, {"vb": 0.3}])
    ensemble.run(0.1)
    snapshot = pickle.loads(pickle.dumps(ensemble.snapshot()))
    ensemble.run(1.0)
    expected = ensemble.state
    ensemble.restore(snapshot)
    ensemble.run(1.0)
    assert np.array_equal(ensemble.state, expected)
    other = Ensemble.from_file("belt", [{"vb": 0.2}, {"vb": 0.3}])
    other.restore(snapshot)
    other.run(1.0)
    assert np.array_equal(other.state, expected)


def test_a_member_whose_contacts_have_no_solution_is_lost_alone_and_told():
    mechanism = parse_mechanism(DRIVEN_INTO_THE_FLOOR)
    ensemble = Ensemble(mechanism, [{"v": 0.0}, {"v": 0.1}, {"v": 0.2}], threads=2)
    ensemble.step(400)
    before = ensemble.state
    ensemble.step(200)
    assert ensemble.alive.tolist() == [True, False, False]
    assert np.array_equal(ensemble.state[1:, :2], before[1:, :2])
    ensemble.step(10)
    assert ensemble.u[0, 0] > 0.0
    with pytest.raises(DivergedError, match=r"2 of 3 members .* the first is member 1.*at 0\.5 s"):
        ensemble.require_alive()
    single = Simulation(mechanism)
    with pytest.raises(EventError, match=r"at 0\.5 s"):
        single.run(1.0)


def test_a_start_without_a_solution_names_the_member():
    mechanism = parse_mechanism(DRIVEN_INTO_THE_FLOOR.replace("0.05 - v*t", "0 - v*t"))
    with pytest.raises(EventError, match="member 1: at 0 s"):
        Ensemble(mechanism, [{"v": 0.0}, {"v": 0.1}])


def test_a_start_inside_an_obstacle_names_the_member():
    with pytest.raises(CommandError, match=r"member 1: constraints\.floor: .* 0\.5 m beyond"):
        Ensemble.from_file("bounce", [{"h": 1.0}, {"h": -0.5}])
    ensemble = Ensemble.from_file("bounce", 2)
    before = ensemble.state
    with pytest.raises(CommandError, match="member 0: "):
        ensemble.reset(q=np.array([[-0.1], [1.0]]))
    assert np.array_equal(ensemble.state, before)


class Observer:
    """Counts impacts, and raises an error at one of them."""

    def __init__(self, fails_at=0):
        self.impacts, self._fails_at = 0, fails_at

    def impact(self, time, before, after):
        self.impacts += 1
        if self.impacts == self._fails_at:
            raise KeyboardInterrupt

    def event(self, event):
        pass


def test_an_error_of_an_observer_leaves_all_members_where_they_were():
    """Those before it in the list had taken the steps, at the old time, and took them again in the next call."""
    ensemble, fresh = Ensemble.from_file("bounce", 3), Ensemble.from_file("bounce", 3)
    ensemble.step(100)
    state = ensemble.state.copy()
    ensemble.observe_contacts([Observer(), Observer(fails_at=2), Observer()])
    with pytest.raises(KeyboardInterrupt):
        ensemble.step(1900)
    assert ensemble.steps == 100
    assert np.array_equal(ensemble.state, state)
    ensemble.observe_contacts([Observer() for _ in range(3)])
    ensemble.step(1900)
    fresh.step(100)
    fresh.step(1900)
    assert np.array_equal(ensemble.state, fresh.state)
    assert np.array_equal(ensemble.energies.residual, fresh.energies.residual)


BOXES = """
mechanism: boxes
parameters: {w: 0.2, mu: 0.3}
parts:
  a: {shape: {type: block, size: [w, 0.2, 0.2], mass: 1}}
  b: {shape: {type: block, size: [0.2, 0.2, 0.2], mass: 1}}
joints:
  a: {type: free, between: [ground, a], position: [0, 0, 0.1]}
  b: {type: free, between: [ground, b], position: [1, 0, 0.1]}
contacts:
  floor: {parts: [a], plane: ground, friction: mu}
  meet: {between: [a, b], friction: mu}
"""


def test_a_size_that_members_cannot_share_names_the_contact():
    """It was named by its place in a list of pairs of bodies, which the file does not have."""
    with pytest.raises(MechanismError, match=r"contacts\.(floor|meet)\.\S+ differs, which is built into"):
        Ensemble(parse_mechanism(BOXES), [{"w": 0.2}, {"w": 0.3}])


def test_each_problem_of_a_member_names_it():
    with pytest.raises(MechanismError) as error:
        Ensemble(parse_mechanism(BOXES), [{"mu": 0.1}, {"mu": -0.1}])
    assert len(error.value.problems) == 2
    assert all(problem.message.startswith("member 1: must be at least 0") for problem in error.value.problems)
