"""The scopes of an SDF: the names and frames of its models, and of those that it includes.

A `Scope` holds the names of a world or of a model. Names with `::` lead into nested models. Models, links, joints and
frames each have a frame, with a pose relative to another one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from mbd_sim.base.errors import MechanismError, Problem, nearest, quoted
from mbd_sim.base.geometry.pose import Pose, identity_pose
from mbd_sim.files.sdf.links import Values
from mbd_sim.files.text.library import file_error, read_text
from mbd_sim.files.text.xml import Element, parse_xml
from mbd_sim.mechanism.values.names import LONGEST_NAME

MODEL, WORLD = "__model__", "world"


@dataclass(eq=False)
class ScopedFrame:
    """A frame: its pose in the frame `relative_to` of its scope. A model has an `inner` scope.

    `attached_to` names the frame with which it moves: of a joint its child, of a link "".
    """

    name: str
    kind: str
    element: Element
    scope: Scope
    pose: Pose
    relative_to: str
    attached_to: str = ""
    inner: Scope | None = None
    local: Pose | None = None
    visiting: bool = False


@dataclass(eq=False)
class Scope:
    """The frames in a model, or in the world, by name; `owner` is the model among the frames of `outer`."""

    file: str
    element: Element
    outer: Scope | None = None
    owner: ScopedFrame | None = None
    canonical: str = ""
    nodes: dict[str, ScopedFrame] = field(default_factory=dict)

    def of_kind(self, kind: str) -> Iterator[ScopedFrame]:
        """The frames of a kind, in the order of the file."""
        return (node for node in self.nodes.values() if node.kind == kind)

    def find(self, name: str) -> ScopedFrame | None:
        """The frame of a name; the model itself is that of its owner, None is the world."""
        if name == MODEL:
            return self.owner
        first, separator, rest = name.partition("::")
        if separator and first in self.nodes and (inner := self.nodes[first].inner) is not None:
            return inner.find(rest)
        return self.nodes.get(name)

    def require(self, name: str, user: Element, key: str) -> ScopedFrame | None:
        """The frame of a name that an element uses; the world is None.

        :raises MechanismError: there is no such frame.
        """
        if name == WORLD or (name == MODEL and self.owner is None):
            return None
        if (found := self.find(name)) is None:
            message, remedy = f"there is no frame {quoted(name)}", nearest(name, self.nodes) or "Define it."
            raise _error(user, key, message, remedy)
        return found


def pose_in_scope(node: ScopedFrame) -> Pose:
    """The pose of a frame in the model, or the world, of its scope.

    :raises MechanismError: a frame does not exist, or is given relative to itself.
    """
    if node.local is not None:
        return node.local
    key = key_of(node.element)
    if node.visiting:
        message = "its pose is given relative to itself, through other frames"
        raise _error(node.element, f"{key}.pose", message, "Give one of them relative to another frame.")
    node.visiting = True
    scope = node.scope
    base = identity_pose()
    if not (node.relative_to == MODEL or (node.relative_to == WORLD and scope.outer is None)):
        found = scope.require(node.relative_to, node.element, f"{key}.pose.relative_to")
        # None is the world, seen from a model.
        base = world_pose(scope.owner).inverse() if found is None else pose_seen_from(found, scope)
    node.local = base @ node.pose @ _placement(node).inverse()
    node.visiting = False
    return node.local


def _placement(node: ScopedFrame) -> Pose:
    """Of a model, the pose of its placement frame in it: that is the frame which its pose places."""
    name = node.element.attributes.get("placement_frame", "")
    if node.inner is None or not name:
        return identity_pose()
    found = node.inner.require(name, node.element, f"{key_of(node.element)}.placement_frame")
    return identity_pose() if found is None else pose_seen_from(found, node.inner)


def pose_seen_from(node: ScopedFrame, scope: Scope) -> Pose:
    """The pose of a frame in the model of its scope, or of one around it."""
    if node is scope.owner:
        return identity_pose()
    pose, current = pose_in_scope(node), node.scope
    while current is not scope and current.owner is not None:
        pose, current = pose_in_scope(current.owner) @ pose, current.owner.scope
    return pose


def world_pose(node: ScopedFrame | None) -> Pose:
    """The pose of a frame in the world; the world is None."""
    if node is None:
        return identity_pose()
    pose = pose_in_scope(node)
    while (owner := node.scope.owner) is not None:
        pose, node = pose_in_scope(owner) @ pose, owner
    return pose


def link_of(node: ScopedFrame | None, depth: int = 0) -> ScopedFrame | None:
    """The link with which a frame moves; None is the world.

    :raises MechanismError: the frames are attached to each other in a circle, or a model has no link.
    """
    if node is None or node.kind == "link":
        return node
    key = key_of(node.element)
    if depth > 100:
        raise _error(node.element, key, "is attached to itself, through other frames", "Attach one of them to a link.")
    if node.inner is not None:
        return link_of(_canonical(node), depth + 1)
    return link_of(node.scope.require(node.attached_to or MODEL, node.element, f"{key}.attached_to"), depth + 1)


def _canonical(node: ScopedFrame) -> ScopedFrame:
    """The link, or nested model, whose motion is that of a model."""
    inner = node.inner
    assert inner is not None
    if inner.canonical:
        found = inner.require(inner.canonical, node.element, f"{key_of(node.element)}.canonical_link")
    else:
        found = next((one for kind in ("link", "model") for one in inner.of_kind(kind)), None)
    if found is None:
        raise _error(node.element, key_of(node.element), "has no link", "Add one.")
    return found


def _error(element: Element, key: str, message: str, remedy: str) -> MechanismError:
    return MechanismError([Problem(message, remedy, key=key, file=element.file, line=element.line)])


def key_of(element: Element) -> str:
    """How an element is named in errors."""
    name = element.attributes.get("name", "")
    if not name:
        return element.tag
    return f"{element.tag}[{name if name.isprintable() and len(name) <= LONGEST_NAME else quoted(name)}]"


SEARCHED = ("GZ_SIM_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")  # environment variables with folders of models
DEEPEST = 20  # nesting of models and of files that include each other
FRAMES = ("model", "include", "link", "joint", "frame")


@dataclass(frozen=True, eq=False)
class ScopeReader:
    """Makes the scope of a world or a model; what is in it besides frames is left for others to read."""

    values: Values

    def fill(self, scope: Scope, element: Element, depth: int = 0) -> None:
        """Add the frames in an element to a scope."""
        if depth > DEEPEST:
            raise file_error(
                element.file, element.line, f"models are nested deeper than {DEEPEST} levels", "Flatten them."
            )
        for child in element.children:
            if child.tag not in FRAMES:
                continue
            model = self._included(child) if child.tag == "include" else child
            name = model.attributes.get("name", "")
            if not name:
                self.values.reading.report(child, child.tag, "'name' is missing", "Add it.")
                continue
            if name in scope.nodes:
                first = scope.nodes[name].element.line
                message = f"has the name of another frame, on line {first}"
                self.values.reading.report(child, key_of(model), message, "Rename one of them.")
                continue
            scope.nodes[name] = self._node(scope, model, name, depth)

    def _node(self, scope: Scope, element: Element, name: str, depth: int) -> ScopedFrame:
        key, pose = key_of(element), element.first("pose")
        attached, relative = "", MODEL
        if element.tag == "joint":
            attached = relative = self.values.text(element, "child")
        elif element.tag == "frame":
            attached = element.attributes.get("attached_to", "")
            relative = attached or MODEL
        if pose is not None and pose.attributes.get("relative_to"):
            relative = pose.attributes["relative_to"]
        node = ScopedFrame(name, element.tag, element, scope, self.values.pose(element, key), relative, attached)
        if element.tag == "model":
            node.inner = Scope(element.file, element, scope, node, element.attributes.get("canonical_link", ""))
            self.fill(node.inner, element, depth + 1)
        return node

    def _included(self, include: Element) -> Element:
        """The model that an `<include>` stands for, with the name, pose and flags that it replaces."""
        uri = self.values.text(include, "uri")
        path = _model_file(uri, Path(include.file).parent)
        if path is None:
            remedy = f"Give a path from the folder of this file, or set {SEARCHED[0]}."
            raise file_error(include.file, include.line, "there is no such model", remedy, "include.uri", quoted(uri))
        if include.attributes.get("merge") in ("true", "1"):
            message = "models that are merged are not read"
            raise file_error(include.file, include.line, message, "Remove 'merge', or copy the model.", "include.merge")
        root = parse_xml(read_text(path), str(path))
        self.values.reading.note_slips(root)
        models = root.all("model")
        if root.tag != "sdf" or len(models) != 1:
            message = f"{path} is not an SDF with one <model>"
            raise file_error(include.file, include.line, message, "Include a model.", "include.uri", quoted(uri))
        model = models[0]
        model.attributes.setdefault("sdf_version", root.attributes.get("version", ""))
        if name := self.values.text(include, "name"):
            model.attributes["name"] = name
        for tag in ("pose", "static"):
            if (given := include.first(tag)) is not None:
                model.children = [child for child in model.children if child.tag != tag] + [given]
        if frame := self.values.text(include, "placement_frame"):
            model.attributes["placement_frame"] = frame
        for child in include.children:
            if child.tag not in ("uri", "name", "pose", "static", "placement_frame"):
                self.values.reading.leave_out_at(f"<{child.tag}> of <include>", child, key_of(model))
        return model


def _model_file(uri: str, folder: Path) -> Path | None:
    """The file of a model: given by its path, or by that of its folder, from `folder` or among the searched ones."""
    name = uri.removeprefix("file://").removeprefix("model://").removeprefix("package://")
    places = [folder, *folder.resolve().parents] if "://" in uri else [folder]
    places += [
        Path(place) for variable in SEARCHED for place in os.environ.get(variable, "").split(os.pathsep) if place
    ]
    for place in places if name else ():
        path = place / name
        if path.is_file():
            return path
        if path.is_dir():
            found = sorted(path.glob("*.sdf"))
            return path / "model.sdf" if (path / "model.sdf").is_file() else found[0] if found else None
    return None
