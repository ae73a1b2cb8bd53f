"""Builds the contacts between shapes from their records in the file.

The shapes of the parts become the bodies of the contacts: balls, rims, corners and convex bodies.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import assert_never

import numpy as np

from mbd_sim.base.errors import InputError, listed, nearest, quoted
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.batch import array
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.files.builders.clusters import clustered
from mbd_sim.files.builders.context import BuildContext, attachment
from mbd_sim.files.builders.outlines import planar_body, planar_face
from mbd_sim.files.builders.parts import hull_of, pose_of, touching_shapes
from mbd_sim.files.schema import shapes as schema
from mbd_sim.files.schema.constraints import ALL, ContactSpec
from mbd_sim.files.schema.file import PartSpec
from mbd_sim.files.schema.shapes import AnyShapeSpec
from mbd_sim.files.text.units import split_unit
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import (
    FIRST_RIM,
    LAST_RIM,
    Ball,
    Barrel,
    Cam,
    ConeBody,
    Contact,
    ContactBody,
    Curved,
    Cushion,
    EllipsoidBody,
    Face,
    PlanarBody,
    Rim,
    Solid,
)
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.mechanism.touching import first_of, free_parts, neighbor_groups, welded
from mbd_sim.mechanism.values.names import reference
from mbd_sim.mechanism.values.source import Location

SIDES = {-1: "-", 1: "+"}
BLOCK = (  # the faces of a block, whose corners are numbered by x, y, z
    (0, 1, 3, 2),
    (4, 6, 7, 5),
    (0, 4, 5, 1),
    (2, 3, 7, 6),
    (0, 2, 6, 4),
    (1, 5, 7, 3),
)
ACROSS = 1e-9  # cosine between the plane and the axis of an outline
MOST_SLOTS = 8  # of a pair: two faces with four corners each
ROUND_SLOTS = 6  # of a pair of cylinders, discs, rings or cones; two more with a solid, over whose edge they may lie


def edges(part: str, shape: schema.AnyShapeSpec | Pose) -> list[tuple[str, Ball | Rim | EllipsoidBody | PlanarBody]]:
    """What of a shape, or of a point, can touch a plane, each with a name: balls, rims, corners, tip and outline."""
    if isinstance(shape, Pose):
        return [("", Ball(Attachment(part, np.array(shape.position)), 0.0))]
    pose = pose_of(shape)

    def at(*offset: float) -> Attachment:
        return Attachment(part, pose.position + pose.rotation @ array(offset))

    def corners(*size: float) -> list[tuple[str, Ball | Rim | EllipsoidBody | PlanarBody]]:
        signs = [(-1, 1) if side else (1,) for side in size]
        return [
            (
                "corner "
                + "".join(SIDES[sign] + axis for sign, axis, side in zip(chosen, "xyz", size, strict=True) if side),
                Ball(at(*(0.5 * sign * side for sign, side in zip(chosen, size, strict=True))), 0.0),
            )
            for chosen in product(*signs)
        ]

    axis: Array = pose.rotation[:, 2]
    match shape:
        case schema.ParticleSpec():
            return [("", Ball(at(0.0, 0.0, 0.0), 0.0))]
        case schema.SphereSpec(radius=r):
            return [("", Ball(at(0.0, 0.0, 0.0), r))]
        case schema.RodSpec(start=start, end=end, radius=r):
            ends = (("from", start), ("to", end))
            return [(f"end {name}", Ball(Attachment(part, np.array(point)), r or 0.0)) for name, point in ends]
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r):
            return [("", Rim(at(0.0, 0.0, 0.0), axis, r))]
        case schema.CylinderSpec(radius=r, length=length):
            first, last = (at(0.0, 0.0, 0.5 * side * length) for side in (-1, 1))
            return [
                (FIRST_RIM.strip(), Rim(first, axis, r, length)),
                (LAST_RIM.strip(), Rim(last, axis, r, length, first=False)),
            ]
        case schema.ConeSpec(radius=r, length=length):
            base, tip = (at(0.0, 0.0, 0.5 * side * length) for side in (-1, 1))
            return [("", Rim(base, axis, r)), ("tip", Ball(tip, 0.0))]
        case schema.CapsuleSpec(radius=r, length=length):
            return [(f"end {SIDES[side]}", Ball(at(0.0, 0.0, 0.5 * side * length), r)) for side in SIDES]
        case schema.EllipsoidSpec(radii=radii):
            return [("", EllipsoidBody(at(0.0, 0.0, 0.0), pose.rotation, radii))]
        case schema.HullSpec():
            found, _ = hull_of(shape)
            return [(f"corner {number}", Ball(at(*corner), 0.0)) for number, corner in enumerate(found, start=1)]
        case schema.PlateSpec(size=(x, y)):
            return corners(x, y, 0.0)
        case schema.BlockSpec(size=(x, y, z)):
            return corners(x, y, z)
        case schema.OutlineSpec():
            return [("", planar_body(part, shape, pose, hollow=False))]
        case _:
            assert_never(shape)


def round_body(part: str, shape: schema.AnyShapeSpec | Pose) -> Ball | Barrel | None:
    """A shape, or a point, as a ball or a cylinder; None for others."""
    if isinstance(shape, Pose):
        return Ball(Attachment(part, np.array(shape.position)), 0.0)
    pose = pose_of(shape)
    center = Attachment(part, pose.position)
    match shape:
        case schema.ParticleSpec():
            return Ball(center, 0.0)
        case schema.SphereSpec(radius=r):
            return Ball(center, r)
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r):
            return Barrel(center, pose.rotation[:, 2], r, 0.0)
        case schema.CylinderSpec(radius=r, length=length):
            return Barrel(center, pose.rotation[:, 2], r, length)
        case (
            schema.RodSpec()
            | schema.PlateSpec()
            | schema.BlockSpec()
            | schema.ConeSpec()
            | schema.CapsuleSpec()
            | schema.EllipsoidSpec()
            | schema.HullSpec()
            | schema.OutlineSpec()
        ):
            return None
        case _:
            assert_never(shape)


def solid(part: str, shape: schema.AnyShapeSpec | Pose) -> Solid | Curved:
    """A shape, or a point, as a convex body."""
    if isinstance(shape, Pose):
        return polytope(part, [shape.position], (), 0.0)
    pose = pose_of(shape)

    def placed(*points: tuple[float, float, float]) -> list[Array]:
        return [pose.position + pose.rotation @ np.array(point) for point in points]

    match shape:
        case schema.ParticleSpec():
            return polytope(part, placed((0.0, 0.0, 0.0)), (), 0.0)
        case schema.SphereSpec(radius=r):
            return polytope(part, placed((0.0, 0.0, 0.0)), (), r)
        case schema.RodSpec(start=start, end=end, radius=r):
            return polytope(part, [np.array(start), np.array(end)], (), r or 0.0)
        case schema.PlateSpec(size=(x, y)):
            corners = [(0.5 * a * x, 0.5 * b * y, 0.0) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            return polytope(part, placed(*corners), ((0, 1, 2, 3), (3, 2, 1, 0)), 0.0)
        case schema.BlockSpec(size=(x, y, z)):
            signs = product((-1, 1), repeat=3)
            return polytope(part, placed(*((0.5 * a * x, 0.5 * b * y, 0.5 * c * z) for a, b, c in signs)), BLOCK, 0.0)
        case schema.CapsuleSpec(radius=r, length=length):
            return polytope(part, placed((0.0, 0.0, -0.5 * length), (0.0, 0.0, 0.5 * length)), (), r)
        case schema.HullSpec():
            points, faces = hull_of(shape)
            return polytope(part, placed(*points), faces, 0.0)
        case schema.DiscSpec(radius=r) | schema.RingSpec(radius=r):
            return Barrel(Attachment(part, pose.position), pose.rotation[:, 2], r, 0.0)
        case schema.CylinderSpec(radius=r, length=length):
            return Barrel(Attachment(part, pose.position), pose.rotation[:, 2], r, length)
        case schema.ConeSpec(radius=r, length=length):
            return ConeBody(Attachment(part, pose.position), pose.rotation[:, 2], r, length)
        case schema.EllipsoidSpec(radii=radii):
            return EllipsoidBody(Attachment(part, pose.position), pose.rotation, radii)
        case schema.OutlineSpec():
            raise ValueError("an outline touches in its plane")
        case _:
            assert_never(shape)


def polytope(part: str, points: Sequence[Array], faces: tuple[tuple[int, ...], ...], radius: float) -> Solid:
    """A convex body with these vertices (3,) in the frame of the part; for `faces` see `Solid`."""
    return Solid(Attachment(part, np.zeros(3)), np.array(points), faces, radius)


def build_contacts(
    specs: Mapping[str, ContactSpec], parts: Mapping[str, PartSpec], context: BuildContext
) -> tuple[Contact, ...]:
    """The contacts of a file; invalid ones are left out and reported to `context`."""
    builder = _ContactBuilder(parts, context)
    return tuple(contact for name, spec in specs.items() for contact in builder.build(name, spec))


@dataclass(frozen=True, eq=False)
class _TouchingShape:
    """A shape of a part, or a point without one, with its `name` in the mechanism."""

    part: str
    name: str
    shape: AnyShapeSpec | Pose

    @property
    def kind(self) -> str:
        return "point" if isinstance(self.shape, Pose) else self.shape.type


class _ContactBuilder:
    """Builds contacts one by one; problems are reported to the context."""

    def __init__(self, parts: Mapping[str, PartSpec], context: BuildContext) -> None:
        self._parts, self._context = parts, context
        points = context.points_by_part
        self._names = {name: known and dict.fromkeys(known) for name, known in points.items()}
        for name, spec in parts.items():
            self._names[name] = {**dict.fromkeys(_shape_names(touching_shapes(spec))), **dict.fromkeys(spec.points)}

    def build(self, name: str, spec: ContactSpec) -> list[Contact]:
        before = len(self._context.problems)
        where: Location = ("contacts", name)
        pairs: list[tuple[str, tuple[str, str], ContactBody, ContactBody]] = []
        if spec.between is not None:
            pairs += self._pairs(where, "between", list(spec.between), spec.inside)
        elif spec.among is not None:
            among = self._pairs_of_all(where, spec) if spec.among == ALL else None
            pairs += self._pairs(where, "among", list(spec.among), False) if among is None else among
        elif spec.plane is not None and (face := self._face(where, spec)) is not None:
            pairs += self._on_face(where, spec, face)
        elif spec.cam is not None and (cam := self._cam(where, spec)) is not None:
            pairs += self._on_cam(where, spec, cam)
        self._check_stiffness(where, spec)
        if len(self._context.problems) > before or not spec.active:
            return []
        law = contact_law(spec)
        slots = [slots_of(*pair[2:], spec.inside, isinstance(law, Cushion)) for pair in pairs]
        if isinstance(law, Cushion) and any(slots):
            message = (
                "only spheres, points, cylinders, discs and rings can have a 'stiffness' in contact with each other"
            )
            self._context.report((*where, "stiffness"), message, "Remove 'stiffness', or use spheres or a plane.")
            return []
        found = [Contact(name, *pair, law, spec.inside, own) for pair, own in zip(pairs, slots, strict=True)]
        if spec.parts is None or spec.plane is None or not isinstance(law, ContactLaw):
            return found
        return clustered(found, self._context.valid_joints.values(), welds=spec.parts == ALL)

    def _check_stiffness(self, where: Location, spec: ContactSpec) -> None:
        """Refuse a stiffness with a unit that does not fit the exponent."""
        if spec.stiffness is None or math.isnan(spec.exponent):
            return
        if spec.exponent.is_integer():
            self._context.has_unit((*where, "stiffness"), f"N/m**{spec.exponent:.0f}")
        elif split_unit(str(self._context.source.data["contacts"][where[1]]["stiffness"]))[1]:
            message = f"no unit stands for N/m^{spec.exponent:g}, that of the stiffness with this exponent"
            remedy = "Write it as a number without a unit, or add 'exponent: 1'."
            self._context.report((*where, "stiffness"), message, remedy)

    def _pairs(
        self, where: Location, key: str, references: list[str], inside: bool
    ) -> Iterator[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        """The pairs of all shapes of different parts in a list of references."""
        places = [(*where, key, index) for index in range(len(references))]
        solids = [
            self._solids(place, reference, inside and index == 1)
            for index, (place, reference) in enumerate(zip(places, references, strict=True))
        ]
        for (_, firsts), (index, seconds) in combinations(enumerate(solids), 2):
            if firsts and seconds and firsts[0].part == seconds[0].part:
                message = f"{quoted(firsts[0].part)} cannot be in contact with itself"
                self._context.report(places[index], message, "Name different parts.")
                continue
            for first, second in product(firsts, seconds):
                if (pair := self._round_pair(places[index], first, second, inside)) is not None:
                    yield _quantity(first, second), (first.name, second.name), *pair

    def _pairs_of_all(
        self, where: Location, spec: ContactSpec
    ) -> list[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        """The pairs of all parts that are not neighbors; a remark says which shapes cannot touch each other."""
        place: Location = (*where, "among")
        joints = list(self._context.valid_joints.values())
        neighbors = neighbor_groups(joints)
        groups, found = welded(joints), list[tuple[str, tuple[str, str], ContactBody, ContactBody]]()
        problems, unable = len(self._context.problems), dict[str, None]()
        for one, other in combinations(self._touching_parts(where, spec), 2):
            ends = first_of(groups, one), first_of(groups, other)
            if ends[0] == ends[1] or frozenset(ends) in neighbors:
                continue
            for first, second in product(self._solids(place, reference(one)), self._solids(place, reference(other))):
                if (pair := self._round_pair(place, first, second, False)) is not None:
                    found.append((_quantity(first, second), (first.name, second.name), *pair))
                else:
                    del self._context.problems[problems:]
                    unable[f"{first.name} and {second.name}"] = None
        if not found:
            self._context.report(place, "no two parts that are not neighbors have shapes", "Give a list of parts.")
        text = f"contacts.{where[1]}: shapes that cannot touch each other: {listed(list(unable))}."
        source = self._context.source
        if unable and text not in source.remarks:
            source.remarks = (*source.remarks, text)
        return found

    def _round_pair(
        self, where: Location, first: _TouchingShape, second: _TouchingShape, inside: bool
    ) -> tuple[ContactBody, ContactBody] | None:
        """Two round bodies as the records of a gap; None, with a problem, if they have none."""
        if any(isinstance(each.shape, schema.OutlineSpec) for each in (first, second)):
            return self._outline_pair(where, first, second, inside)
        bodies = [round_body(each.part, each.shape) for each in (first, second)]
        if bodies[0] is None or bodies[1] is None:
            return self._solid_pair(where, first, second, inside)
        one, other = bodies[0], bodies[1]
        if isinstance(one, Barrel) and isinstance(other, Ball):
            if inside:
                self._context.report(
                    where, f"a {second.kind} cannot enclose a {first.kind}", "Name the inner part first."
                )
                return None
            one, other = other, one
        if inside and not one.radius < other.radius:
            message = (
                f"the radius {one.radius:g} m of {first.name} is not less than {other.radius:g} m of {second.name}"
            )
            self._context.report(
                where, message, "The second part encloses the first: exchange them, or correct a radius."
            )
            return None
        if not inside and one.radius + other.radius == 0.0:
            self._context.report(where, "two points cannot touch", "Give one of them a shape with a radius.")
            return None
        return one, other

    def _outline_pair(
        self, where: Location, first: _TouchingShape, second: _TouchingShape, inside: bool
    ) -> tuple[ContactBody, ContactBody] | None:
        """An outline and another body; None, with a problem, for those whose shadow is no chain of lines and arcs."""
        bodies: list[ContactBody] = []
        for each in (first, second):
            encloses = inside and each is second
            if isinstance(each.shape, schema.OutlineSpec):
                bodies.append(planar_body(each.part, each.shape, pose_of(each.shape), encloses))
            elif encloses:
                message = f"{_article(each.kind)} cannot enclose an outline"
                self._context.report(where, message, "Name the inner part first.")
            elif isinstance(each.shape, schema.EllipsoidSpec):
                message = "an outline cannot be in contact with an ellipsoid"
                self._context.report(where, message, "Give it an outline of arcs, or another shape.")
            else:
                bodies.append(solid(each.part, each.shape))
        return (bodies[0], bodies[1]) if len(bodies) == 2 else None

    def _solid_pair(
        self, where: Location, first: _TouchingShape, second: _TouchingShape, inside: bool
    ) -> tuple[ContactBody, ContactBody] | None:
        """Two convex bodies; None, with a problem, if they cannot touch each other."""
        one, other = (solid(each.part, each.shape) for each in (first, second))
        if inside:
            message = f"{_article(second.kind)} cannot enclose {_article(first.kind)}"
            self._context.report(where, message, "Give the enclosing part several blocks, or remove 'inside'.")
        elif _is_thin(one) and _is_thin(other):
            message = f"{first.name} and {second.name} have no thickness, so that they would pass through each other"
            self._context.report(where, message, "Give a rod a radius, or a block instead of a plate.")
        else:
            return one, other
        return None

    def _face(self, where: Location, spec: ContactSpec) -> Face | None:
        frame = self._context.frame((*where, "plane"), spec.plane or "ground")
        if frame is None:
            return None
        return Face(attachment(frame), frame[1].rotation @ rot.unit(spec.normal))

    def _cam(self, where: Location, spec: ContactSpec) -> Cam | None:
        frame = self._context.frame((*where, "cam"), spec.cam or "")
        if frame is None or spec.profile is None:
            return None
        return Cam(attachment(frame), frame[1].rotation, spec.profile)

    def _on_face(
        self, where: Location, spec: ContactSpec, face: Face
    ) -> Iterator[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        """The corners, rims and balls of parts against a plane, or a cam."""
        names = spec.plane or "ground"
        if spec.cam is not None:
            cam = self._cam(where, spec)
            if cam is not None and self._differ((*where, "cam"), cam.at.part, face.at.part):
                yield f"{_word(spec.cam)} on {_word(names)}", (spec.cam, names), cam, face
            return
        for place, written in self._references(where, spec, face.at.part):
            for solid in self._solids(place, written):
                if not self._differ(place, solid.part, face.at.part):
                    break
                for label, body in edges(solid.part, solid.shape):
                    if isinstance(body, PlanarBody):
                        yield from self._outline_on_face(place, solid, body, names, face)
                        continue
                    quantity = " ".join(filter(None, (_word(solid.name), "on", _word(names), label)))
                    yield quantity, (solid.name, names), body, face

    def _outline_on_face(
        self, where: Location, shape: _TouchingShape, body: PlanarBody, names: str, face: Face
    ) -> Iterator[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        across = body.axes[:, 2]
        if abs(float(across @ face.normal)) > ACROSS:
            message = f"the plane does not cut that of the outline {shape.name!r} at a right angle"
            self._context.report(where, message, "Choose another 'normal', or the 'plane' of the outline.")
            return
        yield f"{_word(shape.name)} on {_word(names)}", (shape.name, names), body, planar_face(face, across)

    def _on_cam(
        self, where: Location, spec: ContactSpec, cam: Cam
    ) -> Iterator[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        """Rollers and points on a cam."""
        assert spec.cam is not None
        for place, written in self._references(where, spec, cam.at.part):
            for solid in self._solids(place, written):
                if not self._differ(place, solid.part, cam.at.part):
                    break
                body = round_body(solid.part, solid.shape)
                if body is None:
                    message = f"{_article(solid.kind)} cannot be in contact with a cam"
                    self._context.report(place, message, "Give a sphere, cylinder, disc or point, or a 'plane'.")
                    break
                yield f"{_word(solid.name)} on {_word(spec.cam)}", (solid.name, spec.cam), body, cam

    def _references(self, where: Location, spec: ContactSpec, support: str) -> list[tuple[Location, str]]:
        """The places and the names of the parts that touch a support, a part or ground."""
        place: Location = (*where, "parts")
        if spec.parts != ALL:
            return [((*place, index), reference) for index, reference in enumerate(spec.parts or [])]
        names = free_parts(self._touching_parts(where, spec), self._context.valid_joints.values(), support)
        if not names:
            self._context.report(place, "no part with a shape can touch it", "Give parts shapes, or 'collisions'.")
        return [(place, reference(name)) for name in names]

    def _touching_parts(self, where: Location, spec: ContactSpec) -> list[str]:
        """The parts with shapes that can touch, but for those that are left out."""
        left_out = set(spec.without or ())
        for index, part in enumerate(spec.without or ()):
            if part not in self._parts:
                message, remedy = f"there is no part {quoted(part)}", nearest(part, self._parts)
                self._context.report((*where, "without", index), message, remedy)
        return [
            name
            for name, part in self._parts.items()
            if name not in left_out and any(not one.hole for one in touching_shapes(part))
        ]

    def _differ(self, where: Location, one: str, other: str) -> bool:
        if one == other:
            self._context.report(where, f"{quoted(one)} cannot be in contact with itself", "Name different parts.")
        return one != other

    def _solids(self, where: Location, reference: str, enclosing: bool = False) -> list[_TouchingShape]:
        """The shapes that a reference names; empty, with a problem, if there are none.

        :param enclosing: prefer the holes of the part.
        """
        try:
            part, name = split_reference(reference, self._names, "shape or point")
        except InputError as error:
            self._context.problems.append(self._context.source.problem_of(where, error))
            return []
        spec = self._parts.get(part)
        shapes = [] if spec is None else touching_shapes(spec)
        names = _shape_names(shapes)
        if name in names and ((shape := shapes[names.index(name)]).name or spec is None or name not in spec.points):
            return [_TouchingShape(part, reference, shape)]
        if spec is None and part != GROUND:
            return []
        if name is not None:
            frame = self._context.frame(where, reference)
            return [] if frame is None else [_TouchingShape(part, reference, frame[1])]
        holes = [shape for shape in shapes if shape.hole]
        chosen = holes if enclosing and holes else [shape for shape in shapes if not shape.hole]
        if not chosen:
            self._context.report(where, f"{quoted(part)} has no shape", "Give it one, or name one of its points.")
        if len(chosen) == 1:
            return [_TouchingShape(part, part, chosen[0])]
        return [
            _TouchingShape(part, f"{part}.{name}", shape)
            for name, shape in zip(_shape_names(chosen), chosen, strict=True)
        ]


def _shape_names(shapes: Sequence[AnyShapeSpec]) -> list[str]:
    """The names of shapes; those without one are called by their places, from `shape1` or `hole1` on."""
    kinds = ["hole" if shape.hole else "shape" for shape in shapes]
    return [
        shape.name or f"{kind}{kinds[: place + 1].count(kind)}"
        for place, (shape, kind) in enumerate(zip(shapes, kinds, strict=True))
    ]


def _is_thin(body: Solid | Curved) -> bool:
    """Whether a body has no volume."""
    return body.thin if isinstance(body, Solid) else isinstance(body, Barrel) and body.length == 0.0


def slots_of(first: ContactBody, second: ContactBody, inside: bool, compliant: bool) -> int:
    """The number of points in which two bodies can touch with changing features; 0 if these never change."""
    if isinstance(first, PlanarBody) or isinstance(second, PlanarBody):
        return MOST_SLOTS  # fewer, once the plane is known
    static = inside or (compliant and isinstance(first, Barrel) and isinstance(second, Barrel))
    if static or isinstance(first, Ball | Rim | Cam) or isinstance(second, Ball | Face | Cam):
        return 0
    if isinstance(first, EllipsoidBody) or isinstance(second, EllipsoidBody):
        return 1
    if not isinstance(first, Solid) or not isinstance(second, Solid):
        vertices = [len(each.vertices) for each in (first, second) if isinstance(each, Solid)]
        return min([*vertices, ROUND_SLOTS + 2 * len(vertices)])
    fewest = min(len(first.vertices), len(second.vertices))
    corners = sum(max(map(len, each.faces), default=len(each.vertices)) for each in (first, second))
    return fewest if fewest <= 2 else min(corners, MOST_SLOTS)


def contact_law(spec: ContactSpec) -> ContactLaw | Cushion:
    """What happens at the contact."""
    friction = spec.friction or 0.0
    if spec.stiffness is not None:
        return Cushion(spec.stiffness, spec.exponent, spec.damping, friction, spec.regularization)
    return ContactLaw(spec.restitution or 0.0, friction, spec.static_friction or friction)


def _quantity(first: _TouchingShape, second: _TouchingShape) -> str:
    return f"{_word(first.name)} on {_word(second.name)}"


def _word(reference: str) -> str:
    """A reference as one word of a name."""
    return reference.strip().replace(".", "_")


def _article(kind: str) -> str:
    return f"a {kind}"
