"""Real time: absolute deadlines, the factor of real time, and a clock that is followed."""

import threading
import time
import types
from dataclasses import astuple

import pytest

from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.ros.stepping import pacing
from mbd_sim.ros.stepping.clock import FollowedClock
from mbd_sim.ros.stepping.pacing import MAX_LATENESS, DurationSummary, Histogram, Pacer
from mbd_sim.simulation.run.events import Event
from test.ros.stepping.threads import collected, wait_for


def test_a_deadline_far_away_is_waited_for_in_parts(monkeypatch):
    now, waits = [0.0], []
    monkeypatch.setattr(pacing.time, "perf_counter", lambda: now[0])
    wake = types.SimpleNamespace(wait=lambda seconds: waits.append(seconds))
    pacer = Pacer()
    pacer.anchor()
    pacer.plan(5000.0)
    assert not pacer.wait(wake)
    now[0] = 3600.0
    monkeypatch.setattr(wake, "wait", lambda seconds: now.__setitem__(0, now[0] + seconds))
    assert pacer.wait(wake) and (waits, now) == ([3600.0], [5000.0])


def test_the_pacer_keeps_absolute_deadlines():
    pacer = Pacer()
    pacer.anchor()
    began = time.perf_counter()
    for _ in range(100):
        pacer.plan(0.002)
        assert pacer.wait(threading.Event())
    assert time.perf_counter() - began >= 0.2
    late, period = pacer.lateness.summary(), pacer.period.summary()
    assert 0.0 <= late.median <= late.p99 <= late.maximum
    assert 0.0 < period.median <= period.p99 <= period.maximum
    # The first wait has no period, nor has one after a restart, which a stall of the machine causes.
    assert 99 - pacer.overruns <= pacer.period.counts().sum() <= 99


def test_a_long_stall_restarts_the_schedule_instead_of_a_burst(monkeypatch):
    now = [0.0]

    def sleep(seconds):
        now[0] += seconds

    monkeypatch.setattr(pacing, "time", types.SimpleNamespace(perf_counter=lambda: now[0], sleep=sleep))
    pacer = Pacer()
    pacer.anchor()
    sleep(MAX_LATENESS + 0.15)
    pacer.plan(0.01)
    assert pacer.wait(threading.Event())
    assert (pacer.overruns, now[0]) == (1, pytest.approx(MAX_LATENESS + 0.15))
    pacer.plan(0.01)
    assert pacer.wait(threading.Event())
    assert (pacer.overruns, now[0]) == (1, pytest.approx(MAX_LATENESS + 0.16))


def test_pauses_resets_and_changes_of_the_factor_cost_no_time(make):
    stepping_thread = make(real_time_factor=1.0)
    pacer, step_size = stepping_thread.pacer, stepping_thread.simulation.step_size
    stepping_thread.start()

    def achieved(factor):
        stepping_thread.pause(True)
        time.sleep(0.4)  # it would more than halve the factor of the 0.2 s that follow
        running, ticks = pacer.running, stepping_thread.ticks
        stepping_thread.rates.real_time_factor = factor
        stepping_thread.pause(False)
        stepping_thread.restart_schedule()
        stepping_thread.reset()
        wait_for(lambda: stepping_thread.ticks > ticks + round(0.2 * factor / step_size))
        stepping_thread.pause(True)
        return (stepping_thread.ticks - ticks) * step_size / (pacer.running - running)

    for factor in (5.0, 0.2):  # a busy machine may leave the thread waiting, but not for ever
        wait_for(lambda factor=factor: achieved(factor) == pytest.approx(factor, rel=0.5))


def test_a_histogram_summarizes_what_came_since():
    histogram = Histogram()
    for count in range(1, 101):
        histogram.add(count * 1e-4)
    assert astuple(histogram.summary()) == pytest.approx((0.005, 0.0099, 0.01), abs=2e-5)
    before = histogram.counts()
    assert histogram.summary(before) == DurationSummary(0.0, 0.0, 0.0)
    for seconds in (-1.0, 0.0, 3.0):
        histogram.add(seconds)
    assert astuple(histogram.summary(before)) == pytest.approx((0.0, 3.0, 3.0), abs=2e-5)


def test_only_the_clock_goes_back_where_the_state_is_to_stay(make):
    stepping_thread = make(paused=True)
    stepping_thread.start()
    stepping_thread.step(30)
    assert stepping_thread.reset(rewind_clock=True, state=False) == ""
    assert (stepping_thread.clock.ns, stepping_thread.simulation.steps) == (0, 30)


def state_times(items):
    """The stamps of states in ms, and the times of the mechanism in steps."""
    snapshots = [item for item in items if isinstance(item, Snapshot) and Due.STATE in item.due and not item.repeated]
    return [(snapshot.clock_ns / 1e6, round(snapshot.time / 1e-3)) for snapshot in snapshots]


def test_a_followed_clock_is_waited_for_and_never_overtaken(make):
    clock = FollowedClock()
    stepping_thread = make(followed=clock, publish=1000.0)
    stepping_thread.start()
    stepping_thread.request_moment()
    assert "no /clock has arrived yet" in (stepping_thread.pause(True) or stepping_thread.step(5))
    stepping_thread.pause(False)
    clock.take(7_000_300_000)  # between two steps of another simulator
    wait_for(lambda: not stepping_thread.waits_for_clock)
    assert (stepping_thread.ticks, stepping_thread.clock.ns) == (0, 7_000_300_000)
    clock.take(7_005_299_999)
    wait_for(lambda: stepping_thread.ticks == 4)
    clock.take(7_005_300_000)
    wait_for(lambda: stepping_thread.ticks == 5)
    stepping_thread.stop()
    items = collected(stepping_thread)
    assert state_times(items) == [(pytest.approx(7000.3 + step), step) for step in range(6)]
    (moment,) = [item for item in items if isinstance(item, Snapshot) and Due.RECORDING in item.due]
    assert (moment.ticks, moment.clock_ns) == (0, 7_000_300_000)


def test_a_followed_clock_that_goes_back_restarts_the_motion_at_the_new_time(make):
    clock = FollowedClock()
    stepping_thread = make(followed=clock, publish=1000.0)
    stepping_thread.start()
    clock.take(0)
    clock.take(20_000_000)
    wait_for(lambda: stepping_thread.ticks == 20)
    clock.take(3_000_000)
    clock.take(8_000_000)
    wait_for(lambda: stepping_thread.ticks == 25)
    assert (stepping_thread.clock.ns, stepping_thread.simulation.steps) == (8_000_000, 5)
    assert "reset the node that publishes it" in stepping_thread.reset(rewind_clock=True)
    assert stepping_thread.simulation.steps == 5
    stepping_thread.stop()
    texts = [item.text for item in collected(stepping_thread) if isinstance(item, Event)]
    assert texts == ["following /clock from 0 s", "clock set: to 0.003 s: /clock has restarted", "reset"]


def test_after_a_pause_a_followed_clock_is_joined_at_its_present_time(make):
    clock = FollowedClock()
    stepping_thread = make(followed=clock)
    stepping_thread.start()
    clock.take(0)
    clock.take(5_000_000)
    wait_for(lambda: stepping_thread.ticks == 5)
    stepping_thread.pause(True)
    clock.take(50_000_000)
    stepping_thread.pause(False)
    clock.take(52_000_000)
    wait_for(lambda: stepping_thread.ticks == 7)
    assert stepping_thread.clock.ns == 52_000_000
    clock.take(552_000_000)  # a jump ahead: all steps are taken
    wait_for(lambda: stepping_thread.ticks == 507)
    assert stepping_thread.lag == 0.0
