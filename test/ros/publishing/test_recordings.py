"""When recordings begin, end and split; real recorders, and moments as the stepping thread would give them."""

import threading
import time

import numpy as np
import pytest

from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.recordings.run.recorder import RecordingError
from mbd_sim.ros.publishing.recordings import NodeRecordings, SplitLimits
from mbd_sim.simulation.run.run_point import RunPoint
from test.recordings.recordings import messages, metadata, recorder_in


def at(tick):
    return Snapshot(tick, tick * 1_000_000, 1e-3 * tick, RunPoint(tick, np.zeros(4), np.zeros(2), 0.0, {}))


class Stepping:
    """Recordings, and the queue of a node: the messages put, and a `Snapshot` for each request."""

    def __init__(self, folder, limits=None):
        self.tick, self.requested, self.complaints = 0, 0, []
        self.recordings = NodeRecordings(
            lambda: recorder_in(folder, begun=False),
            lambda moment: {"first_tick": str(moment.ticks)},
            self._ask,
            self.complaints.append,
            limits or SplitLimits(),
        )

    def _ask(self):
        self.requested += 1

    def go(self, ticks):
        for _ in range(ticks):
            for _ in range(self.requested):
                self.requested -= 1
                self.recordings.at_moment(at(self.tick))
            self.recordings.put("vital", bytes(100), self.tick * 1_000_000, self.tick)
            self.recordings.check_limits(self.tick * 1_000_000)
            self.tick += 1


def ticks(folder):
    """The ticks in each file, in the order of their first one."""
    return sorted([message.sequence for _, message in messages(path)] for path in folder.iterdir())


def test_what_comes_between_start_and_stop_is_recorded(tmp_path):
    node = Stepping(tmp_path)
    node.go(10)
    assert node.recordings.start()[0]
    node.go(10)
    assert not node.recordings.start()[0]
    assert node.recordings.stop()[0]
    node.go(10)
    assert node.recordings.stop() == (False, "not recording")
    assert node.recordings.split() == (False, "not recording")
    node.recordings.close()
    assert ticks(tmp_path) == [list(range(10, 20))]


def test_the_last_of_what_is_latched_comes_first_in_each_file(tmp_path):
    node = Stepping(tmp_path)
    node.recordings.put("text", b"old old ", 0, 0, in_each_file=True)
    node.recordings.put("text", b"new new ", 1, 1, in_each_file=True)
    node.go(5)
    node.recordings.start(at(5))
    node.go(5)
    node.recordings.split()
    node.go(5)
    node.recordings.close()
    for path in tmp_path.iterdir():
        (topic, first), *others = messages(path)
        assert (topic, first.data) == ("/text", b"new new ")
        assert first.sequence == others[0][1].sequence == int(metadata(path)["first_tick"])


def test_a_file_lasts_for_the_duration_that_is_wished(tmp_path):
    node = Stepping(tmp_path, SplitLimits(duration=0.25))
    node.recordings.start(at(0))
    node.go(1000)
    node.recordings.close()
    found = ticks(tmp_path)
    assert [tick for file in found for tick in file] == list(range(1000))
    assert [len(file) for file in found[:-1]] == [251] * (len(found) - 1) and len(found) == 4


def test_a_file_that_has_become_too_large_is_followed_by_another(tmp_path):
    node = Stepping(tmp_path, SplitLimits(size=2000))
    node.recordings.start(at(0))
    while len(list(tmp_path.iterdir())) < 3:
        node.go(10)
        time.sleep(2e-3)
    node.recordings.close()
    found = ticks(tmp_path)
    assert [tick for file in found for tick in file] == list(range(node.tick))
    *full, _ = sorted(tmp_path.iterdir(), key=lambda path: int(metadata(path)["first_tick"]))
    assert all(path.stat().st_size >= 2000 for path in full)


def test_a_recording_that_fails_is_reported_once_and_another_can_be_started(tmp_path, monkeypatch):
    node = Stepping(tmp_path)
    node.recordings.start(at(0))
    node.go(1)
    recorder = node.recordings.recorder
    recorder._end("the disk is gone")
    node.go(10)
    assert node.complaints == ["the disk is gone"]
    assert node.recordings.start()[0]
    node.go(10)
    node.recordings.close()
    assert ticks(tmp_path)[-1] == list(range(11, 21))


def test_the_end_of_the_node_does_not_repeat_what_stopping_a_recording_has_reported(tmp_path):
    node = Stepping(tmp_path)
    assert node.recordings.closing_summary() == ""
    node.recordings.start(at(0))
    node.go(10)
    serving = threading.Thread(target=node.recordings.stop)
    serving.start()
    while serving.is_alive():
        node.go(1)
    node.recordings.close()
    assert "recorded" in node.recordings.summary() and node.recordings.closing_summary() == ""


@pytest.mark.parametrize("end", ["running", "slow disk"])
def test_the_end_of_the_node_reports_a_recording_whose_end_was_not_reported(tmp_path, monkeypatch, end):
    node = Stepping(tmp_path)
    node.recordings.start(at(0))
    node.go(10)
    if end == "slow disk":
        monkeypatch.setattr("mbd_sim.ros.publishing.recordings.DISK_TIMEOUT", 0.0)
        monkeypatch.setattr(node.recordings.recorder.finished, "wait", lambda timeout: False)
        assert "still being written" in node.recordings.stop()[1]
        monkeypatch.undo()
        node.go(1)
    node.recordings.close()
    assert node.recordings.closing_summary() == node.recordings.summary() != ""


def test_a_folder_that_cannot_be_written_is_an_answer_and_no_error(tmp_path):
    node = Stepping(tmp_path)

    def refuse():
        raise RecordingError("cannot record to 'x'")

    node.recordings._open_recorder = refuse
    assert node.recordings.start() == (False, "cannot record to 'x'.")
    node.go(1)
    node.recordings.close()


def test_nothing_begins_once_the_node_ends(tmp_path):
    node = Stepping(tmp_path)
    node.recordings.close()
    assert node.recordings.start() == (False, "the node is shutting down")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("begun", [False, True])
def test_a_recording_that_holds_nothing_is_a_whole_file(tmp_path, begun):
    node = Stepping(tmp_path)
    node.recordings.start(at(3) if begun else None)
    node.recordings.close()
    assert ticks(tmp_path) == [[]]
