"""A recording as arrays: joints, energies and events over time, and these as a flat table in a file.

Further columns hold what a run records on request: reactions, poses, and violation of constraints. A file has one row
per state, with units in the names of the columns.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError, cause_of, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.messages.cdr import DamagedError, Message
from mbd_sim.recordings.messages.definitions import names_by_topic
from mbd_sim.recordings.run.reader import Recording, TopicRole, topic_roles
from mbd_sim.recordings.run.recomputation import SEQUENCE_MODULUS
from mbd_sim.recordings.views.sensor_columns import SensorTable, SensorTables
from mbd_sim.simulation.model.state_records import Energies
from mbd_sim.simulation.run.events import RESTARTS, parse_event

REACTION, CONTACT = "reaction.", "contact."
REACTIONS, POSE = "sensor_msgs/msg/MultiDOFJointState", "geometry_msgs/msg/PoseStamped"
_WRENCH = tuple(f"{vector}_{axis}_{unit}" for vector, unit in (("force", "N"), ("moment", "Nm")) for axis in "xyz")
_AT_CONTACT = (
    *(f"{axis}_m" for axis in "xyz"), *(f"normal_{axis}" for axis in "xyz"), *(f"force_{axis}_N" for axis in "xyz"),
)  # fmt: skip
_STATE = "gap", "rate", "force"  # in SI units, of lengths or angles
_FRICTION = "slides", "slip", "force"
_POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")

ColumnReader = Callable[[Message], tuple[tuple[str, ...], Array]]  # names and values of the columns of a message


def requested_readers(recording: Recording) -> Mapping[str, ColumnReader]:
    """Return functions that read the messages of a run that were recorded on request, by topic."""
    found: dict[str, ColumnReader] = {}
    posed = any(topic.type == POSE for topic in recording.topics.values())
    parts = names_by_topic(recording.mechanism.parts) if posed and recording.mechanism else {}
    for name, topic in recording.topics.items():
        *_, folder, last = ("", *name.split("/"))
        if topic.type == REACTIONS and last == "joint_reactions":
            found[name] = lambda message: _reactions(recording.decoded(message))
        elif topic.type == REACTIONS and last == "contact_forces":
            found[name] = lambda message: _contact_forces(recording.decoded(message))
        elif topic.type == cdr.JOINT_STATE and last == "contact_states":
            found[name] = lambda message: _contact_states(cdr.joint_states(message.payload))
        elif topic.type == POSE and folder == "poses":
            found[name] = partial(_pose, recording, parts.get(last, last))
        elif topic.type == cdr.MULTI_ARRAY and last == "constraint_violation":
            found[name] = lambda message: _violation(recording.decoded(message))
    return found


def _reactions(message: Any) -> tuple[tuple[str, ...], Array]:
    wrenches = [(wrench.force, wrench.torque) for wrench in message.wrench]
    names = tuple(f"{REACTION}{joint}.{column}" for joint in message.joint_names for column in _WRENCH)
    return names, np.array([[v.x, v.y, v.z] for wrench in wrenches for v in wrench]).reshape(-1)


def _contact_forces(message: Any) -> tuple[tuple[str, ...], Array]:
    names = tuple(f"{CONTACT}{contact}.{column}" for contact in message.joint_names for column in _AT_CONTACT)
    rows = []
    for transform, wrench in zip(message.transforms, message.wrench, strict=True):
        at, turned, force = transform.translation, transform.rotation, wrench.force
        normal = from_quaternion(np.array([turned.w, turned.x, turned.y, turned.z]))[:, 2]
        rows.append([at.x, at.y, at.z, *normal, force.x, force.y, force.z])
    return names, np.array(rows).reshape(-1)


def _contact_states(message: cdr.JointStates) -> tuple[tuple[str, ...], Array]:
    """The state of each contact, and for each direction of its friction whether it slides, its slip and its force."""
    names = tuple(
        f"{CONTACT}{contact}.{column}"
        for contact in message.names
        for column in (_FRICTION if ".friction" in contact else _STATE)
    )
    return names, np.stack([message.position, message.velocity, message.effort], axis=1).reshape(-1)


def _pose(recording: Recording, part: str, message: Message) -> tuple[tuple[str, ...], Array]:
    pose = recording.decoded(message).pose
    at, turned = pose.position, pose.orientation
    return tuple(f"pose.{part}.{column}" for column in _POSE), np.array(
        [at.x, at.y, at.z, turned.x, turned.y, turned.z, turned.w]
    )


def _violation(array: cdr.MultiArray) -> tuple[tuple[str, ...], Array]:
    return tuple(f"violation.{label}" for label in array.labels), array.values


ENERGY_NAMES = Energies._fields
Progress = Callable[[float], None]  # called with the completed fraction, from 0 to 1


class PlaybackError(MbdSimError):
    """A recording that does not contain the requested data."""


@dataclass(frozen=True, eq=False)
class RunTable:
    """A recording, one row (n,) for each state.

    `is_run` says whether `sim_node` recorded it. `times` are in s: those of the simulated clock in such runs, and since
    the first message elsewhere; `steps` count since the node started. `position`, `velocity` and `effort` (n, joints)
    are nan where a message has none; `units` are `rad`, `m`, or "" if unknown. `energies` (n, 7) are None if none are
    recorded. `requested` are the columns (n,) of what was recorded on request, by name and unit: reactions such as
    `reaction.elbow.force_x_N`, poses, and the violation of constraints. `sensors` are the measurements, each at its own
    times. `resets` are the rows at which the motion starts again.
    """

    path: Path
    is_run: bool
    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    times: Array
    steps: np.ndarray
    position: Array
    velocity: Array
    effort: Array
    energies: Array | None
    events: tuple[tuple[float, str], ...]
    requested: Mapping[str, Array] = field(default_factory=dict)
    sensors: Mapping[str, SensorTable] = field(default_factory=dict)
    resets: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    about: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.times)


@dataclass
class _Messages:
    """The messages of a recording that make up a table; `stamps` are log time in ns and sequence number of states."""

    stamps: list[tuple[int, int]] = field(default_factory=list)
    states: list[cdr.JointStates] = field(default_factory=list)
    energies: dict[int, Array] = field(default_factory=dict)  # by the number of their state
    requested: dict[int, list[tuple[tuple[str, ...], Array]]] = field(default_factory=dict)  # likewise
    events: list[tuple[int, str]] = field(default_factory=list)
    resets: list[int] = field(default_factory=list)  # numbers of the states that follow

    def add(self, recording: Recording, message: Message, role: TopicRole | None, *, is_state: bool) -> None:
        """Decode a message."""
        if is_state:
            self.stamps.append((message.time_ns, message.sequence))
            self.states.append(recording.decoded(message))
        elif role is TopicRole.ENERGIES:
            if self._is_of_last_state(message):
                self.energies[len(self.stamps) - 1] = cdr.multi_array(message.payload).values
        elif role is TopicRole.EVENTS:
            text = cdr.text(message.payload)
            self.events.append((message.time_ns, text))
            if parse_event(text).kind in RESTARTS:
                self.resets.append(len(self.stamps))

    def add_requested(self, message: Message, columns: tuple[str, ...], values: Array) -> None:
        """Add the numbers of a message that was recorded on request."""
        if self._is_of_last_state(message):
            self.requested.setdefault(len(self.stamps) - 1, []).append((columns, values))

    def _is_of_last_state(self, message: Message) -> bool:
        return bool(self.stamps) and self.stamps[-1] == (message.time_ns, message.sequence)

    def requested_columns(self) -> dict[str, Array]:
        """Return the columns (n,) of what was recorded on request, nan in states without it."""
        found: dict[str, Array] = {}
        for row, parts in self.requested.items():
            for columns, values in parts:
                for name, value in zip(columns, values.tolist(), strict=True):
                    if name not in found:
                        found[name] = np.full(len(self.states), np.nan)
                    found[name][row] = value
        return found

    def energy_table(self) -> Array | None:
        """Return the energies (n, 7), nan in states without them; None if there are none at all."""
        if not self.energies:
            return None
        table = np.full((len(self.states), len(ENERGY_NAMES)), np.nan)
        for row, values in self.energies.items():
            table[row] = values
        return table


def iterate_messages(recording: Recording, progress: Progress, notes: list[str]) -> Iterator[Message]:
    """Yield all messages in file order, as far as the files can be read; problems are added to `notes`."""
    notes += recording.problems
    blocks = recording.blocks
    for number, block in enumerate(blocks):
        progress(number / len(blocks))
        try:
            yield from block.load()
        except DamagedError as error:
            notes.append(f"{error.message}: everything after it is left out")
            break
    progress(1.0)


def read_table(recording: Recording, progress: Progress = lambda fraction: None) -> RunTable:
    """Read all states.

    :raises PlaybackError: there are no joint states.
    """
    is_run = bool(recording.about)
    state_topic = _state_topic(recording)
    roles = topic_roles(recording.topics) if is_run else {}
    notes: list[str] = []
    found = _Messages()
    readers, sensors = requested_readers(recording) if is_run else {}, SensorTables(recording) if is_run else None
    for message in iterate_messages(recording, progress, notes):
        found.add(recording, message, roles.get(message.topic), is_state=message.topic == state_topic)
        if (read := readers.get(message.topic)) is not None:
            found.add_requested(message, *read(message))
        if sensors is not None:
            sensors.add(message, found.stamps)
    states, stamps = found.states, found.stamps
    if not states:
        raise PlaybackError(f"{recording.path}: contains no joint states that can be read.")
    start_ns = 0 if is_run else stamps[0][0]
    names = tuple(dict.fromkeys(name for state in states for name in state.names))
    sequence = np.array([sequence for _, sequence in stamps], dtype=np.int64)
    return RunTable(
        path=recording.path,
        is_run=is_run,
        title=recording.about.get("mechanism", recording.path.stem),
        names=names,
        units=_units(recording, names),
        times=np.array([time_ns - start_ns for time_ns, _ in stamps]) * 1e-9,
        steps=np.unwrap(sequence, period=SEQUENCE_MODULUS),
        position=_by_name(names, [(state.names, state.position) for state in states]),
        velocity=_by_name(names, [(state.names, state.velocity) for state in states]),
        effort=_by_name(names, [(state.names, state.effort) for state in states]),
        energies=found.energy_table(),
        requested=found.requested_columns(),
        sensors={} if sensors is None else sensors.tables(start_ns),
        events=tuple(((time_ns - start_ns) * 1e-9, text) for time_ns, text in found.events),
        resets=tuple(row for row in found.resets if row < len(states)),
        notes=tuple(notes),
        about=dict(recording.about),
    )


def _state_topic(recording: Recording) -> str:
    """Return the topic with the role of joint states, or else the first one of their type."""
    candidates = [name for name, role in topic_roles(recording.topics).items() if role is TopicRole.JOINT_STATES]
    roles = topic_roles(recording.topics)
    candidates += [n for n, topic in recording.topics.items() if topic.type == cdr.JOINT_STATE and n not in roles]
    if not candidates:
        topics = listed(list(recording.topics)) if recording.topics else "none at all"
        raise PlaybackError(
            f"{recording.path}: contains no topic of joint states ({cdr.JOINT_STATE}). Its topics: {topics}."
        )
    return candidates[0]


def _units(recording: Recording, names: Sequence[str]) -> tuple[str, ...]:
    units = coordinate_units(recording.mechanism) if recording.mechanism else {}
    return tuple(units.get(name, "") for name in names)


def coordinate_units(mechanism: Mechanism) -> dict[str, str]:
    """The unit, `rad` or `m`, of each coordinate by its name, also of driven ones."""
    names = (*mechanism.coordinate_names, *mechanism.driven_names)
    return {name: "rad" if mechanism.coordinate(name).rotation else "m" for name in names}


def _by_name(names: tuple[str, ...], given: Iterable[tuple[tuple[str, ...], Array]]) -> Array:
    """Return an array (n, names) of rows that may have their own names; nan where a row has no value."""
    rows = list(given)
    if all(row_names == names and len(values) == len(names) for row_names, values in rows):
        return np.array([values for _, values in rows], dtype=float).reshape(len(rows), len(names))
    table = np.full((len(rows), len(names)), np.nan)
    columns = {name: column for column, name in enumerate(names)}
    for row, (row_names, values) in enumerate(rows):
        if len(values) == len(row_names):
            table[row, [columns[name] for name in row_names]] = values
    return table


SUFFIXES = (".csv", ".parquet", ".npz")
_POSITION_UNITS = {"rad": "rad", "m": "m", "": ""}
_VELOCITY_UNITS = {"rad": "rad_s", "m": "m_s", "": ""}
_EFFORT_UNITS = {"rad": "Nm", "m": "N", "": ""}
Columns = Mapping[str, Array | np.ndarray]


def columns(table: RunTable) -> dict[str, Array | np.ndarray]:
    """Return columns (n,) by name and unit, such as `elbow.velocity_rad_s`; empty columns are left out.

    Those of a sensor, such as `sensor.imu.specific_force_x_m_s2`, hold its last measurement that had arrived.
    """
    found: dict[str, Array | np.ndarray] = {"time_s": table.times}
    if table.is_run:
        found["step"] = table.steps
    for quantity, units, values in (
        ("position", _POSITION_UNITS, table.position),
        ("velocity", _VELOCITY_UNITS, table.velocity),
        ("effort", _EFFORT_UNITS, table.effort),
    ):
        for index, (name, unit) in enumerate(zip(table.names, table.units, strict=True)):
            if not np.all(np.isnan(values[:, index])):
                suffix = f"_{units[unit]}" if units[unit] else ""
                found[f"{name}.{quantity}{suffix}"] = values[:, index]
    if table.energies is not None:
        found |= {f"energy.{name}_J": table.energies[:, index] for index, name in enumerate(ENERGY_NAMES)}
    for sensor, measured in table.sensors.items():
        held = measured.held(len(table), table.resets)
        found |= {f"sensor.{sensor}.{name}": column for name, column in held.items()}
    return found | dict(table.requested)


def require_suffix(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse a file that cannot be written, before anything is read or computed for it.

    :raises InputError: it has another suffix, or its folder does not exist.
    """
    if path.suffix not in suffixes:
        raise InputError(f"{path}: this file format is not supported", f"Choose one of {', '.join(suffixes)}.")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}", "Create it, or choose another file.")


def require_table(path: Path | None, *others: str) -> None:
    """Refuse a table that cannot be written, before anything is computed for it.

    :param others: further suffixes that are accepted.
    :raises InputError: it has another suffix, or its folder does not exist.
    :raises MissingPackageError: it is a Parquet file, and PyArrow is not installed.
    """
    if path is not None:
        require_suffix(path, (*others, *SUFFIXES))
        if path.suffix == ".parquet":
            require_packages("pyarrow", purpose="A Parquet file", otherwise="or choose a .csv or .npz file.")


def export(path: Path, table: RunTable) -> int:
    """Write the columns and return their number. Parquet and NumPy files also contain the description of the run.

    :raises MbdSimError: the file cannot be written, or its format needs a package that is not installed.
    """
    found = columns(table)
    about = {**table.about, "recording": str(table.path), "events": json.dumps(table.events)}
    write_columns(path, found, about)
    return len(found)


def write_columns(path: Path, found: Columns, about: Mapping[str, str]) -> None:
    """Write columns (n,) by name; Parquet and NumPy files also contain the description `about`.

    :raises MbdSimError: the file cannot be written, or its format needs a package that is not installed.
    """
    require_table(path)
    try:
        if path.suffix == ".npz":
            np.savez_compressed(path, about=json.dumps(about), **found)  # type: ignore[arg-type]
        elif path.suffix == ".csv":
            _write_csv(path, found)
        else:
            _write_parquet(path, found, about)
    except OSError as error:
        raise MbdSimError(f"{path} cannot be written: {cause_of(error)}") from error


def _write_csv(path: Path, found: Columns) -> None:
    """Write each number with the fewest digits from which it is read back exactly."""
    lists = [column.tolist() for column in found.values()]
    with path.open("w", encoding="utf-8", newline="") as stream:
        stream.write(",".join(_quoted(name) for name in found) + "\n")
        for row in zip(*lists, strict=True):
            stream.write(",".join(map(_field, row)) + "\n")


def _field(value: object) -> str:
    return _quoted(value) if isinstance(value, str) else "" if value != value else repr(value)  # nan: empty


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n') else name


def _write_parquet(path: Path, found: Columns, about: Mapping[str, str]) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    pyarrow.parquet.write_table(pa.table(dict(found)).replace_schema_metadata(dict(about)), str(path))
