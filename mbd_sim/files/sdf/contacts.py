"""The contacts of an SDF: planes and shapes of its static models with the collision elements of all other links.

They act when they are asked for (`--floor`, `active: true`). Of two surfaces in contact the smaller coefficients of
friction and of restitution count, as in Gazebo with ODE.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import aligning_z, unit
from mbd_sim.files.sdf.links import Values, collision_name, plane_of
from mbd_sim.files.sdf.scopes import ScopedFrame, key_of, world_pose
from mbd_sim.files.text.xml import Element
from mbd_sim.mechanism.values.names import accepted_names, reference, unique_name

FRICTION = 1.0  # of the specification
WAITING = "{}, which act with --floor, or with 'active: true' in contacts"


@dataclass(frozen=True)
class SurfaceLaw:
    """The coefficients of a surface."""

    friction: float
    restitution: float

    def against(self, other: SurfaceLaw) -> dict[str, float]:
        """The keys of a contact of both."""
        friction = min(self.friction, other.friction)
        restitution = min(self.restitution, other.restitution)
        return ({"friction": friction} if friction else {}) | ({"restitution": restitution} if restitution else {})


def surface_of(values: Values, collision: Element, key: str) -> SurfaceLaw:
    """The coefficients of a collision element."""
    surface = collision.first("surface")
    friction = None if surface is None else surface.first("friction")
    ode = None if friction is None else friction.first("ode")
    mu = FRICTION if ode is None else values.number_from_zero(ode, "mu", f"{key}.surface.friction.ode", FRICTION)
    if ode is not None and values.number(ode, "mu2", f"{key}.surface.friction.ode", mu) != mu:
        values.reading.leave_out_at("friction that differs by direction (mu2), of which mu is taken", collision, key)
    bounce = None if surface is None else surface.first("bounce")
    where = f"{key}.surface.bounce"
    rebound = 0.0 if bounce is None else values.number_from_zero(bounce, "restitution_coefficient", where)
    return SurfaceLaw(mu, min(rebound, 1.0) if math.isfinite(rebound) else 0.0)


def contacts_of(
    values: Values,
    links: Iterable[tuple[ScopedFrame, str, bool]],
    point: Callable[[Pose, str], str],
) -> dict[str, dict[str, Any]]:
    """The contacts by name.

    :param links: the links, the names of their parts, and whether they are static.
    :param point: gives the name of a point of ground with a pose in the world.
    """
    planes: list[tuple[str, Pose, SurfaceLaw, Element, str]] = []
    shapes: list[tuple[str, str, SurfaceLaw]] = []
    still: list[tuple[str, str, SurfaceLaw, Element, str]] = []
    for link, part, is_static in links:
        key = key_of(link.element)
        for number, element in enumerate(link.element.all("collision"), start=1):
            where = f"{key}.collision"
            plane, surface = plane_of(element), surface_of(values, element, where)
            if plane is None and not is_static:
                if element.first("geometry") is not None:
                    shapes.append((part, collision_name(element, number), surface))
            elif plane is None and element.first("geometry") is not None:
                still.append((part, collision_name(element, number), surface, element, key))
            elif plane is not None and is_static:
                normal = values.numbers(plane, "normal", where, 3) or [0.0, 0.0, 1.0]
                turn = Pose(np.zeros(3), aligning_z(unit(normal)))
                pose = world_pose(link) @ values.pose(element, where) @ turn
                planes.append((part, pose, surface, element, key))
            elif plane is not None:
                values.reading.leave_out_at("planes of links that move, through which others pass", element, key)
    found: dict[str, dict[str, Any]] = {}
    for part, pose, surface, element, key in planes if shapes else ():
        groups: dict[tuple[tuple[str, float], ...], list[str]] = {}
        for owner, name, own in shapes:
            groups.setdefault(tuple(surface.against(own).items()), []).append(reference(owner, name))
        place = point(pose, part)
        for number, (law, names) in enumerate(groups.items(), start=1):
            parts: str | list[str] = "all" if len(groups) == 1 else names
            found[part if number == 1 else f"{part}_{number}"] = {
                "parts": parts,
                "plane": place,
                **dict(law),
                "active": False,
            }
        values.reading.leave_out_at(WAITING.format("planes"), element, key)
    for part, name, surface, element, key in still if shapes else ():
        for owner, keys in _by_part(shapes, surface):
            wanted = f"{owner}_{part}_{name}".replace(".", "_")
            record = {"between": [owner, reference(part, name)], **keys, "active": False}
            found[unique_name(accepted_names([wanted], "contact")[wanted], found)] = record
        values.reading.leave_out_at(WAITING.format("shapes of static links"), element, key)
    return found


def _by_part(shapes: list[tuple[str, str, SurfaceLaw]], still: SurfaceLaw) -> Iterator[tuple[str, dict[str, float]]]:
    """References to parts, or to their shapes where these have different laws against a surface, with the laws."""
    for part in dict.fromkeys(owner for owner, _, _ in shapes):
        laws = {name: still.against(own) for owner, name, own in shapes if owner == part}
        if all(law == next(iter(laws.values())) for law in laws.values()):
            yield reference(part), next(iter(laws.values()))
        else:
            yield from ((reference(part, name), law) for name, law in laws.items())
