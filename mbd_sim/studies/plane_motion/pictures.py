"""Instant centers, polygons and centrodes as one picture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.studies.kinematic_analysis.picture import require_picture_suffix
from mbd_sim.studies.plane_motion.centers import InstantCenter
from mbd_sim.studies.plane_motion.centrodes import Centrodes, Complexes, InflectionCircle
from mbd_sim.studies.plane_motion.polygons import Polygons
from mbd_sim.studies.plane_motion.snapshot import PlaneSnapshot

RESOLUTION = 110.0  # pixels per inch, of PNG
FAR = 2.5  # sizes of the mechanism around it, up to which centers are drawn
COLORS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22")


@interruptible()
def draw_plane_motion(
    path: Path,
    snapshot: PlaneSnapshot,
    centers: Sequence[InstantCenter],
    found: Polygons | None = None,
    paths: Sequence[Centrodes] = (),
    circles: Sequence[InflectionCircle] = (),
    title: str = "",
) -> None:
    """Draw the links with their instant centers, centrodes and inflection circles, and the polygons beside them.

    :raises InputError: the file has another suffix.
    :raises MbdSimError: it cannot be written.
    """
    require_picture_suffix(path)
    require_packages("matplotlib", purpose="A picture")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0 if found else 7.0, 6.5), layout="constrained")
    grid = figure.add_gridspec(2, 3 if found else 1)
    axes = figure.add_subplot(grid[:, :2] if found else grid[:, :])
    low, high = _draw_links(axes, snapshot)
    _draw_centers(axes, centers, low, high)
    for number, one in enumerate(paths):
        _draw_centrodes(axes, snapshot, one, COLORS[(2 * number + 3) % len(COLORS)])
    for circle in circles:
        turn = circle.center + circle.radius * np.exp(2j * np.pi * np.linspace(0.0, 1.0, 181))
        axes.plot(turn.real, turn.imag, color="0.45", lw=1.0, ls=":", label=f"inflection circle of {circle.part}")
    axes.set_xlim(low.real, high.real)
    axes.set_ylim(low.imag, high.imag)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(alpha=0.25)
    axes.set(xlabel="m", ylabel="m", title=title)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), frameon=False, fontsize="small", ncols=4)
    if found:
        _draw_polygon(figure.add_subplot(grid[0, 2]), snapshot, found, "velocity")
        _draw_polygon(figure.add_subplot(grid[1, 2]), snapshot, found, "acceleration")
    try:
        figure.savefig(path, dpi=RESOLUTION)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _draw_links(axes: Any, snapshot: PlaneSnapshot) -> tuple[complex, complex]:
    """Draw the links between their joints; returns the corners of what is shown."""
    places = np.array([joint.place for joint in snapshot.joints])
    for number, name in enumerate(one for one in snapshot.links if one != GROUND):
        own = np.array([joint.place for joint in snapshot.joints if name in joint.links])
        ends = np.append(own, own[:1])
        axes.plot(ends.real, ends.imag, "-", color=COLORS[number % len(COLORS)], lw=3.0, alpha=0.75, label=name)
    for joint in snapshot.joints:
        if joint.direction:
            line = joint.place + joint.direction * np.array([-0.35, 0.35]) * snapshot.size
            axes.plot(line.real, line.imag, color="0.4", lw=1.0, ls="-.")
        marker = ("s" if joint.direction else "^") if GROUND in joint.links else "o"
        axes.plot(joint.place.real, joint.place.imag, marker, color="0.2", ms=7, mfc="white")
    extent = max(float(np.ptp(places.real)), float(np.ptp(places.imag)), 0.5 * snapshot.size)
    margin = complex(1.0, 1.0) * FAR * 0.5 * extent
    return complex(places.real.min(), places.imag.min()) - margin, complex(
        places.real.max(), places.imag.max()
    ) + margin


def _draw_centers(axes: Any, centers: Sequence[InstantCenter], low: complex, high: complex) -> None:
    """Draw the centers, and the lines on which those of three links are."""
    near = {one.links: one.place for one in centers if one.place is not None and _inside(one.place, low, high)}
    names = list(dict.fromkeys(name for one in centers for name in one.links))
    for three in combinations(names, 3):
        points = np.array([near[pair] for pair in combinations(three, 2) if pair in near])
        if len(points) == 3:
            far = max(combinations(points, 2), key=lambda pair: abs(pair[0] - pair[1]))
            axes.plot(np.real(far), np.imag(far), color="0.6", lw=0.7, ls="--", zorder=0)
    labels: dict[complex, list[str]] = {}
    for links, place in near.items():
        labels.setdefault(complex(np.round(place, 9)), []).append("/".join(links))
    for place, texts in labels.items():
        axes.plot(place.real, place.imag, "x", color="black", ms=6)
        axes.annotate(", ".join(texts), (place.real, place.imag), textcoords="offset points", xytext=(5, 5), fontsize=8)


def _inside(place: complex, low: complex, high: complex) -> bool:
    return low.real <= place.real <= high.real and low.imag <= place.imag <= high.imag


def _draw_centrodes(axes: Any, snapshot: PlaneSnapshot, one: Centrodes, color: str) -> None:
    """Draw both centrodes, the moving one where the part is."""
    link = next(link for link in snapshot.links.values() if one.part in link.parts)
    moving = link.place + link.turn * one.moving
    for path, style, name in ((one.fixed, "-", "fixed"), (moving, "--", "moving")):
        drawn = _broken(path, snapshot.size)
        axes.plot(drawn.real, drawn.imag, style, color=color, lw=1.4, label=f"{name} centrode of {one.part}")


def _broken(path: Complexes, size: float) -> Complexes:
    """A path with gaps where it goes through infinity."""
    far = np.append(np.abs(np.diff(path)) > 10.0 * size, False)
    return np.where(far, complex(np.nan, np.nan), path)


def _draw_polygon(
    axes: Any, snapshot: PlaneSnapshot, found: Polygons, kind: Literal["velocity", "acceleration"]
) -> None:
    """Draw vectors from the pole to the images of points, and the images of links."""
    images: Array = np.array([found.image(index, kind) for index in range(len(found.vectors))])
    size = float(np.max(np.abs(images))) or 1.0
    moving = [name for name in snapshot.links if name != GROUND]
    for number, name in enumerate(moving):
        for first, second in found.edges[name]:
            ends = images[[first, second]]
            axes.plot(ends.real, ends.imag, "-", color=COLORS[number % len(COLORS)], lw=2.4, alpha=0.75)
    labels: dict[complex, dict[str, None]] = {}
    for index, vector in enumerate(found.vectors):
        if abs(images[index]) < 1e-9 * size:
            continue
        axes.annotate(
            "", (images[index].real, images[index].imag), (0.0, 0.0), arrowprops={"arrowstyle": "->", "lw": 0.9}
        )
        labels.setdefault(complex(np.round(images[index] / size, 6)), {})[vector.joint] = None
    for place, names in labels.items():
        at = place * size
        axes.annotate(", ".join(names), (at.real, at.imag), textcoords="offset points", xytext=(4, 4), fontsize=8)
    axes.plot(0.0, 0.0, "o", color="black", ms=5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.2)
    axes.grid(alpha=0.25)
    unit = "m/s" if kind == "velocity" else "m/s²"
    axes.set(title=f"{kind.capitalize()} polygon", xlabel=unit, ylabel=unit)
