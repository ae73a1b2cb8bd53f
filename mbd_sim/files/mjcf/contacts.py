"""The contacts of an MJCF: planes and other geoms that stay in place with what can touch them, and pairs of geoms.

What stays in place acts when it is asked for (`--floor`, `active: true`), explicit pairs always, and other pairs of
bodies only where a mechanism file names them: a robot that touches itself would cost more than all the rest.
"""

from __future__ import annotations

from typing import Any

from mbd_sim.base.errors import counted
from mbd_sim.files.mjcf.collisions import HEIGHT_FIELD, PLANE, GeomPair, geom_pairs
from mbd_sim.files.mjcf.compiled_model import CompiledModel, pose
from mbd_sim.files.mjcf.parts import ModelParts
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.values.names import reference

WAITING = "{}, which act with --floor, or with 'active: true' in contacts"
FEW = 20  # pairs of bodies that a note names


def add_contacts(parts: ModelParts) -> None:
    """Add the contacts of a model, and note what is left out or otherwise."""
    planes: dict[tuple[int, float, bool], list[int]] = {}
    bodies: dict[tuple[str, str], int] = {}
    still: dict[tuple[int, str, float], list[int]] = {}
    for pair in geom_pairs(parts.model):
        kinds = [int(parts.model.m.geom_type[geom]) for geom in (pair.first, pair.second)]
        if HEIGHT_FIELD in kinds:
            parts.model.leave_out("height fields, through which bodies pass", "geom", pair.first)
        elif kinds[1] == PLANE:
            if pair.first in parts.shapes:
                planes.setdefault((pair.second, pair.friction, pair.explicit), []).append(pair.first)
        elif pair.explicit:
            _add_pair(parts, pair)
        elif pair.first in parts.shapes and pair.second in parts.shapes:
            names = parts.shapes[pair.first], parts.shapes[pair.second]
            if _is_still(parts, pair.first):
                still.setdefault((pair.first, names[1], pair.friction), []).append(pair.second)
            elif _is_still(parts, pair.second):
                still.setdefault((pair.second, names[0], pair.friction), []).append(pair.first)
            else:
                bodies[names] = bodies.get(names, 0) + 1
    for (plane, friction, explicit), geoms in planes.items():
        _add_plane(parts, plane, friction, explicit, geoms)
    for (geom, part, friction), geoms in still.items():
        _add_still(parts, geom, part, friction, geoms)
    if bodies:
        count = counted(sum(bodies.values()), "pair")
        sentence = f"contacts of bodies with each other, {count} of geoms, which act where a mechanism file names them"
        for one, other in list(bodies)[:FEW]:
            parts.model.reading.leave_out(sentence, f"{one} – {other}")
        if len(bodies) > FEW:
            parts.model.reading.leave_out(sentence, f"{len(bodies) - FEW} more")
    _note_laws(parts.model, "contacts" in parts.sections)


def _is_still(parts: ModelParts, geom: int) -> bool:
    """Whether a geom is on the world, or on a body that is welded to it."""
    return int(parts.model.m.body_weldid[parts.model.m.geom_bodyid[geom]]) == 0


def _add_still(parts: ModelParts, still: int, part: str, friction: float, geoms: list[int]) -> None:
    """The geoms of a part with one that stays in place."""
    place = reference(parts.shapes[still], parts.geom_names[still])
    parts.model.leave_out(WAITING.format("geoms that stay in place"), "geom", still)
    names = _names(parts, geoms)
    for name in names:
        wanted = f"{part}_{parts.geom_names[still]}" if len(names) == 1 else f"{name}_{parts.geom_names[still]}"
        record = {"between": [name, place], **({"friction": friction} if friction else {}), "active": False}
        parts.add("contacts", "geom", still, wanted.replace(".", "_"), record)


def _add_plane(parts: ModelParts, plane: int, friction: float, explicit: bool, geoms: list[int]) -> None:
    """What touches a plane: all parts, if these are all shapes of the model, or else a list."""
    m = parts.model.m
    part, place = parts.parts[int(m.geom_bodyid[plane])], pose(m.geom_pos[plane], m.geom_quat[plane])
    name = parts.geom_names[plane]
    others = {geom for geom in parts.shapes if m.body_weldid[m.geom_bodyid[geom]] != 0}
    record: dict[str, Any] = {"parts": "all" if set(geoms) == others and part == GROUND else _names(parts, geoms)}
    record |= {"plane": parts.point(part, place, name), **({"friction": friction} if friction else {})}
    if not explicit:
        record["active"] = False
        parts.model.leave_out(WAITING.format("planes"), "geom", plane)
    parts.add("contacts", "geom", plane, name, record)


def _names(parts: ModelParts, geoms: list[int]) -> list[str]:
    """References to shapes; to their part, if these are all of it."""
    found: dict[str, list[int]] = {}
    for geom in geoms:
        found.setdefault(parts.shapes[geom], []).append(geom)
    names: list[str] = []
    for part, own in found.items():
        every = [geom for geom, owner in parts.shapes.items() if owner == part]
        whole = len(every) == len(own)
        names += [reference(part)] if whole else [reference(part, parts.geom_names[geom]) for geom in own]
    return names


def _add_pair(parts: ModelParts, pair: GeomPair) -> None:
    geoms = (pair.first, pair.second)
    if not all(geom in parts.shapes for geom in geoms):
        model = parts.model
        kinds = [str(model.mujoco.mjtGeom(model.m.geom_type[geom]).name).removeprefix("mjGEOM_") for geom in geoms]
        words = " and ".join(kind.lower() for kind in kinds)
        model.leave_out(f"pairs of {words}, which pass through each other", "geom", pair.first)
        return
    between = [reference(parts.shapes[geom], parts.geom_names[geom]) for geom in geoms]
    record = {"between": between, **({"friction": pair.friction} if pair.friction else {})}
    names = [parts.geom_names[geom] for geom in geoms]
    parts.add("contacts", "geom", pair.first, f"{names[0]}_{names[1]}", record)


def _note_laws(model: CompiledModel, has_contacts: bool) -> None:
    """Note what MuJoCo's contacts have and rigid ones do not."""
    m = model.m
    if not has_contacts:
        return
    reading = model.reading
    if m.opt.cone == 0:
        reading.leave_out("friction pyramids, in place of which friction is the same in all directions", "option cone")
    reading.leave_out("the softness of contacts (solref, solimp), which are rigid here, without rebound", "all geoms")
    for geom in range(m.ngeom):
        if not (m.geom_contype[geom] or m.geom_conaffinity[geom]):
            continue
        if m.geom_condim[geom] > 3:
            model.leave_out("torsional and rolling friction of contacts (condim 4 and 6)", "geom", geom)
        if m.geom_margin[geom] or m.geom_gap[geom]:
            model.leave_out("margin and gap of geoms: contacts begin at a distance of 0", "geom", geom)
