"""What of a compiled MJCF can touch: the pairs of geoms by MuJoCo's rules, with their friction."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from mbd_sim.files.mjcf.compiled_model import CompiledModel

PLANE, HEIGHT_FIELD = 0, 1  # mjtGeom
NORMAL_ONLY = 1  # condim of contacts without friction


@dataclass(frozen=True)
class GeomPair:
    """Two geoms that can touch, the plane last, with their coefficient of friction; `explicit` by a `<pair>`."""

    first: int
    second: int
    friction: float
    explicit: bool


def touching_geoms(model: CompiledModel) -> list[int]:
    """The geoms that can touch others."""
    m = model.m
    if model.disabled("CONTACT"):
        return []
    paired = {*m.pair_geom1.tolist(), *m.pair_geom2.tolist()}
    return [geom for geom in range(m.ngeom) if m.geom_contype[geom] or m.geom_conaffinity[geom] or geom in paired]


def geom_pairs(model: CompiledModel) -> Iterator[GeomPair]:
    """The explicit pairs, then those of geoms that MuJoCo's filters let through."""
    m = model.m
    if model.disabled("CONTACT"):
        return
    explicit = set()
    for index in range(m.npair):
        ends = _ordered(model, int(m.pair_geom1[index]), int(m.pair_geom2[index]))
        sliding = m.pair_friction[index][:2].tolist()
        if sliding[0] != sliding[1]:
            model.leave_out("friction of pairs that differs by direction, of which the first is taken", "pair", index)
        explicit.add(ends)
        friction = 0.0 if m.pair_dim[index] == NORMAL_ONLY else sliding[0]
        yield GeomPair(*ends, friction, explicit=True)
    geoms = [geom for geom in range(m.ngeom) if m.geom_contype[geom] or m.geom_conaffinity[geom]]
    excluded = set(m.exclude_signature.tolist())
    for place, one in enumerate(geoms):
        for other in geoms[place + 1 :]:
            ends = _ordered(model, one, other)
            if ends not in explicit and _is_allowed(model, one, other, excluded):
                yield GeomPair(*ends, _friction(model, one, other), explicit=False)


def _ordered(model: CompiledModel, one: int, other: int) -> tuple[int, int]:
    return (other, one) if model.m.geom_type[one] == PLANE else (one, other)


def _is_allowed(model: CompiledModel, one: int, other: int, excluded: set[int]) -> bool:
    """Whether two geoms may touch: by their bits, by `<exclude>`, and unless their bodies are neighbors."""
    m = model.m
    bits = m.geom_contype[one] & m.geom_conaffinity[other], m.geom_contype[other] & m.geom_conaffinity[one]
    if not any(bits) or (m.geom_type[one] == PLANE and m.geom_type[other] == PLANE):
        return False
    bodies = sorted((int(m.geom_bodyid[one]), int(m.geom_bodyid[other])))
    if (bodies[0] << 16) + bodies[1] in excluded or (bodies[1] << 16) + bodies[0] in excluded:
        return False
    welds = [int(m.body_weldid[body]) for body in bodies]
    if welds[0] == welds[1]:
        return False
    parents = [int(m.body_weldid[m.body_parentid[weld]]) for weld in welds]
    filters = not model.disabled("FILTERPARENT") and all(welds)
    return not (filters and (welds[0] == parents[1] or welds[1] == parents[0]))


def _friction(model: CompiledModel, one: int, other: int) -> float:
    """The larger coefficient, or that of the geom with the higher priority."""
    m = model.m
    by_priority = sorted((one, other), key=lambda geom: -int(m.geom_priority[geom]))
    several = m.geom_priority[one] == m.geom_priority[other]
    deciding = by_priority if several else by_priority[:1]
    if max(int(m.geom_condim[geom]) for geom in deciding) == NORMAL_ONLY:
        return 0.0
    return max(float(m.geom_friction[geom][0]) for geom in deciding)
