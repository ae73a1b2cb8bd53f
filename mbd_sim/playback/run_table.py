"""A recording as arrays: joints, energies and events over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mbd_sim.errors import MbdSimError, MechanismError, listed
from mbd_sim.geometry.pose import Array
from mbd_sim.load import parse_mechanism
from mbd_sim.recording import cdr
from mbd_sim.recording.contents import DamagedError, Message
from mbd_sim.recording.reader import Recording
from mbd_sim.recording.recomputation import (
    ENERGIES,
    EVENTS,
    ROLES,
    STATES,
    roles,
)
from mbd_sim.simulation.events import EventKind, parse_event
from mbd_sim.viewer import entity_paths

ENERGY_NAMES = ("kinetic", "potential", "dissipated", "work_applied", "work_drives", "total", "residual")
Progress = Callable[[float], None]  # hears the part that is done, from 0 to 1


class PlaybackError(MbdSimError):
    """A recording that does not hold what is asked for."""


@dataclass(frozen=True, eq=False)
class RunTable:
    """A recorded run, one row (n,) for each state.

    `times` are in s: of the simulated clock in runs of ours, and since the first message elsewhere; `steps` count since
    the node started. `position`, `velocity` and `effort` (n, joints) are nan where a message had none; `units` are
    `rad`, `m`, or "" where that is not known. `energies` (n, 7) are None where none are recorded. `resets` are the rows
    at which the motion begins anew.
    """

    path: Path
    own: bool
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
    resets: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    about: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.times)


def each(recording: Recording, progress: Progress, notes: list[str]) -> Iterator[Message]:
    """All messages in file order, as far as the files can be read; why not further is added to `notes`."""
    notes += recording.problems
    blocks = recording.blocks
    for number, block in enumerate(blocks):
        progress(number / len(blocks))
        try:
            yield from block.load()
        except DamagedError as error:
            notes.append(f"{error}: what is behind it is left out")
            break
    progress(1.0)


def read_table(recording: Recording, progress: Progress = lambda done: None) -> RunTable:
    """Read all states.

    :raises PlaybackError: it holds no joint states.
    """
    own = bool(recording.about)
    topic, known = _states_topic(recording), roles(recording.topics)
    stamps: list[tuple[int, int]] = []
    states: list[cdr.JointStates] = []
    audit: dict[int, Array] = {}
    events: list[tuple[int, str]] = []
    resets: list[int] = []
    notes: list[str] = []
    for message in each(recording, progress, notes):
        if message.topic == topic:
            stamps.append((message.time_ns, message.sequence))
            states.append(recording.decoded(message))
        elif not own:
            continue
        elif known.get(message.topic) == ENERGIES:
            if stamps and stamps[-1] == (message.time_ns, message.sequence):
                audit[len(stamps) - 1] = cdr.numbers(message.payload).values
        elif known.get(message.topic) == EVENTS:
            events.append((message.time_ns, cdr.text(message.payload)))
            if parse_event(events[-1][1]).kind is EventKind.RESET:
                resets.append(len(stamps))
    if not states:
        raise PlaybackError(f"{recording.path}: holds no joint states that can be read.")
    start = 0 if own else stamps[0][0]
    names = tuple(dict.fromkeys(name for state in states for name in state.names))
    energies = None
    if audit:
        energies = np.full((len(states), len(ENERGY_NAMES)), np.nan)
        for row, values in audit.items():
            energies[row] = values
    return RunTable(
        path=recording.path,
        own=own,
        title=recording.about.get("mechanism", recording.path.stem),
        names=names,
        units=_units(recording, names),
        times=np.array([time_ns - start for time_ns, _ in stamps]) * 1e-9,
        steps=np.unwrap(np.array([sequence for _, sequence in stamps], dtype=np.int64), period=1 << 32),
        position=_filled(names, [(state.names, state.position) for state in states]),
        velocity=_filled(names, [(state.names, state.velocity) for state in states]),
        effort=_filled(names, [(state.names, state.effort) for state in states]),
        energies=energies,
        events=tuple(((time_ns - start) * 1e-9, text) for time_ns, text in events),
        resets=tuple(row for row in resets if row < len(states)),
        notes=tuple(notes),
        about=dict(recording.about),
    )


def _states_topic(recording: Recording) -> str:
    found = roles(recording.topics)
    named = [name for name, role in found.items() if role == STATES]
    named += [name for name, topic in recording.topics.items() if topic.type == ROLES[STATES] and name not in named]
    if not named:
        there = listed(list(recording.topics)) if recording.topics else "none at all"
        raise PlaybackError(f"{recording.path}: holds no topic of joint states ({ROLES[STATES]}). Its topics: {there}.")
    return named[0]


def _units(recording: Recording, names: Sequence[str]) -> tuple[str, ...]:
    if recording.mechanism_text is None:
        return ("",) * len(names)
    try:
        mechanism = parse_mechanism(recording.mechanism_text, str(recording.path))
    except MechanismError:
        return ("",) * len(names)
    labels = [*mechanism.coordinate_names, *mechanism.driven_names]
    kinds = [*entity_paths.free_kinds(mechanism), *entity_paths.driven_kinds(mechanism)]
    units = {label: "rad" if kind == entity_paths.ANGULAR else "m" for label, kind in zip(labels, kinds, strict=True)}
    return tuple(units.get(name, "") for name in names)


def _filled(names: tuple[str, ...], given: Iterable[tuple[tuple[str, ...], Array]]) -> Array:
    """(n, names): values where they belong, nan where a message has none."""
    rows = list(given)
    if all(owners == names and len(values) == len(names) for owners, values in rows):
        return np.array([values for _, values in rows], dtype=float).reshape(len(rows), len(names))
    found = np.full((len(rows), len(names)), np.nan)
    place = {name: column for column, name in enumerate(names)}
    for row, (owners, values) in enumerate(rows):
        if len(values) == len(owners):
            found[row, [place[name] for name in owners]] = values
    return found
