"""Tendons of a compiled MJCF: sums of coordinates, and straight lines from site to site.

A fixed tendon has the length Σ c q. Its spring becomes a potential, its damper an effort on each coordinate, and its
friction a friction clutch. A spatial tendon between two sites becomes a spring, and its range a rope and a strut.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mbd_sim.files.mjcf.compiled_model import odd_polynomial, polynomial, signed, weighted_sum
from mbd_sim.files.mjcf.parts import Frame, ModelParts

JOINT, SITE = 1, 3  # mjtWrap


@dataclass(frozen=True, eq=False)
class Tendon:
    """A tendon: the `terms` of a fixed one; or the `frames` and the points, `ends`, of the sites of a spatial one."""

    index: int
    name: str
    terms: Mapping[str, float]
    frames: tuple[Frame, ...] = ()
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
        terms: dict[str, float] = {}
        for place in path:
            own = parts.joints[int(m.wrap_objid[place])]
            terms[own] = terms.get(own, 0.0) + float(m.wrap_prm[place])
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
