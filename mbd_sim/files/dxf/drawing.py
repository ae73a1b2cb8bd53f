"""What a layer of a DXF drawing has: lines, arcs and points, read by `ezdxf`, in m.

Polylines are read with their bulges, circles as two arcs, blocks with what is in them. Ellipses and splines become
straight lines that deviate by at most `CHORD`. Texts, dimensions and hatches are left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.packages import require_packages
from mbd_sim.files.text.units import factor

Place = tuple[float, float]
CHORD = 1e-5  # m, largest deviation of a line from the ellipse or the spline that it replaces
UNITS = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 10: "yd", 14: "dm"}  # by the number of $INSUNITS
FLAT = 1e-9  # of a normal, by which a drawing may be tilted


@dataclass(frozen=True)
class Stretch:
    """A line, or an arc `through` a third point, from `start` to `end`, in m."""

    start: Place
    end: Place
    through: Place | None = None

    def back(self) -> Stretch:
        """In the opposite direction."""
        return replace(self, start=self.end, end=self.start)


class DxfDrawing:
    """A DXF drawing; `unit` is that of its numbers, by default as the file says."""

    def __init__(self, path: Path, unit: str = "") -> None:
        """Read the file.

        :raises InputError: it is not a DXF file, or its unit is not known.
        :raises MissingPackageError: `ezdxf` is not installed.
        """
        require_packages("ezdxf", purpose="A DXF drawing")
        from ezdxf.filemanagement import readfile
        from ezdxf.lldxf.const import DXFError

        try:
            self._document = readfile(path)
        except (DXFError, UnicodeDecodeError, ValueError) as error:
            raise InputError(f"{path.name} is no DXF drawing: {error}", "Save it again as DXF.") from error
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror or error}", "Check the path.") from error
        self.path = path
        number = int(self._document.header.get("$INSUNITS", 0))
        if not unit and number not in UNITS:
            raise InputError(f"{path.name} does not say its unit", "Add 'unit: mm', or another unit of length.")
        self.scale = factor(unit or UNITS[number], "m")

    @cached_property
    def layers(self) -> tuple[str, ...]:
        """The layers that have something."""
        return tuple(dict.fromkeys(entity.dxf.layer for entity in self._document.modelspace()))

    def stretches(self, layer: str) -> list[Stretch]:
        """The lines and arcs of a layer.

        :raises InputError: there is no such layer, or something is not in the x-y plane.
        """
        found = [stretch for entity in self._entities(layer) for stretch in self._stretches(entity)]
        return [stretch for stretch in found if stretch.start != stretch.end]

    def point(self, layer: str) -> Place:
        """The only point of a layer: a point, a block's place, or the center of circles and arcs.

        :raises InputError: there is none, or there are several.
        """
        places = []
        for entity in self._entities(layer, within_blocks=False):
            kind = entity.dxftype()
            if kind == "POINT":
                places.append(entity.dxf.location)
            elif kind == "INSERT":
                places.append(entity.dxf.insert)
            elif kind in ("CIRCLE", "ARC"):
                places.append(self._in_plane(entity, entity.dxf.center))
        size = max((abs(number) for place in places for number in (place.x, place.y)), default=0.0)
        different = [one for one in places if math.dist((one.x, one.y), (places[0].x, places[0].y)) > 1e-9 * size]
        if not places:
            raise InputError(f"layer '{layer}' has no point, circle or block", "Draw a point or a circle there.")
        if different:
            raise InputError(
                f"layer '{layer}' has points at {1 + len(different)} places", "Give each a layer of its own."
            )
        return self._place(places[0])

    def _entities(self, layer: str, *, within_blocks: bool = True) -> Iterator[Any]:
        names = {name.casefold(): name for name in self.layers}
        if layer.casefold() not in names:
            known = nearest(layer, self.layers) or "It has none."
            raise InputError(f"{self.path.name} has no layer '{layer}' with anything on it", known)
        entities: Iterator[Any] = iter(self._document.modelspace())
        for entity in entities:
            if entity.dxf.layer.casefold() == layer.casefold():
                if entity.dxftype() == "INSERT" and within_blocks:
                    yield from entity.virtual_entities()
                else:
                    yield entity

    def _place(self, point: Any) -> Place:
        return self.scale * float(point[0]), self.scale * float(point[1])

    def _in_plane(self, entity: Any, point: Any) -> Any:
        """A point of an entity that may be drawn from below, as mirrored ones are."""
        if abs(abs(entity.dxf.extrusion.z) - 1.0) > FLAT:
            message = f"layer '{entity.dxf.layer}': a {entity.dxftype().lower()} is not in the x-y plane"
            raise InputError(message, "Draw the outline in the x-y plane.")
        return entity.ocs().to_wcs(point)

    def _stretches(self, entity: Any) -> Iterator[Stretch]:
        match entity.dxftype():
            case "LINE":
                yield Stretch(self._place(entity.dxf.start), self._place(entity.dxf.end))
            case "ARC" | "CIRCLE":
                yield from self._of_circle(entity)
            case "LWPOLYLINE" | "POLYLINE":
                self._in_plane(entity, (0.0, 0.0, 0.0))
                for part in entity.virtual_entities():
                    yield from self._stretches(part)
            case "ELLIPSE" | "SPLINE":
                points = [self._place(point) for point in entity.flattening(CHORD / self.scale)]
                yield from (Stretch(*pair) for pair in pairwise(points))
            case _:
                return

    def _of_circle(self, entity: Any) -> Iterator[Stretch]:
        """An arc by its middle, or a circle as two arcs."""
        center, radius = entity.dxf.center, entity.dxf.radius
        if entity.dxftype() == "CIRCLE":
            spans = [(0.0, 180.0), (180.0, 360.0)]
        else:
            start, end = entity.dxf.start_angle, entity.dxf.end_angle
            spans = [(start, start + ((end - start) % 360.0 or 360.0))]
            if spans[0][1] - start > 359.0:
                spans = [(start, start + 180.0), (start + 180.0, spans[0][1])]
        for first, last in spans:
            ends = []
            for angle in (first, 0.5 * (first + last), last):
                x, y = (math.cos(math.radians(angle)), math.sin(math.radians(angle)))
                offset = (center.x + radius * x, center.y + radius * y, center.z)
                ends.append(self._place(self._in_plane(entity, offset)))
            yield Stretch(ends[0], ends[2], ends[1])
