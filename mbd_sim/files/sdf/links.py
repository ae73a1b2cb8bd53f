"""Links of an SDF as parts of a mechanism file, mass and inertia and shapes to draw, and the values of SDF elements."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.base.errors import quoted
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import from_quaternion, from_rpy, to_quaternion, unit
from mbd_sim.files.text.xml import NUMBER, Element, Reading, capsule, hull, rows, with_collisions
from mbd_sim.mechanism.mass_properties import MassProperties, inertia_defect
from mbd_sim.mechanism.values.names import is_name

PRODUCTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
READ = ("pose", "inertial", "visual", "collision", "sensor")  # elements of a link


def part_of(values: Values, link: Element, key: str) -> dict[str, Any]:
    """The record of a part. A link without `<inertial>` has 1 kg and 1 kg·m², as in the specification."""
    inertial = link.first("inertial")
    if inertial is None:
        values.reading.leave_out_at("links without <inertial>, which have 1 kg and 1 kg·m² in SDF", link, key)
        part: dict[str, Any] = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}
    else:
        part = _inertial(values, inertial, f"{key}.inertial")
    part |= _shapes(values, link, key)
    for element in link.children:
        neutral = element.tag in ("self_collide", "must_be_base_link")
        switched_on = element.tag == "gravity" and values.flag(link, "gravity", key)
        if element.tag not in READ and not neutral and not switched_on:
            values.reading.leave_out_at(f"<{element.tag}> of links", element, key)
    return part


def _inertial(values: Values, inertial: Element, key: str) -> dict[str, Any]:
    if inertial.attributes.get("auto", "false") in ("true", "1"):
        message = "an inertia that follows from the collision shapes is not computed"
        values.reading.report(inertial, f"{key}.auto", message, "Give <mass> and <inertia>.")
    mass = values.number_from_zero(inertial, "mass", key, 1.0)
    tensor, element = np.eye(3), inertial.first("inertia")
    for name, index in PRODUCTS.items() if element is not None else ():
        assert element is not None
        otherwise = 1.0 if index[0] == index[1] else 0.0
        tensor[index] = tensor[index[::-1]] = values.number(element, name, f"{key}.inertia", otherwise)
    body = MassProperties(mass, np.zeros(3), tensor).placed(values.pose(inertial, key))
    tensor = 0.5 * (body.inertia + body.inertia.T)
    part: dict[str, Any] = {"mass": mass} | ({"center": rows(body.center)} if np.any(body.center) else {})
    diagonal = not np.any(tensor - np.diag(np.diag(tensor)))
    named = {name[1:]: float(tensor[index]) for name, index in PRODUCTS.items()}
    part["inertia"] = rows(np.diag(tensor)) if diagonal else named
    if inertia_defect(tensor) or not mass:
        values.reading.leave_out_at("inertia that no rigid body can have, used as given", inertial, key)
        part["inertia_check"] = False
    return part


def _shapes(values: Values, link: Element, key: str) -> dict[str, list[dict[str, Any]]]:
    """The meshes and shapes of the visual elements, and the shapes of the collision elements."""
    found: dict[str, list[dict[str, Any]]] = {"meshes": [], "shapes": [], "collisions": []}
    for element in link.all("visual"):
        if (entry := _shape(values, element, f"{key}.visual")) is not None:
            found[entry[0]].append(entry[1])
    for number, element in enumerate(link.all("collision"), start=1):
        if element.first("geometry") is None:
            values.reading.leave_out_at("<collision> without a shape", element, key)
        elif plane_of(element) is None and (entry := _shape(values, element, f"{key}.collision")) is not None:
            shape = hull(entry[1]) if entry[0] == "meshes" else entry[1]
            found["collisions"].append(shape | {"name": collision_name(element, number)})
    return with_collisions(found, lambda shape: str(shape.get("type")))


def collision_name(collision: Element, number: int) -> str:
    """The name of the shape of a collision element, which is the one of this number in its link."""
    name = collision.attributes.get("name", "")
    return name if is_name(name) else f"collision_{number}"


def plane_of(collision: Element) -> Element | None:
    """The plane of a collision element, if it has one."""
    geometry = collision.first("geometry")
    return None if geometry is None else geometry.first("plane")


def _shape(values: Values, element: Element, key: str) -> tuple[str, dict[str, Any]] | None:
    geometry = element.first("geometry")
    form = geometry.children[0] if geometry is not None and geometry.children else None
    if form is None:
        return None
    pose, where = values.pose(element, key), f"{key}.{form.tag}"
    record: dict[str, Any]
    match form.tag:
        case "mesh":
            scale = values.numbers(form, "scale", where, 3)
            record = {"file": values.text(form, "uri")} | ({"scale": scale} if scale else {})
            return ("meshes", record | _placed(pose)) if record["file"] else None
        case "box":
            record = {"type": "block", "size": values.numbers(form, "size", where, 3) or [1.0, 1.0, 1.0]}
        case "sphere":
            record = {"type": "sphere", "radius": values.number(form, "radius", where, 1.0)}
        case "ellipsoid":
            record = {"type": "ellipsoid", "radii": values.numbers(form, "radii", where, 3) or [1.0, 1.0, 1.0]}
        case "cylinder":
            record = {
                "type": "cylinder",
                "radius": values.number(form, "radius", where, 1.0),
                "length": values.number(form, "length", where, 1.0),
            }
        case "capsule":
            record = capsule(pose, values.number(form, "radius", where, 0.5), values.number(form, "length", where, 1.0))
            return ("shapes", record | _color(values, element, key)) if record["radius"] > 0.0 else None
        case _:
            values.reading.leave_out_at(f"{form.tag} shapes, which are not taken", element, key)
            return None
    sizes = [
        *record.get("size", ()),
        *record.get("radii", ()),
        *(record[name] for name in ("radius", "length") if name in record),
    ]
    if min(sizes) <= 0.0:
        values.reading.leave_out_at("shapes without size, which are not taken", element, key)
        return None
    return "shapes", record | _placed(pose) | _color(values, element, key)


def _placed(pose: Pose) -> dict[str, Any]:
    return ({"at": rows(pose.position)} if np.any(pose.position) else {}) | rotated(pose)


def rotated(pose: Pose) -> dict[str, Any]:
    """The key `rotate` of a pose, if it needs one."""
    return {"rotate": {"quaternion": rows(to_quaternion(pose.rotation))}} if np.any(pose.rotation != np.eye(3)) else {}


def _color(values: Values, element: Element, key: str) -> dict[str, Any]:
    material = element.first("material")
    diffuse = None if material is None else material.first("diffuse")
    if diffuse is not None and len(diffuse.text.split()) not in (3, 4):
        values.reading.leave_out_at("colors without three or four numbers, with which nothing is drawn", diffuse, key)
        return {}
    numbers = None if diffuse is None else values.numbers_in(diffuse, f"{key}.material.diffuse", 3, 4)
    if numbers is None or not all(map(math.isfinite, numbers)):
        return {}
    return {"color": "#" + "".join(f"{round(255.0 * min(max(value, 0.0), 1.0)):02x}" for value in numbers[:3])}


UNLIMITED = 1e15  # limits from here on stand for none
INFINITE = {"inf": math.inf, "+inf": math.inf, "-inf": -math.inf, "infinity": math.inf, "-infinity": -math.inf}


class Values:
    """Values of elements inside others; what is wrong is reported."""

    def __init__(self, reading: Reading, version: str) -> None:
        """:param version: of the file, unless a model is included from another one."""
        self.reading, self.version = reading, version

    def text(self, element: Element, tag: str, otherwise: str = "") -> str:
        """The text of the first element with a tag."""
        found = element.first(tag)
        return otherwise if found is None else found.text.strip()

    def flag(self, element: Element, tag: str, key: str) -> bool:
        """Whether it is true; false if it is missing."""
        word = self.text(element, tag, "false")
        if word not in ("true", "false", "1", "0"):
            self.reading.report(
                element.first(tag) or element, f"{key}.{tag}", "unknown word", "Write true or false.", word
            )
        return word in ("true", "1")

    def numbers_in(self, element: Element, key: str, *counts: int) -> list[float] | None:
        """The numbers in the text of an element; None, with a problem, if they are not as many as one of `counts`."""
        words = element.text.split()
        if wrong := [word for word in words if not NUMBER.fullmatch(word) and word.lower() not in INFINITE]:
            self.reading.report(element, key, f"{quoted(wrong[0])} is not a number", "Write plain numbers.")
        elif len(words) not in counts:
            wanted = " or ".join(map(str, counts))
            self.reading.report(element, key, f"has {len(words)} numbers", f"Write {wanted}, separated by spaces.")
        else:
            return [INFINITE[word.lower()] if word.lower() in INFINITE else float(word) + 0.0 for word in words]
        return None

    def numbers(self, element: Element, tag: str, key: str, count: int) -> list[float] | None:
        """The finite numbers of the first element with a tag; None if it is missing or wrong."""
        found = element.first(tag)
        numbers = None if found is None else self.numbers_in(found, f"{key}.{tag}", count)
        if found is not None and numbers and not all(map(math.isfinite, numbers)):
            self.reading.report(found, f"{key}.{tag}", "must be finite", "Write a number.")
            return None
        return numbers

    def number(self, element: Element, tag: str, key: str, otherwise: float = 0.0) -> float:
        """The finite number of the first element with a tag; `otherwise` if it is missing or wrong."""
        numbers = self.numbers(element, tag, key, 1)
        return numbers[0] if numbers else otherwise

    def number_from_zero(self, element: Element, tag: str, key: str, otherwise: float = 0.0) -> float:
        """The number of the first element with a tag, where negative numbers have no meaning."""
        value = self.number(element, tag, key, otherwise)
        if value < 0.0:
            self.reading.report(
                element.first(tag) or element, f"{key}.{tag}", "must not be negative", "Write its size."
            )
            return otherwise
        return value

    def bound(self, element: Element, tag: str, key: str, otherwise: float) -> float:
        """A limit, infinite if it stands for none."""
        found = element.first(tag)
        numbers = None if found is None else self.numbers_in(found, f"{key}.{tag}", 1)
        value = numbers[0] if numbers else otherwise
        return math.copysign(math.inf, value) if abs(value) >= UNLIMITED else value

    def pose(self, element: Element, key: str) -> Pose:
        """The pose in the element's `<pose>`: position, and roll, pitch, yaw or a quaternion (x, y, z, w)."""
        found = element.first("pose")
        if found is None or not found.text.strip():
            return identity_pose()
        where = f"{key}.pose"
        if found.attributes.get("rotation_format", "euler_rpy") == "quat_xyzw":
            numbers = self.numbers_in(found, where, 7)
            if numbers is None or not any(numbers[3:]):
                if numbers:
                    self.reading.report(found, where, "has a quaternion of 0", "Write for example 0 0 0 1.")
                return identity_pose()
            x, y, z, w = numbers[3:]
            return Pose(np.array(numbers[:3]), from_quaternion(unit([w, x, y, z])))
        numbers = self.numbers_in(found, where, 6)
        if numbers is None:
            return identity_pose()
        scale = math.pi / 180.0 if found.attributes.get("degrees") in ("true", "1") else 1.0
        return Pose(np.array(numbers[:3]), from_rpy(*(scale * angle for angle in numbers[3:])))


def direction(numbers: list[float] | None) -> Array:
    """A unit vector (3,); z if there is none."""
    return np.array([0.0, 0.0, 1.0]) if numbers is None else unit(numbers)
