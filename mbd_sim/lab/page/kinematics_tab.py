"""A turn of a drive: dead points, limit positions, transmission angles, and the whole path of a point."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.scene.traces import TIPS, traceable
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.session import Session
from mbd_sim.lab.session.sliders import Setting
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.shapes import palette

NONE = "none"
HEIGHT = 170  # px of the plot
DEFINITION = "It is the angle between coupler and follower, or the normal of a slide, folded at 90 deg, which is best."


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is to be analyzed: the drive, and the point whose path is shown, of a mechanism with certain lengths."""

    mechanism: Mechanism
    drive: str
    point: str
    reach: float  # m, through which a slide moves to both sides


@dataclass(frozen=True, eq=False)
class Analysis:
    """A text, the travel (n,) of the drive and the transmission angles (n,) in deg by pin, and the path (n, 3).

    `angles` give the transmission angle in rad by pin for coordinates (nq,).
    """

    text: str
    travel: Array = field(default_factory=lambda: np.zeros(1))
    transmission: dict[str, Array] = field(default_factory=dict)
    angles: dict[str, Callable[[Array], float]] = field(default_factory=dict)
    path: Array = field(default_factory=lambda: np.zeros((0, 3)))


def analyze(wanted: Wanted) -> Analysis:
    """Move the drive through a turn, or along its slide, and back from dead points."""
    from mbd_sim.studies.kinematic_analysis.loads import TransmissionAngle, couplers_and_followers
    from mbd_sim.studies.kinematic_analysis.motion import driven_motion
    from mbd_sim.studies.kinematic_analysis.text import motion_text

    mechanism, name = wanted.mechanism, wanted.drive
    joint = next(one for one in mechanism.joints.values() if name in one.coordinate_names)
    (start,), (coordinate,) = joint.position, joint.kind.coordinates
    limits = joint.limits_of(0)
    reach = math.pi if coordinate.rotation else wanted.reach
    low, high = start - reach, start + reach
    if limits is not None and math.isfinite(limits.upper - limits.lower):
        low, high = limits.lower, limits.upper
    try:
        motion = driven_motion(mechanism, {name: (low, high)}, dead_points="follow")
        pins = couplers_and_followers(mechanism, [name])
        text = motion_text(motion, [], pins, None).split("\n\n")[0]
        path = motion.point(wanted.point).position if wanted.point != NONE else np.zeros((0, 3))
    except MbdSimError as error:
        return Analysis(str(error))
    angles = {one.pin: TransmissionAngle(motion.system, one) for one in pins}
    plain = motion.q.shape[1] == len(mechanism.coordinate_names)  # without quaternions, as frames have them
    travel = np.cumsum(np.abs(np.diff(motion.drives[:, 0], prepend=motion.drives[0, 0])))
    found = {pin: np.degrees([angle(q) for q in motion.q]) for pin, angle in angles.items()}
    return Analysis(
        text, np.degrees(travel) if coordinate.rotation else travel, found, dict(angles) if plain else {}, path
    )


def coupler_point(mechanism: Mechanism) -> str:
    """A point with a curve of its own: away from the joints of a part that no joint connects to ground; else none."""
    grounded, pins = set[str](), dict[str, list[Array]]()
    for joint in mechanism.all_joints.values():
        if GROUND in (joint.parent, joint.child):
            grounded |= {joint.parent, joint.child}
        pins.setdefault(joint.parent, []).append(joint.parent_pose.position)
        pins.setdefault(joint.child, []).append(joint.child_pose.position)
    for part in mechanism.parts.values():
        for name, pose in part.points.items():
            free = not any(np.allclose(pose.position, pin) for pin in pins.get(part.name, ()))
            if free and part.name not in grounded:
                return f"{part.name}.{name}"
    return NONE


class KinematicsTab:
    """The choice of the drive and the point; the analysis follows changed lengths in a thread of its own."""

    def __init__(self, gui: Any, session: Session, scene: Scene, settings: list[Setting], size: float) -> None:
        bench = session.bench
        mechanism = bench.simulation.mechanism
        self._session, self._scene, self._settings, self._size = session, scene, settings, size
        names = [
            one.name for one in mechanism.joints.values() if not one.drive and one.type in ("revolute", "prismatic")
        ]
        self._drive = gui.add_dropdown("Drive", (NONE, *names), initial_value=bench.drive or NONE)
        points = (NONE, *(one for one in traceable(mechanism) if one != TIPS))
        curve = coupler_point(mechanism)
        start = curve if bench.drive else NONE
        self._point = gui.add_dropdown("Path of", points, initial_value=start, hint="the coupler curve of this point")
        self._offered = NONE if bench.drive else curve  # with the first drive that is chosen
        self._drive.on_update(self._offer)
        gui.add_button("Keep this curve").on_click(lambda _: scene.keep_path(self._changes()))
        gui.add_button("Clear the kept curves", color="gray").on_click(lambda _: scene.clear_kept_paths())
        self._now, self._text = gui.add_markdown(""), gui.add_markdown("Choose the drive that moves the mechanism.")
        self._plot = gui.add_uplot(
            (np.zeros(1), np.zeros(1)),
            ({"label": "travel"}, {"label": ""}),
            title="Transmission angle (deg) over the travel of the drive",
            scales={"x": {"time": False, "auto": True}, "y": {"auto": True}},
            height=HEIGHT,
            visible=False,
        )
        self._asked: tuple[Mechanism | None, str, str] = (None, NONE, NONE)
        self._busy = False
        self._found = self._shown = Analysis("")

    def show(self, frame: Frame) -> None:
        """Show the analysis of the present lengths, and the transmission angles of the present configuration."""
        asked = frame.mechanism, self._drive.value, self._point.value
        if self._drive.value != NONE and not self._busy and asked != self._asked:
            self._busy, self._asked = True, asked
            threading.Thread(target=self._analyze, args=(Wanted(*asked, self._size),), daemon=True).start()
        if self._found is not self._shown:
            self._shown = self._found
            self._present(self._shown)
        angles = [f"{pin}: {math.degrees(one(frame.positions)):.1f} deg" for pin, one in self._shown.angles.items()]
        text = f"**Transmission angle** now: {', '.join(angles)}. {DEFINITION}" if angles else ""
        if text != self._now.content:
            self._now.content = text

    def _offer(self, _: Any) -> None:
        if self._drive.value != NONE and self._offered != NONE:
            if self._point.value == NONE:
                self._point.value = self._offered
            self._offered = NONE

    def _changes(self) -> str:
        """The values that are not those of the file, in its units."""
        values = self._session.frame.values
        changed = [
            f"{one.label} = {values[one.key] / one.factor:.4g} {one.unit}".strip()
            for one in self._settings
            if one.kind == "value" and not math.isclose(values[one.key], one.value * one.factor, abs_tol=1e-12)
        ]
        return ", ".join(changed) or "as in the file"

    def _analyze(self, wanted: Wanted) -> None:
        try:
            self._found = analyze(wanted)
        finally:
            self._busy = False

    def _present(self, found: Analysis) -> None:
        self._text.content = "\n\n".join(map(_as_markdown, found.text.splitlines()))
        self._scene.draw_path(found.path)
        self._plot.visible = bool(found.transmission)
        if found.transmission:
            colors = ["rgb({},{},{})".format(*color) for color in palette.PARTS]
            self._plot.series = (
                {"label": "travel"},
                *(
                    {"label": pin, "stroke": colors[number % len(colors)], "width": 1.5}
                    for number, pin in enumerate(found.transmission)
                ),
            )
            self._plot.data = (found.travel, *found.transmission.values())


def _as_markdown(line: str) -> str:
    """A line of a report that is too wide for the panel: its head in bold, and what it says, angles to 0.1 deg."""
    line = re.sub(r"-?\d+\.\d+(?= deg)", lambda number: f"{float(number[0]):.1f}", line)
    head, _, text = line.partition("  ")
    return f"**{head}** {text.strip()}" if head and text else line.strip()
