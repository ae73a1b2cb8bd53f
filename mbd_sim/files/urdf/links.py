"""Converts URDF links to parts of a mechanism file: inertia, and shapes to draw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.text.xml import Element, Reading, placed, pose_of, rows
from mbd_sim.mechanism.mass_properties import inertia_defect
from mbd_sim.mechanism.values.source import Location, Origin

MOMENTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}

Origins = dict[Location, Origin]


def part_of(reading: Reading, link: Element, key: str, colors: dict[str, str], origins: Origins) -> dict[str, Any]:
    """The part's record; the origins of its keys are added to `origins`."""
    part: dict[str, Any] = {"mass": 0.0}
    if inertial := link.first("inertial"):
        part |= _inertial(reading, inertial, f"{key}.inertial", origins)
    drawn = _drawn(reading, link, key, colors, origins)
    if "shapes" in drawn:
        part.setdefault("inertia", [0.0, 0.0, 0.0])  # given, so that shapes are only drawn
    return part | drawn


def _inertial(reading: Reading, inertial: Element, key: str, origins: Origins) -> dict[str, Any]:
    xyz, rpy = reading.pose(inertial, key)
    mass, inertia = inertial.first("mass"), inertial.first("inertia")
    for name, element in (("mass", mass), ("inertia", inertia)):
        if element is None:
            reading.report(inertial, key, f"<{name}> is missing", "Add it, or remove <inertial>.")
    value = reading.required(mass, "value", f"{key}.mass") if mass else None
    if mass and value is not None and value < 0.0:
        reading.report(mass, f"{key}.mass.value", "must be at least 0", "Write 0 or a positive mass.", f"{value:g}")
    tensor = _moments(reading, inertia, f"{key}.inertia") if inertia else np.zeros((3, 3))
    if mass is None or inertia is None or not (value or np.any(tensor)):
        return {}
    if any(rpy):
        turn = pose_of(xyz, rpy).rotation
        tensor = turn @ tensor @ turn.T
        tensor = 0.5 * (tensor + tensor.T)
    origins |= {
        ("mass",): reading.origin(mass, f"{key}.mass"),
        ("center",): reading.origin(inertial, key),
        ("inertia",): reading.origin(inertia, f"{key}.inertia"),
    }
    record = {"mass": value or 0.0} | ({"center": xyz} if any(xyz) else {}) | {"inertia": _tensor(tensor)}
    defect = (
        "inertia without mass" if not value else "inertia that no rigid body can have" if inertia_defect(tensor) else ""
    )
    if defect:
        reading.leave_out(f"{defect}, used as given", key.removesuffix(".inertial"))
        record["inertia_check"] = False
    return record


def _moments(reading: Reading, inertia: Element, key: str) -> Array:
    tensor = np.zeros((3, 3))
    for name, index in MOMENTS.items():
        read = reading.required if index[0] == index[1] else reading.number  # products are optional
        tensor[index] = tensor[index[::-1]] = read(inertia, name, key) or 0.0
    return tensor


def _tensor(tensor: Array) -> Any:
    if not np.any(tensor - np.diag(np.diag(tensor))):
        return rows(np.diag(tensor))
    return {name[1:]: float(tensor[index]) for name, index in MOMENTS.items()}


def _drawn(reading: Reading, link: Element, key: str, colors: dict[str, str], origins: Origins) -> dict[str, Any]:
    """The meshes and the shapes of the visual elements, or else the shapes of the collision elements."""
    drawn: dict[str, list[dict[str, Any]]] = {"meshes": [], "shapes": []}
    for tag in ("visual", "collision"):
        for element in link.all(tag):
            shape = _shape(reading, element, f"{key}.{tag}", link_key=key)
            if shape is None or (tag == "collision" and "file" in shape):
                continue
            if color := _color(reading, element, f"{key}.{tag}", colors):
                shape["color"] = color
            kind = "meshes" if "file" in shape else "shapes"
            origins[(kind, len(drawn[kind]))] = reading.origin(element, f"{key}.{tag}")
            drawn[kind].append(shape)
        if drawn["shapes"]:
            break
    if drawn["meshes"]:
        reading.leave_out("meshes, drawn and passed on to exported URDF", key)
    return {kind: shapes for kind, shapes in drawn.items() if shapes}


def _shape(reading: Reading, element: Element, key: str, link_key: str) -> dict[str, Any] | None:
    geometry = element.first("geometry")
    if geometry is None or not geometry.children:
        reading.report(
            geometry or element, key, "has no shape in its <geometry>", f"Add one, or remove <{element.tag}>."
        )
        return None
    form = geometry.children[0]
    where = f"{key}.{form.tag}"
    pose = placed(*reading.pose(element, key))
    match form.tag:
        case "mesh":
            return _mesh(reading, form, where, pose)
        case "box":
            if "size" not in form.attributes:
                reading.report(form, where, "'size' is missing", "Add it.")
            size = reading.numbers(form, "size", where, 3)
            shape: dict[str, Any] = {"type": "block", "size": size}
            sizes = size or []
        case "cylinder" | "sphere":
            keys = ("radius", "length") if form.tag == "cylinder" else ("radius",)
            found = {name: reading.required(form, name, where) for name in keys}
            shape = {"type": form.tag, **found}
            sizes = [value for value in found.values() if value is not None]
        case _:
            reading.leave_out(f"{form.tag} shapes, which are not drawn", link_key)
            return None
    if not sizes or None in shape.values():
        return None
    if min(sizes) <= 0.0:
        reading.leave_out("shapes without size, which are not drawn", link_key)
        return None
    return shape | pose


def _mesh(reading: Reading, form: Element, key: str, pose: dict[str, Any]) -> dict[str, Any] | None:
    if not form.attributes.get("filename"):
        reading.report(form, key, "'filename' is missing", "Add it.")
        return None
    scale = reading.numbers(form, "scale", key, 3)
    return {"file": form.attributes["filename"]} | ({"scale": scale} if scale else {}) | pose


def _color(reading: Reading, element: Element, key: str, colors: dict[str, str]) -> str | None:
    material = element.first("material")
    if material is None:
        return None
    return color_of(reading, material, f"{key}.material") or colors.get(material.attributes.get("name", ""))


def color_of(reading: Reading, material: Element, key: str) -> str | None:
    """The color of a material as #rrggbb; None if it only refers to another material by its name."""
    color = material.first("color")
    if color is None:
        return None
    if len(color.attributes.get("rgba", "").split()) not in (0, 4):
        reading.leave_out_at("colors without four numbers, with which nothing is drawn", color, f"{key}.color")
        return None
    rgba = reading.numbers(color, "rgba", f"{key}.color", 4)
    if rgba is None:
        return None
    if not all(0.0 <= value <= 1.0 for value in rgba):
        remedy = "Write red, green, blue and alpha from 0 to 1, such as 0.5 0.5 0.5 1."
        reading.report(color, f"{key}.color.rgba", "is not a color", remedy, color.attributes["rgba"])
        return None
    return "#" + "".join(f"{math.floor(255.0 * value + 0.5):02x}" for value in rgba[:3])
