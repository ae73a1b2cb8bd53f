"""Joints between the parts of an assembly, from the faces that they share.

Each contact takes freedom from the relative motion of two parts: a shaft leaves the motion along and about its axis, a
ball all rotations, a plane sliding and turning on it. The joint is the one that has the freedom that is left. Planes
keep parts only in one direction, and those that touch both shoulders of a shaft in both: only then is it a hinge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.errors import counted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.imports.assembly import CadAssembly
from mbd_sim.imports.contacts import ANGLE, FaceContact, by_axis, contacts_of
from mbd_sim.mechanism.elements.joint_types import JointType
from mbd_sim.mechanism.values.names import unique_name

WORDS: dict[str, JointType] = {  # on the command line, besides the types of the file
    "hinge": "revolute",
    "slider": "prismatic",
    "ball": "spherical",
    "weld": "fixed",
}
OFFERED: tuple[JointType, ...] = ("revolute", "prismatic", "cylindrical", "spherical", "planar", "fixed")
NEED_AXIS: tuple[JointType, ...] = ("revolute", "prismatic", "cylindrical", "planar")
SMALL = 0.02  # of the largest, below which a singular value of the rows is zero; rad for inexact directions


def word_of(kind: JointType | None) -> str:
    """What users call a type of joint; `none` if there is none."""
    return next((word for word, found in WORDS.items() if found == kind), kind or "none")


Freedom = tuple[JointType | None, Array | None]  # the type, and the axis of what is left


@dataclass(frozen=True, eq=False)
class Candidate:
    """A joint that is offered between two parts, by its `number`, from 1.

    `type` is that of the freedom that the shared faces leave; None if no joint has it. `point` (3,) and `axis` (3,) are
    in the frame of the assembly; a ball has no axis. `why` says what the parts share.
    """

    number: int
    name: str
    parts: tuple[str, str]
    type: JointType | None
    point: Array
    axis: Array | None
    why: str


def candidates_of(assembly: CadAssembly, gap: float) -> list[Candidate]:
    """The joints between parts that touch, in the order of the parts.

    :param gap: the largest distance in m of surfaces that touch.
    """
    names, used, found = [part.name for part in assembly.parts], set[str](), list[Candidate]()
    for (one, other), contacts in contacts_of(assembly.parts, gap).items():
        parts = (names[one], names[other])
        name = unique_name(f"{parts[0]}_{parts[1]}", used)
        used.add(name)
        kind, point, axis = _joint_of(contacts, gap)
        found.append(Candidate(len(found) + 1, name, parts, kind, point, axis, _why(contacts, kind, axis, gap)))
    return found


def _joint_of(contacts: Sequence[FaceContact], gap: float) -> tuple[JointType | None, Array, Array | None]:
    """The type, the point and the axis of the joint that shared faces leave."""
    round_ones = [contact for contact in contacts if contact.kind != "plane"]
    planes = [contact for contact in contacts if contact.kind == "plane"]
    main = _main(round_ones, gap)
    middle = main.point if main is not None else np.mean([contact.point for contact in planes], axis=0)
    size = max([float(np.linalg.norm(contact.point - middle)) for contact in contacts] + [gap])
    rows = [row for contact in round_ones for row in _round_rows(contact, middle, size)]
    left = _left(rows)
    pinned = bool(round_ones) and all(contact.kind == "holes" for contact in round_ones)
    kept = [pinned or _keeps(plane, planes, left) for plane in planes]  # links whose pin is missing stay together
    counted_planes = [
        row for plane, keeps in zip(planes, kept, strict=True) for row in _plane_rows(plane, middle, size, keeps)
    ]
    kind, axis = _classified(_left([*rows, *counted_planes]))
    if kind is None or axis is None:
        axis = main.direction if main is not None and main.kind != "ball" else axis
    return kind, middle, None if axis is None else _tidy(axis)


def _main(contacts: Sequence[FaceContact], gap: float) -> FaceContact | None:
    """A contact at the middle of the longest axis, or of a ball."""
    with_axis = [contact for contact in contacts if contact.kind != "ball"]
    if not with_axis:
        return contacts[0] if contacts else None
    group = max(by_axis(with_axis, gap), key=lambda group: sum(contact.size for contact in group))
    first = group[0]
    along = [float((contact.point - first.point) @ first.direction) for contact in group]
    ends = [(s - 0.5 * c.size, s + 0.5 * c.size) for s, c in zip(along, group, strict=True)]
    middle = 0.5 * (min(low for low, _ in ends) + max(high for _, high in ends))
    point = first.point + middle * first.direction
    return FaceContact(first.kind, point, first.direction, first.radius, first.size, first.faces)


def _round_rows(contact: FaceContact, origin: Array, size: float) -> list[Array]:
    """The rows (6,) of velocity at `origin` and angular velocity times `size` that a round contact makes zero."""
    arm = (contact.point - origin) / size
    if contact.kind == "ball":
        return [_row(direction, arm) for direction in np.eye(3)]
    across = _across(contact.direction)
    return [*(_row(direction, arm) for direction in across), *(_turning(direction) for direction in across)]


def _plane_rows(plane: FaceContact, origin: Array, size: float, keeps: bool) -> list[Array]:
    """The rows of a plane, on which a part slides and turns, and which it does not leave if it `keeps`."""
    along = [_row(plane.direction, (plane.point - origin) / size)] if keeps else []
    return [*along, *(_turning(direction) for direction in _across(plane.direction))]


def _keeps(plane: FaceContact, planes: Sequence[FaceContact], left: Array) -> bool:
    """Whether a plane counts as a restriction in both directions along its normal.

    Without round faces it does: the part lies on it. A shaft that could move along the normal needs a second plane.
    """
    slides = bool(len(left) < 6 and np.max(np.abs(left[:, :3] @ plane.direction), initial=0.0) > 0.5)
    opposite = any(float(other.direction @ plane.direction) < -1.0 + ANGLE for other in planes)
    return not slides or opposite


def _row(direction: Array, arm: Array) -> Array:
    return np.concatenate([direction, np.cross(arm, direction)])


def _turning(direction: Array) -> Array:
    return np.concatenate([np.zeros(3), direction])


def _across(direction: Array) -> list[Array]:
    """Two unit vectors (3,) perpendicular to a direction and to each other."""
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first = first / np.linalg.norm(first)
    return [first, np.cross(direction, first)]


def _left(rows: Sequence[Array]) -> Array:
    """A basis (k, 6) of the motions that rows leave."""
    if not rows:
        return np.eye(6)
    _, values, vectors = np.linalg.svd(np.array(rows))
    rank = int(np.sum(values > SMALL * values[0]))
    left: Array = vectors[rank:]
    return left


def _classified(left: Array) -> Freedom:
    """The joint whose freedom is spanned by motions (k, 6): velocities at a point, and angular velocities."""
    if not len(left):
        return "fixed", None
    _, values, vectors = np.linalg.svd(left[:, 3:])
    turns = int(np.sum(values > SMALL))
    slides = _pure_slides(left)
    match (len(slides), turns):
        case (1, 0):
            return "prismatic", slides[0]
        case (0, 1):
            turn = vectors[0]
            return ("revolute", turn) if np.linalg.norm(left[0, :3]) < SMALL else (None, turn)
        case (1, 1) if abs(slides[0] @ vectors[0]) > 1.0 - SMALL:
            return "cylindrical", vectors[0]
        case (2, 1) if np.max(np.abs(slides @ vectors[0])) < SMALL:
            return "planar", vectors[0]
        case (0, 3):
            return "spherical", None
    return None, None


def _pure_slides(left: Array) -> Array:
    """An orthonormal basis (k, 3) of the translations among motions (n, 6)."""
    vectors, values, _ = np.linalg.svd(left[:, 3:])
    rank = int(np.sum(values > SMALL))
    slides: Array = vectors[:, rank:].T @ left[:, :3]
    return slides / np.linalg.norm(slides, axis=1)[:, None] if len(slides) else slides


def _tidy(axis: Array) -> Array:
    """A unit vector along an axis without round-off, whose largest component is positive."""
    axis = np.where(np.abs(axis) < 1e-9, 0.0, axis)
    axis = axis / np.linalg.norm(axis)
    first = int(np.argmax(np.abs(axis) > 0.99 * np.abs(axis).max()))
    return axis if axis[first] > 0.0 else 0.0 - axis


def _why(contacts: Sequence[FaceContact], kind: JointType | None, axis: Array | None, gap: float) -> str:
    """What two parts share, in words."""
    words = []
    for name in ("shaft", "holes"):
        of_kind = [contact for contact in contacts if contact.kind == name]
        groups = by_axis(of_kind, gap)
        for group in groups[:1]:
            what = "an axis" if name == "shaft" else "an axis of holes"
            words.append(f"{what} of radius {_millimeters(group[0].radius)}")
        if len(groups) > 1:
            words[-1] = f"{len(groups)} {'axes' if name == 'shaft' else 'axes of holes'}"
    if balls := [contact for contact in contacts if contact.kind == "ball"]:
        words.append(f"a ball of radius {_millimeters(balls[0].radius)}")
    planes = [contact for contact in contacts if contact.kind == "plane"]
    if planes:
        words.append(counted(len(planes), "plane"))
    text = f"share {' and '.join(words)}"
    if kind == "cylindrical" and axis is not None:
        kept = any(abs(plane.direction @ axis) > 1.0 - ANGLE for plane in planes)
        text += "; kept along it in one direction only" if kept else "; not kept along it"
    return text


def _millimeters(length: float) -> str:
    return f"{1e3 * length:.4g} mm"
