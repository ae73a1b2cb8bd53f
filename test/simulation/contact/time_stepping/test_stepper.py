"""Time stepping converges with order one to the motion with located events, and keeps what rests where it is."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent

STACK = """
mechanism: stack
parts:
  b_{i}: {for: {i: 1..2}, shape: {type: block, mass: 1, size: [0.2, 0.1, 0.1]}}
joints:
  b_{i}:
    for: {i: 1..2}
    type: planar
    between: [ground, "b_{i}"]
    axis: [0, 1, 0]
    x_axis: [1, 0, 0]
    position: [0.02*i, "0.05 - 0.1*i", 0]
contacts:
  floor: {parts: [b_1], plane: ground, friction: 0.5}
  pair: {between: [b_1, b_2], friction: 0.5}
"""


@pytest.mark.parametrize(("name", "end", "largest"), [
    ("bounce", 1.1, 4.0),  # rebounds
    ("rocking", 1.2, 20.0),  # one edge closes as the other one opens
    ("rope", 1.2, 2.0),  # a curved path of a contact that stays closed
    ("slider_crank_friction", 0.3, 1.0),  # friction by the load of a joint in a loop
    ("freewheel", 1.0, 0.2),  # a one-way clutch
])  # fmt: skip
def test_its_error_is_in_proportion_to_the_step(name, end, largest):
    """The error of an impact depends on where in its step it is, so the bound counts and not the ratio of two errors."""
    own, exact = Simulation.from_file(name, method="moreau", step=2e-3), Simulation.from_file(name, step=5e-4)
    for simulation in (exact, own):
        simulation.run(until=end)
    assert np.max(np.abs(own.q - exact.q)) < largest * own.step_size


@pytest.fixture(scope="module")
def stack():
    return Simulation.from_text(STACK, method="moreau")


def test_a_stack_rests_without_creep(stack):
    stack.reset()
    start, events = stack.q.copy(), stack.contact_event_count
    stack.step(60)
    assert np.max(np.abs(stack.q - start)) < 1e-15
    assert abs(stack.energies.residual) < 1e-15
    states = stack.contacts()
    for contact, load in (("floor", 2.0 * 9.81), ("pair", 9.81)):
        pressed = [state for name, state in states.items() if name.startswith(contact) and state.normal]
        assert sum(state.normal for state in pressed) == pytest.approx(load, rel=1e-9)
        assert len(pressed) == 2 and {state.state for state in pressed} == {"sticks"}
    assert stack.contact_event_count == events


def test_steps_one_by_one_and_from_a_snapshot_are_the_same_bit_for_bit(stack):
    stack.reset(u=np.tile([0.3, 0.0, 0.0], 2))
    stack.step(10)
    snapshot = stack.snapshot()
    stack.step(30)
    together = stack.y.copy()
    stack.restore(snapshot)
    for _ in range(30):
        stack.step()
    assert np.array_equal(stack.y, together)


def test_its_recordings_verify_bit_for_bit(tmp_path, capsys):
    simulation = Simulation.from_file("spinning_ball", method="moreau")
    simulation.run(until=0.5)
    with simulation.recording(tmp_path / "run.mcap"):
        simulation.run(until=1.2)
    assert main(["verify", str(tmp_path / "run.mcap")]) == 0
    assert "verified, bit for bit" in capsys.readouterr().out
    assert simulation.contact_event_count > 1


def test_sliding_friction_and_what_pushes_are_in_the_account(stack):
    """The residual is the error of the method; what friction dissipates and forces do belongs to the account."""
    simulation = Simulation.from_file("grasp", method="moreau", parameters={"F": 9.0})
    simulation.run(until=0.05)
    slip = 0.5 * (9.81 - 9.0) * 0.05**2
    assert simulation.q[3] == pytest.approx(slip, rel=1e-9)  # the z-axis of the joint points downward
    assert simulation.losses.friction == pytest.approx(9.0 * slip, rel=1e-9)
    assert abs(simulation.energies.residual) < 1e-12


PRESSED = """
mechanism: pressed
parts:
  carriage: {mass: 1, center: [0, 0, 0], inertia: [1, 1, 1]}
  finger: {shape: {type: sphere, mass: 0.1, radius: 0.01}}
joints:
  along: {type: prismatic, between: [ground, carriage], axis: [1, 0, 0]}
  down: {type: prismatic, between: [carriage, finger], axis: [0, 0, 1], position: 0.01, damping: 100}
forces:
  push: {type: effort, coordinate: along, effort: 20}
  press: {type: effort, coordinate: down, effort: -10}
contacts: {floor: {parts: [finger], plane: ground, friction: 0.5}}
"""


def test_dampers_that_act_in_the_free_motion_take_from_what_presses_a_contact_as_the_advice_says():
    sim = Simulation.from_text(PRESSED, method="moreau", step=1e-3)
    sim.step(100)
    part = (1.0 - np.exp(-1.0)) / 1.0  # of the force, with a rate of 1000/s
    assert sim.u[0] == pytest.approx(0.1 * (20.0 - 0.5 * part * (10.0 + 0.1 * 9.81)) / 1.1, rel=1e-4)
    assert "dampers at down act at a rate of 1e+03/s" in sim.step_advice and f"bears {part:.2g} of" in sim.step_advice
    fine = Simulation.from_text(PRESSED, method="moreau", step=5e-5)
    fine.step(2000)
    assert fine.step_advice is None
    assert fine.u[0] == pytest.approx(0.1 * (20.0 - 0.5 * (10.0 + 0.1 * 9.81)) / 1.1, rel=1.2e-2)
    assert Simulation.from_text(PRESSED, step=1e-3).pressing_advice is None


def test_members_of_an_ensemble_move_as_single_simulations_do():
    from mbd_sim import Ensemble

    ensemble = Ensemble.from_file("bounce", [{"e": 0.5}, {"e": 0.8}], method="moreau")
    ensemble.run(until=0.8)
    for e, q in zip((0.5, 0.8), ensemble.q, strict=True):
        single = Simulation.from_file("bounce", method="moreau", parameters={"e": e})
        single.run(until=0.8)
        assert q == pytest.approx(single.q, abs=1e-13)


def test_it_is_chosen_by_the_user_alone_and_named_where_events_come_too_fast():
    assert Simulation.from_file("bounce").model.method_name != "moreau"
    assert "method moreau" in ContactEvent(0.1, "contacts", ContactChange.BOUND).text
    unsolved = ContactEvent(0.1, "contacts", ContactChange.UNSOLVED, loss=2e-4)
    assert "0.0002 of their size off" in unsolved.text
