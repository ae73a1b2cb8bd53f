"""Sliders of everything that can change, in the units of the file."""

from __future__ import annotations

from functools import partial
from typing import Any

from mbd_sim.lab.page.touched import Touched
from mbd_sim.lab.session.background import Preparer
from mbd_sim.lab.session.session import Frame, Session
from mbd_sim.lab.session.sliders import Setting, as_yaml

OPEN_SLIDERS = 12  # folders with more sliders are closed at first
OPEN = ("Drive", "Parameters", "Commands", "Actuators")


class ChangeTab:
    """Folders of sliders, and what to write into the file."""

    def __init__(
        self, gui: Any, session: Session, preparer: Preparer, settings: list[Setting], touched: Touched
    ) -> None:
        self._session, self._preparer, self._settings, self._touched = session, preparer, settings, touched
        self._sliders: dict[str, Any] = {}
        groups: dict[str, list[Setting]] = {}
        for setting in settings:
            groups.setdefault(setting.group, []).append(setting)
        for group, members in groups.items():
            with gui.add_folder(group, expand_by_default=len(members) <= OPEN_SLIDERS and group in OPEN):
                for setting in members:
                    self._add_slider(gui, setting)
                back = gui.add_button("Back to the file", color="gray")
                back.on_click(partial(self._restore, members))
        if not groups:
            gui.add_markdown("Nothing of this mechanism can change.")
        copied = gui.add_button("Copy as YAML", icon=None)
        text = gui.add_markdown("")

        def show_yaml(_: Any) -> None:
            shown = {key: slider.value for key, slider in self._sliders.items()}
            text.content = f"```yaml\n{as_yaml(self._settings, shown)}```"

        copied.on_click(show_yaml)

    def show(self, frame: Frame) -> None:
        """Move the sliders that nobody is moving to the values of a frame."""
        for setting in self._settings:
            slider, value = self._sliders[setting.key], frame.values[setting.key] / setting.factor
            if self._touched.free(setting.key) and abs(slider.value - _within(setting, value)) > 1e-9 * abs(value):
                slider.value = _within(setting, value)

    def _add_slider(self, gui: Any, setting: Setting) -> None:
        label = f"{setting.label} ({setting.unit})" if setting.unit else setting.label
        slider = gui.add_slider(
            label, min=setting.low, max=setting.high, step=setting.step, initial_value=_within(setting, setting.value)
        )
        self._sliders[setting.key] = slider

        def moved(event: Any) -> None:
            if event.client is not None:
                self._touched.touch(setting.key)
                self._apply(setting, slider.value)

        slider.on_update(moved)

    def _restore(self, settings: list[Setting], _: Any) -> None:
        for setting in settings:
            self._apply(setting, setting.value)

    def _apply(self, setting: Setting, shown: float) -> None:
        if setting.kind == "drive":
            self._session.ask("drive", lambda session: session.drive_to(shown * setting.factor))
        elif setting.kind == "value":
            self._preparer.ask(setting.key, shown * setting.factor)
        else:
            self._session.ask(f"{setting.kind} {setting.key}", lambda session: setting.apply(session.bench, shown))


def _within(setting: Setting, value: float) -> float:
    return min(max(value, setting.low), setting.high)
