"""The cost of recording: messages per second, bytes per message, the stepping period with and without.

Runs with and without recording alternate, so that other load on the machine affects both alike.

    python -m benchmarks.recording --seconds 10 --rounds 7
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from mcap.reader import make_reader

from benchmarks.node_process import load, running
from mbd_sim import Simulation
from mbd_sim.recordings.messages import definitions, states
from mbd_sim.recordings.messages.definitions import Topic
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.recordings.messages.topics import TOPICS
from mbd_sim.recordings.run.metadata import run_metadata
from mbd_sim.recordings.run.paths import new_recording_paths
from mbd_sim.recordings.run.recorder import Recorder

QUEUE_LIMIT = 4e6  # bytes that may wait, so that nothing is dropped


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--mechanism", default="double_rod")
    parser.add_argument("--seconds", type=float, default=10.0, help="duration of each run")
    parser.add_argument("--rounds", type=int, default=5, help="runs with recording, and as many without")
    options = parser.parse_args()
    writer(options.mechanism, options.seconds)
    if options.rounds:
        period(options.mechanism, options.seconds, options.rounds)
    print(load())


def writer(mechanism: str, seconds: float) -> None:
    """Write joint states and energies of a motion as fast as possible."""
    messages, topics, simulation = motion(mechanism)
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(new_recording_paths(Path(folder), mechanism), topics, simulation.mechanism.source.text)
        recorder.begin(run_metadata(simulation))
        began, number = time.perf_counter(), 0
        while time.perf_counter() - began < seconds:
            for key, payload in messages:
                recorder.put(key, payload, number * 1_000_000, number)
                number += 1
            while recorder.queued > QUEUE_LIMIT:
                time.sleep(1e-3)
        recorder.close()
        took = time.perf_counter() - began
        raw = sum(len(payload) for _, payload in messages) / len(messages)
        size = recorder.path.stat().st_size
        with recorder.path.open("rb") as stream:
            found = make_reader(stream).get_summary()
    assert found is not None and found.statistics is not None
    print(f"written             {found.statistics.message_count} messages in {took:.1f} s, {recorder.dropped} dropped")
    print(
        f"sustained           {recorder.written / took:.0f} messages per second, {size / took / 1e6:.1f} MB/s to disk"
    )
    print(f"message size        {raw:.0f} bytes serialized, {size / recorder.written:.1f} in the file on average")


def motion(mechanism: str) -> tuple[list[tuple[str, bytes]], dict[str, Topic], Simulation]:
    """The messages of the node for two seconds of a motion, and its topics."""
    simulation = Simulation.from_file(mechanism)
    model = simulation.model
    writers = {"joint_states": states.joint_states(model), "energies": states.energies(model)}
    messages = []
    for tick in range(2000):
        simulation.step()
        snapshot = Snapshot(tick, tick * 1_000_000, simulation.time, simulation.snapshot())
        messages += [(key, writer.payload(snapshot, simulation.energies)) for key, writer in writers.items()]
    profile = definitions.offered_qos_profiles(definitions.STATE)
    topics = {
        topic.name: Topic(f"/{topic.name}", topic.message_type, profile) for topic in TOPICS if topic.name in writers
    }
    return messages, topics, simulation


def period(mechanism: str, seconds: float, rounds: int) -> None:
    """The period at 1 kHz as the node measures it, with and without recording."""
    found: dict[str, list[float]] = {"true": [], "false": []}
    for number in range(rounds):
        for record in ("true", "false") if number % 2 else ("false", "true"):
            with running([f"mechanism:={mechanism}", f"record:={record}"], domain=95) as node:
                time.sleep(seconds)
                found[record].append(float(node.diagnostics["period p99 of the run (us)"]))
    with_it, without = (statistics.median(found[record]) for record in ("true", "false"))
    print(f"period p99          {with_it:.0f} µs recording, {without:.0f} not: {with_it / without:.3f} times")
    print(f"                    recording {sorted(found['true'])}, not {sorted(found['false'])}")


if __name__ == "__main__":
    main()
