"""Sliders of everything that can change, in the units of the file."""

from __future__ import annotations

import html
import math
import time
from collections.abc import Mapping
from typing import Any

from mbd_sim.lab.page.touched import Touched
from mbd_sim.lab.session.background import Preparer
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.session import Session
from mbd_sim.lab.session.sliders import Setting, as_yaml
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism

OPEN_SLIDERS = 12  # folders with more sliders are closed at first
OPEN = ("Drive", "Parameters", "Commands", "Actuators")
FINER = 3  # digits of a typed number beyond those of the slider's step
ALL = "all"
SETTLED = 0.3  # s after which a number that is being typed counts as complete: each keystroke arrives
NO_ACTUATORS = (
    "This mechanism has no actuators. For a controller, add `actuators` with a `servo` to its file, as those of the "
    "shipped `cart_servo`: `mbd_sim lab cart_servo`."
)
# The text is selected before it is copied: where the browser forbids to copy, it can still be copied by hand.
YAML = """<div style="padding: 0 0.8em 0.8em">
<button style="width: 100%%; padding: 0.3em; cursor: pointer; border: 0; background: #3478be; color: white"
 onclick="const range = document.createRange(); range.selectNodeContents(this.nextElementSibling);
 const chosen = getSelection(); chosen.removeAllRanges(); chosen.addRange(range);
 this.textContent = document.execCommand('copy') ? 'Copied' : 'Selected: copy it with Ctrl+C'">Copy as YAML</button>
<pre style="user-select: text; margin: 0.5em 0 0; overflow-x: auto; font-size: 0.85em">%s</pre></div>"""


class ChangeTab:
    """Folders of sliders, and what to write into the file."""

    def __init__(
        self, gui: Any, session: Session, preparer: Preparer | None, settings: list[Setting], touched: Touched
    ) -> None:
        self._session, self._preparer, self._touched = session, preparer, touched
        self._yaml, groups = "", dict[str, list[Setting]]()
        for setting in settings:
            groups.setdefault(setting.group, []).append(setting)
        self._groups: list[_Group] = []
        for group, members in groups.items():
            with gui.add_folder(group, expand_by_default=len(members) <= OPEN_SLIDERS and group in OPEN):
                self._groups.append(_Group(gui, members, self))
        self._settings = settings
        self._typed: dict[str, tuple[Setting, float, float]] = {}  # numbers that may be incomplete, with their times
        self._last: dict[str, float] = {}
        if not groups:
            gui.add_markdown("Nothing of this mechanism can change.")
        if driven := driven_text(session.bench.simulation.mechanism):
            gui.add_markdown(driven)
        if not session.bench.simulation.mechanism.commanded:
            gui.add_markdown(NO_ACTUATORS)
        self._copied = gui.add_html("")

    def show(self, frame: Frame) -> None:
        """Move the sliders that nobody is moving to the values of a frame."""
        for key, (setting, value, when) in list(self._typed.items()):
            if time.monotonic() - when >= SETTLED and self._typed.pop(key, None) is not None:
                self._last.pop(key, None)
                self._touched.touch(key)
                self.apply(setting, value)
        shown = {one.key: value_of(one, frame, self._session) / one.factor for one in self._settings}
        for group in self._groups:
            group.show(shown)
        text = as_yaml(self._settings, shown)
        if text != self._yaml:
            self._yaml, self._copied.content = text, YAML % html.escape(text)

    def moved(self, setting: Setting, shown: float) -> None:
        """The user gives a value in the unit of the file: it acts at once if a slider is dragged, else when settled."""
        key, last = setting.key, self._last.get(setting.key)
        self._touched.touch(key)
        self._last[key] = shown
        self._typed[key] = setting, shown, time.monotonic()
        if last is not None and not may_be_typed(last, shown):
            self._typed.pop(key, None)
            self.apply(setting, shown)

    def is_free(self, setting: Setting) -> bool:
        """Whether the slider may follow the session."""
        return self._touched.free(setting.key) and setting.key not in self._typed

    def apply(self, setting: Setting, shown: float) -> None:
        """Ask for a value, in the unit of the file."""
        if setting.kind == "value" and self._preparer is not None:
            self._preparer.ask(setting.key, shown * setting.factor)
        else:
            self._session.ask(f"{setting.kind} {setting.key}", lambda session: setting.apply(session, shown))


class _Group:
    """The sliders of a folder, and buttons that take the changed ones back to the file, one by one or all."""

    def __init__(self, gui: Any, settings: list[Setting], tab: ChangeTab) -> None:
        self._tab, self._settings = tab, settings
        self._followed: dict[str, float] = {}
        self._sliders = {one.key: self._add_slider(gui, one) for one in settings}
        self._told = {key: slider.value for key, slider in self._sliders.items()}  # values that the page knows
        self._changed: dict[str, list[Setting]] = {}
        self._back = gui.add_button_group("Back to the file", (ALL,), visible=False)
        self._back.on_click(lambda event: self._restore(event.target.value))

    def show(self, shown: Mapping[str, float]) -> None:
        """Move the sliders to values by key, and offer to take back those that are not the file's."""
        changed: dict[str, list[Setting]] = {}
        for setting in self._settings:
            value = shown[setting.key]
            slider = self._sliders[setting.key]
            told = slider.value == self._told[setting.key]  # if not, the user has moved it, and `moved` is to come
            if told and self._tab.is_free(setting) and self._followed.get(setting.key) != value:
                _move(slider, setting, value)
                self._told[setting.key] = slider.value
                self._followed[setting.key] = value  # a slider that the user is just moving has another one
            if setting.from_file and not math.isclose(value, setting.value, rel_tol=1e-9, abs_tol=1e-12):
                changed[f"{setting.label}: {setting.value:.6g}"] = [setting]
        if len(changed) > 1:
            changed[ALL] = [one for (one,) in changed.values()]
        if changed.keys() != self._changed.keys():
            self._changed = changed
            if changed:
                self._back.options = tuple(changed)
            self._back.visible = bool(changed)

    def _add_slider(self, gui: Any, setting: Setting) -> Any:
        label = f"{setting.label} ({setting.unit})" if setting.unit else setting.label
        slider = gui.add_slider(
            label, min=setting.low, max=setting.high, step=setting.step, initial_value=setting.value
        )
        slider.precision += FINER

        slider.on_update(lambda event: None if event.client is None else self.moved(setting))
        return slider

    def moved(self, setting: Setting) -> None:
        """A user has given the slider its value."""
        slider = self._sliders[setting.key]
        value = self._told[setting.key] = slider.value
        self._tab.moved(setting, value)
        self._followed.pop(setting.key, None)  # later it follows again, also if the value is refused
        _widen(slider, setting, value)

    def _restore(self, label: str) -> None:
        for setting in self._changed.get(label, ()):
            self._tab.apply(setting, setting.value)


def value_of(setting: Setting, frame: Frame, session: Session) -> float:
    """The present value of a setting, in SI units."""
    if setting.kind in ("position", "speed"):
        numbers = frame.positions if setting.kind == "position" else frame.speeds
        return float(numbers[session.bench.simulation.coordinate_names.index(setting.label)])
    return frame.values[setting.key]


def may_be_typed(last: float, shown: float) -> bool:
    """Whether a number continues or shortens the digits of the last one, as while it is typed."""
    one, other = (f"{value:.15g}" for value in (last, shown))
    return one.startswith(other) or other.startswith(one)


def driven_text(mechanism: Mechanism) -> str:
    """The joints whose motion the file prescribes; what can change in it are the parameters that it names."""
    lines = [
        f"- {joint.name} = {', '.join(one.text for one in joint.drive)}"
        for joint in mechanism.all_joints.values()
        if joint.drive and not isinstance(joint.drive, CommandedDrive)
    ]
    return "\n".join(["**Prescribed by the file**, with its parameters:\n", *lines]) if lines else ""


def _move(slider: Any, setting: Setting, value: float) -> None:
    """Move a slider to a value."""
    if abs(slider.value - value) > 1e-9 * abs(value):
        _widen(slider, setting, value)
        slider.value = value


def _widen(slider: Any, setting: Setting, value: float) -> None:
    """Give a slider its ends, or those that a typed value needs."""
    low, high = min(setting.low, value), max(setting.high, value)
    if (slider.min, slider.max) != (low, high):
        slider.min, slider.max = low, high
