"""The profiles and points of a mechanism file, replaced by what the DXF drawings that they name have.

A shape `{type: outline, profile: {dxf: plate.dxf, layer: outline}}` gets the points of the largest closed chain of the
layer. Further chains in it are holes: shapes of their own that remove material. A point `{dxf: plate.dxf, layer: pin}`
gets the place of what is on its layer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import InputError, MechanismError, Problem, nearest
from mbd_sim.files.dxf.chains import closed_chains, outline_points
from mbd_sim.files.dxf.drawing import DxfDrawing, Place
from mbd_sim.files.text.library import digest_of_file
from mbd_sim.mechanism.values.source import Location, Source

_KEYS = ("dxf", "layer", "unit", "origin")
_POINT_KEYS = (*_KEYS, "plane", "rotate")
_AXES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


@dataclass
class _Reader:
    """The drawings that were read, and what is wrong."""

    source: Source
    drawings: dict[tuple[str, str], DxfDrawing] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def drawing(self, entry: Mapping[str, Any]) -> DxfDrawing:
        """The drawing that an entry names, relative to the folder of the mechanism file."""
        name, unit = str(entry["dxf"]), str(entry.get("unit") or "")
        if (name, unit) not in self.drawings:
            path = Path(self.source.file).parent / Path(name).expanduser()
            if not path.is_file():
                raise InputError(f"there is no file {path}", "Give its path, relative to the mechanism file.")
            self.drawings[name, unit] = DxfDrawing(path, unit)
        return self.drawings[name, unit]

    def origin(self, drawing: DxfDrawing, entry: Mapping[str, Any]) -> Place:
        """The place of a drawing that becomes the origin: numbers in its unit, or the layer of a point."""
        given = entry.get("origin", (0.0, 0.0))
        if isinstance(given, str):
            return drawing.point(given)
        if not (isinstance(given, list | tuple) and len(given) == 2 and all(isinstance(x, int | float) for x in given)):
            raise InputError("origin must be two numbers, or a layer", "Write [0, 0] in the unit of the drawing.")
        return drawing.scale * float(given[0]), drawing.scale * float(given[1])

    def report(self, location: Location, error: InputError) -> None:
        self.problems.append(self.source.problem_of(location, error))


def with_dxf(source: Source) -> Source:
    """The source with outlines and points in place of the drawings that it names.

    :raises MechanismError: a drawing cannot be read, or has not what is asked of it.
    :raises MissingPackageError: `ezdxf` is not installed.
    """
    if not isinstance(source.data, dict):
        return source
    reader, data = _Reader(source), dict(source.data)
    if isinstance(data.get("parts"), dict):
        data["parts"] = {
            name: _part(reader, ("parts", name), part) if isinstance(part, dict) else part
            for name, part in data["parts"].items()
        }
    if isinstance(data.get("ground"), dict):
        data["ground"] = _part(reader, ("ground",), data["ground"])
    if reader.problems:
        raise MechanismError(reader.problems)
    if not reader.drawings:
        return source
    read = {str(one.path): digest_of_file(one.path) for one in reader.drawings.values()}
    comments = source.comments if source.text is None else (f"From {Path(source.file).name} and its drawings.",)
    return replace(
        source,
        data=data,
        text=None,
        comments=comments,
        other_files=None if source.other_files is None else {**source.other_files, **read},
    )


def _part(reader: _Reader, location: Location, part: dict[str, Any]) -> dict[str, Any]:
    """A part, or ground, without drawings."""
    found = dict(part)
    if isinstance(part.get("points"), dict):
        found["points"] = {
            name: _point(reader, (*location, "points", name), entry) for name, entry in part["points"].items()
        }
    if _has_profile(part.get("shape")):
        shapes = _shapes(reader, (*location, "shape"), part["shape"])
        found["shape"] = shapes[0]
        if len(shapes) > 1:
            del found["shape"]
            found["shapes"] = shapes
    for key in ("shapes", "collisions"):
        if isinstance(part.get(key), list):
            found[key] = [
                shape
                for number, entry in enumerate(part[key])
                for shape in (_shapes(reader, (*location, key, number), entry) if _has_profile(entry) else [entry])
            ]
    return found


def _has_profile(shape: Any) -> bool:
    return isinstance(shape, dict) and isinstance(shape.get("profile"), dict)


def _point(reader: _Reader, location: Location, entry: Any) -> Any:
    if not (isinstance(entry, dict) and "dxf" in entry):
        return entry
    try:
        _require_keys(entry, _POINT_KEYS)
        drawing = reader.drawing(entry)
        x, y = drawing.point(str(entry["layer"]))
        origin = reader.origin(drawing, entry)
        plane = str(entry.get("plane", "xy"))
        if plane not in _AXES:
            raise InputError(f"there is no plane '{plane}'", "Write xy, xz or yz.")
    except InputError as error:
        reader.report(location, error)
        return [0.0, 0.0, 0.0]
    place = [0.0, 0.0, 0.0]
    for axis, value in zip(_AXES[plane], (x - origin[0], y - origin[1]), strict=True):
        place[axis] = value
    return {"at": place, "rotate": entry["rotate"]} if "rotate" in entry else place


def _shapes(reader: _Reader, location: Location, shape: dict[str, Any]) -> list[dict[str, Any]]:
    """The outline of a profile, and its holes."""
    profile = shape["profile"]
    kept = {key: value for key, value in shape.items() if key != "profile"}
    try:
        _require_keys(profile, _KEYS)
        if "points" in shape:
            raise InputError("has both points and a profile", "Give one of them.")
        drawing = reader.drawing(profile)
        layer = str(profile["layer"])
        chains = closed_chains(drawing.stretches(layer), layer)
        origin = reader.origin(drawing, profile)
        if len(chains) > 1 and shape.get("mass") is not None:
            message = f"layer '{layer}' has holes, so that a mass of its outline alone would not be that of the plate"
            raise InputError(message, "Give 'thickness' and 'density', or the mass of the part.")
    except InputError as error:
        reader.report((*location, "profile"), error)
        return [{**kept, "points": [[0, 0], [1, 0], [0, 1]]}]
    holes = {key: value for key, value in kept.items() if key != "name"}
    return [
        {**(holes if number else kept), "points": outline_points(chain, origin), **({"hole": True} if number else {})}
        for number, chain in enumerate(chains)
    ]


def _require_keys(entry: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in entry:
        if key not in known:
            raise InputError(f"'{key}' is not a key of a drawing", nearest(str(key), known))
    for key in ("dxf", "layer"):
        if not entry.get(key):
            raise InputError(f"lacks '{key}'", "Write {dxf: plate.dxf, layer: outline}.")
