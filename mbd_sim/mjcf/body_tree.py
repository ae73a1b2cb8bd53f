"""The bodies of an MJCF as a list, each with its joints, geoms and sites in its own frame.

A `<frame>` places what is in it and has no further meaning, so it is dissolved here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from mbd_sim.errors import quoted
from mbd_sim.geometry.pose import Pose, identity_pose
from mbd_sim.mjcf.compiler_options import Context
from mbd_sim.mjcf.geoms import COMPILED, Geom, ends, geom_of
from mbd_sim.mjcf.items import Item
from mbd_sim.urdf.value_reader import LONGEST_NAME, unique_name
from mbd_sim.urdf.xml_elements import Element

WORLD = "world"
GENERATORS = ("replicate", "attach", "composite", "flexcomp", "plugin")  # they stand for bodies that are not written


@dataclass(frozen=True, eq=False)
class Placed:
    """An element with its key, its attributes, and the pose of the frame around it in its body."""

    item: Item
    name: str
    frame: Pose


@dataclass(eq=False)
class Body:
    """A body: its pose in its `parent`, an index in the list of bodies, and what is in it.

    `start` is its pose in the world where all joints are at their reference positions.
    """

    item: Item
    name: str
    parent: int
    pose: Pose
    start: Pose
    joints: list[Placed] = field(default_factory=list)
    geoms: list[Geom] = field(default_factory=list)
    sites: list[Placed] = field(default_factory=list)
    inertial: Item | None = None


class BodyTree:
    """All bodies of a model from the world on, in the order of MuJoCo, and the names that are taken."""

    def __init__(self, root: Element, context: Context) -> None:
        self._context = context
        self._named = {
            kind: {
                found.attributes["name"] for found in root.walk() if found.tag in tags and "name" in found.attributes
            }
            for kind, tags in (("body", ("body",)), ("joint", ("joint", "freejoint")), ("site", ("site",)))
        }
        self._seen: dict[tuple[str, str], Element] = {}
        self.bodies: list[Body] = []
        worlds = root.all("worldbody")
        world = worlds[0] if worlds else root
        item = context.defaults.item(world, "worldbody", tag="body")
        self.bodies.append(Body(item, WORLD, -1, identity_pose(), identity_pose()))
        for element in worlds:
            self._read(element, 0, identity_pose(), element.attributes.get("childclass", ""))

    def _read(self, element: Element, own: int, frame: Pose, childclass: str) -> None:
        context, body = self._context, self.bodies[own]
        for child in element.children:
            match child.tag:
                case "body":
                    self._body(child, own, frame, childclass)
                case "frame":
                    inner = context.defaults.item(child, "frame", tag="frame")
                    within = self._childclass(child, "frame") or childclass
                    self._read(child, own, frame @ context.pose(inner), within)
                case "joint" | "freejoint":
                    name = self._name(child, "joint", f"{body.name}_joint")
                    item = context.defaults.item(child, key_of(child), childclass)
                    body.joints.append(Placed(item, name, frame))
                case "geom":
                    geom = geom_of(context, child, key_of(child), childclass)
                    body.geoms.append(Geom(geom.item, geom.kind, geom.size, frame @ geom.pose))
                case "site":
                    name = self._name(child, "site", f"{body.name}_site")
                    body.sites.append(Placed(context.defaults.item(child, key_of(child), childclass), name, frame))
                case "inertial":
                    body.inertial = context.defaults.item(child, f"{body.item.key}.inertial")
                case tag if tag in GENERATORS:
                    message = f"<{tag}> is not read"
                    context.reading.report(child, body.item.key, message, f"Write out what it makes: {COMPILED}")

    def _body(self, element: Element, parent: int, frame: Pose, childclass: str) -> None:
        name = self._name(element, "body", f"body_{len(self.bodies)}")
        item = self._context.defaults.item(element, key_of(element))
        pose = frame @ self._context.pose(item)
        self.bodies.append(Body(item, name, parent, pose, self.bodies[parent].start @ pose))
        within = self._childclass(element, item.key) or childclass
        self._read(element, len(self.bodies) - 1, identity_pose(), within)

    def _childclass(self, element: Element, key: str) -> str:
        name = element.attributes.get("childclass", "")
        if name and not self._context.defaults.exists(name):
            message = f"there is no default class {quoted(name)}"
            self._context.reading.report(element, f"{key}.childclass", message, "Define it in <default>.")
            return ""
        return name

    def _name(self, element: Element, kind: str, otherwise: str) -> str:
        name = element.attributes.get("name", "")
        if not name:
            name = unique_name(otherwise, self._named[kind])
            self._named[kind].add(name)
            return name
        if (kind, name) in self._seen or (kind, name) == ("body", WORLD):
            first = self._seen.get((kind, name))
            message = f"is given twice, first on line {first.line}" if first else "is the name of the world"
            self._context.reading.report(element, key_of(element), message, "Rename one of them.")
        self._seen[kind, name] = element
        return name

    def site_pose(self, site: Placed) -> Pose:
        """The pose of a site in its body."""
        pose = ends(self._context, site.item)[0] if site.item.has("fromto") else self._context.pose(site.item)
        return site.frame @ pose

    def named(self) -> Iterator[tuple[int, Body]]:
        """The bodies with their indices, without the world."""
        return ((index, body) for index, body in enumerate(self.bodies) if index)


def key_of(element: Element) -> str:
    """How an element is named in errors and in the list of what was left out."""
    name = element.attributes.get("name", "")
    if not name:
        return element.tag
    return f"{element.tag}[{name if name.isprintable() and len(name) <= LONGEST_NAME else quoted(name)}]"
