"""The motion of drives: how it follows commands, and how small changes of it are inputs of the equations.

A commanded drive follows a reference model of third order, whose states are part of the coordinates. With the position
r, the velocity v and the acceleration a of the drive, the commands c and w of its position and its velocity, and the
bandwidth ω, λ = 3 ω:

    r' = v,    v' = a,    a' = 2 λ (sat(λ/2 (v* - v)) - a),    v* = sat(w + p(c - r)),

where sat limits the acceleration and the velocity. Where neither limit acts, p(e) = 4/9 ω e, and the poles are -ω, -ω
and -4 ω. All are real, so that r follows a step of c without overshoot, and a ramp without a lasting error if w is its
slope. A commanded velocity has v* = sat(w), with both poles at -λ. The commands of drives come after those of actuators
among the inputs, in the order of the file.

The limits hold without error: a follows a limited signal with a lag of first order. Where the acceleration is not
limited, v and z = v + a/λ are a chain of two such lags, v' = λ (z - v) and z' = λ (v* - z), which cannot overshoot; a
limited acceleration only slows this down. A range of positions limits v* to p(upper - r) and from p(lower - r) on. Then
the distance e = upper - r obeys (D + 4 ω) (D + ω)² e ≥ 0, and from rest it never becomes negative. With a limit A of
the acceleration, p(e) is at most sqrt(2 B (|e| - e₀/2)) in size, e₀ = B (4/9 ω)⁻², which brakes with B = 2/3 A.

Disturbances are small changes of the motion of drives and of ground. They are zero; derivatives by them show how a
mechanism responds. With changes ρ, ν, α of the position, the velocity and the acceleration of a driven coordinate at
the time t₀, its motion is

    r(t) + ρ + ν (t - t₀) + α (t - t₀)²/2,

so that all its derivatives at t₀ are changed by them. An acceleration a of ground without rotation acts on the motion
relative to ground as a change -a of gravity. Among the inputs are all ρ, all ν and all α, in the order of the driven
joints, then t₀ and a (3,).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.base.errors import MechanismError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.links import Disturbance, Link
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters
from mbd_sim.dynamics.layouts.vectors import UNDRIVEN, CoordinateLayout, InputLayout
from mbd_sim.dynamics.math.expressions import time_functions
from mbd_sim.dynamics.math.spatial import constant, limited
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.joint_types import CommandedDrive, default_command
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism

INNER = 3.0  # λ/ω
OUTER = 4.0 / 27.0 * INNER  # slope of the approach, divided by ω
BRAKING = 2.0 / 3.0  # of the limit of the acceleration, with which the approach brakes
FASTEST = 4.0  # the fastest pole, divided by ω


def driven_motion(link: Link, t: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The positions, velocities and accelerations (n,) of a driven joint at time t and coordinates q (nq,)."""
    drive = link.joint.drive
    if not isinstance(drive, CommandedDrive):
        values, rates, accelerations = time_functions(drive, t)
        if (change := link.disturbance) is not None:
            since = t - change.at
            values += change.position + since * (change.velocity + 0.5 * since * change.acceleration)
            rates += change.velocity + since * change.acceleration
            accelerations += change.acceleration
        return values, rates, accelerations
    position, velocity, acceleration = ca.vertsplit(q[link.drive])
    return position, velocity, acceleration


def drive_rates(drive: CommandedDrive, states: ca.SX, commands: ca.SX) -> ca.SX:
    """The rates (3,) of the position, velocity and acceleration of a drive in `states` (3,).

    :param commands: (n,), those of `CommandedDrive.channels`.
    """
    position, velocity, acceleration = ca.vertsplit(states)
    decay = INNER * drive.bandwidth
    wanted = commands[-1]
    if drive.controls == "position":
        wanted += _approach(drive, commands[0] - position)
    if drive.upper < math.inf:
        wanted = ca.fmin(wanted, _approach(drive, drive.upper - position))
    if drive.lower > -math.inf:
        wanted = ca.fmax(wanted, _approach(drive, drive.lower - position))
    wanted = limited(wanted, drive.velocity_limit)
    pull = limited(0.5 * decay * (wanted - velocity), drive.acceleration_limit)
    return ca.vertcat(velocity, acceleration, 2.0 * decay * (pull - acceleration))


def _approach(drive: CommandedDrive, error: ca.SX) -> ca.SX:
    """The velocity with which a drive approaches a position that is this far away."""
    slope = OUTER * drive.bandwidth
    if drive.acceleration_limit == math.inf:
        return slope * error
    braking = BRAKING * drive.acceleration_limit
    near, distance = braking / slope**2, ca.fabs(error)
    curve = ca.sqrt(2.0 * braking * (ca.fmax(distance, near) - 0.5 * near))
    return ca.if_else(distance <= near, slope * error, ca.sign(error) * curve)


RESOLVED = 0.5  # largest product of the step and the fastest rate of a drive


def drive_command_slices(mechanism: Mechanism, first: int) -> dict[str, slice]:
    """The commands of each drive, by the name of its joint, from the index `first` on."""
    found = {}
    for name, drive in commanded_drives(mechanism).items():
        found[name] = slice(first, first + len(drive.channels))
        first = found[name].stop
    return found


def drive_command_count(mechanism: Mechanism) -> int:
    """The number of commands of all drives."""
    return sum(len(drive.channels) for drive in commanded_drives(mechanism).values())


def hold_drives(
    mechanism: Mechanism, layout: CoordinateLayout, input_layout: InputLayout, y: Array | ca.SX, inputs: Array | ca.SX
) -> None:
    """Set the commands of all drives in place to those before the first command: the positions in y, without speed."""
    drives: dict[str, CommandedDrive] = dict(commanded_drives(mechanism))
    first = input_layout.commands.stop - drive_command_count(mechanism)
    for name, span in drive_command_slices(mechanism, first).items():
        position = y[layout.drives[name].start]
        for index, channel in enumerate(drives[name].channels, span.start):
            inputs[index] = default_command(channel, position)


def require_resolved(mechanism: Mechanism, step: float) -> None:
    """Refuse drives that are too fast for steps of `step` in s.

    :raises MechanismError: their joints are named.
    """
    problems = []
    for name, drive in commanded_drives(mechanism).items():
        if (longest := RESOLVED / (FASTEST * drive.bandwidth)) < step:
            message = f"a bandwidth of {drive.bandwidth:g} rad/s is too high for steps of {step:g} s"
            remedy = f"Give at most {RESOLVED / (FASTEST * step):g} rad/s, or use steps of at most {longest:g} s."
            problems.append(mechanism.source.problem(("joints", name, "drive", "bandwidth"), message, remedy))
    if problems:
        raise MechanismError(problems)


def time_driven(mechanism: Mechanism) -> list[str]:
    """The coordinates that are functions of time, in the order of the joints."""
    joints = mechanism.joints.values()
    return [name for joint in joints if _follows_time(joint) for name in joint.motion_names]


def disturbance_count(mechanism: Mechanism) -> int:
    """The number of disturbances among the inputs."""
    return 3 * len(time_driven(mechanism)) + UNDRIVEN


def with_room(parameters: SymbolicParameters, count: int) -> SymbolicParameters:
    """The parameters, with this number of disturbances after them."""
    return replace(parameters, base=np.concatenate([parameters.base, np.zeros(count)])) if count else parameters


def disturbed(mechanism: Mechanism, links: Sequence[Link], symbols: ca.SX) -> tuple[Mechanism, list[Link]]:
    """The mechanism and its links with these disturbances (n,), or as they are without any."""
    if symbols.is_empty():
        return mechanism, list(links)
    names = time_driven(mechanism)
    changes, rest = ca.reshape(symbols[: 3 * len(names)], len(names), 3), symbols[3 * len(names) :]
    gravity: Any = constant(mechanism.gravity) - rest[1:]
    return replace(mechanism, gravity=gravity), [_disturbed(link, changes, rest[0], names) for link in links]


def _follows_time(joint: Joint) -> bool:
    return bool(joint.drive) and not isinstance(joint.drive, CommandedDrive)


def _disturbed(link: Link, changes: ca.SX, at: ca.SX, names: Sequence[str]) -> Link:
    if not _follows_time(link.joint):
        return link
    own = [names.index(name) for name in link.joint.motion_names]
    return replace(link, disturbance=Disturbance(changes[own, 0], changes[own, 1], changes[own, 2], at))
