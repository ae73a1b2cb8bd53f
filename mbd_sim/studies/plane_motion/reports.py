"""Instant centers, polygons and inflection circles as text and as columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.studies.plane_motion.centers import InstantCenter
from mbd_sim.studies.plane_motion.centrodes import Centrodes, InflectionCircle
from mbd_sim.studies.plane_motion.polygons import Polygons

HEAD = 34  # width of the first column


def centers_text(centers: Sequence[InstantCenter]) -> str:
    """A row for each pair of links."""
    lines = ["Instant centers"]
    for one in centers:
        name = " / ".join(one.links)
        where = f"({_plain(one.place)}) m" if one.place is not None else f"at infinity, {_direction(one.direction)}"
        lines.append(f"  {name:<{HEAD - 2}}{where:<34}{one.found_by}")
    return "\n".join(lines)


def polygons_text(found: Polygons) -> str:
    """The velocity and the acceleration of each point, and the components of relative accelerations."""
    lines = ["Velocities and accelerations of joints"]
    for vector in found.vectors:
        name = f"{vector.link} at {vector.joint}"
        lines.append(
            f"  {name:<{HEAD - 2}}({_plain(vector.velocity)}) m/s, {abs(vector.velocity):.6g}; "
            f"({_plain(vector.acceleration)}) m/s², {abs(vector.acceleration):.6g}"
        )
    lines.append("Relative accelerations on a link")
    for (first, second), (normal, tangential) in found.components.items():
        one, other = found.vectors[first], found.vectors[second]
        name = f"{one.link}: {one.joint} to {other.joint}"
        lines.append(f"  {name:<{HEAD - 2}}  normal {abs(normal):.6g} m/s², tangential {abs(tangential):.6g} m/s²")
    return "\n".join(lines)


def inflection_text(circle: InflectionCircle) -> str:
    """The pole and the circle of a part."""
    return (
        f"{f'Inflection circle of {circle.part}':<{HEAD}}pole ({_plain(circle.pole)}) m, center "
        f"({_plain(circle.center)}) m, diameter {2.0 * circle.radius:.6g} m"
    )


def centrode_columns(drive: tuple[str, Array], found: Sequence[Centrodes]) -> dict[str, Array]:
    """Columns (n,): the drive, and the pole of each part in ground's plane and in the axes of the part."""
    columns = {drive[0]: drive[1]}
    for one in found:
        for name, path in (("fixed", one.fixed), ("moving", one.moving)):
            columns |= {f"{one.part}.{name}.x_m": path.real, f"{one.part}.{name}.y_m": path.imag}
    return columns


def _plain(point: complex) -> str:
    rounded = complex(np.round(point, 12))
    return f"{rounded.real + 0.0:.6g}, {rounded.imag + 0.0:.6g}"


def _direction(direction: complex | None) -> str:
    return f"toward {np.degrees(np.angle(direction or 0j)):.6g} deg"
