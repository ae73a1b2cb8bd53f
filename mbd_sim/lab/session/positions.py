"""A mechanism that is only moved through its positions, by one of its joints: its parts need no masses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.base.errors import CommandError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.checks.override import with_values
from mbd_sim.lab.session.bench import Bench
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.run.simulation import BaseSimulation

TURN_TIME = 6.0  # s for a full turn, or for the length of the mechanism
PERIOD = 1.0 / 60.0  # s between two positions
STEP = math.radians(2.0)  # of the joint between two configurations, in natural units
JUMP = 8.0  # a coordinate that moves this many times as far as the joint has jumped to another assembly


class PositionBench(Bench):
    """A bench on which time moves a joint, named `drive`, and nothing else acts.

    At a dead point, where the joint cannot move on, its direction changes.
    """

    positions_only = True

    def __init__(self, simulation: BaseSimulation, drive: str) -> None:
        super().__init__(simulation)
        if drive not in simulation.coordinate_names:
            raise CommandError(
                f"--drive: there is no joint '{drive}' that can be moved",
                nearest(drive, simulation.coordinate_names),
            )
        self.period = max(1, round(PERIOD / simulation.step_size))
        self.drive, self.message, self._direction = drive, "", 1.0
        self._index = simulation.coordinate_names.index(drive)
        scales = simulation.model.equations.constraints.scales
        self._unit = float(scales[self._index])
        self._speed = 2.0 * math.pi * self._unit / TURN_TIME

    @classmethod
    def driven(cls, mechanism: Mechanism, drive: str) -> PositionBench:
        """Build the bench; parts without mass get one, which has no effect on positions.

        A joint whose motion the file prescribes is moved from where it is at time zero.

        :raises MechanismError: with all problems of the file.
        :raises CommandError: there is no such joint.
        """
        return cls(Bench.of(_weighted(_freed(mechanism, drive))).simulation, drive)

    @property
    def position(self) -> float:
        """That of the driven joint, in rad or m."""
        return float(self.simulation.model.coordinates(self.simulation.y)[self._index])

    def advance(self, steps: int) -> None:
        """Let time pass for some steps, in which the joint moves on."""
        simulation = self.simulation
        change = self._direction * self._speed * steps * simulation.step_size
        try:
            self._move(self.position + change)
            self.message = ""
        except CommandError:
            self._direction = -self._direction
            self.message = f"{self.drive} cannot go beyond {self._shown()}: it turns back"
        simulation.restore(simulation.state, simulation.steps + steps, start_energy=simulation.start_energy)

    def drive_to(self, position: float) -> None:
        """Move the joint to a position in rad or m, along the configurations between.

        :raises CommandError: a dead point is in between; the mechanism is then close to it.
        """
        count = max(1, math.ceil(abs(position - self.position) / (STEP * self._unit)))
        for target in np.linspace(self.position, position, count + 1)[1:].tolist():
            self._move(target)

    def values(self) -> dict[str, float]:
        """The live values, and the position of the driven joint."""
        return {**super().values(), self.drive: self.position}

    def take_hold(self, part: str, point: Array, target: Array) -> None:
        """Nothing pulls: the mechanism follows the pointer."""
        self.drag(part, point, target)

    def _move(self, position: float) -> None:
        """Put the joint into a position close to the present one."""
        simulation, before = self.simulation, self.simulation.snapshot()
        old = simulation.model.coordinates(before.state)
        simulation.set_state({self.drive: position}, dict.fromkeys(simulation.coordinate_names, 0.0))
        moved = simulation.model.coordinates(simulation.y) - old
        allowed = JUMP * max(abs(position - old[self._index]) / self._unit, STEP / 4.0)
        if np.any(np.abs(moved) / simulation.model.equations.constraints.scales > allowed):
            simulation.restore(before)
            raise CommandError(f"{self.drive} is close to a dead point at {self._shown()}", "Move it back.")

    def _shown(self) -> str:
        rotates = [
            c.rotation for j in self.simulation.mechanism.joints.values() if not j.drive for c in j.kind.coordinates
        ]
        return f"{math.degrees(self.position):.1f} deg" if rotates[self._index] else f"{self.position:.4g} m"


def _freed(mechanism: Mechanism, name: str) -> Mechanism:
    """The mechanism in which the joint of a driven coordinate has no drive."""
    for joint in mechanism.joints.values():
        if joint.drive and name in joint.motion_names:
            drive = joint.drive
            start = [drive.start] if isinstance(drive, CommandedDrive) else [one.at(0.0) for one in drive]
            position = start[0] if len(start) == 1 else start
            return with_values(
                mechanism, {f"joints.{joint.name}.drive": None, f"joints.{joint.name}.position": position}
            )
    return mechanism


def _weighted(mechanism: Mechanism) -> Mechanism:
    """The mechanism with a mass and an inertia in each part that has none."""
    changes: dict[str, Any] = {}
    for name, part in mechanism.parts.items():
        if part.mass == 0.0:
            changes[f"parts.{name}.mass"] = 1.0
            if not part.shapes:
                changes[f"parts.{name}.inertia"] = [1.0, 1.0, 1.0]
    return with_values(mechanism, changes) if changes else mechanism
