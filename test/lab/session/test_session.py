"""The session: time, requests, winding back, pulling, and recordings of what users do."""

import math

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.continuation import continue_run
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.session import MOST_REQUESTS


class Clock:
    """A clock that the test moves."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def session_of(name, **options):
    clock = Clock()
    session = OwnSession(Bench.of(load_mechanism(name)), clock=clock, **options)
    return session, clock


def turns(session, clock, count, period=1 / 60):
    for _ in range(count):
        clock.now += period
        session.turn()


def test_time_follows_the_clock_and_the_speed():
    session, clock = session_of("four_bar")
    turns(session, clock, 60)
    assert session.frame.time == pytest.approx(1.0, abs=2 * session.bench.simulation.step_size)
    session.ask("speed", lambda one: one.set_speed(0.25))
    turns(session, clock, 60)
    assert session.frame.time == pytest.approx(1.25, abs=0.25 / 60 + 3e-3)  # the turn in which it changes is lost


def test_pause_step_and_reset():
    session, clock = session_of("four_bar")
    turns(session, clock, 10)
    session.ask("run", OwnSession.pause)
    turns(session, clock, 10)
    paused = session.frame.time
    session.ask("run", lambda one: one.step(3))
    turns(session, clock, 1)
    assert session.frame.time == pytest.approx(paused + 3 * session.bench.simulation.step_size)
    session.ask("run", OwnSession.reset)
    turns(session, clock, 1)
    assert (session.frame.time, session.frame.span) == (0.0, (0.0, 0.0))


@pytest.mark.parametrize("go_on", [OwnSession.step, OwnSession.play])
def test_a_page_that_begins_within_a_run_shows_its_time_and_can_return_there(go_on):
    begun = Simulation.from_file("four_bar")
    begun.run(until=0.6)
    clock = Clock()
    bench = Bench.of(begun.mechanism)
    continue_run(bench.simulation, begun, bench.file)
    session = OwnSession(bench, clock=clock, running=False)
    turns(session, clock, 1)
    assert session.frame.span == (begun.time, begun.time)
    session.ask("run", go_on)
    turns(session, clock, 5)
    assert session.frame.span[0] == begun.time < session.frame.span[1]
    session.ask("back", lambda one: one.wind_to(0.0))
    turns(session, clock, 1)
    assert (session.frame.time, session.frame.q.tolist()) == (begun.time, begun.q.tolist())


def test_a_run_that_was_wound_back_goes_on_with_the_same_bits():
    session, clock = session_of("cart_pendulum")
    session.ask("push", lambda one: one.bench.simulation.set_efforts({"rail": 4.0}))
    turns(session, clock, 120)
    end, steps = session.bench.simulation.state, session.bench.simulation.steps
    session.ask("wind", lambda one: one.wind_to(0.7))
    turns(session, clock, 1)
    simulation = session.bench.simulation
    assert not session.running
    assert 0.65 < simulation.time < 0.75
    simulation.step(steps - simulation.steps)
    assert np.array_equal(simulation.state, end)


def test_a_pause_is_the_last_point_of_the_history():
    """Otherwise the time line ends up to 33 ms before the state that is shown."""
    session, clock = session_of("cart_pendulum")
    for count in range(2, 7):
        session.ask("run", OwnSession.play)
        turns(session, clock, count)
        session.ask("run", OwnSession.pause)
        turns(session, clock, 1)
        assert session.frame.span[1] == session.frame.time > 0.0


def test_a_step_back_undoes_a_step():
    """However long ago the point of the history before the pause is."""
    session, clock = session_of("cart_pendulum")
    turns(session, clock, 30)
    session.ask("run", OwnSession.pause)
    turns(session, clock, 1)
    paused = session.frame.time
    times = [time for time, _ in session.history.points()]
    session.ask("step", OwnSession.step)
    for expected in (paused, times[-2], times[-3]):
        session.ask("back", OwnSession.step_back)
        turns(session, clock, 1)
        assert session.frame.time == expected


def test_winding_back_keeps_what_lies_ahead_and_lets_go():
    session, clock = session_of("cart_pendulum")
    turns(session, clock, 30)
    session.ask("hold", lambda one: one.bench.take_hold("pendulum", np.zeros(3), np.array([3.0, 0.0, 0.0])))
    turns(session, clock, 30)
    simulation = session.bench.simulation
    hand = simulation.wrench_map.slices["pendulum"]
    assert simulation.inputs[hand].any()
    for when in (0.7, 0.9):
        session.ask("wind", lambda one, when=when: one.wind_to(when))
        turns(session, clock, 1)
        assert session.frame.time == pytest.approx(when, abs=0.04)
        assert not simulation.inputs[hand][:6].any()


def test_history_after_the_wound_back_moment_is_given_up():
    session, clock = session_of("cart_pendulum")
    turns(session, clock, 120)
    session.ask("wind", lambda one: one.wind_to(0.5))
    session.ask("run", OwnSession.play)
    turns(session, clock, 6)
    assert session.frame.span[1] < 0.7
    times = [row[0] for row in session.samples.rows]
    assert times == sorted(times)
    assert times[-1] < 0.7


def test_requests_of_one_name_replace_each_other_and_others_are_bounded():
    session, clock = session_of("cart_pendulum", running=False)
    served = []
    for value in range(1000):
        session.ask("slider", lambda one, value=value: served.append(value))
    for value in range(10_000):
        session.ask(f"hostile {value}", lambda one: served.append("hostile"))
    turns(session, clock, 1)
    assert served[0] == 999
    assert len(served) == MOST_REQUESTS


def test_a_refused_request_leaves_the_run_as_it_is():
    session, clock = session_of("four_bar", running=False)
    before = session.bench.simulation.state
    session.ask("value", lambda one: one.change("parameters.coupler", 9.0))
    turns(session, clock, 1)
    assert "loops can be closed only up to" in session.frame.message
    assert np.array_equal(session.bench.simulation.state, before)
    assert session.frame.values["parameters.coupler"] == 1.4


def test_a_length_in_a_loop_changes_while_it_runs():
    session, clock = session_of("four_bar")
    turns(session, clock, 30)
    session.ask("value", lambda one: one.change("parameters.coupler", 1.25))
    turns(session, clock, 30)
    simulation = session.bench.simulation
    tip = simulation.point("coupler.tip").position
    assert np.linalg.norm(tip - simulation.point("crank.tip").position) == pytest.approx(1.25, abs=1e-12)
    assert simulation.violation.position < 1e-12
    assert abs(simulation.energies.residual) < 1e-10


def test_pulling_is_the_same_wrench_from_a_script():
    bench = Bench.of(load_mechanism("simple_pendulum"))
    part = next(iter(bench.simulation.wrench_map.slices))
    grabbed, target = np.array([0.01, 0.0, -0.2]), np.array([0.4, 0.1, 0.3])
    script = Simulation(load_mechanism("simple_pendulum"), live=list(bench.simulation.live), wrenches=[part])
    bench.take_hold(part, grabbed, target)
    hold = bench.hold
    bench.advance(297)
    bench.pull_to(-target)
    bench.advance(300)
    bench.let_go()
    bench.advance(100)
    for step in range(697):
        if step < 597 and step % bench.period == 0:
            end = target if step < 297 else -target
            frame = script.frame(part)
            arm = frame.rotation @ grabbed
            velocity = frame.velocity + np.cross(frame.angular_velocity, arm)
            force = hold.stiffness * (end - (frame.position + arm)) - hold.damping * velocity
            script.set_wrench(part, force * min(1.0, hold.strongest / np.linalg.norm(force)), at=grabbed)
        if step == 597:
            script.set_wrench(part)
        script.step()
    assert np.array_equal(bench.simulation.state, script.state)
    assert bench.simulation.energies.work_applied != 0.0
    assert abs(bench.simulation.energies.residual) < 1e-9


def test_a_motion_that_becomes_infinite_pauses():
    session, clock = session_of("simple_pendulum")
    session.ask("push", lambda one: one.bench.simulation.set_efforts({"pin": 1e200}))
    turns(session, clock, 30)
    assert not session.frame.running
    assert session.frame.message
    assert math.isfinite(session.frame.positions[0])


def test_sliders_change_values_efforts_and_commands():
    session, clock = session_of("motor_drive", running=False)
    before = session.frame.values
    live = next(key for key in session.bench.simulation.live if before[key])
    effort, command = session.bench.simulation.coordinate_names[0], session.bench.simulation.command_map.names[0]
    session.ask("value", lambda one: one.change(live, 1.01 * before[live]))
    session.ask("effort", lambda one: one.set_effort(effort, 0.5))
    session.ask("command", lambda one: one.set_command(command, 2.0))
    turns(session, clock, 1)
    after = session.frame.values
    assert (after[live], after[effort], after[command]) == (1.01 * before[live], 0.5, 2.0)


def test_the_hand_of_a_page_that_is_closed_lets_go():
    """Otherwise its spring would pull forever."""
    session, clock = session_of("cart_pendulum")
    for page in (1, 2):
        session.ask(f"page {page}", lambda one, page=page: one.enter(page))
    session.ask("drag", lambda one: one.drag(2, "start", "pendulum", np.zeros(3), np.ones(3)))
    turns(session, clock, 5)
    session.ask("page 1", lambda one: one.leave(1))
    turns(session, clock, 5)
    assert session.frame.pull is not None
    session.ask("page 2", lambda one: one.leave(2))
    turns(session, clock, 5)
    assert session.frame.pull is None
    assert not session.bench.simulation.inputs[session.bench.simulation.wrench_map.slices["pendulum"]][:6].any()
