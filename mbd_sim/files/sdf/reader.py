"""An SDF as the source of a mechanism: its links and joints become parts and joints, its frames points.

Links that no joint connects to the world fly freely, as in Gazebo, unless their model is static. Tables say what is
read of each element within links, joints and frames; everything else is listed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.sdf.contacts import contacts_of
from mbd_sim.files.sdf.joints import GEARBOX, gearbox_of, joint_of, mimics_of
from mbd_sim.files.sdf.links import PRODUCTS, Values, part_of, rotated
from mbd_sim.files.sdf.scopes import FRAMES, Scope, ScopedFrame, ScopeReader, key_of, link_of, world_pose
from mbd_sim.files.sdf.sensors import FORCE_TORQUE, IMU, load_frame, sensor_record
from mbd_sim.files.text.library import file_error
from mbd_sim.files.text.xml import Base, Element, Reading, parse_xml, rows
from mbd_sim.files.urdf.reader import note_unread, read
from mbd_sim.mechanism.elements.parts import GROUND, is_frame_name
from mbd_sim.mechanism.values.names import accepted_names, is_name, reference, unique_name
from mbd_sim.mechanism.values.source import Location, Origin, Source

_OWN_POSE = read("rotation_format degrees")
READ = {
    "frame": read("name attached_to", "pose"),
    "link": read("name", "pose inertial", "visual collision", checked=True),
    "joint": read(
        "name type",
        "pose parent child axis axis2 screw_thread_pitch thread_pitch gearbox_ratio gearbox_reference_body",
        checked=True,
    ),
    "pose": read("relative_to rotation_format degrees"),
    **dict.fromkeys(("inertial/pose", "visual/pose", "collision/pose"), _OWN_POSE),
    "inertial": read("auto", "pose mass inertia"),
    "inertia": read("", " ".join(PRODUCTS)),
    "visual": read("name", "pose geometry material"),
    "collision": read("name", "pose geometry surface"),
    "surface": read("", "friction bounce"),
    "surface/friction": read("", "ode"),
    "ode": read("", "mu mu2"),
    "bounce": read("", "restitution_coefficient"),
    "plane": read("", "normal size"),
    "geometry": read("", "box sphere plane ellipsoid cylinder capsule mesh", checked=True),
    "box": read("", "size"),
    "sphere": read("", "radius"),
    "ellipsoid": read("", "radii"),
    **dict.fromkeys(("cylinder", "capsule"), read("", "radius length")),
    "mesh": read("", "uri scale"),
    "material": read("", "diffuse"),
    **dict.fromkeys(("axis", "axis2"), read("", "xyz limit dynamics mimic use_parent_model_frame")),
    "xyz": read("expressed_in"),
    "limit": read("", "lower upper effort velocity"),
    "dynamics": read("", "damping friction spring_reference spring_stiffness"),
    "mimic": read("joint axis", "multiplier offset reference"),
}
SCOPES = {  # attributes of models and worlds
    "model": {"name", "canonical_link", "placement_frame", "sdf_version"},
    "world": {"name"},
    "sdf": {"version"},
}


def note_unread_values(reading: Reading, node: ScopedFrame) -> None:
    """List what is not read of a link, joint or frame."""
    if node.kind in READ:
        note_unread(reading, node.element, key_of(node.element), READ)


def note_unread_attributes(reading: Reading, element: Element) -> None:
    """List the attributes of a model or a world that are not read."""
    for name in element.attributes:
        if name not in SCOPES.get(element.tag, ()) and not name.startswith("xmlns"):
            reading.leave_out_at(f"{name} of <{element.tag}>", element, key_of(element))


MOST = 1000  # elements of a kind in the list of what was left out
WORLD_GRAVITY = [0.0, 0.0, -9.8]  # of the specification
GRAVITY = [0.0, 0.0, -9.81]
QUIET = ("static", "pose", "self_collide", "allow_auto_disable", "enable_wind")  # of models, without effect here


def sdf_source(text: str, file: str, base: Base | None = None) -> Source:
    """An SDF as the source of a mechanism file, with the origins of its values.

    Problems of single elements are among its `problems`, with which `validate` refuses it. Its `notes` list everything
    that was left out.

    :param base: `fixed` or `free`, of models that are not attached to the world; `free` by default.
    :raises MechanismError: the text is not XML or not SDF, or frames or included models do not exist.
    """
    root = parse_xml(text, file)
    if root.tag != "sdf":
        shown = f"<{root.tag[:60]}>"
        raise file_error(file, root.line, "this is not SDF", "An SDF's root element is <sdf>.", value=shown)
    worlds = root.all("world")
    if len(worlds) > 1:
        raise file_error(file, worlds[1].line, "has several worlds", "Keep one of them.", key=key_of(worlds[1]))
    return _SdfReader(root, worlds[0] if worlds else root, file, base).source()


class _SdfReader:
    """The frames of an SDF, and their conversion to the data of a mechanism file."""

    def __init__(self, root: Element, world: Element, file: str, base: Base | None) -> None:
        self.reading, self.root, self.world, self.base = Reading(file, MOST), root, world, base or "free"
        self.reading.note_slips(root)
        self.values = Values(self.reading, root.attributes.get("version", "1.7"))
        self.scope = Scope(file, world)
        ScopeReader(self.values).fill(self.scope, world)
        self.links: list[ScopedFrame] = []
        self.joints: list[ScopedFrame] = []
        self.frames: list[ScopedFrame] = []
        self.static: set[int] = set()  # id of links in static models
        self._collect(self.scope, static=False)
        self.part_names = self._names(self.links, "link")
        self.joint_names = self._names(self.joints, "joint")
        self.origins: dict[Location, Origin] = {}
        self.data: dict[str, dict[str, Any]] = {
            "ground": {},
            "parts": {},
            "joints": {},
            "constraints": {},
            "contacts": {},
            "sensors": {},
        }

    def source(self) -> Source:
        """The data, and the origins of its values."""
        if not self.links and not self.reading.problems:
            raise file_error(
                self.reading.file, self.world.line, "has no <link>", "Add a model.", key=key_of(self.world)
            )
        for link in self.links:
            name, key = self.part_names[id(link)], key_of(link.element)
            self.data["parts"][name] = part_of(self.values, link.element, key)
            self.origins["parts", name] = self.reading.origin(link.element, key)
        for joint in self.joints:
            self._add_joint(joint)
        self._add_bases()
        self._add_couplings()
        links = [(link, self.part_names[id(link)], id(link) in self.static) for link in self.links]
        for name, record in contacts_of(
            self.values, links, lambda pose, wanted: self._point(None, pose, wanted)
        ).items():
            self.data["contacts"][unique_name(name, self.data["contacts"])] = record
        for frame in self.frames:
            self._point(link_of(frame), world_pose(frame), frame.name, always=True)
        self._add_sensors()
        self._note_rest()
        models = [*self.scope.of_kind("model")]
        name = models[0].name if len(models) == 1 else self.world.attributes.get("name") or "world"
        sections = {key: entries for key, entries in self.data.items() if entries}
        content = {"mechanism": accepted_names([name], "model")[name], **self._gravity(), **sections}
        source = Source(
            content, file=self.reading.file, problems=self.reading.problems, origins=self.origins, format="SDF"
        )
        source.notes = self.reading.notes
        source.other_files = None if any(element.tag == "include" for element in self.root.walk()) else {}
        source.comments = (f"From {Path(self.reading.file).name}.", *source.notes)
        return source

    def _collect(self, scope: Scope, static: bool) -> None:
        for node in scope.nodes.values():
            match node.kind:
                case "link":
                    self.links.append(node)
                    self.static |= {id(node)} if static else set()
                case "joint" if static:
                    self.reading.leave_out_at("joints of static models", node.element, key_of(node.element))
                case "joint":
                    self.joints.append(node)
                case "frame":
                    self.frames.append(node)
                case _ if node.inner is not None:
                    flag = self.values.flag(node.element, "static", key_of(node.element))
                    self._collect(node.inner, static or flag)

    def _names(self, nodes: list[ScopedFrame], kind: str) -> dict[int, str]:
        """A valid name for each frame: its own, with those of its models where there are several."""
        alone = len([*self.scope.of_kind("model")]) == 1
        written = []
        for node in nodes:
            path, owner = [node.name], node.scope.owner
            while owner is not None:
                path.insert(0, owner.name)
                owner = owner.scope.owner
            written.append("::".join(path[1:] if alone and len(path) > 1 else path))
        names = accepted_names(written, kind, is_frame_name if kind == "link" else is_name)
        for old, new in names.items():
            if old != new:
                self.reading.leave_out("names that are not valid here, as old → new", f"{old} → {new}")
        return {id(node): names[name] for node, name in zip(nodes, written, strict=True)}

    def _end(self, joint: ScopedFrame, tag: str) -> ScopedFrame | None:
        """The link at an end of a joint; None is the world."""
        key = f"{key_of(joint.element)}.{tag}"
        name, element = self.values.text(joint.element, tag), joint.element.first(tag)
        if element is None or not name:
            raise file_error(joint.element.file, joint.element.line, f"<{tag}> is missing", "Add it.", key=key)
        return link_of(joint.scope.require(name, element, key))

    def _add_joint(self, joint: ScopedFrame) -> None:
        if joint.element.attributes.get("type") == GEARBOX:
            return
        parent, child = self._end(joint, "parent"), self._end(joint, "child")
        own, key = self.joint_names[id(joint)], key_of(joint.element)
        if parent is child:
            self.reading.report(joint.element, key, "connects a link with itself", "Name two links.")
            return
        record = joint_of(self.values, joint)
        place = world_pose(joint)
        between = [self._point(parent, place, own), self._point(child, place, own)]
        self.data["joints"][own] = {"type": record.pop("type"), "between": between, **record}
        self.origins["joints", own] = self.reading.origin(joint.element, key)

    def _point(self, link: ScopedFrame | None, place: Pose, wanted: str, always: bool = False) -> str:
        """The name of a point of a link, or of the world, at a pose in the world; of the part alone at its own pose."""
        part = GROUND if link is None else self.part_names[id(link)]
        pose = place if link is None else world_pose(link).inverse() @ place
        rotation = _clean(pose.rotation)
        pose = Pose(_clean(pose.position), rotation)
        if not always and not np.any(pose.position) and not np.any(rotation != np.eye(3)):
            return reference(part)
        holder = self.data["ground"] if link is None else self.data["parts"][part]
        points = holder.setdefault("points", {})
        name, turned = unique_name(accepted_names([wanted], "point")[wanted], points), rotated(pose)
        points[name] = {"at": rows(pose.position), **turned} if turned else rows(pose.position)
        return reference(part, name)

    def _add_bases(self) -> None:
        """Attach each group of links that joints connect, but not to the world, by its first link."""
        groups = self._groups()
        for group in groups:
            names = [*self.joint_names.values(), *self.data["joints"]]
            for link in group if id(group[0]) in self.static else group[:1]:
                part, place = self.part_names[id(link)], world_pose(link)
                name = unique_name("base" if len(groups) == len(group) == 1 else f"{part}_base", names)
                names.append(name)
                own = reference(part)
                if id(link) in self.static or self.base == "fixed":
                    record: dict[str, Any] = {"type": "fixed", "between": [self._point(None, place, part), own]}
                else:
                    record = {"type": "free", "between": [GROUND, own]}
                    record |= {"position": rows(place.position)} if np.any(place.position) else {}
                    turned = rotated(Pose(place.position, _clean(place.rotation)))
                    record |= {"orientation": turned["rotate"]} if turned else {}
                self.data["joints"][name] = record
                self.origins["joints", name] = self.reading.origin(link.element, key_of(link.element))

    def _groups(self) -> list[list[ScopedFrame]]:
        """The links that are not connected to the world, in groups that joints connect."""
        group = {id(link): {id(link)} for link in self.links}
        grounded: set[int] = set()
        for joint in self.joints:
            if joint.element.attributes.get("type") == GEARBOX:
                continue
            ends = [end for tag in ("parent", "child") if (end := self._end(joint, tag)) is not None]
            if len(ends) == 1:
                grounded.add(id(ends[0]))
            elif ends and group[id(ends[0])] is not group[id(ends[1])]:
                merged = group[id(ends[0])] | group[id(ends[1])]
                group |= dict.fromkeys(merged, merged)
        found: list[list[ScopedFrame]] = []
        seen: set[int] = set()
        for link in self.links:
            members = group[id(link)]
            if id(link) in seen:
                continue
            seen |= members
            if not members & grounded or id(link) in self.static:
                found.append([one for one in self.links if id(one) in members])
        return found

    def _add_couplings(self) -> None:
        names = {id(joint): self.joint_names[id(joint)] for joint in self.joints}
        for joint in self.joints:
            own = names[id(joint)]
            if joint.element.attributes.get("type") == GEARBOX:
                found = gearbox_of(self.values, joint, self.joints, names, self._end)
                entries = [] if found is None else [(own, found)]
            else:
                entries = [(f"{own}_mimic", one) for one in mimics_of(self.values, joint, names)]
            for name, record in entries:
                unique = unique_name(name, self.data["constraints"])
                self.data["constraints"][unique] = record
                self.origins["constraints", unique] = self.reading.origin(joint.element, key_of(joint.element))

    def _add_sensors(self) -> None:
        for link in self.links:
            for sensor in link.element.all("sensor"):
                key = key_of(link.element)
                if (record := self._sensor(sensor, key, IMU)) is not None:
                    place = world_pose(link) @ self.values.pose(sensor, key)
                    self._add_sensor(
                        sensor, key, record | {"at": self._point(link, place, sensor.attributes.get("name", IMU))}
                    )
        for joint in self.joints:
            for sensor in joint.element.all("sensor"):
                key, child = key_of(joint.element), self._end(joint, "child")
                record = self._sensor(sensor, key, FORCE_TORQUE)
                if record is not None and child is not None:
                    place = load_frame(self.values, sensor, key, world_pose(joint), world_pose(child))
                    at = self._point(child, place, sensor.attributes.get("name", FORCE_TORQUE))
                    self._add_sensor(sensor, key, record | {"joint": self.joint_names[id(joint)], "at": at})

    def _sensor(self, sensor: Element, key: str, kind: str) -> dict[str, Any] | None:
        """The record of a sensor without its place, if it is of the kind that is read there."""
        if sensor.attributes.get("type") in (IMU, FORCE_TORQUE) and sensor.attributes.get("type") != kind:
            sentence = f"{sensor.attributes['type']} sensors that are not where the format has them"
            self.reading.leave_out_at(sentence, sensor, key)
            return None
        return sensor_record(self.values, sensor, key)

    def _add_sensor(self, sensor: Element, key: str, record: dict[str, Any]) -> None:
        written = sensor.attributes.get("name", "") or str(record["type"])
        name = unique_name(accepted_names([written], "sensor", is_frame_name)[written], self.data["sensors"])
        self.data["sensors"][name] = record
        self.origins["sensors", name] = self.reading.origin(sensor, key)

    def _note_rest(self) -> None:
        for element in self.root.children if self.world is not self.root else ():
            if element is not self.world:
                self.reading.leave_out_at(f"<{element.tag}> beside the world", element, key_of(element))
        scopes = [self.scope]
        while scopes:
            scope = scopes.pop(0)
            scopes += [node.inner for node in scope.nodes.values() if node.inner is not None]
            note_unread_attributes(self.reading, scope.element)
            for node in scope.nodes.values():
                note_unread_values(self.reading, node)
            for element in scope.element.children:
                if element.tag not in (*FRAMES, *QUIET) and not (scope is self.scope and element.tag == "gravity"):
                    self.reading.leave_out_at(f"<{element.tag}>", element, key_of(element))

    def _gravity(self) -> dict[str, list[float]]:
        if self.world is self.root:
            return {}
        given = self.values.numbers(self.world, "gravity", key_of(self.world), 3)
        if given is None:
            self.reading.leave_out("gravity that is not given, and has the value of the specification", "9.8 m/s²")
        gravity = given or WORLD_GRAVITY
        return {} if gravity == GRAVITY else {"gravity": gravity}


def _clean(array: Any) -> Any:
    """Numbers within rounding of whole ones as these, so that frames that coincide are found to."""
    nearest_whole = np.round(array)
    return np.where(np.abs(array - nearest_whole) <= 4e-16, nearest_whole, array) + 0.0
