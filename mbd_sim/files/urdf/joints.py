"""Converts URDF joints to joints of a mechanism file, and `<mimic>` to couplings."""

from __future__ import annotations

from typing import Any

from mbd_sim.base.errors import nearest, quoted
from mbd_sim.files.text.xml import Element, Reading, placed
from mbd_sim.files.urdf.links import Origins

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
        if lower > upper:
            message = f"lower {lower:g} is above upper {upper:g}"
            reading.report(limit, where, message, "Swap them.")
        elif lower == upper:
            reading.leave_out("limits without a range between them, taken as unlimited", key)
        else:
            record["limits"] = {"lower": lower, "upper": upper}
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
