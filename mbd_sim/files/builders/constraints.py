"""Builds the constraints of a mechanism from their records in the file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import assert_never

from mbd_sim.base.errors import quoted
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.builders.context import BuildContext
from mbd_sim.files.schema import constraints as schema
from mbd_sim.files.schema.fields import UNKNOWN
from mbd_sim.mechanism.elements import constraints as c
from mbd_sim.mechanism.elements.constraints import ContactLaw, Play
from mbd_sim.mechanism.elements.parts import Attachment, Joint
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.source import Location

ZERO = TimeExpression("0", {})


def build_constraints(specs: Mapping[str, schema.AnyConstraintSpec], context: BuildContext) -> tuple[c.Constraint, ...]:
    """The constraints of a file; invalid ones are left out and reported to `context`."""
    builder = _ConstraintBuilder(context)
    built = (builder.build(name, spec) for name, spec in specs.items())
    return tuple(constraint for constraint in built if constraint is not None)


def coupled_joints(constraints: Iterable[c.Constraint], joints: Mapping[str, Joint]) -> list[str]:
    """The joints whose coordinates a coupling refers to."""
    owners = {label: joint.name for joint in joints.values() for label in joint.motion_names}
    found: list[str] = []
    for constraint in constraints:
        match constraint:
            case c.Coupling(factors=factors, value=value):
                found += [*factors, *(name.coordinate for name in value.state)]
            case c.Clutch(factors=factors):
                found += factors
            case c.Distance() | c.Flat() | c.Surface() | c.Rolling() | c.KnifeEdge() | c.Cable():
                pass
            case _:
                assert_never(constraint)
    return [owners[name] for name in found]


@dataclass(frozen=True, eq=False)
class _GuidedPoint:
    """A constrained point, the base of its guide, and the axes (3, 3) at both points in the frames of their parts."""

    point: Attachment
    base: Attachment
    point_axes: Array
    base_axes: Array

    def plane(self, name: str, spec: schema.OnPlaneSpec) -> c.Flat:
        """The point stays on a plane through the base."""
        normal = product(self.base_axes, rot.unit(spec.normal))
        return c.Flat(name, self.point, self.base, normal[None, :], spec.type, spec.bound, contact_law(spec))

    def line(self, name: str, spec: schema.OnLineSpec) -> c.Flat:
        """The point stays on a line through the base."""
        across = rot.aligning_z(rot.unit(spec.direction))[:, :2]
        return c.Flat(name, self.point, self.base, (product(self.base_axes, across)).T, spec.type)

    def surface(self, name: str, spec: schema.OnSurfaceSpec) -> c.Surface:
        """The point stays where expressions of its coordinates are zero."""
        equations = (spec.equation,) if spec.equation else spec.equations or ()
        law = contact_law(spec)
        return c.Surface(name, self.point, self.base, self.base_axes, equations, spec.type, spec.bound, law)

    def rolling(self, name: str, spec: schema.RollingSpec) -> c.Rolling:
        """The point is the center of a wheel or a ball that rolls on a plane through the base."""
        axis = None if spec.axis is None else product(self.point_axes, rot.unit(spec.axis))
        law = rolling_law(spec)
        normal = product(self.base_axes, rot.unit(spec.normal))
        return c.Rolling(name, self.point, axis, spec.radius, self.base, normal, law=law)

    def knife_edge(self, name: str, spec: schema.KnifeEdgeSpec) -> c.KnifeEdge:
        """The point is on an edge that does not move sideways in a plane through the base."""
        direction = product(self.point_axes, rot.unit(spec.direction))
        return c.KnifeEdge(name, self.point, direction, self.base, product(self.base_axes, rot.unit(spec.normal)))


class _ConstraintBuilder:
    """Builds constraints one by one; problems are reported to the context."""

    def __init__(self, context: BuildContext) -> None:
        self._context = context

    def build(self, name: str, spec: schema.AnyConstraintSpec) -> c.Constraint | None:
        match spec:
            case schema.DistanceSpec(length=length):
                points = self._points_apart(name, "between", spec.between, length)
                law = contact_law(spec)
                return c.Distance(name, points[0], points[1], length, bound=spec.bound, law=law) if points else None
            case schema.CableSpec(length=length):
                points = self._points_apart(name, "through", spec.through, length)
                law = contact_law(spec)
                return c.Cable(name, tuple(points), length, bound=spec.bound, law=law) if points else None
            case schema.GearSpec(joints=names, radii=(first, second), internal=internal):
                factors = {names[0]: first, names[1]: -second if internal else second}
                return self._coupling(name, factors, ("joints", names), spec)
            case schema.RackSpec(pinion=pinion, rack=rack, radius=radius, reverse=reverse):
                factors = {pinion: radius if reverse else -radius, rack: 1.0}
                return self._coupling(name, factors, ("", (pinion, rack)), spec)
            case schema.CouplingSpec(terms=terms, value=value):
                return self._coupling(name, terms, ("terms", tuple(terms)), spec, value)
            case schema.ClutchSpec(terms=terms):
                return self._clutch(name, spec)
            case schema.OnPlaneSpec():
                guided = self._guided(name, ("point", spec.point), ("plane", spec.plane))
                return guided.plane(name, spec) if guided else None
            case schema.OnLineSpec():
                guided = self._guided(name, ("point", spec.point), ("line", spec.line))
                return guided.line(name, spec) if guided else None
            case schema.OnSurfaceSpec():
                guided = self._guided(name, ("point", spec.point), ("frame", spec.frame))
                return guided.surface(name, spec) if guided else None
            case schema.RollingSpec():
                guided = self._guided(name, ("wheel", spec.wheel), ("plane", spec.plane))
                return guided.rolling(name, spec) if guided else None
            case schema.KnifeEdgeSpec():
                guided = self._guided(name, ("at", spec.at), ("plane", spec.plane))
                return guided.knife_edge(name, spec) if guided else None
            case _:
                assert_never(spec)

    def _points_apart(
        self, name: str, key: str, references: list[str] | tuple[str, ...], length: TimeExpression
    ) -> list[Attachment]:
        """The points between which a length is given; empty, with a problem, if they or the length are invalid."""
        where: Location = ("constraints", name)
        points = self._context.attachments((*where, key), references)
        if points and length is not UNKNOWN and (value := length.at(0.0)) <= 0.0:
            message = f"must be greater than 0, but is {value:g} at the start"
            self._context.report((*where, "length"), message, "For points that coincide use a spherical joint.")
            return []
        return points

    def _guided(self, name: str, point: tuple[str, str], guide: tuple[str, str]) -> _GuidedPoint | None:
        """A point and its guide, each given by its key and its reference."""
        where: Location = ("constraints", name)
        frames = [self._context.frame((*where, key), reference) for key, reference in (point, guide)]
        attachments = self._context.on_different_parts((*where, point[0]), frames)
        if not attachments or frames[0] is None or frames[1] is None:
            return None
        return _GuidedPoint(attachments[0], attachments[1], frames[0][1].rotation, frames[1][1].rotation)

    def _coupling(
        self,
        name: str,
        factors: Mapping[str, float],
        written: tuple[str, tuple[str, ...]],
        spec: schema.GearSpec | schema.RackSpec | schema.CouplingSpec,
        value: TimeExpression = ZERO,
    ) -> c.Coupling | None:
        """A coupling of coordinates.

        :param written: the key of the coordinates in the file (`""` for the record itself), and the coordinates.
        """
        if not self._couples(name, factors, written):
            return None
        units = self._units(factors) if isinstance(spec, schema.CouplingSpec) else ["m"]
        for quantity in ("value", "backlash"):
            self._context.has_unit(("constraints", name, quantity), *units)
        play = None if spec.backlash is None else Play(0.5 * spec.backlash, spec.restitution or 0.0)
        if not isinstance(spec, schema.CouplingSpec):
            return c.Coupling(name, dict(factors), value, spec.type, play)
        if spec.bound is None:
            return c.Coupling(name, dict(factors), value, spec.type, play, follower=spec.follower)
        if spec.slip is not None and not self._couples(name, spec.slip, ("slip", tuple(spec.slip))):
            return None
        law, slip = contact_law(spec), dict(spec.slip or {})
        return c.Coupling(name, dict(factors), value, spec.type, None, spec.bound, law, slip, spec.follower)

    def _clutch(self, name: str, spec: schema.ClutchSpec) -> c.Clutch | None:
        if not self._couples(name, spec.terms, ("terms", tuple(spec.terms))):
            return None
        efforts = {"rad": "N*m", "m": "N"}
        self._context.has_unit(("constraints", name, "capacity"), *(efforts[unit] for unit in self._units(spec.terms)))
        law = ContactLaw() if spec.one_way else None
        return c.Clutch(name, dict(spec.terms), spec.capacity, spec.static, law)

    def _units(self, coordinates: Iterable[str]) -> list[str]:
        """The units that a sum of coordinates can have: factors may have dimensions where these differ."""
        known = self._context.coordinates
        return list(dict.fromkeys(known[name][1].unit for name in coordinates))

    def _couples(self, name: str, factors: Mapping[str, float], written: tuple[str, tuple[str, ...]]) -> bool:
        """Whether coordinates can be coupled with these factors; if not, problems are reported.

        :param written: see `_coupling`.
        """
        key, names = written
        where: Location = ("constraints", name, *([key] if key else []))
        before, valid = len(self._context.problems), True
        if len(set(names)) < len(names):
            self._context.report(where, f"couples '{names[0]}' with itself", "Name two joints.")
        for coordinate in dict.fromkeys(names):
            found = self._context.coordinate(where, coordinate)
            if found is None:
                valid = False
            elif found[0].kind.quaternion is not None and coordinate.rsplit(".", 1)[1].startswith("r"):
                message = f"{quoted(coordinate)} is a component of an angular velocity: it has no coordinate to couple"
                remedy = "Couple joints that rotate about an axis: revolute, universal, cylindrical, planar or screw."
                self._context.report(where, message, remedy)
            elif not factors[coordinate]:
                self._context.report((*where, coordinate), "has the factor 0", "Leave it out.")
        return valid and len(self._context.problems) == before


def contact_law(spec: schema.BoundedSpec | schema.CouplingSpec) -> ContactLaw | None:
    """The law of a constraint with a bound; None without one."""
    if spec.bound is None:
        return None
    friction = getattr(spec, "friction", None) or 0.0
    static = getattr(spec, "static_friction", None)
    return ContactLaw(spec.restitution or 0.0, friction, friction if static is None else static)


def rolling_law(spec: schema.RollingSpec) -> ContactLaw | None:
    """The law of rolling that can slip and lift off; None where it cannot."""
    if spec.friction is None and spec.restitution is None:
        return None
    friction = spec.friction or 0.0
    static = friction if spec.static_friction is None else spec.static_friction
    return ContactLaw(spec.restitution or 0.0, friction, static)
