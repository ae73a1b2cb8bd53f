"""The bodies of a compiled MJCF as parts and joints of a mechanism file, with their geoms.

Geoms become shapes and meshes that are drawn. A joint of MuJoCo is placed in the frame of its body, and moves it from
where it is at `ref`. The coordinates here are MuJoCo's: at `ref`, the body has the pose that the file gives. The module
also keeps where the names of the MJCF lead.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import PurePath
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.convex_hull import convex_hull
from mbd_sim.base.geometry.pose import Array, Pose, identity_pose
from mbd_sim.base.geometry.rotation import about, to_quaternion
from mbd_sim.base.linear_algebra import product
from mbd_sim.files.mjcf.collisions import PLANE, touching_geoms
from mbd_sim.files.mjcf.compiled_model import CompiledModel, pose
from mbd_sim.files.text.xml import capsule, hull, rows
from mbd_sim.mechanism.elements.parts import GROUND, MOST_CORNERS, PartFrame, is_frame_name
from mbd_sim.mechanism.mass_properties import inertia_defect
from mbd_sim.mechanism.values.names import accepted_names, is_name, reference, unique_name
from mbd_sim.mechanism.values.source import Location, Origin

GRAY = np.array([0.5, 0.5, 0.5, 1.0], dtype=np.float32)


def drawn(model: CompiledModel, geom: int) -> tuple[str, dict[str, Any]] | None:
    """The section of a part, `shapes` or `meshes`, and the entry with which a geom is drawn; None if it is not."""
    m = model.m
    kind = model.mujoco.mjtGeom(m.geom_type[geom]).name.removeprefix("mjGEOM_")
    place, size = pose(m.geom_pos[geom], m.geom_quat[geom]), m.geom_size[geom].tolist()
    turned = rows(to_quaternion(place.rotation))
    at = {"at": rows(place.position)} if np.any(place.position) else {}
    pose_keys = at | ({"rotate": {"quaternion": turned}} if np.any(place.rotation != np.eye(3)) else {})
    record: dict[str, Any]
    match kind:
        case "SPHERE":
            record = {"type": "sphere", "radius": size[0], **at}
        case "ELLIPSOID":
            record = {"type": "ellipsoid", "radii": size, **pose_keys}
        case "CAPSULE":
            record = capsule(place, size[0], 2.0 * size[1])
        case "CYLINDER":
            record = {"type": "cylinder", "radius": size[0], "length": 2.0 * size[1], **pose_keys}
        case "BOX":
            record = {"type": "block", "size": [2.0 * side for side in size], **pose_keys}
        case _:
            return _mesh(model, geom, kind, place)
    return "shapes", record | _color(model, geom)


def _mesh(model: CompiledModel, geom: int, kind: str, place: Pose) -> tuple[str, dict[str, Any]] | None:
    """A mesh as its file has it: the compiler has moved it to its center and principal axes. Others are hulls."""
    m, number = model.m, int(model.m.geom_dataid[geom])
    mesh = model.spec.meshes[number] if kind == "MESH" else None
    if mesh is None:
        model.leave_out(f"{kind.lower()} geoms, which are not drawn", "geom", geom)
        return None
    center = pose(m.mesh_pos[number], m.mesh_quat[number])
    own = place @ center.inverse()
    record: dict[str, Any]
    if mesh.file:
        file = PurePath(mesh.file).name if model.spec.strippath else mesh.file
        record = {"file": str(PurePath(model.spec.meshdir) / file)}
        if np.any(mesh.scale != 1.0):
            record["scale"] = mesh.scale.tolist()
    elif (points := _hull_points(model, geom, mesh, center)) is not None:
        record = {"type": "hull", "points": points}
    else:
        return None
    if np.any(own.position):
        record["at"] = rows(own.position)
    if np.any(own.rotation != np.eye(3)):
        record["rotate"] = {"quaternion": rows(to_quaternion(own.rotation))}
    return "meshes" if mesh.file else "shapes", record | _color(model, geom)


def _hull_points(model: CompiledModel, geom: int, mesh: Any, center: Pose) -> list[list[float]] | None:
    """The corners of the hull of a mesh whose vertices the MJCF has, or that MuJoCo makes; None if there is no hull."""
    number = int(model.m.geom_dataid[geom])
    first, count = int(model.m.mesh_vertadr[number]), int(model.m.mesh_vertnum[number])
    made = product(model.m.mesh_vert[first : first + count].astype(float), center.rotation.T) + center.position
    vertices = np.reshape(mesh.uservert, (-1, 3)) * mesh.scale if len(mesh.uservert) else made
    try:
        hull = convex_hull(vertices, MOST_CORNERS)
    except InputError as error:
        model.leave_out(f"meshes that are not drawn and touch nothing: its vertices {error.message}", "geom", geom)
        return None
    if hull.beyond:
        sentence = f"hulls with more than {MOST_CORNERS} corners, of which those farthest out are taken"
        model.leave_out(sentence, "geom", geom, f", by {hull.beyond:.2g} m")
    return [rows(vertices[corner]) for corner in hull.corners]


def _color(model: CompiledModel, geom: int) -> dict[str, str]:
    """The color of a geom, unless it is that of all geoms."""
    m, material = model.m, int(model.m.geom_matid[geom])
    rgba: Array = m.mat_rgba[material] if material >= 0 else m.geom_rgba[geom]
    if material < 0 and np.all(rgba == GRAY):
        return {}
    return {"color": "#" + "".join(f"{round(255.0 * min(max(value, 0.0), 1.0)):02x}" for value in rgba[:3].tolist())}


WORLD = "world_geoms"  # the part with the geoms of the world that are not planes
LAST_VISIBLE = 2  # group of geoms that MuJoCo draws by default

UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")


class ModelParts:
    """The sections of a mechanism file: parts and joints of a model, to which its forces and constraints are added.

    `parts` are the names by the numbers of bodies, `joints` and `sites` by those of joints and sites.
    """

    def __init__(self, model: CompiledModel) -> None:
        self.model = model
        self.sections: dict[str, dict[str, Any]] = {"ground": {}, "parts": {}, "joints": {}}
        self.origins: dict[Location, Origin] = {}
        m = model.m
        bodies = self._names("body", m.nbody, lambda index: f"body_{index}")
        self.parts = {**accepted_names_of(bodies, "body", is_frame_name), 0: GROUND}
        self.geom_names = accepted_names_of(self._names("geom", m.ngeom, lambda index: f"geom_{index}"), "geom")
        self.touching = set(touching_geoms(model))
        self.shapes: dict[int, str] = {}  # the parts of geoms that touch
        owners = {index: self.parts[int(m.jnt_bodyid[index])] for index in range(m.njnt)}
        self.joints = accepted_names_of(self._names("joint", m.njnt, lambda i: f"{owners[i]}_joint"), "joint")
        self.inward: dict[str, str] = {}  # the joints that lead to the parts
        self._used_parts = set(self.parts.values())
        for index in range(1, m.nbody):
            self._add_part(index)
        world = self._shapes(0, unique_name(WORLD, self._used_parts))
        for index in range(1, m.nbody):
            self._add_joints(index)
        if any(world.values()):
            self._add_world(world)
        self.sites = self._add_sites()

    def _names(self, kind: str, count: int, otherwise: Any) -> dict[int, str]:
        """The names of elements by their numbers; those without one get another one."""
        written = {index: self.model.name(kind, index) for index in range(count)}
        used = {name for name in written.values() if name}
        for index, name in written.items():
            if not name:
                written[index] = unique_name(otherwise(index), used)
                used.add(written[index])
        return written

    def single(self, joint: int) -> bool:
        """Whether a joint has one coordinate, which has its name."""
        return int(self.model.m.jnt_type[joint]) in SINGLE

    def coordinates(self, joint: int) -> list[str]:
        """The names of the coordinates of a joint, in the order of MuJoCo's speeds."""
        name, count = self.joints[joint], {0: 6, 1: 3}.get(int(self.model.m.jnt_type[joint]), 1)
        labels = ("x", "y", "z", "rx", "ry", "rz")
        return [name] if count == 1 else [f"{name}.{label}" for label in labels[-count:]]

    def add(self, section: str, kind: str, index: int, wanted: str, record: dict[str, Any]) -> str:
        """Add an entry; the name that it has."""
        entries = self.sections.setdefault(section, {})
        valid = is_frame_name if section == "sensors" else is_name
        name = unique_name(accepted_names([wanted], section[:-1], valid)[wanted], entries)
        entries[name] = record
        self.origins[section, name] = self.model.origin(kind, index)
        return name

    def point(self, part: str, place: Pose, wanted: str) -> str:
        """The name of a point of a part with this pose; that of the part alone, if the pose is its own."""
        own = not np.any(place.position) and not np.any(place.rotation != np.eye(3))
        return reference(part) if own else self._add_point(part, place, wanted)

    def _add_point(self, part: str, place: Pose, wanted: str) -> str:
        holder = self.sections["ground"] if part == GROUND else self.sections["parts"][part]
        points = holder.setdefault("points", {})
        name, turned = unique_name(accepted_names([wanted], "point")[wanted], points), rotated(place)
        points[name] = {"at": rows(place.position), **turned} if turned else rows(place.position)
        return reference(part, name)

    def _add_part(self, index: int) -> None:
        m, name = self.model.m, self.parts[index]
        inner = pose(m.body_ipos[index], m.body_iquat[index])
        moments = product(product(inner.rotation, np.diag(m.body_inertia[index])), inner.rotation.T)
        part: dict[str, Any] = {"mass": float(m.body_mass[index])}
        if part["mass"] or np.any(moments):
            part |= {"center": rows(inner.position)} if np.any(inner.position) else {}
            part["inertia"] = tensor_entry(moments)
            if inertia_defect(moments) or not part["mass"]:
                part["inertia_check"] = False
        part |= self._shapes(index, name)
        if "shapes" in part:
            part.setdefault("inertia", [0.0, 0.0, 0.0])  # given, so that shapes are only drawn
        self.sections["parts"][name] = part
        self.origins["parts", name] = self.model.origin("body", index)

    def _add_world(self, shapes: dict[str, Any]) -> None:
        """Add the geoms of the world as a part that is fixed to ground."""
        own = unique_name(WORLD, self._used_parts)
        self._used_parts.add(own)
        self.sections["parts"][own] = {"mass": 0.0, **shapes} | ({"inertia": [0.0] * 3} if "shapes" in shapes else {})
        self.origins["parts", own] = self.model.origin("body", 0)
        name = unique_name(f"{own}_fixed", {*self.joints.values(), *self.sections["joints"]})
        self._add_joint(name, "body", 0, {"type": "fixed", "between": [GROUND, reference(own)]})

    def _shapes(self, body: int, part: str) -> dict[str, Any]:
        """What is drawn of a body, and what of it touches, if that is something else."""
        m, found = self.model.m, dict[str, list[dict[str, Any]]](meshes=[], shapes=[], collisions=[])
        geoms = range(int(m.body_geomadr[body]), int(m.body_geomadr[body] + m.body_geomnum[body]))
        has_visible = any(m.geom_group[geom] <= LAST_VISIBLE for geom in geoms)
        for geom in geoms:
            if (body == 0 and m.geom_type[geom] == PLANE) or (entry := drawn(self.model, geom)) is None:
                continue
            kind, record = entry
            if geom in self.touching:
                name, self.shapes[geom] = self.geom_names[geom], part
                record |= {"name": name} if kind == "shapes" else {}
                found["collisions"].append(record if kind == "shapes" else {**hull(record), "name": name})
                if has_visible and m.geom_group[geom] > LAST_VISIBLE:
                    continue
            found[kind].append(record)
        if found["collisions"] == found["shapes"]:
            found["collisions"] = []
            return {kind: entries for kind, entries in found.items() if entries}
        return {kind: entries for kind, entries in found.items() if entries or kind == "collisions"}

    def _add_joints(self, index: int) -> None:
        """Connect a body to its parent; between several joints there are parts without mass."""
        m, own = self.model.m, self.parts[index]
        inner, place = self.parts[int(m.body_parentid[index])], pose(m.body_pos[index], m.body_quat[index])
        joints = range(int(m.body_jntadr[index]), int(m.body_jntadr[index] + m.body_jntnum[index]))
        if not joints:
            name = unique_name(f"{own}_fixed", {*self.joints.values(), *self.sections["joints"]})
            record = {"type": "fixed", "between": [self.point(inner, place, own), reference(own)]}
            self._add_joint(name, "body", index, record)
            self.inward[own] = name
        for joint in joints:
            name, last = self.joints[joint], joint == joints[-1]
            outer = own if last else unique_name(f"{own}_{name}", self._used_parts)
            self._used_parts.add(outer)
            if not last:
                self.sections["parts"][outer] = {"mass": 0.0}
                self.origins["parts", outer] = self.model.origin("joint", joint)
            record, base, anchor = joint_record(self.model, joint, place)
            between = [self.point(inner, base, name), self.point(outer, anchor, name)]
            self._add_joint(name, "joint", joint, {"type": record.pop("type"), "between": between, **record})
            inner, place = outer, identity_pose()
            self.inward[outer] = name

    def _add_joint(self, name: str, kind: str, index: int, record: dict[str, Any]) -> None:
        self.sections["joints"][name] = record
        self.origins["joints", name] = self.model.origin(kind, index)

    def _add_sites(self) -> dict[int, PartFrame]:
        m, found = self.model.m, {}
        for index in range(m.nsite):
            part, place = self.parts[int(m.site_bodyid[index])], pose(m.site_pos[index], m.site_quat[index])
            self._add_point(part, place, self.model.name("site", index) or f"{part}_site")
            found[index] = PartFrame(part, place)
        return found


def accepted_names_of(
    written: dict[int, str], otherwise: str, valid: Callable[[str], bool] = is_name
) -> dict[int, str]:
    """A unique name for each number."""
    found = accepted_names(written.values(), otherwise, valid)
    return {index: found[name] for index, name in written.items()}


def tensor_entry(tensor: Array) -> list[float] | dict[str, float]:
    """The key `inertia` of a part; products of inertia that are round-off of the principal axes are 0."""
    tensor = 0.5 * (tensor + tensor.T)
    products = tensor - np.diag(np.diag(tensor))
    if np.max(np.abs(products)) <= np.finfo(float).eps * np.trace(tensor):
        return rows(np.diag(tensor))
    return {name: float(tensor[index]) + 0.0 for name, index in zip(ENTRIES, UPPER, strict=True)}


def rotated(place: Pose) -> dict[str, Any]:
    """The key `rotate` of a pose, if it needs one."""
    if not np.any(place.rotation != np.eye(3)):
        return {}
    return {"rotate": {"quaternion": rows(to_quaternion(place.rotation))}}


FREE, BALL, SLIDE, HINGE = range(4)  # mjtJoint
SINGLE = (SLIDE, HINGE)
TYPES = {FREE: "free", BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}


def joint_record(model: CompiledModel, joint: int, place: Pose) -> tuple[dict[str, Any], Pose, Pose]:
    """The record of a joint without `between`, its frame on the inner part, and that on the outer one.

    :param place: the pose of the outer part in the inner one, at `ref`.
    """
    m, kind = model.m, int(model.m.jnt_type[joint])
    record: dict[str, Any] = {"type": TYPES[kind]}
    still = np.eye(3)
    anchor = Pose(m.jnt_pos[joint].copy(), still)
    if kind == FREE:
        position, turned = rows(place.position), {"quaternion": rows(to_quaternion(place.rotation))}
        record |= (
            {"position": position, "orientation": turned} if np.any(place.rotation != still) or any(position) else {}
        )
        pose_at_rest = {"at": position, "rotate": turned}
        if stiffness := _stiffness(model, joint):
            record |= {"stiffness": [stiffness] * 6, "rest": pose_at_rest}
        if damping := _damping(model, joint):
            record["damping"] = [damping] * 6
        return record, Pose(np.zeros(3), still), Pose(np.zeros(3), still)
    if kind == BALL:
        if stiffness := _stiffness(model, joint):
            record["stiffness"] = stiffness
        if damping := _damping(model, joint):
            record["damping"] = damping
        if m.jnt_limited[joint] and not model.disabled("LIMIT"):
            model.leave_out("ranges of ball joints, past which they turn here", "joint", joint)
        return record, place @ anchor, anchor
    axis, ref = m.jnt_axis[joint].copy(), float(m.qpos0[m.jnt_qposadr[joint]])
    record["axis"] = rows(axis)
    _add_single(model, joint, record, ref)
    back = Pose(np.zeros(3), about(axis, -ref)) if kind == HINGE else Pose(-ref * axis, still)
    return record, place @ anchor @ back, anchor


def _add_single(model: CompiledModel, joint: int, record: dict[str, Any], ref: float) -> None:
    m, dof = model.m, int(model.m.jnt_dofadr[joint])
    if ref:
        record["position"] = ref
    if stiffness := _stiffness(model, joint):
        rest = float(m.qpos_spring[m.jnt_qposadr[joint]])
        record |= {"stiffness": stiffness} | ({"rest": rest} if rest else {})
    if damping := _damping(model, joint):
        record["damping"] = damping
    if (friction := float(m.dof_frictionloss[dof])) and not model.disabled("FRICTIONLOSS"):
        record["friction"] = {"coulomb": friction}
    lower, upper = map(float, m.jnt_range[joint])
    if m.jnt_limited[joint] and not model.disabled("LIMIT") and lower < upper:
        record["limits"] = {"lower": lower, "upper": upper}


def _stiffness(model: CompiledModel, joint: int) -> float:
    """The linear stiffness, unless it is negative or a polynomial, which become forces."""
    linear = float(model.m.jnt_stiffness[joint])
    return 0.0 if model.disabled("SPRING") or has_spring_force(model, joint) else linear


def _damping(model: CompiledModel, joint: int) -> float:
    linear = float(model.m.dof_damping[model.m.jnt_dofadr[joint]])
    return 0.0 if model.disabled("DAMPER") or linear < 0.0 else linear


def has_spring_force(model: CompiledModel, joint: int) -> bool:
    """Whether the spring of a joint is one that its record cannot express."""
    return bool(model.m.jnt_stiffness[joint] < 0.0 or np.any(model.m.jnt_stiffnesspoly[joint]))
