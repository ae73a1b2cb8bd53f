"""Equality constraints of a compiled MJCF: joints that close loops, and couplings of coordinates.

MuJoCo's equalities are soft; here they are exact.
"""

from __future__ import annotations

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import from_quaternion, unit
from mbd_sim.files.mjcf.compiled_model import polynomial, signed, weighted_sum
from mbd_sim.files.mjcf.parts import Frame, ModelParts
from mbd_sim.files.mjcf.tendons import Tendon

CONNECT, WELD, JOINT, TENDON = range(4)  # mjtEq
TORQUE_SCALE = 10  # its place in eq_data of a weld


def add_equalities(parts: ModelParts, tendons: list[Tendon]) -> None:
    """Add what the elements of `<equality>` mean."""
    model, m = parts.model, parts.model.m
    for index in range(m.neq):
        kind = int(m.eq_type[index])
        if model.disabled("EQUALITY"):
            model.leave_out("equalities, which are disabled", "equality", index)
        elif not m.eq_active0[index]:
            model.leave_out("equalities that are not active", "equality", index)
        elif kind == CONNECT or (kind == WELD and m.eq_data[index][TORQUE_SCALE] == 0.0):
            _close(parts, index, "spherical")
        elif kind == WELD:
            _close(parts, index, "fixed")
        elif kind == JOINT:
            _couple_joints(parts, index)
        elif kind == TENDON:
            _couple_tendons(parts, index, tendons)
        else:
            model.leave_out("equalities of flexes, which do not hold", "equality", index)


def _close(parts: ModelParts, index: int, kind: str) -> None:
    frames = _frames(parts, index)
    name = parts.model.name("equality", index) or ("connect" if kind == "spherical" else "weld")
    if frames[0].part == frames[1].part:
        parts.model.leave_out("equalities of a body with itself", "equality", index)
        return
    ends = [parts.point(frame.part, frame.pose, name) for frame in frames]
    parts.add("joints", "equality", index, name, {"type": kind, "between": ends, "cut": True})


def _frames(parts: ModelParts, index: int) -> tuple[Frame, Frame]:
    """The frames that coincide, in their parts."""
    m = parts.model.m
    first, second = int(m.eq_obj1id[index]), int(m.eq_obj2id[index])
    if int(m.eq_objtype[index]) == int(parts.model.mujoco.mjtObj.mjOBJ_SITE):
        return parts.sites[first], parts.sites[second]
    data, still = m.eq_data[index].copy(), np.eye(3)
    if int(m.eq_type[index]) == CONNECT:
        inner, outer = Pose(data[:3], still), Pose(data[3:6], still)
    else:
        inner, outer = Pose(data[3:6], from_quaternion(unit(data[6:10]))), Pose(data[:3], still)
    return Frame(parts.parts[first], inner), Frame(parts.parts[second], outer)


def _couple_joints(parts: ModelParts, index: int) -> None:
    m = parts.model.m
    joints = [joint for joint in (int(m.eq_obj1id[index]), int(m.eq_obj2id[index])) if joint >= 0]
    start = {joint: float(m.qpos0[m.jnt_qposadr[joint]]) for joint in joints}
    _add_coupling(parts, index, [({parts.joints[joint]: 1.0}, start[joint]) for joint in joints])


def _couple_tendons(parts: ModelParts, index: int, tendons: list[Tendon]) -> None:
    m = parts.model.m
    found = [tendons[tendon] for tendon in (int(m.eq_obj1id[index]), int(m.eq_obj2id[index])) if tendon >= 0]
    if len(found) == 1 and found[0].has_line:
        length = float(m.tendon_length0[found[0].index] + m.eq_data[index][0])
        record = {"type": "distance", "between": list(found[0].ends), "length": length}
        parts.add("constraints", "equality", index, parts.model.name("equality", index) or found[0].name, record)
    elif all(tendon.terms for tendon in found):
        sums = [(dict(tendon.terms), float(m.tendon_length0[tendon.index])) for tendon in found]
        _add_coupling(parts, index, sums)
    else:
        parts.model.leave_out("equalities of spatial tendons, which do not hold", "equality", index)


def _add_coupling(parts: ModelParts, index: int, sums: list[tuple[dict[str, float], float]]) -> None:
    """y - y₀ = Σ cᵢ (x - x₀)ⁱ for sums of coordinates y and x, which are y₀ and x₀ at the reference positions."""
    coefficients = parts.model.m.eq_data[index][:5].tolist()
    (terms, start), *others = sums
    value: float | str = start + coefficients[0]
    if others:
        inner, offset = others[0]
        if any(coefficients[2:]):
            shifted = f"({weighted_sum(inner, 'position')} - {signed(offset)})"
            value = f"{value!r} + {polynomial([0.0, *coefficients[1:]], shifted)}"
        else:
            value = start + coefficients[0] - coefficients[1] * offset
            for name, factor in inner.items():
                terms[name] = terms.get(name, 0.0) - coefficients[1] * factor
    terms = {name: factor for name, factor in terms.items() if factor}
    if not terms:
        parts.model.leave_out("equalities that constrain nothing", "equality", index)
        return
    record = {"type": "coupling", "terms": terms} | ({"value": value} if value else {})
    if len(terms) == 2 and int(parts.model.m.eq_type[index]) == JOINT:
        record["follower"] = next(iter(terms))  # the first joint, of which the polynomial gives the position
    wanted = parts.model.name("equality", index) or f"{next(iter(terms))}_equality"
    parts.add("constraints", "equality", index, wanted, record)
