"""What one step may miss of a contact: parts that turn far in it, and small ones that fly through each other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import assert_never

import casadi as ca

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.equations import expressed_in_state
from mbd_sim.dynamics.contact.barrel_rows import has_one_row
from mbd_sim.dynamics.contact.planar.plane import still_axis
from mbd_sim.dynamics.kinematics.poses import BodyFrame, BodySymbols
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism, trace
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.dynamics.math.spatial import constant
from mbd_sim.mechanism.elements import constraints as c
from mbd_sim.mechanism.elements.contacts import (
    CAM_ANGLE,
    Ball,
    Barrel,
    Cam,
    Cluster,
    ConeBody,
    Contact,
    ContactBody,
    EllipsoidBody,
    Face,
    PlanarBody,
    Rim,
    RimPoint,
    Solid,
)
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class PassingFunctions:
    """What steps may miss of pairs of parts with a gap, by the `names` of their elements.

    `motions(t, y, inputs)` (4, pairs) are the larger angular speed of both parts in rad/s; the second and the third
    rate, at constant speeds of all coordinates, of the place in m on which the gap depends; and the relative speed in
    m/s. The inputs are those before live values. `sizes` are those in m of the two bodies of a compliant contact that
    can be passed, otherwise None.
    """

    names: tuple[str, ...]
    sizes: tuple[float | None, ...]
    motions: ca.Function


@dataclass(frozen=True, eq=False)
class _Pair:
    name: str
    ends: tuple[Attachment, Attachment]
    place: Callable[[BodyFrame, BodyFrame], ca.SX]
    size: float | None = None


def passing_functions(mechanism: Mechanism, loaded: Sequence[str] = ()) -> PassingFunctions | None:
    """The functions for contacts and for one-sided constraints between points of a mechanism; None without any.

    :param loaded: see `trace`.
    """
    static = [contact for contact in mechanism.contacts if not contact.slots or isinstance(contact.first, Ball)]
    constraints = [*_constraint_pairs(mechanism)]
    if not static and not constraints:
        return None
    traced = trace(mechanism, loaded)
    still = still_axis(traced.poses)
    static = [contact for contact in static if not contact.slots or has_one_row(contact, still)]
    pairs = [*constraints, *map(_contact_pair, static)]  # the others are followed within a step
    if not pairs:
        return None
    bodies = BodySymbols(traced.links)
    in_state = expressed_in_state(traced, bodies, ca.SX.sym("time"))
    columns = [ca.densify(_motion(pair, traced, bodies, in_state)) for pair in pairs]
    motions = ca.Function("passing", [traced.state.t, traced.y, traced.inputs], [ca.horzcat(*columns)], {"cse": True})
    return PassingFunctions(tuple(pair.name for pair in pairs), tuple(pair.size for pair in pairs), motions)


def _motion(pair: _Pair, traced: TracedMechanism, bodies: BodySymbols, in_state: Callable[[ca.SX], ca.SX]) -> ca.SX:
    first, second = (bodies.frame(end.part, end.point) for end in pair.ends)
    place = in_state(pair.place(first, second))
    second_rate = traced.state.rate(traced.state.rate(place))
    third_rate, turning = traced.state.rate(second_rate), [in_state(each.omega) for each in (first, second)]
    fastest = ca.fmax(*(_size(omega) for omega in turning))
    speed = _size(in_state(first.velocity - second.velocity))
    return ca.vertcat(fastest, _size(second_rate), _size(third_rate), speed)


def _size(vector: ca.SX) -> ca.SX:
    return ca.sqrt(ca.dot(vector, vector))


def _constraint_pairs(mechanism: Mechanism) -> Iterator[_Pair]:
    """The pairs of one-sided constraints between two points, or a point and a surface."""
    for constraint in mechanism.constraints:
        match constraint:
            case c.Flat(law=law) if law is not None:
                yield _Pair(
                    constraint.name,
                    (constraint.point, constraint.base),
                    partial(_along, constant(constraint.normals)),
                )
            case c.Surface(law=law) if law is not None:
                yield _Pair(constraint.name, (constraint.point, constraint.base), _in_axes)
            case c.Distance(law=law) if law is not None:
                yield _Pair(constraint.name, (constraint.first, constraint.second), _in_ground)
            case _:
                continue


def _contact_pair(contact: Contact) -> _Pair:
    first, second = contact.first, contact.second

    def place(one: BodyFrame, other: BodyFrame) -> ca.SX:
        """What the gap depends on; tilts count as lengths at the rim."""
        match second:
            case Face():
                normal = other.rotation @ constant(second.normal)
                tilt = [radius * ca.dot(normal, one.rotation @ constant(axis)) for radius, axis in _arms(first)]
                return ca.vertcat(ca.dot(normal, _in_ground(one, other)), *tilt)
            case Barrel():
                own = other.rotation @ constant(second.axis)
                line = _in_ground(one, other)
                return ca.vertcat(ca.dot(own, line), ca.cross(own, line))
            case Cam():
                return _in_axes(one, other)
            case _:
                return _in_ground(one, other)

    can_be_passed = not contact.rigid and not contact.inside and not isinstance(second, Face)
    size = _thickness(first) + _thickness(second) if can_be_passed else None
    return _Pair(contact.name, (first.at, second.at), place, size)


def _in_ground(one: BodyFrame, other: BodyFrame) -> ca.SX:
    return one.position - other.position


def _along(normals: ca.SX, one: BodyFrame, other: BodyFrame) -> ca.SX:
    """The place of the first along directions (k, 3) in the axes of the second."""
    return normals @ _in_axes(one, other)


def _in_axes(one: BodyFrame, other: BodyFrame) -> ca.SX:
    """The place of the first in the axes of the second."""
    return other.rotation.T @ _in_ground(one, other)


def _arms(body: ContactBody) -> list[tuple[float, Array]]:
    """Radii of a body that is not a ball, each with a direction: that about which it is round, or one across a cam."""
    match body:
        case Ball() | Face() | Solid() | PlanarBody() | Cluster():
            return []
        case Cam():
            return [(_radius(body), body.axes[:, 0])]
        case EllipsoidBody(radii=radii, axes=axes):
            return list(zip(radii, axes.T, strict=True))
        case Rim() | RimPoint() | Barrel() | ConeBody():
            return [(body.radius, body.axis)]
        case _:
            assert_never(body)


def _thickness(body: ContactBody) -> float:
    """Half the extent in m across which a body is thinnest."""
    return min(body.radius, 0.5 * body.length) if isinstance(body, Barrel) else _radius(body)


def _radius(body: ContactBody) -> float:
    """In m; of a cam, at the angle zero."""
    match body:
        case Cam():
            return float(ca.evalf(ca.SX(function_of(body.profile, {CAM_ANGLE: ca.SX(0)}))))
        case Face() | PlanarBody():
            return 0.0
        case EllipsoidBody():
            return min(body.radii)
        case Cluster(bodies=bodies):
            return max(each.radius for each in bodies)
        case _:
            return body.radius
