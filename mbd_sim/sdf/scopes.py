"""Reads the models of an SDF, with those that it includes, into scopes of frames."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from mbd_sim.errors import quoted
from mbd_sim.mechanism_file.file_limits import file_error, read_text
from mbd_sim.sdf.frame_graph import MODEL, Node, Scope, key_of
from mbd_sim.sdf.values import Values
from mbd_sim.urdf.xml_elements import Element, parse_xml

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

    def _node(self, scope: Scope, element: Element, name: str, depth: int) -> Node:
        key, pose = key_of(element), element.first("pose")
        attached, relative = "", MODEL
        if element.tag == "joint":
            attached = relative = self.values.text(element, "child")
        elif element.tag == "frame":
            attached = element.attributes.get("attached_to", "")
            relative = attached or MODEL
        if pose is not None and pose.attributes.get("relative_to"):
            relative = pose.attributes["relative_to"]
        node = Node(name, element.tag, element, scope, self.values.pose(element, key), relative, attached)
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
