"""Inertias of links regrouped: what moves alike with a link and with the link inboard of it counts as the latter's.

A fixed joint makes one rigid body of two links. A thin rod along the axis of a hinge moves alike with the links on both
sides of it, whatever its mass, and so do a particle in the center of a spherical joint and, beside a slider, a body
without mass that resists rotation only. Such parts of each link's inertia are moved inboard. The equations of motion
remain the same, with fewer entries that are not zero: these are the base parameters of robot identification (Khalil &
Dombre, *Modeling, Identification and Control of Robots*, ch. 9). Energies and wrenches across joints need the
inertias as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import skew
from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.kinematics.links import COMPONENT_ROUND_OFF, Link
from mbd_sim.dynamics.math.spatial import constant, is_symbolic


def lumped_inertias(links: Sequence[Link]) -> list[ca.SX]:
    """The inertias (6, 6) about the links' origins with which the equations of motion are those of the links.

    Only numbers are regrouped: a link whose inertia, or the pose of whose joint, contains symbols keeps its inertia.

    :param links: from ground outward.
    """
    inertias: list[Array | ca.SX] = [link.inertia for link in links]
    for index in reversed(range(len(links))):
        link, inertia = links[index], inertias[index]
        if isinstance(inertia, ca.SX) or is_symbolic(link.X_PF.position, link.X_PF.rotation):
            continue
        moved = _movable(link, inertia)
        if moved is None:
            continue
        inertias[index] = _without_round_off(inertia - moved, inertia)
        if link.parent >= 0:
            carried = _at_inboard_link(link, moved)
            inboard = inertias[link.parent]
            inertias[link.parent] = inboard + (constant(carried) if is_symbolic(inboard) else carried)
    return [constant(inertia) for inertia in inertias]


def _movable(link: Link, inertia: Array) -> Array | None:
    """The part (6, 6) of an inertia that does not change if the joint moves, and does not resist it; None if zero."""
    moved = np.zeros((6, 6))
    match link.joint.type:
        case "fixed":
            moved = inertia
        case "prismatic":
            moved[:3, :3] = inertia[:3, :3]
        case "spherical":
            moved[3:, 3:] = inertia[3:, 3:]
        case "revolute":
            moved = _thin_rod(link.axes.axis, inertia)
        case "screw" | "cylindrical" | "planar":
            moved[:3, :3] = _thin_rod(link.axes.axis, inertia)[:3, :3]
        case "universal" | "free":
            pass
        case _ as unknown:
            assert_never(unknown)
    return moved if np.any(moved) else None


def _thin_rod(axis: Array, inertia: Array) -> Array:
    """The inertia (6, 6) of a rod along an axis; zero unless that is a coordinate axis.

    The rod has the mass and the mass moment along the axis of another inertia, and one of its moments across the axis.
    """
    rod = np.zeros((6, 6))
    if np.count_nonzero(axis) == 1:
        k = int(np.argmax(np.abs(axis)))
        i, j = (k + 1) % 3, (k + 2) % 3
        rod[i, i] = rod[j, j] = inertia[i, i]
        mass_moment = np.zeros(3)
        mass_moment[k] = inertia[j, i + 3]
        rod[:3, 3:], rod[3:, :3] = skew(mass_moment), -skew(mass_moment)
        rod[3:, 3:] = inertia[3:, 3:]
    return rod


def _at_inboard_link(link: Link, inertia: Array) -> Array:
    """An inertia about the joint's inboard frame as one about the inboard link's origin, in its axes."""
    R, p = link.X_PF.rotation, skew(link.X_PF.position)
    transform = np.block([[R.T, np.zeros((3, 3))], [product(-R.T, p), R.T]])
    carried = product(product(transform.T, inertia), transform)
    return _without_round_off(0.5 * (carried + carried.T), carried)


def _without_round_off(array: Array, before: Array) -> Array:
    """The inertia without entries that are round-off of their block in another one."""
    result = array.copy()
    for rows in (slice(0, 3), slice(3, 6)):
        for columns in (slice(0, 3), slice(3, 6)):
            size = np.max(np.abs(before[rows, columns]))
            block = result[rows, columns]
            block[np.abs(block) <= 2.0 * COMPONENT_ROUND_OFF * size] = 0.0
    return result
