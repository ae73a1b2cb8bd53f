"""Recordings that are started, stopped and split while the node runs: each file is computed again alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from mbd_sim.recordings.run.reader import open_recording
from test.system.growing_recordings import described_run, stop_recording, until_recorded
from test.system.nodes import Listener, running


def recomputed(path: Path) -> int:
    """Compute one file again, from nothing but itself; how many states agreed, all of them bit for bit."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        messages = [(c.topic, m.sequence, content) for _, c, m, content in reader.iter_decoded_messages()]
    simulation, about = described_run(path)
    energy, history = float.fromhex(about["start_energy"]), exact(about.get("history", "[]"))
    simulation.restore(exact(about["start"]), int(about["first_step"]), exact(about["inputs"]), energy, history=history)
    ticks, states = int(about["first_tick"]), 0
    for topic, sequence, content in messages:
        simulation.step(sequence - ticks)
        ticks = sequence
        match topic:
            case "/sim_node/applied_efforts":
                simulation.set_efforts(content.data)
            case "/joint_states":
                states += 1
                assert list(content.position) == simulation.q.tolist()
                assert list(content.velocity) == simulation.u.tolist()
            case "/energies":
                assert list(content.data) == list(simulation.energies)
    return states


def exact(text: str) -> list[float]:
    return [float.fromhex(value) for value in json.loads(text)]


def record(listener: Listener, data: bool) -> Any:
    return listener.call(SetBool, "record", data=data)


def more_states(listener: Listener, count: int) -> None:
    """Wait for states, of which some may have been on their way already."""
    seen = len(listener.states)
    listener.until(lambda: len(listener.states) > seen + count, "states")


def command(listener: Listener, efforts: Sequence[float]) -> None:
    applied = len(listener.applied)
    listener.by_order.publish(Float64MultiArray(data=efforts))
    listener.until(lambda: len(listener.applied) > applied, "the command's effect")


def test_recordings_that_begin_and_end_in_the_middle_are_computed_again_alone(tmp_path: Path) -> None:
    with running(tmp_path, record_dir="logs", command_timeout=0.0) as (process, listener):
        listener.ready_to_command()
        command(listener, [0.4, -0.2])  # before the beginning, and felt after it
        answer = record(listener, True)
        assert answer.success, answer.message
        first = tmp_path / answer.message
        assert not record(listener, True).success
        until_recorded(listener, first, 20)
        command(listener, [-1.0, 0.5])
        until_recorded(listener, first, 40)
        assert stop_recording(listener, tmp_path) == first
        assert state_ticks(first)  # it is finished while the node goes on
        assert not record(listener, False).success
        more_states(listener, 5)
        listener.pause(True)
        second = tmp_path / record(listener, True).message
        listener.pause(False)
        until_recorded(listener, second, 20)
        process.end()
    assert second != first
    assert recomputed(first) >= 40
    assert recomputed(second) >= 20
    with second.open("rb") as stream:
        topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
    assert {"/robot_description", "/sim_node/live_values"} <= topics


def test_split_by_service_loses_nothing_and_each_file_is_computed_again_alone(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    with running(tmp_path, record=True, record_dir="logs", command_timeout=0.0) as (process, listener):
        listener.ready_to_command()
        command(listener, [0.3, 0.1])
        paths: list[Path] = []
        for number in range(3):
            if number:
                assert listener.call(Trigger, "split_recording").success
            listener.until(lambda number=number: len(list(logs.glob("*.mcap"))) > number, "the next file")
            paths += set(logs.glob("*.mcap")) - set(paths)
            listener.by_order.publish(Float64MultiArray(data=[0.3, 0.1]))  # changes nothing: it is not recorded
            until_recorded(listener, paths[-1], 15)
        process.end()
    efforts = [m for path in paths for m in open_recording(path).messages() if m.topic.endswith("applied_efforts")]
    assert len(efforts) == 1
    assert sorted(paths) == sorted(logs.iterdir())
    assert len(paths) == 3
    assert all(recomputed(path) >= 14 for path in paths)
    ticks = [tick for path in paths for tick in state_ticks(path)]
    assert ticks == list(range(0, ticks[-1] + 1, 10))


def state_ticks(path: Path) -> list[int]:
    with path.open("rb") as stream:
        found = make_reader(stream).iter_messages(topics=["/joint_states"], log_time_order=False)
        return [message.sequence for _, _, message in found]
