"""Tendons and equality constraints of a compiled MJCF.

A fixed tendon has the length Σ c q. Its spring becomes a potential, its damper an effort on each coordinate, and its
friction a friction clutch. A spatial tendon between two sites becomes a spring, and its range a rope and a strut.
Equalities, which are soft in MuJoCo and exact here, become joints that close loops, and couplings of coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.geometry.rotation import from_quaternion, unit
from mbd_sim.files.mjcf.compiled_model import odd_polynomial, polynomial, signed, weighted_sum
from mbd_sim.files.mjcf.parts import ModelParts
from mbd_sim.mechanism.elements.parts import PartFrame

JOINT, SITE = 1, 3  # mjtWrap


@dataclass(frozen=True, eq=False)
class Tendon:
    """A tendon: the `terms` of a fixed one; or the `frames` and the points, `ends`, of the sites of a spatial one."""

    index: int
    name: str
    terms: Mapping[str, float]
    frames: tuple[PartFrame, ...] = ()
    ends: tuple[str, ...] = ()

    @property
    def has_line(self) -> bool:
        """Whether it is a straight line between two parts."""
        return len(self.frames) == 2 and self.frames[0].part != self.frames[1].part


def tendon_of(parts: ModelParts, index: int) -> Tendon:
    """A tendon; one with pulleys or around geoms has neither terms nor ends, and is noted."""
    m, model = parts.model.m, parts.model
    name = model.name("tendon", index) or f"tendon_{index + 1}"
    path = range(int(m.tendon_adr[index]), int(m.tendon_adr[index] + m.tendon_num[index]))
    kinds = {int(m.wrap_type[place]) for place in path}
    if kinds == {JOINT}:
        # MuJoCo refuses a joint that is repeated
        terms = {parts.joints[int(m.wrap_objid[place])]: float(m.wrap_prm[place]) for place in path}
        return Tendon(index, name, {own: factor for own, factor in terms.items() if factor})
    if kinds != {SITE}:
        model.leave_out("tendons around geoms or over pulleys, which exert no force", "tendon", index)
        return Tendon(index, name, {})
    frames = tuple(parts.sites[int(m.wrap_objid[place])] for place in path)
    return Tendon(
        index, name, {}, frames, tuple(parts.point(frame.part, frame.pose, f"{name}_end") for frame in frames)
    )


def add_tendon(parts: ModelParts, tendon: Tendon) -> None:
    """Add the forces and the range of a tendon."""
    model, m, index = parts.model, parts.model.m, tendon.index
    stiffness = [float(m.tendon_stiffness[index]), *m.tendon_stiffnesspoly[index].tolist()]
    damping = [float(m.tendon_damping[index]), *m.tendon_dampingpoly[index].tolist()]
    friction = float(m.tendon_frictionloss[index])
    stiffness = [0.0] if model.disabled("SPRING") else stiffness
    damping = [0.0] if model.disabled("DAMPER") else damping
    friction = 0.0 if model.disabled("FRICTIONLOSS") else friction
    if m.tendon_armature[index] and len(tendon.terms) != 1:
        model.leave_out("armature of tendons, whose inertia is missing", "tendon", index)
    if m.tendon_plasticadr[index] >= 0:
        model.leave_out("springyield of tendons, whose springs stay elastic here", "tendon", index)
    if tendon.terms:
        _add_sum(parts, tendon, stiffness, damping)
        if friction:
            record = {"type": "clutch", "terms": dict(tendon.terms), "capacity": friction}
            parts.add("constraints", "tendon", index, f"{tendon.name}_friction", record)
    elif tendon.has_line:
        _add_line(parts, tendon, stiffness, damping)
        if friction:
            model.leave_out("friction of spatial tendons, which is missing", "tendon", index)
    elif tendon.frames and any((*stiffness, *damping, friction)) and len(tendon.frames) > 2:
        sentence = "stiffness, damping and friction of tendons over more than two sites, which are missing"
        model.leave_out(sentence, "tendon", index)
    if m.tendon_limited[index] and not model.disabled("LIMIT"):
        _add_range(parts, tendon)


def _rest(parts: ModelParts, tendon: Tendon) -> list[float]:
    """The length between whose bounds the spring is slack; one number if they are equal."""
    lower, upper = parts.model.m.tendon_lengthspring[tendon.index].tolist()
    return [lower] if lower == upper else [lower, upper]


def _slack(length: str, rest: list[float]) -> str:
    """How much longer or shorter than its rest length a spring is."""
    if len(rest) == 1:
        return f"{length} - {signed(rest[0])}"
    return f"min(0, {length} - {signed(rest[0])}) + max(0, {length} - {signed(rest[1])})"


def _add_sum(parts: ModelParts, tendon: Tendon, stiffness: list[float], damping: list[float]) -> None:
    if any(stiffness):
        longer = f"({_slack(weighted_sum(tendon.terms, 'position'), _rest(parts, tendon))})"
        energy = polynomial([0.0, 0.0, *(k / (power + 2) for power, k in enumerate(stiffness))], longer)
        parts.add("forces", "tendon", tendon.index, tendon.name, {"type": "potential", "energy": energy})
    if any(damping):
        force = odd_polynomial(damping, f"({weighted_sum(tendon.terms, 'velocity')})")
        for name, factor in tendon.terms.items():
            record = {"type": "effort", "coordinate": name, "effort": f"{signed(-factor)}*({force})"}
            parts.add("forces", "tendon", tendon.index, f"{tendon.name}_damper_{name}", record)


def _add_line(parts: ModelParts, tendon: Tendon, stiffness: list[float], damping: list[float]) -> None:
    rest, between = _rest(parts, tendon), list(tendon.ends)
    record: dict[str, Any] = {"type": "spring", "between": between}
    if any(stiffness[1:]) or (stiffness[0] and rest[1:]) or stiffness[0] < 0.0:
        longer = "x" if not rest[1:] else f"(min(0, x) + max(0, x - {signed(rest[1] - rest[0])}))"
        record |= {"force": polynomial([0.0, *stiffness], longer), "length": rest[0]}
    elif stiffness[0]:
        record |= {"stiffness": stiffness[0], "length": rest[0]}
    plain = damping[0] >= 0.0 and not any(damping[1:])
    if plain and damping[0]:
        record["damping"] = damping[0]
    if len(record) > 2:
        parts.add("forces", "tendon", tendon.index, tendon.name, record)
    if not plain:
        record = {"type": "line_force", "between": between, "force": odd_polynomial(damping, "x.velocity")}
        parts.add("forces", "tendon", tendon.index, f"{tendon.name}_damper", record)


def _add_range(parts: ModelParts, tendon: Tendon) -> None:
    """The range of a spatial tendon as a rope and a strut without rebound, if it holds at the reference positions."""
    m, index = parts.model.m, tendon.index
    lower, upper = m.tendon_range[index].tolist()
    start = float(m.tendon_length0[index])
    if tendon.terms:
        parts.model.leave_out("ranges of fixed tendons, which do not act, like those of joints", "tendon", index)
    elif tendon.frames and not lower <= start <= upper:
        sentence = "ranges of tendons that do not hold at the start, and do not act"
        parts.model.leave_out(sentence, "tendon", index, f", length {start:g}")
    elif len(tendon.frames) > 2:
        record = {"type": "cable", "through": list(tendon.ends), "length": upper, "bound": "at_most", "restitution": 0}
        parts.add("constraints", "tendon", index, f"{tendon.name}_at_most", record)
    elif tendon.has_line:
        for bound, length in (("at_least", lower), ("at_most", upper)):
            if length > 0.0:
                record = {"type": "distance", "between": list(tendon.ends), "length": length, "bound": bound}
                parts.add("constraints", "tendon", index, f"{tendon.name}_{bound}", record | {"restitution": 0})


CONNECT, WELD, ONE_JOINT, TENDON = range(4)  # mjtEq
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
        elif kind == ONE_JOINT:
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


def _frames(parts: ModelParts, index: int) -> tuple[PartFrame, PartFrame]:
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
    return PartFrame(parts.parts[first], inner), PartFrame(parts.parts[second], outer)


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
    if len(terms) == 2 and int(parts.model.m.eq_type[index]) == ONE_JOINT:
        record["follower"] = next(iter(terms))  # the first joint, of which the polynomial gives the position
    wanted = parts.model.name("equality", index) or f"{next(iter(terms))}_equality"
    parts.add("constraints", "equality", index, wanted, record)
