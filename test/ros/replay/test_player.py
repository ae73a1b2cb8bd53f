"""The player alone: what is due when, with an output that only records."""

import threading
import time
from pathlib import Path

import pytest

from mbd_sim.recordings.messages.cdr import Block, DamagedError, Message, RecordedFile, RecordedTopic
from mbd_sim.recordings.run.reader import Recording
from mbd_sim.ros.replay import player as replay_player
from mbd_sim.ros.replay.player import Player
from test.waiting import PATIENCE, wait_until

MS = 1_000_000


class RecordingOutput:
    """An output that records what is played, and when."""

    def __init__(self):
        self.messages, self.clocks, self.texts, self.moments = [], [], [], []
        self.ended = threading.Event()

    def clock(self, time_ns):
        self.clocks.append(time_ns)

    def publish(self, message):
        self.moments.append(time.perf_counter())
        self.messages.append(message)

    def warn(self, text):
        self.texts.append(text)

    def inform(self, text):
        self.texts.append(text)

    def end(self):
        self.ended.set()

    def until(self, condition):
        wait_until(condition, "what is played", meanwhile=lambda: time.sleep(0.002))


def recording(times_ms, own=False, damaged=(), first_ms=0):
    """Blocks of ten messages on /a, and one on /latched at the begin."""
    messages = [Message("/latched", b"L", first_ms * MS, 0)]
    messages += [Message("/a", str(n).encode(), ms * MS, n) for n, ms in enumerate(times_ms)]
    blocks = []
    for number, first in enumerate(range(0, len(messages), 10)):
        some = messages[first : first + 10]

        def load(some=some, number=number):
            if number in damaged:
                raise DamagedError(Path("x.mcap"), "damaged: a block")
            return some

        times = [message.time_ns for message in some]
        blocks.append(Block(min(times), max(times), frozenset(message.topic for message in some), load))
    topics = {name: RecordedTopic(name, "std_msgs/msg/String", "", "", "cdr", 1) for name in ("/a", "/latched")}
    return Recording(
        Path("x.mcap"), [RecordedFile(Path("x.mcap"), topics, {"mbd_sim": {"a": "b"}} if own else {}, None, blocks)]
    )


def played(given, **options):
    memory = RecordingOutput()
    player = Player(given, memory, **({"rate": 0.0, "clock_rate": 0.0} | options))
    player.start()
    assert memory.ended.wait(PATIENCE)
    player.stop()
    return memory, player


def shown(memory):
    return [message.time_ns // MS for message in memory.messages if message.topic == "/a"]


def test_as_fast_as_possible_everything_comes_in_order():
    memory, player = played(recording(range(1000)))
    assert shown(memory) == list(range(1000))
    assert player.played == 1001 and player.time == pytest.approx(0.999)


def test_foreign_messages_come_by_time_and_a_run_of_ours_as_it_was_written():
    mixed = [5, 3, 8, 20, 15, 30, 28, 27, 40, 35, 33, 41]
    assert shown(played(recording(mixed))[0]) == sorted(mixed)
    rewound = [0, 10, 20, 30, 0, 10, 20]
    assert shown(played(recording(rewound, own=True))[0]) == rewound


def test_the_clock_goes_in_even_steps_and_never_behind_a_message():
    memory, _ = played(recording([0, 4, 25, 26]), clock_rate=100.0)
    assert [ns // MS for ns in memory.clocks] == [0, 10, 20]
    assert all(clock % (10 * MS) == 0 for clock in memory.clocks)


def test_start_end_and_latched_messages_before_the_start():
    memory, _ = played(recording(range(0, 1000, 10)), start=0.5, end=0.6, latched=["/latched"])
    assert shown(memory) == list(range(500, 601, 10))
    assert memory.messages[0].topic == "/latched"


def test_a_recording_of_epoch_times_starts_at_its_first_message():
    epoch = 1_700_000_000_000
    memory, player = played(recording([epoch, epoch + 5, epoch + 9], first_ms=epoch), start=0.004)
    assert shown(memory) == [epoch + 5, epoch + 9]
    assert player.duration == pytest.approx(0.009)


def test_a_loop_begins_again():
    memory = RecordingOutput()
    player = Player(recording(range(5)), memory, rate=0.0, clock_rate=0.0, loop=True)
    player.start()
    memory.until(lambda: len(memory.messages) > 30)
    player.stop()
    assert shown(memory)[:12] == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4, 0, 1]


def test_time_passes_as_it_did_scaled_by_the_rate():
    for rate in (1.0, 4.0):
        began = time.perf_counter()
        memory, _ = played(recording([0, 100, 300]), rate=rate)
        assert all(
            moment - began >= ms * 1e-3 / rate for moment, ms in zip(memory.moments[1:], (0, 100, 300), strict=True)
        )


def test_a_step_that_is_requested_before_the_thread_starts_is_taken():
    memory = RecordingOutput()
    player = Player(recording([0, 10]), memory, paused=True)
    assert player.step() == ""
    player.start()
    memory.until(lambda: len(memory.messages) == 2)
    player.stop()


def test_paused_nothing_comes_and_steps_bring_one_time_each():
    memory = RecordingOutput()
    player = Player(recording([0, 10, 10, 10, 20, 30]), memory, paused=True)
    player.start()
    time.sleep(0.1)
    assert memory.messages == []
    player.step()
    memory.until(lambda: len(memory.messages) == 2)  # and the latched one of the same time
    player.step()
    memory.until(lambda: shown(memory) == [0, 10, 10, 10])
    player.step(2)
    memory.until(lambda: shown(memory) == [0, 10, 10, 10, 20, 30])
    assert memory.ended.wait(PATIENCE)
    player.stop()
    assert player.step() == "the recording has ended"


def test_seeking_back_and_forth_while_paused_and_while_playing():
    memory = RecordingOutput()
    player = Player(recording(range(0, 10_000, 10)), memory, paused=True, stay=True, latched=["/latched"])
    player.start()
    assert player.seek(5.0) == ""
    memory.until(lambda: [message.topic for message in memory.messages] == ["/latched"])
    player.step()
    memory.until(lambda: shown(memory) == [5000])
    player.seek(1.0)
    player.step()
    memory.until(lambda: shown(memory) == [5000, 1000])
    player.seek(9.9)
    player.pause(False)
    memory.until(lambda: player.paused)  # it stays at the end
    assert shown(memory)[-10:] == list(range(9900, 10_000, 10))
    assert any("at the end" in text for text in memory.texts) and not memory.ended.is_set()
    player.seek(9.98)
    player.pause(False)
    memory.until(lambda: shown(memory)[-2:] == [9980, 9990] and shown(memory)[-3] == 9990)
    assert "cannot seek to 11 s: the recording runs from 0 to 9.99 s" in player.seek(11.0)
    player.stop()


def test_a_change_of_rate_counts_from_where_it_is():
    memory = RecordingOutput()
    player = Player(recording([0, 50, 100_000]), memory, rate=1.0)
    player.start()
    memory.until(lambda: shown(memory) == [0, 50])
    player.set_rate(0.0)
    assert memory.ended.wait(PATIENCE)
    assert shown(memory) == [0, 50, 100_000]
    player.stop()


def test_damaged_blocks_are_left_out_and_reported_once():
    for own in (False, True):
        memory, _ = played(recording(range(50), damaged=[2], own=own))
        assert shown(memory) == [*range(19), *range(29, 50)]
        assert memory.texts == ["not played: x.mcap: damaged: a block."]


class SteppedTime:
    """A clock that only waits advance, as the module `time` of the player and as the event that wakes it up."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        return self.now

    def sleep(self, duration):
        self.now += duration

    def event(self):
        event = threading.Event()
        event.wait = self.sleep
        return event


@pytest.mark.parametrize(("rate", "seconds"), [(0.0, 0.0), (0.2, 0.195), (1.0, 0.039), (20.0, 0.00195)])
def test_it_waits_exactly_as_long_as_the_rate_says_and_never_if_it_is_as_fast_as_possible(monkeypatch, rate, seconds):
    clock, output = SteppedTime(), RecordingOutput()
    monkeypatch.setattr(replay_player, "time", clock)
    player = Player(recording(range(40)), output, rate=rate, clock_rate=200.0)
    player._wake = clock.event()
    player.start()
    assert output.ended.wait(PATIENCE)
    player.stop()
    assert shown(output) == list(range(40)) and len(output.clocks) == 8
    assert clock.now == pytest.approx(seconds, abs=1e-9)
