"""Builds the contacts between shapes from their records in the file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

from mbd_sim.base.errors import InputError, listed, nearest, quoted
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.linear_algebra import product as matrix_product
from mbd_sim.files.builders.bodies.contact_bodies import edges, is_thin, round_body, slots_of, solid
from mbd_sim.files.builders.bodies.outlines import is_usable, planar_body
from mbd_sim.files.builders.bodies.parts import touching_shapes
from mbd_sim.files.builders.bodies.shapes import pose_of
from mbd_sim.files.builders.context import BuildContext, attachment
from mbd_sim.files.schema import shapes as schema
from mbd_sim.files.schema.constraints import ALL, ContactSpec
from mbd_sim.files.schema.file import PartSpec
from mbd_sim.files.schema.shapes import AnyShapeSpec
from mbd_sim.files.text.units import split_unit
from mbd_sim.mechanism.clusters import clustered
from mbd_sim.mechanism.elements.constraints import ContactLaw
from mbd_sim.mechanism.elements.contacts import (
    Ball,
    Barrel,
    Cam,
    ComplianceLaw,
    Contact,
    ContactBody,
    Face,
)
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.mechanism.touching import first_of, free_parts, neighbor_groups, welded
from mbd_sim.mechanism.values.names import reference
from mbd_sim.mechanism.values.source import Location


def build_contacts(
    specs: Mapping[str, ContactSpec], parts: Mapping[str, PartSpec], context: BuildContext
) -> tuple[Contact, ...]:
    """The contacts of a file; invalid ones are left out and reported to `context`."""
    builder = _ContactBuilder(parts, context)
    found = tuple(contact for name, spec in specs.items() for contact in builder.build(name, spec))
    _remark_on_repeated_pairs(found, context)
    return found


def _remark_on_repeated_pairs(contacts: Sequence[Contact], context: BuildContext) -> None:
    """Say which bodies several entries of the file name, all of which act."""
    owners: dict[frozenset[str], dict[str, None]] = {}
    for contact in contacts:
        if not isinstance(contact.second, Face | Cam):
            owners.setdefault(frozenset(contact.names), {})[contact.name] = None
    for pair, names in owners.items():
        if len(names) > 1:
            both, entries = (listed([quoted(name) for name in group]) for group in (sorted(pair), names))
            _add_remark(context, f"{both} touch in the contacts {entries}, which all act. Name each pair once.")


def _add_remark(context: BuildContext, text: str) -> None:
    if text not in context.source.remarks:
        context.source.remarks = (*context.source.remarks, text)


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
        slots = [slots_of(*pair[2:], spec.inside, isinstance(law, ComplianceLaw)) for pair in pairs]
        if isinstance(law, ComplianceLaw) and any(slots):
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
        if not found and self._all_known:
            self._context.report(place, "no two parts that are not neighbors have shapes", "Give a list of parts.")
        text = f"contacts.{where[1]}: shapes that cannot touch each other: {listed(list(unable))}."
        if unable:
            _add_remark(self._context, text)
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
        """An outline and another body; None, with a problem, if its shadow is not a chain of lines and arcs."""
        bodies: list[ContactBody] = []
        if any(isinstance(each.shape, schema.OutlineSpec) and not is_usable(each.shape) for each in (first, second)):
            return None
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
        elif is_thin(one) and is_thin(other):
            message = f"{first.name} and {second.name} have no thickness, so that they would pass through each other"
            self._context.report(where, message, "Give a rod a radius, or a block instead of a plate.")
        else:
            return one, other
        return None

    def _face(self, where: Location, spec: ContactSpec) -> Face | None:
        frame = self._context.frame((*where, "plane"), spec.plane or "ground")
        if frame is None:
            return None
        return Face(attachment(frame), matrix_product(frame[1].rotation, rot.unit(spec.normal)))

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
            for shape in self._solids(place, written):
                if not self._differ(place, shape.part, face.at.part):
                    break
                if isinstance(shape.shape, schema.OutlineSpec) and not is_usable(shape.shape):
                    continue
                for label, body in edges(shape.part, shape.shape):
                    quantity = " ".join(filter(None, (_word(shape.name), "on", _word(names), label)))
                    yield quantity, (shape.name, names), body, face

    def _on_cam(
        self, where: Location, spec: ContactSpec, cam: Cam
    ) -> Iterator[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        """Rollers and points on a cam."""
        assert spec.cam is not None
        for place, written in self._references(where, spec, cam.at.part):
            for shape in self._solids(place, written):
                if not self._differ(place, shape.part, cam.at.part):
                    break
                body = round_body(shape.part, shape.shape)
                if body is None:
                    message = f"{_article(shape.kind)} cannot be in contact with a cam"
                    self._context.report(place, message, "Give a sphere, cylinder, disc or point, or a 'plane'.")
                    break
                yield f"{_word(shape.name)} on {_word(spec.cam)}", (shape.name, spec.cam), body, cam

    def _references(self, where: Location, spec: ContactSpec, support: str) -> list[tuple[Location, str]]:
        """The places and the names of the parts that touch a support, a part or ground."""
        place: Location = (*where, "parts")
        if spec.parts != ALL:
            return [((*place, index), written) for index, written in enumerate(spec.parts or [])]
        names = free_parts(self._touching_parts(where, spec), self._context.valid_joints.values(), support)
        if not names and self._all_known:
            self._context.report(place, "no part with a shape can touch it", "Give parts shapes, or 'collisions'.")
        return [(place, reference(name)) for name in names]

    def _touching_parts(self, where: Location, spec: ContactSpec) -> list[str]:
        """The parts with shapes that can touch, but for those that are left out."""
        left_out = set(spec.without or ())
        for index, part in enumerate(spec.without or ()):
            if part not in self._names or part == GROUND:
                others = [name for name in self._names if name != GROUND]
                message, remedy = f"there is no part {quoted(part)}", nearest(part, others)
                self._context.report((*where, "without", index), message, remedy)
        return [
            name
            for name, part in self._parts.items()
            if name not in left_out and any(not one.hole for one in touching_shapes(part))
        ]

    @property
    def _all_known(self) -> bool:
        """Whether no part has problems of its own, because of which it is left out here."""
        return self._names.keys() <= {*self._parts, GROUND}

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


def contact_law(spec: ContactSpec) -> ContactLaw | ComplianceLaw:
    """What happens at the contact."""
    friction = spec.friction or 0.0
    if spec.stiffness is not None:
        return ComplianceLaw(spec.stiffness, spec.exponent, spec.damping, friction, spec.regularization)
    return ContactLaw(spec.restitution or 0.0, friction, spec.static_friction or friction)


def _quantity(first: _TouchingShape, second: _TouchingShape) -> str:
    return f"{_word(first.name)} on {_word(second.name)}"


def _word(reference: str) -> str:
    """A reference as one word of a name."""
    return reference.strip().replace(".", "_")


def _article(kind: str) -> str:
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"
