"""The controls of the run: play, pause, step, reset, speed and the time line, with their keys."""

from __future__ import annotations

import math
from collections.abc import Callable
from operator import methodcaller
from typing import Any

from mbd_sim.lab.page.touched import Touched
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.session import Session

SPEEDS = {"1/100": 0.01, "1/10": 0.1, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "fastest": math.inf}
NOT_BACK = "The time of a node is not wound back, as other nodes follow its clock. *Reset* returns to the start."
ACTIONS: dict[str, Callable[[Session], None]] = {
    "Play": methodcaller("play"),
    "Pause": methodcaller("pause"),
    "Step": methodcaller("step"),
    "Reset": methodcaller("reset"),
}
KEYS: dict[str, tuple[str, Callable[[Session], None]]] = {
    "space": ("Play or pause", lambda session: session.pause() if session.running else session.play()),
    "arrowright": ("Step", ACTIONS["Step"]),
    "arrowleft": ("Step back", methodcaller("step_back")),
    "home": ("Reset", ACTIONS["Reset"]),
}


class RunBar:
    """The buttons, the speed and the time line above the tabs."""

    def __init__(self, gui: Any, session: Session, touched: Touched) -> None:
        self._session, self._touched = session, touched
        buttons = gui.add_button_group("Run", tuple(ACTIONS))
        buttons.on_click(self._act)
        self._speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1", hint="Simulated seconds per second")
        self._speed.on_update(self._set_speed)
        keys = dict(KEYS)
        self.time: Any = None
        self._shown_time = 0.0
        if session.of_node:
            del keys["arrowleft"]
            gui.add_markdown(NOT_BACK)
        else:
            self.time = gui.add_slider("Time (s)", min=0.0, max=1.0, step=0.001, initial_value=0.0, hint="Wind back")
            self.time.on_update(self._wound)
        for key, (label, action) in keys.items():
            command = gui.add_command(label, hotkey=key)
            command.on_trigger(lambda _, label=label, action=action: session.ask(f"key {label}", action))

    def show(self, frame: Frame) -> None:
        """Move the time line to a frame, and show a speed that others have chosen."""
        speeds = [name for name, speed in SPEEDS.items() if speed == frame.speed]
        if speeds and self._touched.free("speed"):
            self._speed.value = speeds[0]
        if self.time is None:
            return
        low, high = frame.span
        high = max(high, low + 1e-3)
        moved = self.time.value != self._shown_time  # by a user, and viser has not told yet
        if self._touched.free("time") and frame.number and not moved:
            self._shown_time = round(min(max(frame.time, low), high), 3)
            self.time.min, self.time.max = round(low, 3), round(high, 3)
            self.time.value = self._shown_time

    def _act(self, event: Any) -> None:
        if action := ACTIONS.get(event.target.value):  # a hostile page may send any text
            self._session.ask("run", action)

    def _set_speed(self, event: Any) -> None:
        speed = SPEEDS.get(self._speed.value)
        if event.client is not None and speed is not None:
            self._touched.touch("speed")
            self._session.ask("speed", lambda session: session.set_speed(speed))

    def _wound(self, event: Any) -> None:
        if event.client is not None and self.time is not None:
            self._touched.touch("time")
            where = self._shown_time = self.time.value
            self._session.ask("wind", lambda session: session.wind_to(where))
