"""Builds the contacts between shapes from their records in the file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, product

from mbd_sim.errors import InputError, quoted
from mbd_sim.geometry import rotation as rot
from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.attachments import split_reference
from mbd_sim.mechanism.contacts import Ball, Barrel, Cam, Contact, ContactBody, Cushion, Face
from mbd_sim.mechanism.one_sided import ContactLaw
from mbd_sim.mechanism.records import GROUND
from mbd_sim.mechanism.source import Location
from mbd_sim.mechanism_file.builders.build_context import BuildContext, attachment
from mbd_sim.mechanism_file.builders.contact_shapes import edges, round_body
from mbd_sim.mechanism_file.builders.part_builder import shapes_of
from mbd_sim.mechanism_file.schema.contact_schema import ContactSpec
from mbd_sim.mechanism_file.schema.file_schema import PartSpec
from mbd_sim.mechanism_file.schema.shape_schema import AnyShapeSpec
from mbd_sim.mechanism_file.value_parser import split_unit


def build_contacts(
    specs: Mapping[str, ContactSpec], parts: Mapping[str, PartSpec], context: BuildContext
) -> tuple[Contact, ...]:
    """The contacts of a file; invalid ones are left out and reported to `context`."""
    builder = _ContactBuilder(parts, context)
    return tuple(contact for name, spec in specs.items() for contact in builder.build(name, spec))


@dataclass(frozen=True, eq=False)
class _Solid:
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
            shapes = dict.fromkeys(shape.name for shape in shapes_of(spec) if shape.name)
            self._names[name] = {**shapes, **dict.fromkeys(spec.points)}

    def build(self, name: str, spec: ContactSpec) -> list[Contact]:
        before = len(self._context.problems)
        where: Location = ("contacts", name)
        pairs: list[tuple[str, tuple[str, str], ContactBody, ContactBody]] = []
        if spec.between is not None:
            pairs += self._pairs(where, "between", list(spec.between), spec.inside)
        elif spec.among is not None:
            pairs += self._pairs(where, "among", spec.among, False)
        elif spec.plane is not None and (face := self._face(where, spec)) is not None:
            pairs += self._on_face(where, spec, face)
        elif spec.cam is not None and (cam := self._cam(where, spec)) is not None:
            pairs += self._on_cam(where, spec, cam)
        self._check_stiffness(where, spec)
        if len(self._context.problems) > before:
            return []
        law = contact_law(spec)
        return [Contact(name, *pair, law, spec.inside) for pair in pairs]

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

    def _round_pair(
        self, where: Location, first: _Solid, second: _Solid, inside: bool
    ) -> tuple[ContactBody, ContactBody] | None:
        """Two round bodies as the records of a gap; None, with a problem, if they have none."""
        bodies = [round_body(solid.part, solid.shape) for solid in (first, second)]
        if bodies[0] is None or bodies[1] is None:
            flat = first if bodies[0] is None else second
            message = (
                f"{_article(flat.kind)} cannot be in contact with {_article((second if flat is first else first).kind)}"
            )
            remedy = "Spheres, cylinders, discs, rings and points can be; blocks, plates and rods only with a plane."
            self._context.report(where, message, remedy)
            return None
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
        for index, reference in enumerate(spec.parts or []):
            place = (*where, "parts", index)
            for solid in self._solids(place, reference):
                if not self._differ(place, solid.part, face.at.part):
                    break
                for label, body in edges(solid.part, solid.shape):
                    quantity = " ".join(filter(None, (_word(solid.name), "on", _word(names), label)))
                    yield quantity, (solid.name, names), body, face

    def _on_cam(
        self, where: Location, spec: ContactSpec, cam: Cam
    ) -> Iterator[tuple[str, tuple[str, str], ContactBody, ContactBody]]:
        """Rollers and points on a cam."""
        assert spec.cam is not None
        for index, reference in enumerate(spec.parts or []):
            place = (*where, "parts", index)
            for solid in self._solids(place, reference):
                if not self._differ(place, solid.part, cam.at.part):
                    break
                body = round_body(solid.part, solid.shape)
                if body is None:
                    message = f"{_article(solid.kind)} cannot be in contact with a cam"
                    self._context.report(place, message, "Give a sphere, cylinder, disc or point, or a 'plane'.")
                    break
                yield f"{_word(solid.name)} on {_word(spec.cam)}", (solid.name, spec.cam), body, cam

    def _differ(self, where: Location, one: str, other: str) -> bool:
        if one == other:
            self._context.report(where, f"{quoted(one)} cannot be in contact with itself", "Name different parts.")
        return one != other

    def _solids(self, where: Location, reference: str, enclosing: bool = False) -> list[_Solid]:
        """The shapes that a reference names; empty, with a problem, if there are none.

        :param enclosing: prefer the holes of the part.
        """
        try:
            part, name = split_reference(reference, self._names, "shape or point")
        except InputError as error:
            self._context.problems.append(self._context.source.problem_of(where, error))
            return []
        spec = self._parts.get(part)
        shapes = [] if spec is None else shapes_of(spec)
        if named := [shape for shape in shapes if name and shape.name == name]:
            return [_Solid(part, reference, named[0])]
        if spec is None and part != GROUND:
            return []
        if name is not None:
            frame = self._context.frame(where, reference)
            return [] if frame is None else [_Solid(part, reference, frame[1])]
        holes = [shape for shape in shapes if shape.hole]
        chosen = holes if enclosing and holes else [shape for shape in shapes if not shape.hole]
        if not chosen:
            self._context.report(where, f"{quoted(part)} has no shape", "Give it one, or name one of its points.")
        if len(chosen) == 1:
            return [_Solid(part, part, chosen[0])]
        return [
            _Solid(part, f"{part}.{shape.name or f'shape{number}'}", shape)
            for number, shape in enumerate(chosen, start=1)
        ]


def contact_law(spec: ContactSpec) -> ContactLaw | Cushion:
    """What happens at the contact."""
    friction = spec.friction or 0.0
    if spec.stiffness is not None:
        return Cushion(spec.stiffness, spec.exponent, spec.damping, friction, spec.regularization)
    return ContactLaw(spec.restitution or 0.0, friction, spec.static_friction or friction)


def _quantity(first: _Solid, second: _Solid) -> str:
    return f"{_word(first.name)} on {_word(second.name)}"


def _word(reference: str) -> str:
    """A reference as one word of a name."""
    return reference.strip().replace(".", "_")


def _article(kind: str) -> str:
    return f"a {kind}"
