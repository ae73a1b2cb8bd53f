"""What an agent observes of a mechanism, and the efforts that it can apply: the same for one environment and many.

The actions are the commands of actuators and drives, with their names and their ranges.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, SupportsFloat

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from mbd_sim.base.errors import CommandError, InputError, listed, nearest, quoted, require_each_once
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.contents import action_bounds, channel_names
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.arguments import positive_count

Limit = float | Sequence[float]  # the largest absolute value, or the bounds


class CommandNames:
    """The commands of a mechanism by their names, with their ranges `bounds`, and the actuators and drives `first`.

    `channels` are their full names, in order.
    """

    def __init__(self, mechanism: Mechanism, limits: Mapping[str, Limit]) -> None:
        """:param limits: replace the bounds of some commands, by name.

        :raises InputError: an unknown name, or limits that are no numbers, or in the wrong order.
        """
        self.channels = channel_names(mechanism.commanded)
        self._index = {name: index for index, name in enumerate(self.channels)}
        self.first = tuple(taker.name for taker in mechanism.commanded)
        for taker in mechanism.commanded:
            self._index[taker.name] = self._index[f"{taker.name}.{taker.channels[0]}"]
        self.bounds = [bounds for taker in mechanism.commanded for bounds in action_bounds(mechanism, taker)]
        for name, limit in limits.items():
            if (place := self.get(name)) is None:
                raise InputError(f"there is no command '{name}'", nearest(name, self.names))
            try:
                lower, upper = (-float(limit), float(limit)) if isinstance(limit, SupportsFloat) else map(float, limit)
            except (TypeError, ValueError):
                lower, upper = math.nan, math.nan
            if not lower <= upper:
                remedy = "Give the largest absolute value, or a pair of bounds."
                raise InputError(f"the limit of the command {name} is {quoted(limit)}", remedy)
            self.bounds[place] = lower, upper

    @property
    def names(self) -> list[str]:
        """All names: `actuator.channel`, and `actuator` for its first channel."""
        return list(self._index)

    def get(self, name: str) -> int | None:
        """The index of a command; None if there is none of this name."""
        return self._index.get(name)


EFFORTS = "efforts."  # before the name of a coordinate, where an actuator has this name too


class AgentInterface:
    """Actions and observations of a mechanism, with their spaces.

    An action is an effort (N or N·m) for each `actuated` coordinate, within its limit, or the command of an actuator or
    a drive, in the unit of its channel and within its range. An observation is (q without
    angles, cos of angles, sin of angles, u), in SI units.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        model: Model,
        limits: Array,
        actuated: Sequence[str] | None = None,
        trigonometric: bool = True,
        command_limits: Mapping[str, Limit] | None = None,
    ) -> None:
        """Find what is actuated, by default the first command of each actuator, or all coordinates; and the angles.

        :param limits: (nv,) the largest absolute efforts in N or N·m.
        :param trigonometric: observe cos and sin of angles instead of the angles.
        :param command_limits: the largest absolute commands, or pairs of bounds, by actuator or `actuator.channel`.
        :raises ValueError: an unknown name, one that is given twice, or an effort or a command without a limit.
        """
        if isinstance(actuated, str):
            raise InputError(f"actuated is the text {quoted(actuated)}", f"Give a list of names: {[actuated]}.")
        commands = CommandNames(mechanism, command_limits or {})
        names, default = model.coordinate_names, commands.first or model.coordinate_names
        self.actuated = tuple(default if actuated is None else actuated)
        places = [_place(name, names, commands) for name in self.actuated]
        channels = commands.channels
        full = [names[place] if kind == "effort" else channels[place] for kind, place in places]
        require_each_once(full, "Each coordinate has one effort, and each actuator one command.")
        self._count = len(names)
        efforts = [(index, place) for index, (kind, place) in enumerate(places) if kind == "effort"]
        self._sources_of_efforts, self._places = (_places([pair[k] for pair in efforts]) for k in (0, 1))
        taken = [(index, place) for index, (kind, place) in enumerate(places) if kind == "command"]
        self._sources_of_commands, self._channels = (_places([pair[k] for pair in taken]) for k in (0, 1))
        self.has_commands, self.has_efforts = bool(taken), bool(efforts)
        ranges = [
            (-limits[place], limits[place]) if kind == "effort" else commands.bounds[place] for kind, place in places
        ]
        self.action_space = _action_space(self.actuated, np.array(ranges, dtype=np.float32).reshape(-1, 2))
        angles = _angles(mechanism, model) if trigonometric else np.zeros(model.layout.nq, bool)
        self._others, self._angles = np.flatnonzero(~angles), np.flatnonzero(angles)
        self._least, self._most = (bound.astype(float) for bound in (self.action_space.low, self.action_space.high))
        self._cosines = slice(self._others.size, self._others.size + self._angles.size)
        self._sines = slice(self._cosines.stop, self._cosines.stop + self._angles.size)
        state = np.arange(model.start.size)
        q, u = state[model.q_range], state[model.u_range]
        self._sources = np.concatenate([q[self._others], q[self._angles], q[self._angles], u])
        bounds = np.full(self._sines.stop + model.layout.nv, np.inf)
        bounds[self._cosines] = bounds[self._sines] = 1.0
        self.observation_space = spaces.Box(-bounds, bounds, dtype=np.float64)

    def observation(self, y: Array) -> Array:
        """The observation (n,) of one state y, in a new array, with the same bits as in `observations`."""
        found: Array = np.asarray(y).take(self._sources)
        if self._angles.size:
            cosines, sines = found[self._cosines], found[self._sines]
            np.cos(cosines, cosines)
            np.sin(sines, sines)
        return found

    def observations(self, q: Array, u: Array) -> Array:
        """The observations (k, n) of k states with the coordinates q (k, nq) and speeds u (k, nv)."""
        found = np.empty((len(q), self._sines.stop + u.shape[1]))
        found[:, : self._cosines.start] = q[:, self._others]
        angles = q[:, self._angles]
        found[:, self._cosines], found[:, self._sines] = np.cos(angles), np.sin(angles)
        found[:, self._sines.stop :] = u
        return found

    def efforts(self, action: Any, members: tuple[int, ...] = ()) -> Array:
        """The efforts (nv,) of an action (actuated,), clipped to the limits.

        :param members: () for one environment, (k,) for k of them: the same axis comes first in action and efforts.
        :raises CommandError: the action has another shape.
        """
        efforts = np.zeros((*members, self._count))
        if self.has_efforts:
            efforts[..., self._places] = self._clipped(action, members)[..., self._sources_of_efforts]
        return efforts

    def commands(self, action: Any, current: Array) -> Array:
        """All commands (…, n) of an action (…, actuated), clipped to the limits; other channels stay as in `current`.

        :raises CommandError: the action has another shape.
        """
        commands = current.copy()
        commands[..., self._channels] = self._clipped(action, current.shape[:-1])[..., self._sources_of_commands]
        return commands

    def _clipped(self, action: Any, members: tuple[int, ...]) -> Array:
        values = np.asarray(action, dtype=float)
        if values.shape != (*members, len(self.actuated)):
            raise CommandError(
                f"the action has the shape {values.shape}",
                (
                    f"Give one number for each of: {listed(self.actuated)}"
                    f"{f', in {members[0]} rows' if members else ''}."
                ),
            )
        return np.asarray(np.minimum(np.maximum(values, self._least), self._most))


def _place(name: str, coordinates: Sequence[str], commands: CommandNames) -> tuple[str, int]:
    """Whether a name is that of an effort or of a command, and its index among these.

    :raises ValueError: it is neither, or both.
    """
    coordinate = name.removeprefix(EFFORTS)
    command = None if name.startswith(EFFORTS) else commands.get(name)
    if coordinate not in coordinates and command is None:
        raise ValueError(f"there is no coordinate '{name}'. {nearest(name, [*coordinates, *commands.names])}")
    if command is None:
        return "effort", list(coordinates).index(coordinate)
    if coordinate in coordinates:
        channel = commands.channels[command]
        message = f"'{name}' is a coordinate and an actuator"
        raise InputError(message, f"Write '{channel}' for its command, or '{EFFORTS}{name}' for an effort.")
    return "command", command


def _action_space(names: Sequence[str], bounds: NDArray[np.float32]) -> spaces.Box:
    """The space of actions within bounds (n, 2).

    :raises ValueError: a bound is infinite.
    """
    if unlimited := [name for name, pair in zip(names, bounds, strict=True) if not np.all(np.isfinite(pair))]:
        raise InputError(
            f"the effort or command of {listed(unlimited)} has no limit",
            "Give joints an 'effort_limit' and motors their limits, or the environment 'effort_limits' or "
            "'command_limits'.",
        )
    return spaces.Box(*bounds.T, dtype=np.float32)


def with_limits(names: Sequence[str], limits: Array, given: Mapping[str, float]) -> Array:
    """The limits (…, nv) of efforts, of which the given ones replace those of their coordinates.

    :raises ValueError: an unknown coordinate, or a limit that is negative or not a number.
    """
    require_coordinates(names, given)
    limits = limits.copy()
    for name, limit in given.items():
        if not (isinstance(limit, SupportsFloat) and float(limit) >= 0.0):
            raise InputError(f"the effort limit of {name} is {quoted(limit)}", "Give a number in N or N·m.")
        limits[..., names.index(name)] = limit
    return limits


def require_coordinates(names: Sequence[str], given: Sequence[str] | Mapping[str, Any]) -> None:
    """Refuse names of coordinates that do not exist.

    :raises ValueError: it suggests the nearest one.
    """
    for name in given:
        if name not in names:
            raise ValueError(f"there is no coordinate '{name}'. {nearest(name, names)}")


def require_episodes(start: Mapping[str, Any] | None, noise: float, frame_skip: int, horizon: int | None) -> None:
    """Refuse settings of episodes that cannot be used: see `MechanismEnv`.

    :raises ValueError: a name in `start` is neither q nor u, or a number is negative, or not whole.
    """
    require_starts(start or {})
    positive_count(frame_skip, "frame_skip")
    if horizon is not None:
        positive_count(horizon, "the number of actions of an episode")
    if not 0.0 <= noise < math.inf:
        raise InputError(f"start_noise is {quoted(noise)}", "Give 0 or a positive number.")


def require_starts(given: Collection[str], others: Sequence[str] = ()) -> None:
    """Refuse what is given for the start of an episode besides q, u and `others`.

    :raises ValueError: it names the first one.
    """
    valid = ("q", "u", *others)
    for name in given:
        if name not in valid:
            raise InputError(f"an episode does not start from {quoted(name)}", f"Valid: {listed(valid)}.")


def _places(indices: Sequence[int]) -> slice | NDArray[np.intp]:
    """Indices as a slice, which NumPy follows faster, if each is one more than that before."""
    found = np.array(indices, dtype=np.intp)
    return slice(indices[0], indices[-1] + 1) if found.size and np.all(np.diff(found) == 1) else found


def _angles(mechanism: Mechanism, model: Model) -> NDArray[np.bool_]:
    """Which of the coordinates q (nq,) are angles."""
    angles = np.zeros(model.layout.nq, dtype=bool)
    for name, joint in mechanism.joints.items():
        if not joint.drive and joint.kind.quaternion is None:
            angles[model.layout.q[name]] = [coordinate.rotation for coordinate in joint.kind.coordinates]
    return angles
