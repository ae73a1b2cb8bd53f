"""The stepping thread: in real time, without ROS."""

import math
import pickle
import threading
import time
import types

import pytest

from mbd_sim import Simulation
from mbd_sim.files.checks.override import with_values
from mbd_sim.recordings.messages.events import Journal
from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.stepping import output
from mbd_sim.ros.stepping.clock import Rates
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.run.changes import StateValues
from mbd_sim.simulation.run.events import AppliedWrench, Event, EventKind
from test.ros.stepping.threads import collected, wait_for
from test.waiting import PATIENCE


@pytest.mark.parametrize("factor", [0.0, 1.0, 20.0])
def test_every_publication_is_handed_out_at_its_very_step(make, factor):
    stepping_thread = make(real_time_factor=factor, publish=125.0, clock=50.0)
    stepping_thread.start()
    wait_for(lambda: stepping_thread.ticks > 200)
    stepping_thread.stop()
    snapshots = [item for item in collected(stepping_thread) if isinstance(item, Snapshot)]
    last = snapshots[-1].ticks
    assert [s.ticks for s in snapshots if Due.STATE in s.due] == list(range(0, last + 1, 8))[
        : sum(Due.STATE in s.due for s in snapshots)
    ]
    assert all(s.ticks % 20 == 0 for s in snapshots if Due.CLOCK in s.due)
    assert all(s.clock_ns == s.ticks * 1_000_000 for s in snapshots)


@pytest.mark.parametrize("publish", [0.0, 20.0, 100.0])
def test_markers_and_samples_for_the_viewer_keep_their_rates_at_any_rate_of_states(make, publish):
    stepping_thread = make(real_time_factor=0.0, publish=publish, clock=333.0, markers=30.0, view=60.0)
    stepping_thread.start()
    snapshots = []
    while not snapshots or snapshots[-1].ticks <= 3000:
        snapshots.append(stepping_thread.output.get(timeout=PATIENCE))
    stepping_thread.stop()
    snapshots = [snapshot for snapshot in snapshots if 0 < snapshot.ticks <= 3000]
    counts = {due: sum(due in snapshot.due for snapshot in snapshots) for due in Due if due is not Due.NONE}
    expected = {Due.STATE: 3 * publish, Due.CLOCK: 999, Due.MARKERS: 90, Due.VIEW: 180}
    assert {due: counts[due] for due in expected} == expected


def test_a_command_takes_effect_between_two_steps_and_reports_which(make):
    stepping_thread = make(real_time_factor=0.0)
    stepping_thread.run.commands.by_order([2.0])
    stepping_thread.start()
    wait_for(lambda: stepping_thread.ticks > 100)
    stepping_thread.stop()
    (event,) = [item for item in collected(stepping_thread) if isinstance(item, Event)]
    assert (event.ticks, event.text, event.payload.values.tolist()) == (0, "command", [2.0])


def test_a_command_is_reported_only_if_it_changes_the_efforts(make):
    stepping_thread = make(real_time_factor=0.0, paused=True)
    stepping_thread.start()
    for effort in (0.0, 2.0, 2.0, 2.0, -0.0, 0.0, 0.0, 3.0):
        stepping_thread.run.commands.by_order([effort])
        assert stepping_thread.step(1) == ""
    stepping_thread.reset(False)
    stepping_thread.run.commands.by_order([3.0])
    assert stepping_thread.step(1) == ""
    stepping_thread.stop()
    events = [item for item in collected(stepping_thread) if isinstance(item, Event) and item.text == "command"]
    found = [(event.ticks, str(event.payload.values[0])) for event in events]
    assert found == [(1, "2.0"), (4, "-0.0"), (5, "0.0"), (7, "3.0"), (8, "3.0")]


class Heard:
    """A listener that notes what a recorder in a script would write."""

    def __init__(self, simulation):
        self._journal, self.events = Journal(simulation), []
        simulation.listen(self)

    def parts_of(self, steps):
        yield steps
        self._journal.count_steps()

    def report(self, kind, payload=None):
        self.events.append(self._journal.event(kind, payload))


def test_the_events_of_a_node_are_those_of_a_script_that_does_the_same(make):
    stepping_thread = make(paused=True, wrenches=["rod"], live=["gravity[2]"])
    simulation, run = stepping_thread.simulation, stepping_thread.run
    script, run.start_values = simulation.copy(), StateValues({"pin": 0.5}, {})
    heard = Heard(script)
    stepping_thread.start()
    run.commands.timeout = run.wrenches.timeout = 0.004
    run.commands.by_order([2.0])
    run.wrenches.take("rod", None, "rod", (3.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for _ in range(5):
        assert stepping_thread.step(1) == ""
    assert stepping_thread.set_live({"gravity[2]": -1.6}) == ""
    assert stepping_thread.set_state(StateValues({}, {"pin": 1.0})) == ""
    assert stepping_thread.reset(rewind_clock=True) == ""
    stepping_thread.stop()
    script.set_efforts([2.0])
    script.set_wrench("rod", (3.0, 0.0, 0.0), axes="part")
    script.step(4)
    script.expire_efforts(["pin"])
    script.expire_wrench("rod")
    script.step()
    script.set_live({"gravity[2]": -1.6})
    script.set_state({}, {"pin": 1.0})
    script.reset(q={"pin": 0.5}, u={})
    found = [each for each in collected(stepping_thread) if isinstance(each, Event) and each.kind is not EventKind.NOTE]
    assert [each.text for each in heard.events] == [
        "command",
        "command",
        "commands expired: effort of pin set to zero",
        "commands expired: wrench on rod set to zero",
        "live values: gravity[2] = -1.6",
        "new state",
        "reset",
    ]
    assert [(each.kind, each.ticks) for each in found] == [(each.kind, each.ticks) for each in heard.events]
    assert [pickle.dumps(each.payload) for each in found] == [pickle.dumps(each.payload) for each in heard.events]
    assert found[-1].clock_ns == 0 and simulation.state.tobytes() == script.state.tobytes()


def test_a_reset_that_cannot_reach_its_start_changes_and_reports_nothing(make):
    stepping_thread = make(paused=True)
    stepping_thread.start()
    stepping_thread.step(5)
    before, clock = stepping_thread.simulation.snapshot(), stepping_thread.clock.ns
    stepping_thread.run.start_values = StateValues({"pin": math.inf}, {})
    assert "the position of pin is not finite" in stepping_thread.reset(rewind_clock=True)
    stepping_thread.stop()
    assert (stepping_thread.simulation.steps, stepping_thread.clock.ns) == (before.steps, clock)
    assert stepping_thread.simulation.state.tobytes() == before.state.tobytes()
    assert not [item for item in collected(stepping_thread) if isinstance(item, Event)]


def test_changes_of_contacts_are_reported_at_a_bounded_rate_and_counted(make, monkeypatch):
    stepping_thread = make(paused=True)
    now = [7.0]
    monkeypatch.setattr(output, "time", types.SimpleNamespace(monotonic=lambda: now[0]))
    for number in range(30):
        stepping_thread.run.output.report(EventKind.CONTACT, str(number))
    now[0] = 8.0
    stepping_thread.run.output.report(EventKind.CONTACT, "later")
    stepping_thread.stop()
    expected = [*(str(number) for number in range(20)), "10 further changes", "later"]
    assert [item.text for item in collected(stepping_thread)] == [f"contact: {text}" for text in expected]


def test_requests_are_served_while_paused_and_while_running(make):
    stepping_thread = make(paused=True)
    stepping_thread.start()
    assert stepping_thread.step(25) == ""
    assert stepping_thread.ticks == 25
    stepping_thread.pause(False)
    assert "running" in stepping_thread.step(1)
    wait_for(lambda: stepping_thread.ticks > 50)
    stepping_thread.pause(True)
    ticks = stepping_thread.ticks
    stepping_thread.reset()
    assert (stepping_thread.simulation.time, stepping_thread.clock.ns) == (0.0, ticks * 1_000_000)
    stepping_thread.reset(rewind_clock=True)
    assert stepping_thread.clock.ns == 0
    stepping_thread.stop()
    texts = [item.text for item in collected(stepping_thread) if isinstance(item, Event)]
    assert texts == ["running", "paused", "reset", "reset"]


def test_a_request_to_a_thread_that_has_stopped_returns(make):
    stepping_thread = make()
    stepping_thread.start()
    stepping_thread.stop()
    assert stepping_thread.step(1) == "the simulation has stopped"


def test_a_step_that_diverges_pauses_and_keeps_the_last_state(make):
    stepping_thread = make(paused=True)
    stepping_thread.start()
    stepping_thread.run.commands.by_order([1e308])
    assert "became infinite" in stepping_thread.step(100)
    assert stepping_thread.paused
    assert stepping_thread.simulation.q[0] == pytest.approx(1.5707963, abs=1e-6)
    stepping_thread.reset()
    assert stepping_thread.step(100) == ""


def test_a_step_that_is_too_large_is_warned_of_once_until_a_reset(make):
    stepping_thread = make(step=0.2, paused=True)
    stepping_thread.start()
    for _ in range(3):
        assert stepping_thread.step(20) == ""
    stepping_thread.reset()
    assert stepping_thread.step(20) == ""
    stepping_thread.stop()
    texts = [item.text for item in collected(stepping_thread) if isinstance(item, Event)]
    assert [text.split(":")[0] for text in texts] == ["warning", "reset", "warning"]
    assert "a step of 0.2 s is too large for rod_pendulum" in texts[0]


def test_a_very_slow_run_answers_requests_and_ends_at_once(make):
    stepping_thread = make(real_time_factor=1e-6)
    stepping_thread.start()
    wait_for(lambda: stepping_thread.ticks == 1)
    stepping_thread.reset()  # the next step is due in 1000 s
    assert stepping_thread.simulation.steps == 0
    stepping_thread.rates.real_time_factor = 50.0
    stepping_thread.restart_schedule()
    wait_for(lambda: stepping_thread.ticks > 100)
    stepping_thread.rates.real_time_factor = 1e-6
    began = time.monotonic()
    stepping_thread.stop()
    assert time.monotonic() - began < PATIENCE


@pytest.mark.parametrize("factor", [1e-15, 1e-200, 5e-324])
def test_a_factor_of_any_size_leaves_the_thread_able_to_answer(make, factor):
    stepping_thread = make(real_time_factor=factor)
    stepping_thread.start()
    wait_for(lambda: stepping_thread.ticks == 1)
    assert stepping_thread.reset() == ""
    stepping_thread.rates.real_time_factor = 1000.0
    stepping_thread.restart_schedule()
    wait_for(lambda: stepping_thread.ticks > 100)


def test_the_fastest_run_of_small_steps_serves_requests_between_batches(make):
    stepping_thread = make(step=1e-7, real_time_factor=1000.0)
    assert stepping_thread._steps_until_due() <= 1000


def failing(thread, monkeypatch, place):
    """Let the thread fail once at some place of its loop, and then not again."""
    owner, name = {
        "step": (thread.simulation, "step"),
        "output": (thread.run.output, "emit"),
        "commands": (thread.run.commands, "due"),
        "pacing": (thread.pacer, "wait"),
    }[place]
    whole, fails = getattr(owner, name), threading.Event()
    fails.set()

    def once(*arguments, **options):
        if fails.is_set():
            fails.clear()
            raise ZeroDivisionError("once")
        return whole(*arguments, **options)

    monkeypatch.setattr(owner, name, once)
    return fails


@pytest.mark.parametrize("place", ["step", "output", "commands", "pacing"])
def test_after_a_failure_the_run_is_paused_and_a_reset_starts_it_again(make, monkeypatch, capfd, place):
    stepping_thread = make(real_time_factor=1.0)
    fails = failing(stepping_thread, monkeypatch, place)
    stepping_thread.start()
    wait_for(lambda: stepping_thread.run.problem and not fails.is_set())
    assert stepping_thread.run.problem == "failed: ZeroDivisionError('once')"
    wait_for(lambda: stepping_thread.paused)
    assert stepping_thread.reset() == ""
    assert not stepping_thread.paused and stepping_thread.run.problem == ""
    ticks = stepping_thread.ticks
    wait_for(lambda: stepping_thread.ticks > ticks + 20)
    stepping_thread.stop()
    texts = [item.text for item in collected(stepping_thread) if isinstance(item, Event)]
    assert texts == ["failed: ZeroDivisionError('once')", "reset", "running"]
    assert "test_thread.py" in capfd.readouterr().err  # where the program is wrong


def test_a_request_that_fails_says_why_and_a_reset_leaves_a_paused_run_paused(make, capfd):
    stepping_thread = make(paused=True)
    stepping_thread.start()
    assert stepping_thread.between_steps(lambda: str(1 / 0)) == "an error of the program, see the console"
    assert stepping_thread.reset() == "" and stepping_thread.paused
    assert stepping_thread.step(1) == ""
    capfd.readouterr()


def test_a_pause_after_a_failure_outlasts_the_reset(make, monkeypatch, capfd):
    stepping_thread = make(real_time_factor=1.0)
    failing(stepping_thread, monkeypatch, "step")
    stepping_thread.start()
    wait_for(lambda: stepping_thread.run.problem)
    stepping_thread.pause(True)
    assert stepping_thread.reset() == "" and stepping_thread.paused
    capfd.readouterr()


@pytest.mark.parametrize("value", [0.0, 5e-324, 1e-300, -1e-300, 1e300, -1.7976931348623157e308])
def test_live_values_at_the_ends_of_double_precision_leave_a_run_that_a_reset_restores(make, value):
    stepping_thread = make(paused=True, live=("gravity[*]",))
    stepping_thread.start()
    stepping_thread.set_live({"gravity[2]": value})
    stepping_thread.step(50)
    stepping_thread.set_live({"gravity[2]": -9.81})
    assert stepping_thread.reset() == ""
    assert stepping_thread.step(10) == ""
    assert math.isfinite(stepping_thread.simulation.q[0])


def test_live_values_and_wrenches_are_reported_with_their_tick(make):
    stepping_thread = make(paused=True, wrenches=["rod"], live=["gravity[2]"])
    stepping_thread.start()
    stepping_thread.step(10)
    assert stepping_thread.set_live({"gravity[2]": -1.6}) == ""
    assert "'gravty' is not a live value" in stepping_thread.set_live({"gravty": 1.0})
    for _ in range(2):  # the second one changes nothing and is not reported
        stepping_thread.run.wrenches.take("rod", None, "ground", (3.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        stepping_thread.step(5)
    stepping_thread.stop()
    events = [item for item in collected(stepping_thread) if isinstance(item, Event)]
    assert [(event.ticks, event.text) for event in events] == [
        (10, "live values: gravity[2] = -1.6"),
        (10, "command"),
    ]
    assert events[0].payload.all_values == {"gravity[2]": -1.6}
    assert isinstance(events[1].payload, AppliedWrench)
    assert (events[1].payload.part, events[1].payload.inputs[:3].tolist()) == ("rod", [3.0, 0.0, 0.0])


def test_a_length_in_a_loop_changes_in_a_node_as_in_a_script():
    simulation = Simulation.from_file("four_bar", live=["parameters.crank"])
    script = simulation.copy()
    stepping_thread = SteppingThread(simulation, CommandBuffer(simulation.effort_map, 0.0), Rates(), paused=True)
    stepping_thread.start()
    stepping_thread.step(20)
    assert "reassemble=True" in stepping_thread.set_live({"parameters.crank": 0.6})
    assert stepping_thread.set_live({"parameters.crank": 0.6}, reassemble=True) == ""
    assert "can be closed only up to" in stepping_thread.set_live({"parameters.crank": 9.0}, reassemble=True)
    stepping_thread.step(20)
    stepping_thread.stop()
    script.step(20)
    script.set_live({"parameters.crank": 0.6}, reassemble=True)
    script.step(20)
    assert simulation.state.tobytes() == script.state.tobytes()
    items = collected(stepping_thread)
    texts = [item.text for item in items if isinstance(item, Event)]
    assert texts[0] == "live values: parameters.crank = 0.6" and texts[1].startswith("assembled anew: ")
    shown = [item for item in items if isinstance(item, Snapshot) and item.ticks == 20 and not item.repeated]
    assert len(shown) == 2 and shown[0].point.state.tobytes() != shown[1].point.state.tobytes()


@pytest.fixture
def changing(make, monkeypatch):
    """A stepping thread with live values, and the idents of the threads that validated changes of them."""
    stepping_thread = make(paused=True, live=["gravity[*]"])
    validated_in = []

    def recorded(mechanism, values):
        validated_in.append(threading.get_ident())
        return with_values(mechanism, values)

    monkeypatch.setattr("mbd_sim.simulation.model.live_values.with_values", recorded)
    stepping_thread.start()
    return stepping_thread, validated_in


def test_live_values_are_validated_in_the_calling_thread(changing):
    stepping_thread, validated_in = changing
    assert stepping_thread.set_live({"gravity[2]": -1.6}) == ""
    assert "gravity" in stepping_thread.set_live({"gravity[2]": float("nan")})
    assert "'gravty' is not a live value" in stepping_thread.set_live({"gravty": 1.0})
    assert validated_in and set(validated_in) == {threading.get_ident()}
    assert stepping_thread.simulation.live["gravity[2]"] == -1.6


def test_concurrent_changes_of_live_values_are_all_applied_one_after_another(changing):
    stepping_thread, validated_in = changing

    def change(axis):
        for value in range(20):
            assert stepping_thread.set_live({f"gravity[{axis}]": float(value)}) == ""

    callers = [threading.Thread(target=change, args=(axis,)) for axis in range(3)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(PATIENCE)
    stepping_thread.stop()
    assert set(validated_in) == {caller.ident for caller in callers}
    events = [item.payload for item in collected(stepping_thread) if isinstance(item, Event)]
    known = {f"gravity[{axis}]": value for axis, value in enumerate((0.0, 0.0, -9.81))}
    for payload in events:
        known |= payload.changes
        assert payload.all_values == known
    assert len(events) == 60
    assert stepping_thread.simulation.live == {f"gravity[{axis}]": 19.0 for axis in range(3)}
