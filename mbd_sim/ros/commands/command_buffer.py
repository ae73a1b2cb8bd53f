"""Buffers the commands of a run from the topics until the next step, under a lock. Independent of ROS.

Efforts are kept here, and a watchdog ends them; commands of actuators, velocities of bases and trajectories are kept
in an `ActuatorBuffer`.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import CommandError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.layouts.vectors import InputLayout
from mbd_sim.mechanism.elements.actuators import Base, Velocity
from mbd_sim.mechanism.elements.joint_types import Channel
from mbd_sim.ros.commands.actuator_buffer import ActuatorBuffer
from mbd_sim.ros.commands.joint_commands import CommandRanges, JointCommandRouter
from mbd_sim.ros.commands.trajectory_player import JointCurve, Setpoint, Trajectory
from mbd_sim.simulation.model.commands import Command, CommandMap, EffortMap
from mbd_sim.simulation.run.simulation import BaseSimulation


@dataclass(frozen=True, slots=True)
class DueEfforts:
    """What takes effect at the next step: new `efforts` (nv,), or none where those of `expired` coordinates end."""

    efforts: Array | None = None
    expired: tuple[str, ...] = ()

    def apply(self, simulation: BaseSimulation) -> None:
        """Command these efforts from the next step on; the simulation reports what changes."""
        if self.efforts is not None:
            simulation.set_efforts(self.efforts)
        else:
            simulation.expire_efforts(self.expired)


@dataclass(frozen=True, slots=True)
class Followed:
    """A trajectory that is followed: its `number`, and its `start` in ns of the run.

    `curves` has, for each joint, the name of the actuator or drive that takes its positions, and its curve.
    """

    number: int
    start: int
    curves: Mapping[str, tuple[str, JointCurve]]

    def elapsed(self, now: int) -> float:
        """The time in s from the start to `now` in ns of the run."""
        return 1e-9 * (now - self.start)


class CommandBuffer:
    """Takes commands in one thread and passes the newest efforts to the stepping thread.

    A command is accepted or rejected as a whole. A coordinate for which none has arrived for `timeout` seconds of
    simulated time (0: no limit) gets the effort zero until the next command for it, whatever others are sent. An effort
    that is zero already does not expire.
    """

    def __init__(
        self,
        effort_map: EffortMap,
        timeout: float,
        actuators: CommandMap | None = None,
        step_size: float = 1e-3,
        ranges: CommandRanges | None = None,
    ) -> None:
        """A buffer for steps of `step_size` in s. With `ranges`, commands of actuators are clamped to them."""
        self.map, self.timeout = effort_map, timeout
        command_map = actuators or CommandMap((), InputLayout(len(effort_map.names)))
        self._actuators = ActuatorBuffer(command_map, step_size, ranges)
        self._router = JointCommandRouter(effort_map, list(self._actuators.map.takers.values()))
        self.accepted = self.rejected = self.expired = self._reduced = 0
        self._excess = ""  # an effort that has been reduced, in words
        size = len(effort_map.names)
        self._requested, self._new = np.zeros(size), False
        self._commanded, self._lapsed = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
        self._last_times, self._oldest = np.full(size, np.inf), np.inf  # of the coordinates that are watched
        self._bases: Mapping[str, Base] = {}  # those with live values that have changed
        self._lock = threading.Lock()

    @contextmanager
    def _taking(self) -> Iterator[None]:
        """Count a command as accepted, or as rejected where it does not fit; under the lock."""
        with self._lock:
            try:
                yield
            except CommandError:
                self.rejected += 1
                raise
            self.accepted += 1

    def keep_within(self, ranges: CommandRanges, bases: Sequence[Base]) -> None:
        """Clamp commands to other ranges from now on, and convert velocities as other bases of the same names do."""
        with self._lock:
            self._actuators.keep_within(ranges)
            self._bases = {base.name: base for base in bases}

    @property
    def limited(self) -> int:
        """How many efforts, commands of actuators and velocities of bases were beyond limits, and were reduced."""
        return self._actuators.limited + self._reduced

    def take_excess(self) -> str:
        """A command that has been reduced since the last call, in words; empty if none has."""
        with self._lock:
            found = self._actuators.excess or self._excess
            self._actuators.excess = self._excess = ""
            return found

    @property
    def lapsed(self) -> tuple[str, ...]:
        """The coordinates whose efforts are zero because commands for them stopped arriving."""
        return self._names_of(self._lapsed)

    def by_order(self, efforts: Sequence[float]) -> None:
        """Take efforts for all coordinates, in their order.

        :raises CommandError: rejected; nothing changes.
        """
        self._take(efforts)

    def by_name(
        self,
        names: Sequence[str],
        efforts: Sequence[float],
        positions: Sequence[float] = (),
        velocities: Sequence[float] = (),
    ) -> None:
        """Take commands for some coordinates, those of actuators included; the others keep theirs.

        :raises CommandError: rejected; nothing changes.
        """
        arrays: dict[Channel, Sequence[float]] = {"position": positions, "velocity": velocities, "effort": efforts}
        try:
            routed = self._router.route(names, arrays)
        except CommandError:
            self.rejected += 1
            raise
        self._take(routed.efforts, routed.actuators)

    def actuators_by_order(self, values: Sequence[float]) -> None:
        """Take commands for all channels of all actuators, in their order.

        :raises CommandError: rejected; nothing changes.
        """
        with self._taking():
            self._actuators.take(self._actuators.in_order(values), self._actuators.map.takers)

    def efforts_by_name(self, efforts: Mapping[str, float]) -> None:
        """Take efforts of some coordinates, besides what their actuators exert; the others keep theirs.

        :raises CommandError: rejected; nothing changes.
        """
        self._take(efforts)

    def actuators_by_name(self, commands: Mapping[str, Command]) -> None:
        """Take commands of some actuators and drives, as `Simulation.set_commands`; the others keep theirs.

        :raises CommandError: rejected; nothing changes.
        """
        with self._taking():
            self._actuators.take(self._actuators.merged(commands), commands)

    def renew(self, efforts: Mapping[str, float], commands: Mapping[str, float]) -> None:
        """Restart the watchdogs of efforts and of commands by channel that are still the newest, as if repeated."""
        with self._lock:
            pairs = zip(self.map.names, self._requested.tolist(), strict=True)
            kept = np.array([efforts.get(name) == effort for name, effort in pairs], dtype=bool)
            self._commanded |= kept
            self._new |= bool(np.any(kept))
            self._actuators.renew(commands)

    def overlay(self, inputs: Array, layout: InputLayout) -> Array:
        """The inputs of a run with the commands that take effect at its next step."""
        inputs = inputs.copy()
        with self._lock:
            if self._new:
                inputs[layout.efforts] = self.map.clamped(self._requested)
            inputs[layout.commands] = self._actuators.newest(inputs[layout.commands])
        return inputs

    def move(self, base: Base, linear: Sequence[float], angular: Sequence[float]) -> None:
        """Take a velocity of a base, (3,) in m/s and (3,) in rad/s; after `timeout` without another one, it stops.

        :raises CommandError: rejected; nothing changes.
        """
        with self._taking():
            commands = self._bases.get(base.name, base).commands(Velocity.of(linear, angular))
            self._actuators.take(self._actuators.merged(commands.takers), commands.takers, self.timeout)
            self._reduced += commands.limited

    def follow(self, trajectory: Trajectory, now_ns: int, zero_ns: int) -> Followed:
        """Take a trajectory of some joints.

        :param now_ns: the present time of the clock of stamps, `zero_ns` that at the start of the run.
        :raises CommandError: rejected; nothing changes.
        """
        curves = self.checked(trajectory, now_ns)
        with self._lock:
            self.accepted += 1
            start = trajectory.start_ns - zero_ns if trajectory.start_ns else None
            taken = dict(curves.values())
            number = self._actuators.player.take(taken, start)
        return Followed(number, (trajectory.start_ns or now_ns) - zero_ns, curves)

    def checked(self, trajectory: Trajectory, now_ns: int) -> dict[str, tuple[str, JointCurve]]:
        """The actuator or drive of each joint of a trajectory, and its curve.

        :raises CommandError: the trajectory is rejected.
        """
        try:
            curves = dict[str, tuple[str, JointCurve]]()
            for name, curve in trajectory.curves(now_ns).items():
                taker = self._router.positioner(name)
                if self._actuators.ranges is not None:
                    self._actuators.ranges.require(taker, name, curve)
                curves[name] = taker, curve
        except CommandError:
            self.rejected += 1
            raise
        return curves

    def follows(self, followed: Followed) -> bool:
        """Whether all joints still follow a trajectory: no other command has ended it."""
        with self._lock:
            player = self._actuators.player
            return all(player.follows(taker, followed.number) for taker, _ in followed.curves.values())

    def desired(self, followed: Followed, now: int) -> dict[str, Setpoint]:
        """The motion of each joint of a trajectory that is commanded `now` in ns of the run; after it, its end."""
        with self._lock:
            player = self._actuators.player
            return {
                joint: player.motion(taker, now) or Setpoint(curve.points[-1].position)
                for joint, (taker, curve) in followed.curves.items()
            }

    def stop(self, followed: Followed) -> None:
        """End a trajectory; its joints are held at the positions that are commanded now."""
        with self._lock:
            takers = [
                taker for taker, _ in followed.curves.values() if self._actuators.player.follows(taker, followed.number)
            ]
            self._actuators.take(self._actuators.merged({}), takers)

    def _take(
        self,
        efforts: Mapping[str, float] | Sequence[float],
        actuators: Mapping[str, Mapping[Channel, float]] = MappingProxyType({}),
    ) -> None:
        with self._taking():
            commands = self._actuators.merged(actuators) if actuators else None
            self._requested = self.map.merged(self._requested, efforts)
            if commands is not None:
                self._actuators.take(commands, actuators)
            if commands is None or efforts:
                self._new = True
                excess = self.map.excess(self._requested)
                self._excess, self._reduced = excess or self._excess, self._reduced + bool(excess)
                by_name = isinstance(efforts, Mapping)
                self._commanded |= [name in efforts for name in self.map.names] if by_name else True

    def due_for_actuators(self, time: float, current: Array) -> Array | None:
        """The commands (n,) of all actuators to apply from simulated `time` (s) on, if there are new ones."""
        with self._lock:
            return self._actuators.due(time, current)

    def steps_to_sample(self, tick: int, at_most: int) -> int:
        """The steps to the next tick at which a sample of a trajectory may be due, or fewer."""
        with self._lock:
            return self._actuators.player.steps_to_sample(tick, at_most)

    def take_expired_actuators(self) -> list[str]:
        """The actuators whose commands have expired since the last call."""
        with self._lock:
            found, self._actuators.expired = self._actuators.expired, []
            self.expired += bool(found)
            return found

    def watch_actuators(self, timeout: float) -> None:
        """Let commands of actuators expire after a time in s of the run without a new one; 0: never.

        Positions are held then; all other commands become zero.
        """
        with self._lock:
            self._actuators.timeout = timeout

    def skip_nan(self, skips: bool) -> None:
        """Take NaN in commands by name as no command, which ros2_control sends for interfaces without a controller."""
        self._router.skips_nan = skips

    def sample_trajectories(self, rate: float) -> None:
        """Sample trajectories at a rate in Hz of simulated time from now on."""
        with self._lock:
            self._actuators.player.rate = rate

    def due(self, time: float) -> list[DueEfforts]:
        """The efforts to apply from simulated `time` (s, monotonic) on, in this order; none where they stay."""
        with self._lock:
            found = []
            if self._new:
                self._last_times[self._commanded] = time
                self._lapsed &= ~self._commanded
                self._commanded[:], self._new = False, False
                self._oldest = float(self._last_times.min(initial=np.inf))
                found.append(DueEfforts(self._requested))
            if self.timeout > 0.0 and time - self._oldest >= self.timeout:
                found += self._expire(time - self._last_times >= self.timeout)
        return found

    def _expire(self, expiring: NDArray[np.bool_]) -> list[DueEfforts]:
        """Set efforts to zero; those that are zero already have nothing that could expire."""
        self._last_times[expiring] = np.inf
        self._oldest = float(self._last_times.min(initial=np.inf))
        changing = expiring & (self._requested != 0.0)
        if not np.any(changing):
            return []
        self._lapsed |= changing
        self.expired += 1
        self._requested = np.where(changing, 0.0, self._requested)
        return [DueEfforts(expired=self._names_of(changing))]

    def _names_of(self, flags: NDArray[np.bool_]) -> tuple[str, ...]:
        return tuple(name for name, flag in zip(self.map.names, flags, strict=True) if flag)

    def clear(self) -> None:
        """Discard all commands, as after a reset."""
        with self._lock:
            self._actuators.clear()
            self._requested = np.zeros_like(self._requested)
            self._commanded[:] = self._lapsed[:] = self._new = False
            self._last_times[:] = self._oldest = np.inf
