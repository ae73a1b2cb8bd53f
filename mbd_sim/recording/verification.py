"""A recorded run computed again and compared, bit for bit where this is the same machine and version."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.geometry.rotation import of_vector
from mbd_sim.recording import cdr
from mbd_sim.recording.contents import DamagedError, Message, Part
from mbd_sim.recording.reader import open_recording
from mbd_sim.recording.recomputation import (
    COMMANDS,
    ENERGIES,
    EVENTS,
    STATES,
    Mismatch,
    Recomputation,
    joint_rows,
)  # fmt: skip
from mbd_sim.recording.run_metadata import run_metadata
from mbd_sim.recording.run_start import RecomputeError
from mbd_sim.simulation.compiled_model import Energies

TOLERANCE = 1e-9  # of 1 + the largest of the numbers, between two recorded states, on another machine or version
ENVIRONMENT = ("mbd_sim", "casadi", "llvmlite", "numpy", "processor")  # what the bits may depend on
LITTLE = b"\x01"  # the second byte of CDR: least significant bytes first, as this machine has them
_FIELDS = ("position", "velocity", "effort")


@dataclass(frozen=True)
class Difference:
    """A recorded number that the computation does not give; `tick` counts steps since the node started."""

    topic: str
    name: str
    tick: int
    time: float
    recorded: float
    computed: float

    @property
    def size(self) -> float:
        """How large it is; infinite where one of the numbers is not finite."""
        size = abs(self.recorded - self.computed)
        return size if np.isfinite(size) else float("inf")


@dataclass
class Verification:
    """What comparing one file gave. `tolerance` None: bit for bit."""

    path: Path
    mechanism: str = ""
    method: str = ""
    step: float = 0.0
    tolerance: float | None = None
    elsewhere: Sequence[str] = ()  # how the environment of the recording differs from this one
    compared: Counter[str] = field(default_factory=Counter)  # messages by role
    commands: Counter[str] = field(default_factory=Counter)
    steps: int = 0
    took: float = 0.0
    first: Difference | None = None
    largest: Difference | None = None
    differing: int = 0
    since: int = 0  # messages that agree, since the last that does not
    suspects: list[str] = field(default_factory=list)
    problem: str = ""  # why the file is not whole
    failure: str = ""  # why it could not be compared to its end

    @property
    def holds(self) -> bool:
        """Whether every recorded state is what the computation gives."""
        return self.first is None and not self.failure


def verify(
    path: str | Path, tolerance: float | None = None, progress: Callable[[float], None] | None = None
) -> list[Verification]:
    """Compute each file of a recording again and compare; `progress` hears the part that is done, from 0 to 1.

    :param tolerance: compare to it even where bits should agree. Relative to 1 + the largest number of the message;
        each interval between two recorded states begins from the recorded one then.
    :raises ReadingError, RecomputeError, MechanismError: there is nothing to compare.
    """
    parts = open_recording(path).parts
    found = []
    for number, part in enumerate(parts):

        def told(done: float, number: int = number) -> None:
            if progress is not None:
                progress((number + done) / len(parts))

        found.append(_Comparison(part, tolerance).run(told))
    return found


def elsewhere(about: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """How the environment of a recording differs from this one, as far as bits may depend on it."""
    found = [f"{key} {about[key]}, here {here[key]}" for key in ENVIRONMENT if about.get(key, here[key]) != here[key]]
    there = about.get("platform", here["platform"])
    if _system(there) != _system(here["platform"]):
        found.append(f"platform {there}, here {here['platform']}")
    return found


def _system(platform: str) -> str:
    """Architecture and C library, of what `platform.platform()` says."""
    return "-".join(platform.split("-")[-3:])


class _Comparison:
    """One file on its way through the simulation."""

    def __init__(self, part: Part, tolerance: float | None) -> None:
        self.part = part
        self.replica = Recomputation(part)
        simulation = self.replica.simulation
        about = part.metadata["mbd_sim"]
        differs = elsewhere(about, run_metadata(simulation))
        self.result = Verification(
            path=part.path,
            mechanism=simulation.mechanism.name,
            method=simulation.model.method.name,
            step=simulation.step_size,
            tolerance=tolerance if tolerance is not None else TOLERANCE if differs else None,
            elsewhere=differs,
            problem=part.problem,
        )
        model = simulation.model
        self._names = (*model.coordinate_names, *model.driven_names)
        self._since_agreeing: list[str] = []  # commands after the last state that agrees
        self._resumed: dict[str, Array] = {}  # recorded numbers from which the next interval begins

    def run(self, progress: Callable[[float], None]) -> Verification:
        result, began = self.result, time.perf_counter()
        blocks = self.part.blocks
        try:
            for number, block in enumerate(blocks):
                progress(number / len(blocks))
                for message in block.load():
                    if message.topic in self.replica.roles and not self._take(message):
                        return result
            self._contradict(self.replica.contradictions(), blocks[-1].end_ns if blocks else 0)
        except DamagedError as error:
            result.failure = error.what
        except RecomputeError as error:
            result.failure = str(error)
        finally:
            result.took = time.perf_counter() - began
            result.steps = self.replica.tick - self.replica.first_tick
        progress(1.0)
        return result

    def _take(self, message: Message) -> bool:
        """Compare or apply a message; False where its place in the run cannot be told.

        :raises MbdSimError: it cannot be read, or the simulation does not take it; said with its topic and step.
        """
        try:
            return self._placed(message)
        except MbdSimError as error:
            raise RecomputeError(f"{message.topic} at step {self.replica.tick}: {error}") from error

    def _placed(self, message: Message) -> bool:
        replica = self.replica
        tick = replica.behind(message)
        clock = replica.clock_ns(tick, message)
        if clock != message.time_ns and not replica.rewound(tick, message):
            self._differ(message.topic, "time of the step", tick, message.time_ns, message.time_ns * 1e-9, clock * 1e-9)
            self.result.failure = "a message is not at the time of its step, so that nothing behind it can be placed"
            return False
        if tick != replica.tick:
            self._resume()
            replica.advance(tick)
        role = replica.roles[message.topic]
        if role in COMMANDS:
            self._command(message, role)
        else:
            self.result.compared[role] += 1
            self._compare(message, role)
        return True

    def _command(self, message: Message, role: str) -> None:
        if role != EVENTS:
            self.result.commands[role] += 1
        elif reset := cdr.text(message.payload) == "reset":
            self.result.commands["resets"] += 1
            self._resumed.clear()
        if role != EVENTS or reset:
            self._since_agreeing.append(f"{message.topic} at step {self.replica.tick}")
        self._contradict(self.replica.apply(message), message.time_ns)

    def _contradict(self, found: Sequence[Mismatch], time_ns: int) -> None:
        for name, recorded, expected in found:
            self._differ("live_values", name, self.replica.tick, time_ns, recorded, expected)

    def _agrees(self, message: Message, role: str) -> bool:
        """Whether all bits of a message are as computed."""
        simulation = self.replica.simulation
        if role != STATES:
            told = simulation.energies if role == ENERGIES else simulation.violation
            return cdr.number_bits(message.payload) == (told._fields, np.array(told).tobytes())
        rows = joint_rows(simulation.model, simulation.time, simulation.y, simulation.inputs)
        bits = b"".join(row.tobytes() for row in rows)
        return cdr.joint_bits(message.payload) == (message.time_ns, self._names, bits)

    def _compare(self, message: Message, role: str) -> None:
        if self.result.tolerance is None and message.payload[1:2] == LITTLE and self._agrees(message, role):
            self.result.since += 1
            if role == STATES:
                self._since_agreeing.clear()
            return
        replica, simulation = self.replica, self.replica.simulation
        if role == STATES:
            given = cdr.joint_states(message.payload)
            rows = joint_rows(simulation.model, simulation.time, simulation.y, simulation.inputs)
            agrees = given.stamp_ns == message.time_ns and given.names == self._names
            if not agrees:
                self._differ(
                    message.topic, "stamp" if given.names == self._names else "names of the joints",
                    replica.tick, message.time_ns, given.stamp_ns * 1e-9, message.time_ns * 1e-9,
                )  # fmt: skip
            for kind, recorded, computed in zip(_FIELDS, given[3:], rows, strict=True):
                agrees &= self._same(message, kind, self._names, recorded, computed)
            self._resumed[role] = np.concatenate(given[3:5])
        else:
            numbers = cdr.numbers(message.payload)
            told = simulation.energies if role == ENERGIES else simulation.violation
            agrees = numbers.labels == told._fields
            if not agrees:
                length = float(len(numbers.labels)), float(len(told))
                self._differ(message.topic, "labels of the numbers", replica.tick, message.time_ns, *length)
            agrees &= self._same(message, "", told._fields, numbers.values, np.array(told))
            self._resumed[role] = numbers.values
        if agrees:
            self.result.since += 1
            if role == STATES:
                self._since_agreeing.clear()
        else:
            self.result.differing += 1
            self.result.since = 0

    def _same(self, message: Message, kind: str, names: Sequence[str], recorded: Array, computed: Array) -> bool:
        """Whether numbers agree; tells each that does not."""
        if len(recorded) != len(computed):
            self._differ(message.topic, f"length of {kind or 'data'}", self.replica.tick, message.time_ns,
                         float(len(recorded)), float(len(computed)))  # fmt: skip
            return False
        tolerance = self.result.tolerance
        if tolerance is None:
            if recorded.tobytes() == computed.tobytes():
                return True
            off = recorded.view(np.int64) != np.ascontiguousarray(computed).view(np.int64)
        else:
            bound = tolerance * (1.0 + np.max(np.abs(computed), initial=0.0))
            off = ~(np.abs(recorded - computed) <= bound)
            if not np.any(off):
                return True
        for place in np.flatnonzero(off):
            name = f"{names[int(place)]} {kind}".strip()
            self._differ(
                message.topic, name, self.replica.tick, message.time_ns, float(recorded[place]), float(computed[place])
            )
        return False

    def _differ(self, topic: str, name: str, tick: int, time_ns: int, recorded: float, computed: float) -> None:
        result = self.result
        difference = Difference(topic, name, tick, time_ns * 1e-9, recorded, computed)
        if result.first is None:
            result.first = difference
            result.suspects = list(self._since_agreeing)
        if result.largest is None or difference.size > result.largest.size:
            result.largest = difference

    def _resume(self) -> None:
        """Where only a tolerance is asked for, go on from what was recorded: chaotic motions lose every bit."""
        if self.result.tolerance is None or not self._resumed:
            return
        simulation = self.replica.simulation
        model, y = simulation.model, simulation.state
        if (recorded := self._resumed.get(STATES)) is not None:
            free = model.layout.nv
            y[model.q_range] = np.fromiter(_coordinates(self.replica, recorded[:free]), dtype=float)
            y[model.u_range] = recorded[len(self._names) :][:free]
        if (audit := self._resumed.get(ENERGIES)) is not None:
            told = Energies(*audit)
            y[-3:] = told.work_applied, told.work_drives, told.dissipated
        simulation.restore(y, simulation.steps)
        self._resumed.clear()


def _coordinates(replica: Recomputation, positions: Array) -> Iterator[float]:
    """The generalized coordinates of positions as `joint_states` tells them."""
    model = replica.simulation.model
    for joint, place in model.layout.u.items():
        told = positions[place]
        if joint in model.quaternions:
            yield from told[:-3]
            yield from of_vector(told[-3:])
        else:
            yield from told
