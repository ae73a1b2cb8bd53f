"""What a real node does when its recording meets full, missing and odd disks, kills, and clocks that are set back."""

from __future__ import annotations

import errno
import os
import random
import shutil
import signal
import struct
import subprocess
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from mbd_sim.cli.main import main
from mbd_sim.recordings.run.recovery import recover
from mbd_sim.recordings.run.verification import verify
from test.recordings.recordings import readable
from test.system.growing_recordings import until_recorded
from test.system.nodes import Listener, SimNodeProcess, nanoseconds, new_domain, running
from test.system.test_recording_services import recomputed, state_ticks


def goes_on(listener: Listener) -> None:
    newest = nanoseconds(listener.states[-1].header.stamp)
    listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) > newest + 300_000_000, "more states")


@pytest.fixture(scope="module")
def faulty_disk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library that makes writes fail, see its source."""
    if not shutil.which("gcc"):
        pytest.skip("gcc is not installed")
    library = tmp_path_factory.mktemp("library") / "faulty_disk.so"
    source = Path(__file__).with_name("faulty_disk.c")
    subprocess.run(["gcc", "-O1", "-shared", "-fPIC", source, "-o", library, "-ldl"], check=True)
    return library


def on_a_faulty_disk(library: Path, control: Path, folder: Path) -> dict[str, str]:
    """The variables with which writes of a node to a folder fail as the control file says; at first none do."""
    control.write_bytes(struct.pack("iii", 0, 0, -1))
    return {"LD_PRELOAD": str(library), "FAULTY_CONTROL": str(control), "FAULTY_FOLDER": str(folder)}


def set_fault(control: Path, kind: int, skip: int = 0, count: int = -1) -> None:
    with control.open("r+b") as stream:
        stream.write(struct.pack("iii", kind, skip, count))


def test_a_disk_that_does_not_answer_does_not_keep_the_node_from_ending(faulty_disk: Path, tmp_path: Path) -> None:
    control, folder = tmp_path / "control", tmp_path / "logs"
    variables = on_a_faulty_disk(faulty_disk, control, folder)
    options = {"record": True, "record_dir": str(folder), "record_format": "rosbag2"}
    with running(tmp_path, variables=variables, **options) as (node, listener):
        (path,) = folder.glob("*/*.mcap")
        listener.until(lambda: len(readable(path)) > 20, "a recording of some size")
        set_fault(control, -2)  # writes hang
        goes_on(listener)
        assert node.end() == 0  # it waited for ever
    assert "the disk does not respond" in node.text and "mbd_sim recover" in node.text
    kept = len(readable(path))
    assert main(["recover", str(path.parent)]) == 0
    with AnyReader([path.parent]) as reader:
        assert reader.message_count == kept > 20


@pytest.mark.parametrize(
    ("calls", "count", "at_end"),
    [(0, 1, False), (2, -1, True)],
)
def test_a_quota_that_is_reached_at_any_call_does_not_keep_the_node_from_ending(
    faulty_disk: Path, tmp_path: Path, calls: int, count: int, at_end: bool
) -> None:
    """Among these calls are chunks and their fdatasync(), new files at a split, and metadata.yaml at the end."""
    control, folder = tmp_path / "control", tmp_path / "logs"
    variables = on_a_faulty_disk(faulty_disk, control, folder)
    options = {"record": True, "record_dir": str(folder), "record_format": "rosbag2", "record_split_duration": 0.5}
    with running(tmp_path, variables=variables, **options) as (node, listener):
        listener.until(lambda: len(list(folder.glob("*/*.mcap"))) > 2, "splits")
        set_fault(control, errno.EDQUOT, calls, count)
        if not at_end:
            goes_on(listener)
        assert node.end() == 0
    set_fault(control, 0)
    assert "Traceback" not in node.text and "the disk does not respond" not in node.text  # it did not wait for it
    (recording,) = folder.iterdir()
    assert main(["recover", str(recording)]) == 0
    with AnyReader([recording]) as reader:
        assert reader.message_count > 100
    assert all(result.agrees for result in verify(recording))


def recorded_so_far(folder: Path) -> int:
    """The messages that are on disk in the recording in a folder."""
    return sum(len(readable(path)) for path in folder.glob("*.mcap"))


def test_killed_nodes_leave_recordings_that_lack_at_most_half_a_second_and_are_computed_again(tmp_path: Path) -> None:
    nodes = []
    for number in range(2):
        domain, folder = new_domain(), tmp_path / str(number)
        folder.mkdir()
        parameters = {"record": True, "record_dir": ".", "publish_rate": [5.0, 500.0][number]}
        nodes.append((SimNodeProcess(domain, folder, parameters), Listener(domain), folder))
    try:
        for _, listener, _ in nodes:
            listener.until(lambda listener=listener: len(listener.states) > 2, "states")
        for node, listener, folder in nodes:
            listener.by_order.publish(Float64MultiArray(data=[1.0, -0.5]))
            listener.until(lambda folder=folder: recorded_so_far(folder) > 5, "a recording of some size")  # type: ignore[misc]
            listener.spin(random.uniform(0.0, 0.5))
            node.process.send_signal(signal.SIGKILL)
            node.process.wait()
            last = nanoseconds(listener.states[-1].header.stamp)
            (path,) = folder.glob("*.mcap")
            assert last - readable(path)[-1].log_time <= 1e9 * (0.5 + listener.stall)
            assert main(["verify", "--quiet", str(path)]) == 0  # as it was left
            recover(path)
            assert recomputed(path) == len(state_ticks(path)) >= 2
            assert main(["verify", "--quiet", str(path)]) == 0
    finally:
        for node, listener, _ in nodes:
            listener.close()
            node.kill()


def test_a_system_clock_that_is_set_back_and_forth_changes_nothing_in_the_recording(tmp_path: Path) -> None:
    if not shutil.which("gcc"):
        pytest.skip("gcc is not installed")
    library, clock = tmp_path / "shifted_clock.so", tmp_path / "clock"
    source = Path(__file__).with_name("shifted_clock.c")
    subprocess.run(["gcc", "-O1", "-shared", "-fPIC", source, "-o", library, "-ldl"], check=True)
    clock.write_bytes(bytes(8))
    variables = {"LD_PRELOAD": str(library), "SHIFTED_CLOCK": str(clock)}

    def set_clock(shift: int) -> None:
        with clock.open("r+b") as stream:
            stream.write(struct.pack("q", shift))

    wrapper = ["env"]  # which starts the node by itself: the library wants its clock from the start
    with running(tmp_path, wrapper=wrapper, variables=variables, record=True, record_dir="logs") as (node, listener):
        for shift in (-3_600, 7_200, -86_400):
            set_clock(shift)
            goes_on(listener)
        known = set((tmp_path / "logs").glob("*.mcap"))  # not the hidden name that a file has at its very beginning
        assert listener.call(Trigger, "split_recording").success
        listener.until(lambda: set((tmp_path / "logs").glob("*.mcap")) - known, "the next file")
        (second,) = set((tmp_path / "logs").glob("*.mcap")) - known
        until_recorded(listener, second, 15)
        assert listener.call(SetBool, "record", data=False).success
        late = listener.call(SetBool, "record", data=True)
        assert late.success
        until_recorded(listener, tmp_path / late.message, 15)
        assert node.end() == 0
    named = datetime.strptime(Path(late.message).stem.partition("double_rod_")[2], "%Y%m%d_%H%M%S")
    assert datetime.now() - named > timedelta(hours=20)  # the clock was another one indeed
    paths = sorted((tmp_path / "logs").iterdir(), key=lambda path: state_ticks(path)[0])
    assert len(paths) == 3
    for path in paths:
        assert recomputed(path) > 10
        times = [message.log_time for message in readable(path)]
        assert times == sorted(times)
        assert [time_ns // 1_000_000 for time_ns in times] == [message.sequence for message in readable(path)]
    assert os.path.commonpath([*map(str, paths)]) == str(tmp_path / "logs")
