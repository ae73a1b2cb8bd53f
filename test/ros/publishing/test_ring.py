"""A ring without a node: which pieces it keeps, within its memory, and what has it written."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.recordings.run.run_watch import RunWatch
from mbd_sim.ros.publishing import ring as module
from mbd_sim.ros.publishing.ring import NodeRing, RingTrigger
from mbd_sim.simulation.run.events import EventKind
from mbd_sim.simulation.run.run_point import RunPoint
from test.recordings.recordings import messages, metadata, recorder_in


class Stepping:
    """A ring of 0.4 s and its trigger, told as by the threads of a node whose steps are 1 ms."""

    def __init__(self, folder):
        self.tick, self.said, self.failures = 0, [], []
        self.ring = NodeRing(
            0.4,
            1e-3,
            lambda: recorder_in(folder, begun=False),
            lambda moment: {"first_tick": str(moment.ticks)},
            lambda action: action(self.moment),
            self.said.append,
            self.failures.append,
        )
        self.trigger = RingTrigger(self.ring, RunWatch(Simulation.from_file("double_rod"), ""))
        self.ring.put("text", b"old", 0, 0, in_each_file=True)
        self.ring.begin(self.moment)

    @property
    def moment(self):
        point = RunPoint(self.tick, np.zeros(4), np.zeros(2), 0.0, {})
        return Snapshot(self.tick, self.tick * 1_000_000, 1e-3 * self.tick, point)

    def go(self, steps, payload=bytes(100)):
        while steps > 0:
            part = self.trigger.most_steps(steps)
            steps, self.tick = steps - part, self.tick + part
            self.ring.put("vital", payload, self.tick * 1_000_000, self.tick)
            self.trigger.passed(part)

    def ticks(self, folder):
        """The first tick of the only file, and those of its messages."""
        self.ring.close()
        (path,) = folder.iterdir()
        return int(metadata(path)["first_tick"]), [message.sequence for _, message in messages(path)]


@pytest.mark.parametrize("steps", [399, 400, 401, 499, 500, 777, 5000])
def test_at_least_the_last_seconds_are_kept_and_at_most_a_quarter_more(tmp_path, steps):
    node = Stepping(tmp_path)
    node.go(steps)
    assert node.ring.write()[0]
    first, (latched, *rest) = node.ticks(tmp_path)
    assert latched == first and rest[-1] == steps
    assert min(400, steps) <= steps - first <= 500


def test_a_failure_of_the_run_is_written_and_other_events_are_not(tmp_path):
    node = Stepping(tmp_path)
    node.go(450)
    node.trigger.notice(EventKind.WARNING, "a large step")
    node.trigger.notice(EventKind.DIVERGED, "at t = 0.45 s")
    node.ticks(tmp_path)
    (text,) = node.said
    assert text.endswith("diverged: at t = 0.45 s")


def test_where_memory_does_not_suffice_fewer_seconds_are_kept_and_that_is_said_once(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MOST_BYTES", 4000)
    node = Stepping(tmp_path)
    for _ in range(300):
        node.go(1)
    assert node.ring.write()[0]
    first, _ = node.ticks(tmp_path)
    assert 300 - 13 <= first < 300
    (text,) = node.failures
    assert text.startswith("record_last: ")


def test_before_anything_has_happened_a_request_is_refused(tmp_path):
    node = Stepping(tmp_path)
    assert node.ring.write() == (False, module.NOTHING)
    node.ring.close()
    assert not list(tmp_path.iterdir())
