"""The data of a mechanism file as an MJCF is read: parts, joints and points, and where the names of the MJCF lead."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mbd_sim.errors import nearest, quoted
from mbd_sim.geometry.pose import Pose, identity_pose
from mbd_sim.mechanism.mass_properties import inertia_defect
from mbd_sim.mechanism.records import GROUND
from mbd_sim.mechanism.source import Location, Origin
from mbd_sim.mjcf.body_masses import body_mass, scaled, tensor_entry
from mbd_sim.mjcf.body_tree import WORLD, Body, BodyTree
from mbd_sim.mjcf.compiler_options import Context
from mbd_sim.mjcf.geoms import drawn, rotated
from mbd_sim.mjcf.items import Item
from mbd_sim.mjcf.joint_reader import BodyJoint, joint_of
from mbd_sim.urdf.value_reader import rows, unique_name, valid_names


class Frame(NamedTuple):
    """A frame in the mechanism: its part, its pose there, and its pose in the world at the reference positions."""

    part: str
    pose: Pose
    start: Pose


class MechanismData:
    """The parts and joints of a model, to which its constraints, forces and actuators are added.

    `sections` are those of a mechanism file. `joints`, `bodies` and `sites` lead from the names of the MJCF to what has
    become of them; `names` lead from the names of its joints to those here.
    """

    def __init__(self, context: Context, tree: BodyTree, meshes: dict[str, Item], disabled: frozenset[str]) -> None:
        self.context, self.tree = context, tree
        self.sections: dict[str, dict[str, Any]] = {"ground": {}, "parts": {}, "joints": {}}
        self.origins: dict[Location, Origin] = {}
        self.joints: dict[str, BodyJoint] = {}
        self.names: dict[str, str] = {}
        self.sites: dict[str, Frame] = {}
        self._parts = self._part_names()
        self.bodies = {body.name: Frame(self._parts[body.name], identity_pose(), body.start) for body in tree.bodies}
        self._used_parts = set(self._parts.values())
        self._joint_names = self._all_joint_names()
        self._add_parts(meshes)
        for index, body in tree.named():
            self._add_joints(index, body, disabled)
        self._add_sites()

    def point(self, part: str, pose: Pose, wanted: str) -> str:
        """The name of a point of a part with this pose; that of the part alone, if the pose is its own."""
        own = not np.any(pose.position) and not np.any(pose.rotation != np.eye(3))
        return part if own else self._add_point(part, pose, wanted)

    def _add_point(self, part: str, pose: Pose, wanted: str) -> str:
        holder = self.sections["ground"] if part == GROUND else self.sections["parts"][part]
        points = holder.setdefault("points", {})
        name, turned = unique_name(valid_names([wanted], "point")[wanted], points), rotated(pose)
        points[name] = {"at": rows(pose.position), **turned} if turned else rows(pose.position)
        return f"{part}.{name}"

    def add(self, section: str, item: Item, written: str, record: dict[str, Any]) -> str:
        """Add an entry; the name that it has."""
        entries = self.sections.setdefault(section, {})
        name = unique_name(valid_names([written], section[:-1])[written], entries)
        entries[name] = record
        self.origins[section, name] = self.context.reading.origin(item.element, item.key)
        return name

    def reference(self, item: Item, attribute: str, known: Sequence[str], kind: str) -> str | None:
        """The name in an attribute, if there is something of this name; otherwise it is reported."""
        name = item.text(attribute)
        if name in known:
            return name
        item.report(attribute, f"there is no {kind} {quoted(name)}", nearest(name, known))
        return None

    def _part_names(self) -> dict[str, str]:
        written = [body.name for _, body in self.tree.named()]
        found = valid_names(written, "body")
        self._note_names(found)
        return {**found, WORLD: GROUND}

    def _all_joint_names(self) -> dict[str, str]:
        found = valid_names([joint.name for body in self.tree.bodies for joint in body.joints], "joint")
        self._note_names(found)
        return found

    def _note_names(self, names: dict[str, str]) -> None:
        for written, name in names.items():
            if written != name:
                self.context.reading.leave_out("names that are not valid here, as old → new", f"{written} → {name}")

    def _add_parts(self, meshes: dict[str, Item]) -> None:
        bodies = [body for _, body in self.tree.named()]
        found = [body_mass(self.context, body.item, body.inertial, body.geoms) for body in bodies]
        for body, mass in zip(bodies, scaled(found, self.context.compiler.settotalmass), strict=True):
            part: dict[str, Any] = {"mass": mass.mass}
            if mass.mass or np.any(mass.inertia):
                part |= {"center": rows(mass.center)} if np.any(mass.center) else {}
                part["inertia"] = tensor_entry(mass.inertia)
                if inertia_defect(mass.inertia) or not mass.mass:
                    part["inertia_check"] = False
            for geom in body.geoms:
                if (entry := drawn(geom, meshes, self.context)) is not None:
                    part.setdefault(entry[0], []).append(entry[1])
            if "shapes" in part:
                part.setdefault("inertia", [0.0, 0.0, 0.0])  # given, so that shapes are only drawn
            self._add_part(self._parts[body.name], body.item, part)
        for geom in self.tree.bodies[0].geoms:
            geom.item.leave_out("geoms of the world, which are not drawn")
        for geom in (geom for body in self.tree.bodies for geom in body.geoms):
            if geom.item.number("contype", 1.0) or geom.item.number("conaffinity", 1.0):
                geom.item.leave_out("contacts of geoms, through which other bodies pass")

    def _add_part(self, name: str, item: Item, record: dict[str, Any]) -> None:
        self.sections["parts"][name] = record
        self.origins["parts", name] = self.context.reading.origin(item.element, item.key)

    def _add_joints(self, index: int, body: Body, disabled: frozenset[str]) -> None:
        """Connect a body to its parent; between several joints there are parts without mass."""
        own, parent = self._parts[body.name], self._parts[self.tree.bodies[body.parent].name]
        if not body.joints:
            name = unique_name(f"{own}_fixed", self._joint_names.values())
            self._joint_names[f"fixed joint of {index}"] = name
            self._add_joint(name, body.item, {"type": "fixed", "between": [self.point(parent, body.pose, own), own]})
            return
        inner, pose = parent, body.pose
        for placed in body.joints:
            joint = joint_of(self.context, body, placed, disabled)
            name = self._joint_names[placed.name]
            self.joints[placed.name], self.names[placed.name] = joint, name
            last = placed is body.joints[-1]
            outer = own if last else unique_name(f"{own}_{name}", self._used_parts)
            self._used_parts.add(outer)
            if not last:
                self._add_part(outer, placed.item, {"mass": 0.0})
            if joint.kind == "free":
                between = [GROUND, outer]
            else:
                between = [self.point(inner, pose @ joint.base, name), self.point(outer, joint.anchor, name)]
            record = dict(joint.record)
            self._add_joint(name, placed.item, {"type": record.pop("type"), "between": between, **record})
            inner, pose = outer, identity_pose()

    def _add_joint(self, name: str, item: Item, record: dict[str, Any]) -> None:
        self.sections["joints"][name] = record
        self.origins["joints", name] = self.context.reading.origin(item.element, item.key)

    def _add_sites(self) -> None:
        for body in self.tree.bodies:
            names = valid_names([site.name for site in body.sites], "site")
            for site in body.sites:
                pose, part = self.tree.site_pose(site), self._parts[body.name]
                self.sites[site.name] = Frame(part, pose, body.start @ pose)
                self._add_point(part, pose, names[site.name])
