"""Commands by name, of actuators, of the efforts of joints and of wrenches on parts: each is checked as a whole.

Efforts are clamped to the effort limits of the joints where they take effect, and nowhere else: by `EffortMap.clamped`,
and by compiled code that does the same for arrays, lists and tuples that need no error message: see `bounded_writer`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mbd_sim.base.errors import CommandError, counted, listed, nearest, printable, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.contents import commanded_drives, led_by_drives
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.layouts.vectors import InputLayout
    from mbd_sim.mechanism.elements.actuators import Actuator
    from mbd_sim.mechanism.elements.joint_types import CommandedDrive


Command = float | Mapping[Channel, float]
MemberCommand = float | Array | Mapping[Channel, float | Array]  # for all members of an ensemble, or (k,)
Efforts = Mapping[str, float] | Sequence[float] | Array  # some by name, or all in order


class CommandMap:
    """The commands of actuators and drives, one number for each channel; `names` are `actuator.channel`, in order.

    A command in N, N·m, rad, m, rad/s, m/s, V or A acts on the first channel of an actuator, or on those that it names.
    A drive has the name of its joint.
    """

    __repr__ = short_repr

    def __init__(self, takers: Sequence[Actuator | CommandedDrive], layout: InputLayout) -> None:
        self.takers, self.range = {taker.name: taker for taker in takers}, layout.commands
        channels = [(taker.name, channel) for taker in takers for channel in taker.channels]
        self.names = tuple(f"{name}.{channel}" for name, channel in channels)
        self._index = {key: index for index, key in enumerate(channels)}

    def merged(self, current: Array, commands: Mapping[str, Command]) -> Array:
        """All commands (n,) after new ones; those that they do not name stay as in `current`.

        :raises CommandError: an unknown actuator or channel, or a value that is not a finite number.
        """
        merged = current.copy()
        for index, value in self._given(commands):
            merged[index] = _finite(self.names[index], value)
        return merged

    def merged_rows(
        self, current: Array, commands: Array | Mapping[str, MemberCommand] | Sequence[Mapping[str, Command]]
    ) -> Array:
        """All commands (k, n) of k members after new ones, see `Ensemble.set_commands`.

        :raises CommandError: see `merged`; or the commands do not fit the members.
        """
        count, size = current.shape
        if isinstance(commands, Mapping):
            merged = current.copy()
            for index, value in self._given(commands):
                merged[:, index] = _rows(f"commands of {self.names[index]}", value, (count,))
            return merged
        if not isinstance(commands, np.ndarray) and any(isinstance(one, Mapping) for one in commands):
            if len(commands) != count:
                counts = f"{counted(len(commands), 'command')} for {counted(count, 'member')}"
                raise CommandError(counts, "Give one mapping for each.")
            pairs = zip(current, commands, strict=True)
            return np.array([self.merged(row, given) for row, given in pairs]).reshape(count, size)
        return _rows(f"commands of {counted(size, 'channel')} ({listed(self.names)})", commands, (count, size))

    def _given(self, commands: Mapping[str, Any]) -> Iterator[tuple[int, Any]]:
        """The index and the value of each command.

        :raises CommandError: an unknown actuator or channel.
        """
        for name, given in commands.items():
            if name not in self.takers:
                remedy = nearest(name, self.takers) if self.takers else "This mechanism has no actuators."
                raise CommandError(f"there is no actuator '{name}'", remedy)
            channels = self.takers[name].channels
            for channel, value in (given if isinstance(given, Mapping) else {channels[0]: given}).items():
                if (name, channel) not in self._index:
                    remedy = f"Command its {listed(list(channels))}."
                    raise CommandError(f"actuator '{name}' takes no {channel}", remedy)
                yield self._index[name, channel], value

    def checked(self, labels: Sequence[str], values: Array) -> Array:
        """All commands (n,), as a recording has them.

        :raises CommandError: the labels are those of other actuators, or a value is not finite.
        """
        if tuple(labels) != self.names or len(values) != len(self.names) or not np.all(np.isfinite(values)):
            raise CommandError(f"the commands do not fit: one finite number is needed for {listed(list(self.names))}")
        return values


def _rows(what: str, value: object, shape: tuple[int, ...]) -> Array:
    """Finite numbers of a shape, of which fewer are repeated for all members."""
    try:
        if isinstance(value, str | bytes):
            raise TypeError(f"{quoted(value)} is a text")
        rows = np.broadcast_to(np.asarray(value, dtype=float), shape)
    except (TypeError, ValueError) as error:
        counts = f"the {what} do not fit {counted(shape[0], 'member')}: {error}"
        raise CommandError(counts, "Give numbers for all of them, or one for each.") from error
    if not np.all(np.isfinite(rows)):
        raise CommandError(f"one of the {what} is not finite", "Give finite numbers.")
    return rows


def number_of(name: str, value: Any) -> float:
    """A number that a caller gives for what has a name, such as `command of elbow`; it need not be finite.

    :raises CommandError: it is none.
    """
    try:
        if isinstance(value, str | bytes):
            raise TypeError(f"{quoted(value)} is a text")
        return float(value)
    except (TypeError, ValueError) as error:
        raise CommandError(f"the {name} is not a number ({error})", "Give a number.") from error


def by_name(values: Any, what: str) -> Mapping[str, Any]:
    """Values that must be given by name.

    :param what: they are, for the error.
    :raises CommandError: they are in another form, such as a list.
    """
    if not isinstance(values, Mapping):
        raise CommandError(f"the {what} are not given by name: {quoted(values)}", "Give them as {name: value, …}.")
    return values


def _finite(name: str, value: Any) -> float:
    number = number_of(f"command of {name}", value)
    if not math.isfinite(number):
        raise CommandError(f"the command of {name} is not finite", "Give a finite number.")
    return number


class UnknownJointError(CommandError):
    """A command for a joint that does not exist. The nearest name is searched only when the text is needed."""

    def __init__(self, name: str, valid: Iterable[str]) -> None:
        super().__init__(f"there is no joint '{name}'")
        self.name, self._valid = name, valid

    def __str__(self) -> str:
        remedy = nearest(self.name, self._valid) or "No joint of this mechanism takes commands."
        return printable(f"{self.message}. {remedy}")


class EffortMap:
    """Commands by order or by name, as one effort (N or N·m) for each degree of freedom.

    `limits` are the largest absolute values of those that act: (nv,), or (k, nv) for the members of an ensemble.
    """

    __repr__ = short_repr

    def __init__(
        self,
        names: Sequence[str],
        limits: Array,
        driven: Sequence[str] = (),
        commanded: Mapping[str, CommandedDrive] | None = None,
        led: Mapping[str, str] | None = None,
    ) -> None:
        """Efforts of `names` up to `limits`; `driven` coordinates take none, of which some are `commanded`.

        :param led: coordinates that follow driven ones, see `led_by_drives`.
        """
        self._led = led or {}
        self.names, self._driven, self._commanded = tuple(names), dict.fromkeys(driven), commanded or {}
        self._index = {name: index for index, name in enumerate(self.names)}
        self.limits = np.array(limits, dtype=float)

    @classmethod
    def of(cls, mechanism: Mechanism, limits: Array) -> EffortMap:
        """That of the coordinates of a mechanism."""
        drives, led = commanded_drives(mechanism), led_by_drives(mechanism)
        return cls(mechanism.coordinate_names, limits, mechanism.driven_names, drives, led)

    def limit(self, limits: Array) -> None:
        """Set the largest absolute values from now on, in place: compiled code reads them."""
        self.limits[:] = limits

    def merged(self, current: Array, efforts: Efforts) -> Array:
        """The efforts (nv,) after a command; those that it does not name stay as in `current`.

        :raises CommandError: wrong length, an unknown name, or a value that is not a finite number.
        """
        merged = current.copy()
        try:
            given = efforts.values() if isinstance(efforts, Mapping) else efforts
            if texts := [value for value in given if isinstance(value, str | bytes)]:
                raise TypeError(f"{quoted(texts[0])} is a text")
            if isinstance(efforts, Mapping):
                for name, value in efforts.items():
                    merged[self._index_of(name)] = value
            elif len(efforts) != len(self.names):
                raise CommandError(
                    f"{counted(len(self.names), 'effort')} expected, but {len(efforts)} given",
                    f"Give one for each of: {listed(self.names)}.",
                )
            else:
                merged[:] = efforts
        except (TypeError, ValueError) as error:
            if isinstance(error, CommandError):
                raise
            raise CommandError(f"an effort is not a number ({error})", "Give numbers.") from error
        if not np.all(np.isfinite(merged)):
            bad = [name for name, value in zip(self.names, merged, strict=True) if not math.isfinite(value)]
            raise CommandError(f"the effort of {listed(bad)} is not finite", "Give finite numbers.")
        return merged

    def merged_rows(self, current: Array, efforts: Array | Mapping[str, float | Array]) -> Array:
        """The efforts (k, nv) of k members after a command, see `Ensemble.set_efforts`.

        :raises CommandError: see `merged`; or the efforts do not fit the members.
        """
        if not isinstance(efforts, Mapping):
            return _rows(f"efforts of {counted(len(self.names), 'joint')}", efforts, current.shape)
        merged = current.copy()
        for name, value in efforts.items():
            merged[:, self._index_of(name)] = _rows(f"efforts of {name}", value, (len(current),))
        return merged

    def clamped(self, efforts: Array) -> Array:
        """The efforts within the effort limits of the joints."""
        clamped: Array = np.copysign(np.minimum(np.abs(efforts), self.limits), efforts)
        return clamped

    def excess(self, efforts: Array) -> str:
        """The first of the efforts (nv,) that `clamped` reduces, in words; empty if it reduces none."""
        beyond = np.flatnonzero(np.abs(efforts) > self.limits)
        if not len(beyond):
            return ""
        index = beyond[0]
        return f"the effort {efforts[index]:.6g} of '{self.names[index]}' is beyond {self.limits[index]:.6g}"

    def require(self, name: str) -> None:
        """Check that a joint exists and is not driven.

        :raises CommandError: it does not exist, or is driven.
        """
        self._index_of(name)

    def require_leading(self, name: str) -> None:
        """Refuse a joint that follows a driven one, whose motion no command of its own can change.

        :raises CommandError: it follows one.
        """
        if (leader := self._led.get(name)) is not None:
            remedy = f"Command {leader}." if leader in self._commanded or leader in self._led else ""
            raise CommandError(f"joint '{name}' follows '{leader}', so that it takes no commands", remedy)

    def _index_of(self, name: str) -> int:
        if name in self._driven:
            drive = self._commanded.get(name)
            remedy = f"Command its {listed(list(drive.channels))}." if drive else "Command another joint."
            raise CommandError(
                f"joint '{name}' is driven: its drive prescribes the motion, so it accepts no effort", remedy
            )
        if name not in self._index:
            raise UnknownJointError(name, (*self.names, *self._driven))
        return self._index[name]


AXES = ("ground", "part")


def require_parts(names: Sequence[str], mechanism: Mechanism) -> None:
    """Refuse parts that do not exist.

    :raises CommandError: with the nearest name.
    """
    for name in names:
        if name not in mechanism.parts:
            raise CommandError(f"there is no part '{name}'", nearest(name, mechanism.parts))


class WrenchMap:
    """Wrenches on the loaded parts of a mechanism, as inputs of its equations."""

    __repr__ = short_repr

    def __init__(self, mechanism: Mechanism, layout: InputLayout) -> None:
        self._parts, self._layout = mechanism.parts, layout

    @property
    def slices(self) -> Mapping[str, slice]:
        """The slice of the inputs that holds the wrench on each loaded part."""
        return self._layout.wrenches

    def numbers(
        self,
        part: str,
        force: Sequence[float] | Array,
        couple: Sequence[float] | Array,
        at: str | Sequence[float] | Array | None,
        axes: str,
    ) -> Array:
        """The inputs (15,) of a wrench on a part, see `ExternalWrench`; for the arguments see `Simulation.set_wrench`.

        :raises CommandError: the part takes no wrench, a point or axes do not exist, or a vector is not three finite
            numbers.
        """
        if part not in self.slices:
            raise self._unknown(part)
        if axes not in AXES:
            raise CommandError(f"the axes of a wrench are 'ground' or 'part', not {axes!r}")
        wrench = np.concatenate([_vector(force, "force"), _vector(couple, "couple")])
        in_ground, in_part = (wrench, np.zeros(6)) if axes == "ground" else (np.zeros(6), wrench)
        return np.concatenate([in_ground, in_part, self._point(part, at)])

    def _point(self, part: str, at: str | Sequence[float] | Array | None) -> Array:
        record = self._parts[part]
        if at is None:
            return record.center
        if not isinstance(at, str):
            return _vector(at, "point")
        if at not in record.points:
            raise CommandError(f"part '{part}' has no point '{at}'", nearest(at, record.points))
        return record.points[at].position

    def _unknown(self, part: str) -> CommandError:
        if part in self._parts:
            remedy = f"Build the simulation with wrenches=['{part}']."
            return CommandError(f"part '{part}' does not accept wrenches", remedy)
        return CommandError(f"there is no part '{part}'", nearest(part, self._parts))


def _vector(values: Sequence[float] | Array, name: str) -> Array:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise CommandError(f"the {name} is not three numbers ({error})") from error
    if array.shape != (3,):
        raise CommandError(f"the {name} has the shape {array.shape}", "Give three numbers.")
    if not np.all(np.isfinite(array)):
        raise CommandError(f"the {name} contains a number that is not finite", "Give finite numbers.")
    return array


VECTORS = ("force", "couple", "own_force", "own_couple", "point")  # in the order of `ExternalWrench`


@dataclass(frozen=True, slots=True)
class PublishedWrench:
    """A force (3,) in N and a couple (3,) in N·m on a part, in the arguments of `Simulation.set_wrench`.

    `point` (3,) is in m in the part's frame; `axes` is "ground", or "part" for axes that turn with the part.
    """

    part: str
    force: Array
    couple: Array
    point: Array
    axes: str


def wrench_labels(part: str) -> tuple[str, ...]:
    """Return the labels of the numbers (15,) of a wrench on a part."""
    return tuple(f"{part}.{vector}.{axis}" for vector in VECTORS for axis in "xyz")


def parse_wrench(labels: Sequence[str], numbers: Array) -> PublishedWrench:
    """Return the wrench with these labels and numbers (15,).

    :raises ValueError: there are not 15 numbers.
    """
    part = labels[0].rsplit(".", 2)[0] if labels else ""
    force, couple, own_force, own_couple, point = numbers.reshape(len(VECTORS), 3)
    if np.any(own_force) or np.any(own_couple):
        return PublishedWrench(part, own_force, own_couple, point, "part")
    return PublishedWrench(part, force, couple, point, "ground")
