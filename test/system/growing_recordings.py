"""Recordings that a node writes: where they begin, when they are finished, what they contain and can be computed from."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from std_srvs.srv import SetBool

from mbd_sim import Simulation, parse_mechanism
from mbd_sim.recordings.messages.cdr import JointStates
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.verification import Verification, verify
from test.system.nodes import Listener, nanoseconds

STEP_NS, STEPS_PER_STATE = 1_000_000, 10  # of a node with default parameters
MAGIC = b"\x89MCAP0\r\n"  # the last bytes of a finished file
LATE = " is still being written: the disk is slow"


def first_tick(path: Path) -> int | None:
    """The tick at which a file begins, finished or not; None while that is not yet on disk."""
    with contextlib.suppress(McapError, FileNotFoundError), path.open("rb") as stream:
        for record in StreamReader(stream).records:
            if isinstance(record, Metadata) and record.name == "mbd_sim":
                return int(record.metadata["first_tick"])
    return None


def until_recorded(listener: Listener, path: Path, count: int) -> None:
    """Wait until a file that begins at tick k contains the next `count` states after tick k.

    Counting the states that arrive after the answer of a service would not do: on a busy machine, many of them were
    published before the file began.
    """
    listener.until(lambda: first_tick(path) is not None, f"the beginning of {path.name}")
    last = STEP_NS * ((first_tick(path) or 0) + count * STEPS_PER_STATE)
    listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) >= last, f"{count} states in {path.name}")


def stop_recording(listener: Listener, folder: Path) -> Path:
    """Stop the recording of a node in this folder and wait until the file is finished; returns its path."""
    answer = listener.call(SetBool, "record", data=False)
    assert answer.success, answer.message
    path = folder / answer.message.removesuffix(LATE)
    listener.until(lambda: path.read_bytes().endswith(MAGIC), f"the end of {path.name}")
    return path


def verified(path: Path) -> Verification:
    """The verification of a recording, or of the only one in a folder, that agrees with its file to the last bit."""
    (verification,) = verify(next(iter(path.glob("*.mcap"))) if path.is_dir() else path)
    assert verification.is_intact and verification.agrees and verification.tolerance is None, (
        path, verification.first, verification.failure,
    )  # fmt: skip
    return verification


def recorded_states(folder: Path) -> dict[int, JointStates]:
    """The joint states of the recording in a folder, by the number of steps before them.

    A node records all of them. Of those that it publishes in lockstep, a listener on a busy machine loses some: the
    publisher keeps the last ten, and only the controller is waited for.
    """
    (path,) = folder.glob("*.mcap")
    recording = open_recording(path)
    return {message.sequence: recording.decoded(message) for message in recording.messages(["/joint_states"])}


def described_run(path: Path) -> tuple[Simulation, dict[str, str]]:
    """The simulation that a file alone describes, at the start of its mechanism, and the metadata of the run."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        (attachment,) = reader.iter_attachments()
        about = {record.name: record.metadata for record in reader.iter_metadata()}["mbd_sim"]
    simulation = Simulation(
        parse_mechanism(attachment.data.decode()),
        method=about["method"],
        step=float.fromhex(about["step"]),
        wrenches=json.loads(about["wrenches"]),
        live=list(json.loads(about["live"])),
    )
    return simulation, about
