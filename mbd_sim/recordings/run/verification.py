"""Verifies recordings by recomputing them: bit for bit, or where machine or versions differ, also to a tolerance.

The messages of each file, measurements of sensors included, are compared with their recomputation, and its checksums,
offsets and indexes are checked.
"""

from __future__ import annotations

import struct
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.mcap.check import check_file
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import RUN_METADATA, DamagedError, Message, ReadingError, RecordedFile
from mbd_sim.recordings.messages.sensors import Numbers
from mbd_sim.recordings.messages.states import AccelerationMessages, requested_by
from mbd_sim.recordings.messages.topics import SensorSerializer
from mbd_sim.recordings.run.metadata import FIRST_EQUATIONS, run_metadata
from mbd_sim.recordings.run.reader import COMMANDS, TopicRole, open_recording
from mbd_sim.recordings.run.recomputation import LiveValueMismatch, Recomputation, RecomputeError
from mbd_sim.simulation.model.state_records import Energies, Violation
from mbd_sim.simulation.run.events import EventKind, parse_event
from mbd_sim.simulation.run.run_point import integrated_energies, joint_state_arrays, joint_state_names, recorded_state

NumberDifference = tuple[str, float, float]  # the name of a number, as recorded, and as computed


class SensorComparison:
    """The messages of sensors in a recomputed run."""

    def __init__(self, recomputation: Recomputation) -> None:
        """Prepare the messages, with the frame names that the node was given."""
        self._recomputation, simulation = recomputation, recomputation.simulation
        self._messages = SensorSerializer(simulation.model, simulation.step_size, recomputation.frame_prefix)
        self._numbers = {name.rpartition("/")[2]: number for number, name in enumerate(self._messages.names)}

    def differences(self, message: Message, tolerance: float | None) -> list[NumberDifference]:
        """The numbers of a message that differ from the computed ones: bit for bit, or by more than a tolerance.

        The tolerance is relative to 1 + the largest number of the quantity, beside one step of a value that is rounded.

        :raises ReadingError: it is not a message of its sensor, or nothing is measured at this step.
        """
        name = message.topic.rpartition("/")[2]
        number = self._numbers.get(name)
        if number is None:
            raise ReadingError(f"the mechanism has no sensor '{name}'")
        arrivals = {arrival.sensor: arrival for arrival in self._recomputation.simulation.arrivals}
        if number not in arrivals:
            raise ReadingError("no measurement arrives at this step")
        (measured,) = self._messages.measured([arrivals[number]], message.time_ns)
        expected = measured.payload
        if message.payload == expected:
            return []
        if len(message.payload) != len(expected) or message.payload[:4] != expected[:4]:
            raise ReadingError(f"has {len(message.payload)} bytes, not the {len(expected)} of its sensor's message")
        return self._number_differences(number, message.payload, expected, tolerance)

    def _number_differences(
        self, number: int, recorded: bytes, expected: bytes, tolerance: float | None
    ) -> list[NumberDifference]:
        writer, found = self._messages.writers[number], list[NumberDifference]()
        differing = {index for index, (one, other) in enumerate(zip(recorded, expected, strict=True)) if one != other}
        for name, view in writer.views.items():
            start = writer.message.offset_of(view)
            places = range(start, start + view.nbytes)
            own = differing.intersection(places)
            differing -= own
            if own:
                found += self._in_view(number, name, view, recorded[start : places.stop], tolerance)
        if differing:
            first = min(differing)
            place = f"byte {first} of the message"
            found.append((place, float(recorded[first]), float(expected[first])))
        return found

    def _in_view(
        self, number: int, quantity: str, view: Numbers, recorded: bytes, tolerance: float | None
    ) -> list[NumberDifference]:
        numbers = np.frombuffer(recorded, dtype=view.dtype)
        letters = "xyzw" if len(view) > 1 else " "
        pairs = zip(letters, numbers.tolist(), view.tolist(), strict=False)
        if tolerance is None:
            return [
                (f"{quantity} {letter}".strip(), one, other)
                for letter, one, other in pairs
                if struct.pack("<d", one) != struct.pack("<d", other)
            ]
        bound = tolerance * (1.0 + float(np.max(np.abs(view)))) + self._messages.rounding(number, quantity)
        return [
            (f"{quantity} {letter}".strip(), one, other)
            for letter, one, other in pairs
            if not (abs(one - other) <= bound or one == other)
        ]


@dataclass(frozen=True)
class Difference:
    """A recorded number that differs from the recomputed one; `tick` counts steps since the node started."""

    topic: str
    name: str
    tick: int
    time: float
    recorded: float
    computed: float

    @property
    def size(self) -> float:
        """The absolute difference; infinite if one of the numbers is not finite."""
        size = abs(self.recorded - self.computed)
        return size if np.isfinite(size) else float("inf")


@dataclass
class Verification:
    """The comparison of one file with its recomputation. Without a `tolerance` it is bit for bit."""

    path: Path
    mechanism: str = ""
    method: str = ""
    step: float = 0.0
    tolerance: float | None = None
    environment_differences: Sequence[str] = ()  # between the recording's environment and this one
    compared: Counter[str] = field(default_factory=Counter)  # number of messages by role
    commands: Counter[str] = field(default_factory=Counter)
    steps: int = 0
    wall_time: float = 0.0  # s
    first: Difference | None = None
    largest: Difference | None = None
    differing: int = 0  # number of messages
    agreeing_since: int = 0  # number of messages that agree after the last that does not
    suspected_commands: list[str] = field(default_factory=list)  # between the last state that agrees and `first`
    problem: str = ""  # why the file is incomplete
    index_problem: str = ""  # damage of indexes and summary, because of which other readers may refuse the file
    content_problem: str = ""  # damage of records that are not compared
    failure: str = ""  # why the comparison ended before the end of the file

    @property
    def agrees(self) -> bool:
        """Whether every recorded state is the recomputed one."""
        return self.first is None and not self.failure

    @property
    def is_intact(self) -> bool:
        """Whether all states agree, and nothing else of the file is damaged; it may be truncated."""
        return self.agrees and not self.index_problem and not self.content_problem


LITTLE_ENDIAN = b"\x01"  # the second byte of CDR with the byte order of this machine
_FIELDS = ("position", "velocity", "effort")


class Comparison:
    """Advances a recomputation through the messages of a file and adds the results to a `Verification`."""

    def __init__(self, recomputation: Recomputation, result: Verification) -> None:
        self.recomputation, self.result = recomputation, result
        self._names = joint_state_names(recomputation.simulation.model)
        self._sensors = SensorComparison(recomputation)
        self._commands_since_agreement: list[str] = []  # commands after the last state that agrees
        # With a tolerance, the recorded values from which the next interval starts:
        self._recorded_joints: cdr.JointStates | None = None
        self._recorded_energies: Energies | None = None

    def run(self, progress: Callable[[float], None], *, to_the_end: bool = True) -> None:
        """Compare all messages, or those up to a difference; `progress` is called with the completed fraction."""
        result, started = self.result, time.perf_counter()
        blocks = self.recomputation.file.blocks
        try:
            for number, block in enumerate(blocks):
                progress(number / len(blocks))
                for message in block.load():
                    if message.topic in self.recomputation.roles and not self._process(message):
                        return
                    if result.first is not None and not to_the_end:
                        return
            self._add_mismatches(self.recomputation.live_value_mismatches(), blocks[-1].end_ns if blocks else 0)
        except DamagedError as error:
            result.failure = error.problem
        except RecomputeError as error:
            result.failure = str(error)
        finally:
            result.wall_time = time.perf_counter() - started
            result.steps = self.recomputation.tick - self.recomputation.first_tick
        progress(1.0)

    def _process(self, message: Message) -> bool:
        """Advance to a message, then compare or apply it; False if its tick and its time contradict each other.

        :raises RecomputeError: it cannot be decoded or applied; the message names topic and step.
        """
        try:
            if not self._advance(message):
                return False
            role = self.recomputation.roles[message.topic]
            if role in COMMANDS:
                self._apply(message, role)
            else:
                self.result.compared[role] += 1
                self._count(role, self._agrees(message, role))
        except (MbdSimError, ValueError, IndexError, struct.error) as error:
            raise RecomputeError(f"{message.topic} at step {self.recomputation.tick}: {error}") from error
        return True

    def _advance(self, message: Message) -> bool:
        recomputation = self.recomputation
        tick = recomputation.tick_of(message)
        clock_ns = recomputation.clock_ns(tick, message)
        if clock_ns != message.time_ns:
            if not recomputation.sets_clock(message):
                self._add_difference(message, "time of the step", message.time_ns * 1e-9, clock_ns * 1e-9, tick)
                self.result.failure = "a message is not at the time of its step, so no later one can be assigned a step"
                return False
            recomputation.set_clock(tick, message.time_ns)
        if tick != recomputation.tick:
            if self.result.tolerance is not None:
                self._continue_from_recorded_state()
            recomputation.advance(tick)
        return True

    def _apply(self, message: Message, role: TopicRole) -> None:
        live = self.recomputation.simulation.live
        mismatches = self.recomputation.apply(message)
        if self._is_command(message, role, live):
            is_reset = role is TopicRole.EVENTS
            self.result.commands["resets" if is_reset else role] += 1
            self._commands_since_agreement.append(f"{message.topic} at step {self.recomputation.tick}")
            if is_reset or role is TopicRole.NEW_STATES:
                self._recorded_joints = self._recorded_energies = None
        self._add_mismatches(mismatches, message.time_ns)

    def _is_command(self, message: Message, role: TopicRole, live: Mapping[str, float]) -> bool:
        """Whether a message that has been applied is a command; `live` are the live values before it.

        Every file begins with a message of the live values that are in effect already.
        """
        if role is TopicRole.EVENTS:
            return parse_event(cdr.text(message.payload)).kind is EventKind.RESET
        return role is not TopicRole.LIVE_VALUES or self.recomputation.simulation.live != live

    def _count(self, role: TopicRole, agrees: bool) -> None:
        if not agrees:
            self.result.differing += 1
            self.result.agreeing_since = 0
            return
        self.result.agreeing_since += 1
        if role is TopicRole.JOINT_STATES:
            self._commands_since_agreement.clear()

    def _agrees(self, message: Message, role: TopicRole) -> bool:
        """Compare a message; add the differences to the result."""
        if role is TopicRole.JOINT_STATES:
            return self._joint_states_agree(message)
        simulation = self.recomputation.simulation
        if role is TopicRole.SENSORS:
            return self._measurement_agrees(message)
        if role is TopicRole.ACCELERATIONS:
            return self._accelerations_agree(message)
        computed = simulation.energies if role is TopicRole.ENERGIES else simulation.violation
        return self._values_agree(message, computed)

    def _joint_states_agree(self, message: Message) -> bool:
        simulation = self.recomputation.simulation
        computed = joint_state_arrays(simulation.model, simulation.time, simulation.y, simulation.inputs)
        if self._is_bitwise(message):
            array_bytes = b"".join(values.tobytes() for values in computed)
            if cdr.joint_state_bytes(message.payload) == (message.time_ns, self._names, array_bytes):
                return True
        recorded = cdr.joint_states(message.payload)
        self._recorded_joints = recorded
        agree = recorded.stamp_ns == message.time_ns and recorded.names == self._names
        if not agree:
            name = "stamp" if recorded.names == self._names else "names of the joints"
            self._add_difference(message, name, recorded.stamp_ns * 1e-9, message.time_ns * 1e-9)
        arrays = (recorded.position, recorded.velocity, recorded.effort)
        for kind, values, expected in zip(_FIELDS, arrays, computed, strict=True):
            agree &= self._arrays_agree(message, self._names, values, expected, kind)
        return agree

    def _values_agree(self, message: Message, computed: Energies | Violation) -> bool:
        if self._is_bitwise(message):
            expected = computed._fields, np.array(computed).tobytes()
            if cdr.multi_array_bytes(message.payload) == expected:
                return True
        recorded = cdr.multi_array(message.payload)
        agree = recorded.labels == computed._fields
        if not agree:
            self._add_difference(message, "labels of the numbers", float(len(recorded.labels)), float(len(computed)))
        elif isinstance(computed, Energies) and len(recorded.values) == len(computed):
            self._recorded_energies = Energies(*recorded.values)
        return self._arrays_agree(message, computed._fields, recorded.values, np.array(computed)) and agree

    def _accelerations_agree(self, message: Message) -> bool:
        simulation, recorded = self.recomputation.simulation, cdr.multi_array(message.payload)
        source = AccelerationMessages(simulation.model, requested_by(simulation.model, recorded.labels))
        names = [name for name, size in zip(source.labels, source.sizes, strict=True) for _ in range(size)]
        computed = np.empty(len(names))
        source.write(computed, simulation.time, simulation.y, simulation.inputs, simulation.live)
        return self._arrays_agree(message, names, recorded.values, computed)

    def _measurement_agrees(self, message: Message) -> bool:
        differences = self._sensors.differences(message, self.result.tolerance)
        for name, recorded, computed in differences:
            self._add_difference(message, name, recorded, computed)
        return not differences

    def _is_bitwise(self, message: Message) -> bool:
        """Whether the bytes of a message can be compared with those of computed arrays."""
        return self.result.tolerance is None and message.payload[1:2] == LITTLE_ENDIAN

    def _arrays_agree(
        self, message: Message, names: Sequence[str], recorded: Array, computed: Array, field: str = ""
    ) -> bool:
        """Compare two arrays (n,) bit for bit or to the tolerance; add the differences to the result."""
        if len(recorded) != len(computed):
            name = f"length of {field or 'data'}"
            self._add_difference(message, name, float(len(recorded)), float(len(computed)))
            return False
        tolerance = self.result.tolerance
        if tolerance is None:
            if recorded.tobytes() == computed.tobytes():
                return True
            differ = recorded.view(np.int64) != np.ascontiguousarray(computed).view(np.int64)
        else:
            bound = tolerance * (1.0 + np.max(np.abs(computed), initial=0.0))
            differ = ~(np.abs(recorded - computed) <= bound)
        for index in np.flatnonzero(differ):
            name = f"{names[int(index)]} {field}".strip()
            self._add_difference(message, name, float(recorded[index]), float(computed[index]))
        return not np.any(differ)

    def _add_mismatches(self, mismatches: Sequence[LiveValueMismatch], time_ns: int) -> None:
        for one in mismatches:
            tick, time = self.recomputation.tick, time_ns * 1e-9
            self._add(Difference("live_values", one.key, tick, time, one.recorded, one.announced))

    def _add_difference(
        self, message: Message, name: str, recorded: float, computed: float, tick: int | None = None
    ) -> None:
        tick = self.recomputation.tick if tick is None else tick
        self._add(Difference(message.topic, name, tick, message.time_ns * 1e-9, recorded, computed))

    def _add(self, difference: Difference) -> None:
        result = self.result
        if result.first is None:
            result.first = difference
            result.suspected_commands = list(self._commands_since_agreement)
        if result.largest is None or difference.size > result.largest.size:
            result.largest = difference

    def _continue_from_recorded_state(self) -> None:
        """Start the next interval from the recorded state: on its own a chaotic motion would lose every digit."""
        simulation, joints, energies = self.recomputation.simulation, self._recorded_joints, self._recorded_energies
        if joints is None and energies is None:
            return
        y = simulation.state
        if joints is not None:
            y = recorded_state(simulation.model, y, joints.position, joints.velocity)
        if energies is not None:
            y[-3:] = integrated_energies(energies)
        simulation.restore(y, simulation.steps)
        self._recorded_joints = self._recorded_energies = None


TOLERANCE = 1e-9  # of 1 + the largest number, from one recorded state to the next, for other machines and versions
ENVIRONMENT = ("mbd_sim", "equations", "casadi", "llvmlite", "numpy", "processor")  # on which the bits may depend


def verify(
    path: str | Path, tolerance: float | None = None, progress: Callable[[float], None] | None = None
) -> list[Verification]:
    """Recompute each file of a recording and compare; check all checksums, offsets and indexes of the files.

    Bits that differ on another machine or version may do so rightly: such a file is compared again to `TOLERANCE`.

    :param tolerance: compare to it even where the bits should agree. It is relative to 1 + the largest number of the
        message; each interval between two recorded states then starts from the recorded one.
    :param progress: called with the completed fraction, from 0 to 1.
    :raises ReadingError, RecomputeError, MechanismError: there is nothing to compare.
    """
    files = open_recording(path).files
    results = []
    for number, file in enumerate(files):

        def report(fraction: float, number: int = number) -> None:
            if progress is not None:
                progress((number + fraction) / len(files))

        results.append(_verify_file(file, tolerance, report))
    return results


def _verify_file(file: RecordedFile, tolerance: float | None, progress: Callable[[float], None]) -> Verification:
    recomputation = Recomputation(file)
    differences = environment_differences(file.metadata[RUN_METADATA], run_metadata(recomputation.simulation))
    check = check_file(file.path)

    def compared(recomputation: Recomputation, tolerance: float | None, *, to_the_end: bool) -> Verification:
        simulation = recomputation.simulation
        result = Verification(
            path=file.path,
            mechanism=simulation.mechanism.name,
            method=simulation.model.method_name,
            step=simulation.step_size,
            tolerance=tolerance,
            environment_differences=differences,
            problem=file.problem,
            index_problem=check.index_problem,
            content_problem=check.content_problem,
        )
        Comparison(recomputation, result).run(progress, to_the_end=to_the_end)
        return result

    result = compared(recomputation, tolerance, to_the_end=tolerance is not None or not differences)
    if result.agrees or tolerance is not None or not differences:
        return result
    return compared(Recomputation(file), TOLERANCE, to_the_end=True)


def environment_differences(recorded: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Return how the environment of a recording differs from the present one, as far as bits may depend on it."""
    recorded = {"equations": FIRST_EQUATIONS, **recorded}
    found = [
        f"{key} {recorded[key]}, here {present[key]}"
        for key in ENVIRONMENT
        if recorded.get(key, present[key]) != present[key]
    ]
    platform = recorded.get("platform", present["platform"])
    if _architecture(platform) != _architecture(present["platform"]):
        found.append(f"platform {platform}, here {present['platform']}")
    return found


def _architecture(platform: str) -> str:
    """Return architecture and C library from the value of `platform.platform()`."""
    return "-".join(platform.split("-")[-3:])
