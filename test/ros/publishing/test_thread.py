"""The publishing thread: what it needs is there before the start, and it publishes new states where it cannot keep up."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
import time
from pathlib import Path

from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.ros.publishing import thread as publishing_thread
from mbd_sim.simulation.model.state_records import Energies
from test.recordings.runs import stepped_node
from test.system.nodes import new_domain
from test.waiting import wait_until

ALL_OUTPUTS = {
    "accelerations": "all", "part_poses": "all", "joint_reactions": True, "contact_states": True, "contact_forces": True,
    "energy_values": True,
    "constraint_violation": True, "record": False,
}  # fmt: skip


def test_a_state_is_left_out_only_if_it_is_old_and_a_newer_one_waits(tmp_path: Path, monkeypatch) -> None:
    with stepped_node(tmp_path, "rod_pendulum", record=False) as node:
        thread, output = node.publishing_thread, node.stepping_thread.run.output
        now = [100.0]
        monkeypatch.setattr(publishing_thread.time, "perf_counter", lambda: now[0])
        state = output.journal.snapshot(Due.STATE, taken=99.5)
        output.newest = output.journal.snapshot(Due.STATE, taken=99.9)
        object.__setattr__(output.newest, "ticks", state.ticks + 1)
        assert not thread._is_outdated(state) and thread.age == 0.5  # as after a stall of the machine
        now[0] = 100.6
        assert thread._is_outdated(state)
        assert not thread._is_outdated(output.newest)
        now[0] = 100.65
        assert thread._is_outdated(
            output.journal.snapshot(Due.STATE, taken=100.6)
        )  # 50 ms are much while it cannot keep up
        now[0] = 102.0
        assert not thread._is_outdated(output.journal.snapshot(Due.STATE, taken=101.5))
        assert not thread._is_outdated(output.journal.snapshot(Due.CLOCK | Due.SENSORS, taken=0.0))
        assert not thread._is_outdated(output.journal.snapshot(Due.STATE))  # at full speed, or on request


def test_slow_publishing_leaves_states_out_but_no_times_and_says_how_old_states_are(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr(publishing_thread, "PATIENCE", 0.05)
    rates = {"publish_rate": 1000.0, "clock_rate": 1000.0}
    with stepped_node(tmp_path, "rod_pendulum", record=False, real_time_factor=1.0, **rates) as node:
        thread, clocks = node.publishing_thread, []
        writer = thread._state_writers["joint_states"]

        def slow(snapshot: Snapshot, energies: Energies) -> None:
            time.sleep(0.005)
            writer.write(snapshot, energies)

        thread._state_writers["joint_states"] = dataclasses.replace(writer, write=slow)
        clock = thread._clock_message
        monkeypatch.setattr(clock, "stamp", lambda ns, stamp=clock.stamp: (clocks.append(ns), stamp(ns))[1])
        node.stepping_thread.pause(False)
        wait_until(lambda: thread.left_out > 300 and 0.0 < thread.age < 0.5, "new states again")
        message = str(node.diagnostics._output(node.diagnostics._sample()).message)
        assert "dropped in the last second, and states are" in message and "request fewer outputs" in message
        node.stepping_thread.pause(True)
        wait_until(lambda: not node.stepping_thread.output.qsize(), "an empty queue")
        paused = clocks.index(max(clocks))
        running = clocks[: paused + 1]  # time zero is published again while it is paused
        assert running == sorted(running)
        assert list(dict.fromkeys(running)) == [n * 1_000_000 for n in range(max(clocks) // 1_000_000 + 1)]


def test_measurements_that_take_all_time_leave_new_states_which_are_recorded_in_their_turn(
    tmp_path: Path, monkeypatch
) -> None:
    for name, value in (("PATIENCE", 0.05), ("STARVED", 0.05)):
        monkeypatch.setattr(publishing_thread, name, value)
    with stepped_node(tmp_path, "balancing_pendulum", real_time_factor=1.0, clock_rate=0.0) as node:
        thread, ages, recorded = node.publishing_thread, [], []
        measured, publish, record = thread._sensors.measured, thread._publish, thread._record

        def slow(arrivals, clock_ns):
            time.sleep(0.004)  # for each step of 1 ms
            return measured(arrivals, clock_ns)

        def publish_state(name, payload, time_ns, ticks, repeated=False):
            if name == "joint_states":
                ages.append((node.stepping_thread.ticks - ticks) * node.stepping_thread.simulation.step_size)
            publish(name, payload, time_ns, ticks, repeated)

        def record_state(name, payload, time_ns, ticks, repeated=False):
            recorded.append(time_ns)
            record(name, payload, time_ns, ticks, repeated)

        monkeypatch.setattr(thread._sensors, "measured", slow)
        monkeypatch.setattr(thread, "_publish", publish_state)
        monkeypatch.setattr(thread, "_record", record_state)
        node.stepping_thread.pause(False)
        wait_until(lambda: node.stepping_thread.output.qsize() > 500 and len(ages) > 12, "states all the time")
        lighter = node.diagnostics._lighter
        node.stepping_thread.pause(True)
        monkeypatch.setattr(thread._sensors, "measured", measured)
        wait_until(lambda: not node.stepping_thread.output.qsize() and not thread._ahead, "an empty queue")
        assert max(ages[-3:]) < 0.3  # while what waits is older than 0.5 s
        assert recorded == sorted(recorded)
        assert "measurements per simulated second (" in lighter and "give sensors a lower rate, sensors: {" in lighter


def test_a_run_imports_nothing_also_of_the_page_and_sets_off_no_search_for_garbage(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", QUIET, str(tmp_path), "bounce", str(new_domain())],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == "imports [], searches [], of the page []\n"


ROOT = Path(__file__).parents[3]
QUIET = f"""
import gc, sys
import rclpy
from mbd_sim.compiler.code import machine_code
from mbd_sim.ros.node import sim_node
from test.waiting import wait_until

given = dict(mechanism=sys.argv[2], publish_rate=1000.0, real_time_priority=0, **{ALL_OUTPUTS!r})
arguments = ["--ros-args", "--log-level", "ERROR"]
for name, value in given.items():
    arguments += ["-p", f"{{name}}:={{str(value).lower() if isinstance(value, bool) else value}}"]
rclpy.init(args=arguments, domain_id=int(sys.argv[3]))
machine_code.LEVEL = 0
node = sim_node._make_node(lambda: None)
searches, before = [], set(sys.modules)

def note(phase, info):
    searches.append(info)

gc.callbacks.append(note)
node.start()
wait_until(lambda: node.stepping_thread.ticks > 600, "the run")
node.diagnostics.publish()
node.stepping_thread.reset()
gc.callbacks.remove(note)
print(f"imports {{sorted(set(sys.modules) - before)}}, searches {{searches}}, "
      f"of the page {{[name for name in sys.modules if name.startswith('mbd_sim.lab')]}}")
node.stop()
rclpy.try_shutdown()
"""
