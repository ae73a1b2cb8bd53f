"""The links and joints of a URDF, converted to parts and joints of a mechanism file.

Links have inertia, and shapes to draw; `<mimic>` becomes a coupling.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.base.errors import nearest, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.text.xml import Element, Reading, capsule, hull, placed, pose_of, rows, with_collisions
from mbd_sim.mechanism.mass_properties import inertia_defect
from mbd_sim.mechanism.values.names import is_name
from mbd_sim.mechanism.values.source import Location, Origin

MOMENTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}

Origins = dict[Location, Origin]


def part_of(reading: Reading, link: Element, key: str, colors: dict[str, str], origins: Origins) -> dict[str, Any]:
    """The part's record; the origins of its keys are added to `origins`."""
    part: dict[str, Any] = {"mass": 0.0}
    if inertial := link.first("inertial"):
        part |= _inertial(reading, inertial, f"{key}.inertial", origins)
    drawn = _shapes(reading, link, key, colors, origins)
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
        tensor = product(product(turn, tensor), turn.T)
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


def _shapes(reading: Reading, link: Element, key: str, colors: dict[str, str], origins: Origins) -> dict[str, Any]:
    """The meshes and shapes of the visual elements, and the shapes of the collision elements."""
    found: dict[str, list[tuple[dict[str, Any], Origin]]] = {"meshes": [], "shapes": [], "collisions": []}
    for tag in ("visual", "collision"):
        for element in link.all(tag):
            shape = _shape(reading, element, f"{key}.{tag}", link_key=key)
            if shape is None:
                continue
            if tag == "collision" and "file" in shape:
                shape = hull(shape)
            if color := _color(reading, element, f"{key}.{tag}", colors):
                shape["color"] = color
            kind = "collisions" if tag == "collision" else "meshes" if "file" in shape else "shapes"
            if shape.get("name") in {other.get("name") for other, _ in found[kind]}:
                shape.pop("name", None)
            found[kind].append((shape, reading.origin(element, f"{key}.{tag}")))
    if found["meshes"]:
        reading.leave_out("meshes, drawn and passed on to exported URDF", key)
    entries = with_collisions(found, lambda entry: str(entry[0].get("type")))
    origins |= {(kind, index): origin for kind, many in entries.items() for index, (_, origin) in enumerate(many)}
    return {kind: [shape for shape, _ in many] for kind, many in entries.items()}


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
        case "capsule":
            sizes = [reading.required(form, name, where) or 0.0 for name in ("radius", "length")]
            shape, pose = capsule(pose_of(*reading.pose(element, key)), *sizes), {}
        case _:
            reading.leave_out(f"{form.tag} shapes, which are not taken", link_key)
            return None
    if not sizes or None in shape.values():
        return None
    if min(sizes) <= 0.0:
        reading.leave_out("shapes without size, which are not taken", link_key)
        return None
    return shape | pose | ({"name": name} if is_name(name := element.attributes.get("name", "")) else {})


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


TYPES = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "planar": "planar",
    "floating": "free",
}
AXIAL = ("revolute", "continuous", "prismatic")
X = [1.0, 0.0, 0.0]  # URDF's axis where none is given


def joint_of(reading: Reading, joint: Element, key: str, origins: Origins) -> tuple[dict[str, Any], dict[str, Any]]:
    """The joint's record without `between`, and the keys that place its frame on the parent link."""
    kind = joint.attributes.get("type", "")
    if kind not in TYPES:
        message = f"unknown type {quoted(kind)}" if kind else "'type' is missing"
        reading.report(joint, f"{key}.type", message, nearest(kind, TYPES))
    record: dict[str, Any] = {"type": TYPES.get(kind, "fixed")}
    pose = placed(*reading.pose(joint, key))
    if kind in (*AXIAL, "planar"):
        record["axis"] = _axis(reading, joint, key, origins)
    if kind in AXIAL:
        record |= _limit(reading, joint, kind, key, origins) | _dynamics(reading, joint, key, origins)
    elif kind in ("planar", "floating"):
        for tag in ("limit", "dynamics"):
            if joint.first(tag):
                reading.leave_out(f"<{tag}> of {kind} joints", key)
    for tag in ("calibration", "safety_controller"):
        if joint.first(tag):
            reading.leave_out(f"<{tag}>", key)
    return record, pose


def _axis(reading: Reading, joint: Element, key: str, origins: Origins) -> list[float]:
    axis = joint.first("axis")
    if axis is None:
        return X
    origins[("axis",)] = reading.origin(axis, f"{key}.axis")
    xyz = reading.numbers(axis, "xyz", f"{key}.axis", 3)
    if xyz is not None and not any(xyz):
        reading.report(axis, f"{key}.axis.xyz", "must not be zero", "Write for example 0 0 1.", axis.attributes["xyz"])
        return X
    return xyz or X


LARGEST_ANGLE, FULL_TURN = 10.0, 360.0  # rad: limits between the two are probably meant in degrees


def _limit(reading: Reading, joint: Element, kind: str, key: str, origins: Origins) -> dict[str, Any]:
    limit = joint.first("limit")
    if limit is None:
        if kind != "continuous":
            reading.leave_out(f"{kind} joints without <limit>, taken as unlimited", key)
        return {}
    where = f"{key}.limit"
    record: dict[str, Any] = {}
    for name in ("limits", "effort_limit", "velocity_limit"):
        origins[(name,)] = reading.origin(limit, where)
    lower, upper = (reading.number(limit, name, where) or 0.0 for name in ("lower", "upper"))
    if kind != "continuous":
        if lower < upper:
            record["limits"] = {"lower": lower, "upper": upper}
        else:
            reading.leave_out_at("limits without a range between them, taken as unlimited", limit, key)
        if kind == "revolute" and any(LARGEST_ANGLE < abs(one) <= FULL_TURN for one in (lower, upper)):
            reading.leave_out("limits of revolute joints that look like degrees, taken as radians", key)
    for name in ("effort", "velocity"):
        value = reading.number(limit, name, where)
        if value is not None and value < 0.0:
            reading.report(limit, f"{where}.{name}", "must not be negative", "Write its size.", f"{value:g}")
        elif value:
            record[f"{name}_limit"] = value
        elif value == 0.0:
            reading.leave_out(f"{name} limits of 0, taken as unlimited", key)
    return record


def _dynamics(reading: Reading, joint: Element, key: str, origins: Origins) -> dict[str, Any]:
    dynamics = joint.first("dynamics")
    record: dict[str, Any] = {}
    if dynamics is None:
        return record
    where = f"{key}.dynamics"
    for name in ("damping", "friction"):
        origins[(name,)] = reading.origin(dynamics, where)
        value = reading.number(dynamics, name, where)
        if value is not None and value < 0.0:
            reading.report(dynamics, f"{where}.{name}", "must not be negative", "Write its size.", f"{value:g}")
        elif value:
            record[name] = value if name == "damping" else {"coulomb": value}
    return record


def mimic_of(
    reading: Reading, joint: Element, key: str, names: dict[str, str], kinds: dict[str, str]
) -> dict[str, Any] | None:
    """The coupling that a joint's `<mimic>` means: q = multiplier · q' + offset, with q' of the other joint.

    :param names: the name in the mechanism of each joint that is connected.
    :param kinds: the URDF type of every joint.
    """
    mimic = joint.first("mimic")
    if mimic is None:
        return None
    where, own, other = f"{key}.mimic", joint.attributes["name"], mimic.attributes.get("joint", "")
    if kinds[own] == "fixed":
        reading.leave_out("<mimic> of fixed joints", key)
        return None
    if other not in kinds:
        message = f"there is no joint {quoted(other)}" if other else "'joint' is missing"
        reading.report(mimic, f"{where}.joint", message, nearest(other, set(kinds) - {own}))
        return None
    if other not in names:
        return None  # its own problems are reported
    if other == own:
        reading.report(mimic, f"{where}.joint", "a joint cannot mimic itself", "Name another joint.", other)
        return None
    if unfit := [name for name in (own, other) if kinds[name] not in AXIAL]:
        remedy = f"Only {', '.join(AXIAL)} joints can."
        reading.report(mimic, where, f"{quoted(unfit[0])} has no single coordinate to mimic", remedy)
        return None
    multiplier, offset = (reading.number(mimic, name, where) for name in ("multiplier", "offset"))
    multiplier = 1.0 if multiplier is None else multiplier
    if multiplier == 0.0:
        message = "is 0, so this joint does not follow the other one"
        reading.report(
            mimic, f"{where}.multiplier", message, "Give a nonzero multiplier, or make it a fixed joint.", "0"
        )
        return None
    return {
        "type": "coupling",
        "terms": {names[own]: 1.0, names[other]: -multiplier},
        **({"value": offset} if offset else {}),
        "follower": names[own],
    }
