"""Drives that follow commands: a reference model of third order, whose states are part of the coordinates.

With the position r, the velocity v and the acceleration a of the drive, the commands c and w of its position and its
velocity, and the bandwidth ω, λ = 3 ω:

    r' = v,    v' = a,    a' = 2 λ (sat(λ/2 (v* - v)) - a),    v* = sat(w + p(c - r)),

where sat limits the acceleration and the velocity. Where neither limit acts, p(e) = 4/9 ω e, and the poles are -ω, -ω
and -4 ω. All are real, so that r follows a step of c without overshoot, and a ramp without a lasting error if w is its
slope. A commanded velocity has v* = sat(w), with both poles at -λ.

The limits hold without error: a follows a limited signal with a lag of first order. Where the acceleration is not
limited, v and z = v + a/λ are a chain of two such lags, v' = λ (z - v) and z' = λ (v* - z), which cannot overshoot; a
limited acceleration only slows this down. A range of positions limits v* to p(upper - r) and from p(lower - r) on. Then
the distance e = upper - r obeys (D + 4 ω) (D + ω)² e ≥ 0, and from rest it never becomes negative. With a limit A of
the acceleration, p(e) is at most sqrt(2 B (|e| - e₀/2)) in size, e₀ = B (4/9 ω)⁻², which brakes with B = 2/3 A.
"""

from __future__ import annotations

import math

import casadi as ca

from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.motors import limited
from mbd_sim.dynamics.time_functions import time_functions
from mbd_sim.mechanism.drives import CommandedDrive

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
