"""Reads STEP files: the tree of their assemblies, with names, colors and placements, by OpenCASCADE.

A component is a part; of a component with several solids each one is. A sub-assembly whose name is among `rigid`
becomes one part. Instances of the same component share its geometry. Lengths are converted by the units of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError, listed
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.base.packages import require_packages
from mbd_sim.files.text.library import CAD_SUFFIXES
from mbd_sim.imports.assembly import Body, CadAssembly, ImportedPart, PlacedBody
from mbd_sim.mechanism.elements.parts import is_frame_name
from mbd_sim.mechanism.values.names import accepted_names, unique_name

SUFFIXES = CAD_SUFFIXES
MOST_BYTES = 300_000_000  # of a file
MOST_PARTS = 1000
MILLIMETER = 1e-3  # m, the unit of OpenCASCADE, to which it converts
# What programs write where nobody gave a name.
_UNNAMED = re.compile(r"(NAUO\d*|=>.*|Open CASCADE.*|(Compound|Solid|Shape)\W*\d*|)", re.IGNORECASE)


def read_step(path: Path, rigid: Sequence[str] = ()) -> CadAssembly:
    """The assembly in a STEP file.

    :param rigid: names of sub-assemblies that become one part each; * stands for any letters.
    :raises InputError: it cannot be read, contains no solids, or is too large; the message says why.
    :raises MissingPackageError: OpenCASCADE is not installed.
    """
    require_packages("OCP", purpose="Reading STEP")
    _require_step(path)
    document, units = _document(path)
    reading = _Reading(document, tuple(rigid), path.stem)
    parts = reading.parts()
    if not parts:
        _refuse_without_solids(path, reading)
    if unused := [pattern for pattern in rigid if pattern not in reading.matched]:
        raise InputError(
            f"no sub-assembly or component of several solids is called {listed(unused)}",
            f"There are: {listed(reading.groups)}." if reading.groups else "The file has none: leave out --rigid.",
        )
    notes = [f"{path.name} is in {listed(units) or 'mm'}"]
    if reading.without_solids:
        notes.append(f"left out, as they have surfaces or curves only: {listed(reading.without_solids)}")
    return CadAssembly(path.stem, tuple(parts), tuple(notes))


def _require_step(path: Path) -> None:
    size = path.stat().st_size
    if size > MOST_BYTES:
        message = f"{path}: the file has {size / 1e6:.0f} MB, and at most {MOST_BYTES / 1e6:.0f} MB are read"
        raise InputError(message, "Export fewer parts, or without threads and texts.")
    with path.open("rb") as file:
        start = file.read(1000)
    if not start.strip():
        raise InputError(f"{path}: the file is empty", "Export it again.")
    if b"ISO-10303-21" not in start:
        raise InputError(f"{path}: this is not a STEP file", "It would begin with ISO-10303-21. Export it as STEP.")


def _document(path: Path) -> tuple[Any, list[str]]:
    """The document of OpenCASCADE, and the names of the units of length in the file."""
    from OCP.collections import Sequence_TCollection_AsciiString
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Message import Message
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFApp import XCAFApp_Application

    for printer in list(Message.DefaultMessenger_s().Printers()):  # which write to the standard output
        Message.DefaultMessenger_s().RemovePrinter(printer)
    application = XCAFApp_Application.GetApplication_s()
    document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
    application.NewDocument(TCollection_ExtendedString("BinXCAF"), document)
    reader = STEPCAFControl_Reader()
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    if reader.ReadFile(str(path)) != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise InputError(f"{path}: the file is damaged: its entities cannot be read", "Export it again.")
    lengths, angles, solid_angles = (Sequence_TCollection_AsciiString() for _ in range(3))
    reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
    if not reader.Transfer(document):
        raise InputError(f"{path}: the file contains no shapes", "Export its solids.")
    return document, sorted({unit.ToCString().lower() for unit in lengths})


def _refuse_without_solids(path: Path, reading: _Reading) -> None:
    if reading.without_solids:
        message = f"{path}: the file contains no solids, only surfaces or curves ({listed(reading.without_solids)})"
        raise InputError(message, "Mass and inertia need solids: close the surfaces in CAD, and export them as solids.")
    raise InputError(f"{path}: the file contains no shapes", "Export its solids.")


@dataclass
class _Reading:
    """A pass through the tree of a document."""

    document: Any
    rigid: tuple[str, ...]
    file: str  # the name of what has none
    matched: set[str] = field(default_factory=set)
    groups: list[str] = field(default_factory=list)
    without_solids: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        from OCP.XCAFDoc import XCAFDoc_DocumentTool

        self._shapes = XCAFDoc_DocumentTool.ShapeTool_s(self.document.Main())
        self._colors = XCAFDoc_DocumentTool.ColorTool_s(self.document.Main())
        self._bodies: dict[str, list[tuple[Body, str | None, str]]] = {}

    def parts(self) -> list[ImportedPart]:
        """All parts, with names of their own.

        :raises InputError: there are too many.
        """
        from OCP.collections import Sequence_TDF_Label

        roots = Sequence_TDF_Label()
        self._shapes.GetFreeShapes(roots)
        found: list[ImportedPart] = []
        for root in roots:
            found += self._parts_of(root, Pose(np.zeros(3), np.eye(3)), ())
            if len(found) > MOST_PARTS:
                message = f"the assembly has more than {MOST_PARTS} parts"
                raise InputError(message, "Join those that move together with --rigid, or leave out small ones in CAD.")
        valid = accepted_names([part.name for part in found], "part", is_frame_name)
        used: set[str] = set()
        named = []
        for part in found:
            name = unique_name(valid[part.name], used)
            used.add(name)
            named.append(replace(part, name=name))
        return named

    def _parts_of(self, label: Any, outer: Pose, path: tuple[str, ...]) -> Iterator[ImportedPart]:
        """The parts of a component or a sub-assembly."""
        product = self._product(label)
        pose = outer @ _pose(self._shapes.GetLocation_s(label))
        names = [name for name in (_name(label), _name(product)) if not _UNNAMED.fullmatch(name)]
        name = names[0] if names else (path[-1] if path else self.file)
        solids = list(self._solids(label, pose, names, path))
        several = self._shapes.IsAssembly_s(product) or len(solids) > 1
        if several:
            self.groups.append(name)
            if self._is_rigid([*names, "/".join((*path, name))]):
                inverse = pose.inverse()
                bodies = [replace(body, pose=inverse @ body.pose) for body in solids]
                yield ImportedPart(name, pose, tuple(bodies))
                return
        if self._shapes.IsAssembly_s(product):
            for component in self._components(product):
                yield from self._parts_of(component, pose, (*path, name))
            return
        if not solids:
            self.without_solids.append(name)
        for body in solids:
            own = body.names[0] if several else name
            yield ImportedPart(own, pose, (replace(body, pose=Pose(np.zeros(3), np.eye(3))),))

    def _solids(self, label: Any, pose: Pose, names: Sequence[str], path: tuple[str, ...]) -> Iterator[PlacedBody]:
        """All solids inside a component, each at its pose in the assembly."""
        product = self._product(label)
        here = list(names) or list(path[-1:]) or [self.file]
        if self._shapes.IsAssembly_s(product):
            for component in self._components(product):
                inner = pose @ _pose(self._shapes.GetLocation_s(component))
                own = [_name(component), _name(self._product(component))]
                own = [name for name in own if not _UNNAMED.fullmatch(name)]
                yield from self._solids(component, inner, own, (*path, here[0]))
            return
        instance_color = self._color(label)
        for body, color, name in self._bodies_of(product):
            called = [name] if name else []
            every = (*called, *here, "/".join((*path, here[0])))
            yield PlacedBody(body, pose, tuple(dict.fromkeys(every)), instance_color or color)

    def _bodies_of(self, product: Any) -> list[tuple[Body, str | None, str]]:
        """The solids of a component, each with its color and its own name, if it has one."""
        from mbd_sim.imports.step_geometry import body_of, solids_of

        key = _entry(product)
        if key not in self._bodies:
            shape, found = self._shapes.GetShape_s(product), []
            own = self._color(product)
            for solid in solids_of(shape):
                label = _new_label()
                named = self._shapes.FindSubShape(product, solid, label)
                name = _name(label) if named else ""
                color = (self._color(label) if named else None) or self._face_color(solid) or own
                found.append((body_of(solid, _name(product)), color, "" if _UNNAMED.fullmatch(name) else name))
            self._bodies[key] = found
        return self._bodies[key]

    def _is_rigid(self, names: Sequence[str]) -> bool:
        found = [pattern for pattern in self.rigid if any(fnmatchcase(name, pattern) for name in names)]
        self.matched.update(found)
        return bool(found)

    def _product(self, label: Any) -> Any:
        """What a component refers to, or the label itself."""
        found = _new_label()
        return found if self._shapes.GetReferredShape_s(label, found) else label

    def _components(self, product: Any) -> list[Any]:
        from OCP.collections import Sequence_TDF_Label

        found = Sequence_TDF_Label()
        self._shapes.GetComponents_s(product, found)
        return list(found)

    def _color(self, item: Any) -> str | None:
        """The color of a label or a shape, as #rrggbb."""
        from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
        from OCP.XCAFDoc import XCAFDoc_ColorType

        color = Quantity_Color()
        for kind in (XCAFDoc_ColorType.XCAFDoc_ColorSurf, XCAFDoc_ColorType.XCAFDoc_ColorGen):
            of_label = hasattr(item, "FindAttribute")
            found = self._colors.GetColor_s(item, kind, color) if of_label else self._colors.GetColor(item, kind, color)
            if found:
                values = color.Values(Quantity_TypeOfColor.Quantity_TOC_sRGB)
                return "#" + "".join(f"{round(255.0 * min(max(value, 0.0), 1.0)):02x}" for value in values)
        return None

    def _face_color(self, solid: Any) -> str | None:
        """The color of a solid, or of the most of its faces."""
        from mbd_sim.imports.step_geometry import faces_of

        if own := self._color(solid):
            return own
        colors = [color for face in faces_of(solid) if (color := self._color(face))]
        return max(sorted(set(colors)), key=colors.count) if colors else None


def _new_label() -> Any:
    from OCP.TDF import TDF_Label

    return TDF_Label()


def _name(label: Any) -> str:
    from OCP.TDataStd import TDataStd_Name

    attribute = TDataStd_Name()
    if not label.FindAttribute(TDataStd_Name.GetID_s(), attribute):
        return ""
    return " ".join(str(attribute.Get().ToExtString()).split())


def _entry(label: Any) -> str:
    from OCP.TCollection import TCollection_AsciiString
    from OCP.TDF import TDF_Tool

    text = TCollection_AsciiString()
    TDF_Tool.Entry_s(label, text)
    return str(text.ToCString())


def _pose(location: Any) -> Pose:
    """A placement, with its translation in m."""
    transformation = location.Transformation()
    matrix = np.array([[transformation.Value(row, column) for column in (1, 2, 3, 4)] for row in (1, 2, 3)])
    return Pose(MILLIMETER * matrix[:, 3], matrix[:, :3])
