"""Where a point of a part shall be: the mechanism, or the commands of its joints, follow by inverse kinematics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbd_sim.analysis.mechanics.inverse_kinematics import InverseKinematics
from mbd_sim.base.geometry.pose import Array, Pose, unpack_poses
from mbd_sim.base.geometry.rotation import from_rpy, to_rpy
from mbd_sim.lab.scene.target import Target
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.reaching import Goal, Reacher, pose_of, position_commands
from mbd_sim.lab.session.session import Session
from mbd_sim.mechanism.mechanism import Mechanism

NONE = "none"
HELD = "the point that was held last"
DIGITS = 4  # of a position in m
_NOTHING: tuple[InverseKinematics | None, bool, str] = (None, False, "")
TAKE_HOLD = "Take hold of a part in the scene: it is the point under the pointer."


class ReachPanel:
    """A folder with the point, its target, and what was found; the target is in the scene as well."""

    def __init__(self, gui: Any, scene: Any, session: Session, reacher: Reacher, size: float) -> None:
        """Add the folder to the container that is open in viser's `gui`; `scene` is viser's."""
        self._session, self._reacher = session, reacher
        self._model = session.bench.simulation.model
        self._mechanism: Mechanism = session.bench.simulation.mechanism
        self._held: tuple[str, Array] | None = None
        self._shown = _NOTHING
        self._target = Target(scene, size, self._dragged)
        self._pose: Pose | None = None  # of the target, with all digits
        parts = self._mechanism.parts.values()
        names = [name for part in parts for name in (part.name, *(f"{part.name}.{point}" for point in part.points))]
        with gui.add_folder("Bring a point to a target"):
            self._point = gui.add_dropdown("Point", (NONE, HELD, *names), initial_value=NONE)
            step = float(f"{size / 400.0:.0e}")
            self._position = gui.add_vector3("x, y, z (m)", (0.0, 0.0, 0.0), step=step, visible=False)
            self._turns = gui.add_checkbox("Orientation too", initial_value=False, visible=False)
            self._angles = gui.add_vector3(
                "Roll, pitch, yaw (deg)", (0.0, 0.0, 0.0), step=1.0, visible=False, hint="as `rpy` of the file"
            )
            self._put = gui.add_button("Put it there", visible=False)
            self._command = gui.add_button("Command the joints", visible=False, hint="servos and drives of positions")
            self._back = gui.add_button("Target back to the point", color="gray", visible=False)
            self._text = gui.add_markdown("")
        self._point.on_update(lambda _: self._choose())
        self._position.on_update(self._typed)
        self._angles.on_update(self._typed)
        self._turns.on_update(lambda _: self._choose())
        self._put.on_click(lambda _: self._ask())
        self._command.on_click(lambda _: self._ask(command=True))
        self._back.on_click(lambda _: self._choose())

    def hold(self, part: str, point: Array) -> None:
        """A page has taken hold of a point (3,) of a part, in its frame."""
        self._held = part, point
        if self._point.value == HELD:
            self._choose()

    def show(self, frame: Frame) -> None:
        """Say what was found."""
        reacher, text = self._reacher, ""
        told = reacher.found, reacher.searching, reacher.refused
        if told == self._shown or self._point.value == NONE:
            return
        self._shown = told
        if reacher.found is not None:
            refused, turns = reacher.refused, self._turns.value
            text = found_text(
                frame.mechanism, reacher.found, reacher.searching, refused, commanded=reacher.commanded, turns=turns
            )
        self._text.content = text

    def _choose(self) -> None:
        """Begin with the target where the chosen point is now."""
        chosen = self._chosen()
        for control in (self._position, self._turns, self._put, self._back):
            control.visible = chosen is not None
        self._angles.visible = chosen is not None and self._turns.value
        commands = position_commands(self._mechanism, dict.fromkeys(self._mechanism.joints, 0.0))
        self._command.visible = chosen is not None and bool(commands)
        self._reacher.found, self._shown = None, _NOTHING
        self._text.content = TAKE_HOLD if self._point.value == HELD and chosen is None else ""
        if chosen is None:
            self._target.hide()
            return
        self._move_target(self._present(*chosen))

    def _chosen(self) -> tuple[str, Array] | None:
        """The frame, and the point (3,) in its axes; None if there is none."""
        if self._point.value == HELD:
            return self._held
        return None if self._point.value == NONE else (self._point.value, np.zeros(3))

    def _present(self, frame: str, at: Array) -> Pose:
        shown = self._session.frame
        rows = zip(self._model.part_names, *unpack_poses(shown.poses), strict=True)
        poses = {name: Pose(position, rotation) for name, position, rotation in rows}
        return pose_of(shown.mechanism, frame, at, poses)

    def _move_target(self, pose: Pose) -> None:
        """Show a target in the scene and in the fields."""
        self._pose = pose
        self._target.show(pose, turns=self._turns.value)
        self._position.value = tuple(round(float(one), DIGITS) + 0.0 for one in pose.position)
        self._angles.value = tuple(round(math.degrees(one), 2) + 0.0 for one in to_rpy(pose.rotation))

    def _typed(self, event: Any) -> None:
        if event.client is not None and self._chosen() is not None:
            angles = np.radians(self._angles.value).tolist()
            self._pose = Pose(np.array(self._position.value, dtype=float), from_rpy(*angles))
            self._target.show(self._pose, turns=self._turns.value)

    def _dragged(self, pose: Pose) -> None:
        kept = pose if self._turns.value or self._pose is None else Pose(pose.position, self._pose.rotation)
        self._move_target(kept)
        self._ask(near=True)

    def _ask(self, *, near: bool = False, command: bool = False) -> None:
        chosen, pose = self._chosen(), self._pose
        if chosen is not None and pose is not None:
            rotation = pose.rotation if self._turns.value else None
            self._reacher.ask(Goal(*chosen, pose.position, rotation), near=near, command=command)


def found_text(
    mechanism: Mechanism,
    found: InverseKinematics,
    searching: bool,
    refused: str = "",
    *,
    commanded: bool = False,
    turns: bool,
) -> str:
    """Markdown: whether the target is reached, how far it is if not, and the positions of the joints.

    :param refused: why the mechanism could not be put there.
    :param commanded: whether servos and drives go there, instead.
    """
    if refused:
        head = f"**Not put there:** {refused} The joints would be:"
    elif found.reached:
        head = "**Commanded**, these joints reach it:" if commanded else "**Reached**, with these joints:"
    else:
        left = f"{found.distance:.4g} m" + (f" and {math.degrees(found.angle):.3g} deg" if turns else "")
        ends = f" {', '.join(found.at_limits)} at the limit." if found.at_limits else ""
        head = f"**Not reached:** {left} from the target.{ends}"
        head += " Looking from other positions …" if searching else ""
    rows = ["| joint | position |", "|:--|--:|"]
    for name, value in found.positions.items():
        turning = mechanism.coordinate(name).rotation
        rows.append(f"| {name} | {f'{math.degrees(value):.2f} deg' if turning else f'{value:.5g} m'} |")
    return f"{head}\n\n" + "\n".join(rows)
