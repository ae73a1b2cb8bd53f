"""Linkages for poses as pictures: the poses, the centers and circle points that were found, and one linkage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.studies.kinematic_analysis.picture import require_picture_suffix
from mbd_sim.studies.synthesis.linkages.dyads import Dyad
from mbd_sim.studies.synthesis.linkages.four_bars import DrivenLinkage, PoseLinkage
from mbd_sim.studies.synthesis.linkages.poses import PoseSolutions

RESOLUTION = 110.0  # pixels per inch, of PNG
FAR = 4.0  # sizes of the poses around them, up to which points are drawn
BODY, DRIVER, FOLLOWER, CENTERS, POINTS = "#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e"


@interruptible()
def draw_poses(path: Path, found: PoseSolutions, linkage: PoseLinkage | None) -> None:
    """Draw the poses with all dyads, and a linkage in the first pose with the way of its body.

    :raises InputError: the file has another suffix.
    :raises MbdSimError: it cannot be written.
    """
    require_picture_suffix(path)
    require_packages("matplotlib", purpose="A picture")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 6.5), layout="constrained")
    axes = figure.add_subplot()
    places = np.array([pose.origin for pose in found.poses])
    shown = list(places)
    size = float(np.max(np.abs(places - places.mean()))) or found.motion.size
    near = [dyad for dyad in found.dyads if abs(dyad.center - places.mean()) < FAR * size]
    links = [dyad for dyad in near if dyad.kind == "RR"]
    few = len(links) <= 8
    _dots(axes, np.array([one.center for one in links]), CENTERS, "centers", few)
    _dots(axes, np.array([one.point for one in links]), POINTS, "circle points, in the first pose", few)
    if linkage is not None:
        shown += [linkage.driver.center, linkage.follower.center]
        shown += [*found.motion.of(linkage.driver.point), *found.motion.of(linkage.follower.point)]
        _draw_linkage(axes, found, linkage)
    for number, pose in enumerate(found.poses, 1):
        tip = pose.origin + 0.3 * size * pose.turn
        axes.annotate("", (tip.real, tip.imag), (pose.x, pose.y), arrowprops={"arrowstyle": "->", "lw": 1.8})
        axes.annotate(str(number), (pose.x, pose.y), textcoords="offset points", xytext=(-9, 5), fontsize="large")
    every = np.array(shown)
    margin = 0.15 * max(float(np.ptp(every.real)), float(np.ptp(every.imag)), size)
    axes.set_xlim(every.real.min() - margin, every.real.max() + margin)
    axes.set_ylim(every.imag.min() - margin, every.imag.max() + margin)
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlabel="x (m)", ylabel="y (m)", title=_title(found, linkage))
    axes.grid(alpha=0.25)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.1), frameon=False, fontsize="small", ncols=3)
    try:
        figure.savefig(path, dpi=RESOLUTION)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {error}") from error


def _title(found: PoseSolutions, linkage: PoseLinkage | None) -> str:
    if linkage is None:
        return f"{len(found.poses)} poses"
    angle = f"{np.degrees(linkage.transmission):.3g}° transmission angle"
    return f"{linkage.kind}, {angle}{f', {linkage.defects}' if linkage.defects else ''}"


def _dots(axes: Any, points: np.ndarray[Any, Any], color: str, label: str, large: bool) -> None:
    if len(points):
        axes.plot(points.real, points.imag, "o" if large else ".", ms=6 if large else 2.5, color=color, label=label)


def _draw_linkage(axes: Any, found: PoseSolutions, linkage: PoseLinkage) -> None:
    motion, first = found.motion, found.poses[0]
    for dyad, color, name in ((linkage.driver, DRIVER, "driver"), (linkage.follower, FOLLOWER, "follower")):
        _draw_dyad(axes, found, dyad, color, name)
    corners = np.array([linkage.driver.point, linkage.follower.point, first.origin, linkage.driver.point])
    for index, turn in enumerate(motion.turns):
        place = turn * corners + motion.shifts[index]
        axes.fill(place.real, place.imag, color=BODY, alpha=0.25 if index == 0 else 0.08, lw=0)
        axes.plot(
            place.real, place.imag, color=BODY, lw=1.8 if index == 0 else 0.6, label="body" if index == 0 else None
        )
    if not linkage.defects:
        driven = DrivenLinkage(motion, linkage.driver, linkage.follower)
        path = np.linspace(linkage.drives[0], linkage.drives[-1], 181)
        turns, points = driven.turns(path, float(driven.signs[0])), driven.points(path)
        origin = points + turns * (first.origin - linkage.driver.point)
        axes.plot(origin.real, origin.imag, color="0.3", lw=1.0, ls="--", label="way of the origin")


def _draw_dyad(axes: Any, found: PoseSolutions, dyad: Dyad, color: str, name: str) -> None:
    ends = np.array([dyad.center, dyad.point])
    if dyad.kind == "RR":
        axes.plot(ends.real, ends.imag, "-o", color=color, lw=2.4, ms=5, label=name)
        axes.plot(dyad.center.real, dyad.center.imag, "^", color=color, ms=11)
        return
    reach = (
        np.real((found.motion.of(dyad.point) - dyad.point) / dyad.direction) if dyad.kind == "PR" else np.array([0.0])
    )
    length = max(float(np.ptp(reach)), 0.5 * found.motion.size)
    line = dyad.point + dyad.direction * (float(reach.mean()) + np.array([-0.7, 0.7]) * length)
    axes.plot(
        line.real,
        line.imag,
        color=color,
        lw=1.2,
        ls="-.",
        label=f"{name}: {'guide' if dyad.kind == 'PR' else 'line of the body'}",
    )
    axes.plot(dyad.center.real, dyad.center.imag, "s" if dyad.kind == "PR" else "^", color=color, ms=10)
