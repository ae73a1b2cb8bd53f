"""Disturbances: small changes of the motion of drives and of ground, as inputs of the equations.

They are zero; derivatives by them show how a mechanism responds. With changes ρ, ν, α of the position, the velocity and
the acceleration of a driven coordinate at the time t₀, its motion is

    r(t) + ρ + ν (t - t₀) + α (t - t₀)²/2,

so that all its derivatives at t₀ are changed by them. An acceleration a of ground without rotation acts on the motion
relative to ground as a change -a of gravity. Among the inputs are all ρ, all ν and all α, in the order of the driven
joints, then t₀ and a (3,).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.dynamics.input_layout import UNDRIVEN
from mbd_sim.dynamics.links import Disturbance, Link
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.dynamics.symbolic_parameters import SymbolicParameters
from mbd_sim.mechanism.drives import CommandedDrive
from mbd_sim.mechanism.records import Joint, Mechanism


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
