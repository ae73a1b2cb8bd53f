"""Every control of the page is used once, on a robot with a motor that stands on a floor; those of a loop have tests."""

import contextlib

import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.lab import Lab
from mbd_sim.recordings.run.verification import verify
from test.lab.page.robot import standing_robot
from test.waiting import wait_until

browser_page = pytest.importorskip("test.lab.page.browser_page")
sync_api = pytest.importorskip("playwright.sync_api")
TABS = ("Change", "Plots", "Kinematics", "Show", "Keep")
SENT = ("Picture", "Page with the motion", "Animation")
NARROW = {"width": 640, "height": 320}


class Controls:
    """The controls of a page, and which of them the server has heard of."""

    def __init__(self, opened):
        self._opened, self.heard = opened, set()
        inputs = opened.lab.page.server.gui._gui_input_handle_from_uuid
        self.handles = {
            uuid: handle
            for uuid, handle in inputs.items()
            if handle.visible
            and handle.label not in (*SENT, "Dark", "Recording")
            and (type(handle).__name__ != "GuiDropdownHandle" or len(handle.options) > 1)
        }
        for uuid, handle in self.handles.items():
            handle._impl.update_cb.append(lambda _, uuid=uuid: self.heard.add(uuid))

    def element(self, uuid):
        return self._opened.page.locator(f"[id='{uuid}']")

    def use(self, uuid):
        handle, element = self.handles[uuid], self.element(uuid)
        match type(handle).__name__:
            case "GuiSliderHandle":
                field = element.locator("xpath=following-sibling::*//input")
                aim = handle.min + 0.6 * (handle.max - handle.min)
                text = f"{aim if abs(aim - handle.value) > handle.step else aim + handle.step:.6f}"
                with contextlib.suppress(sync_api.TimeoutError):
                    self._opened.fill(field, text)
            case "GuiButtonGroupHandle":
                for option in handle.options:
                    self._opened.button(option)
            case "GuiDropdownHandle":
                option = next(one for one in handle.options if one != handle.value)
                self._opened.choose(element, option)
            case _:
                element.dispatch_event("click")

    def use_all(self):
        """Use what each tab shows, with all folders opened."""
        opened = self._opened
        for tab in TABS:
            opened.tab(tab)
            if tab == "Change":
                self._open_folders()
                sliders = {u for u, h in self.handles.items() if type(h).__name__ == "GuiSliderHandle"}
                wait_until(lambda sliders=sliders: sliders <= self._shown(), "the sliders in the folders")
            shown = self._shown()
            for uuid in self.handles:  # one after the other: viser sends only the last of two that change at once
                if uuid in shown - self.heard:
                    label = f"what the server hears of {self.handles[uuid].label}"
                    opened.act(lambda uuid=uuid: self.use(uuid), lambda uuid=uuid: uuid in self.heard, label)

    def _open_folders(self):
        handles = self._opened.lab.page.server.gui._container_handle_from_uuid.values()
        for folder in handles:
            if (
                type(folder).__name__ == "GuiFolderHandle"
                and not folder.expand_by_default
                and "check" not in folder.label
            ):
                self._opened.folder(folder.label)

    def _shown(self):
        """The controls that the page shows; a group of buttons has no element of its own."""
        found = "ids => ids.filter(id => document.getElementById(id)?.checkVisibility())"
        groups = {u for u, h in self.handles.items() if type(h).__name__ == "GuiButtonGroupHandle" and h.label == "Run"}
        return groups | set(self._opened.page.evaluate(found, list(self.handles)))


def records(opened):
    """A recording under a name."""
    opened.tab("Keep")
    inputs = opened.lab.page.server.gui._gui_input_handle_from_uuid.values()
    (path,) = (one for one in inputs if one.label == "Recording")
    opened.enter("Recording", "mine.mcap", lambda: path.value == "mine.mcap", "the name")
    opened.lab.session.ask("speed", lambda session: session.set_speed(1.0))
    opened.press("Pause", lambda: not opened.frame.running, "the pause")
    opened.press("Reset", lambda: opened.frame.time == 0.0, "the start")
    opened.press("Record", lambda: opened.frame.recording == "mine.mcap", "the recording")
    opened.press("Play", lambda: opened.frame.time > 0.2, "the run")
    opened.press("Pause", lambda: not opened.frame.running, "the pause")
    opened.press("End the recording", lambda: not opened.frame.recording, "the end")
    assert all(one.agrees for one in verify("mine.mcap"))


@pytest.mark.timeout(1800)  # on a machine with ten busy processes per core, each of some fifty controls takes seconds
def test_every_control_is_used_once(chromium, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with Lab(load_mechanism(standing_robot(tmp_path)), port=0) as lab:
        opened = browser_page.BrowserPage(chromium, lab, NARROW)
        controls = Controls(opened)
        controls.use_all()
        unused = {handle.label for uuid, handle in controls.handles.items() if uuid not in controls.heard}
        assert unused <= {"Back to the file"}
        records(opened)
        opened.tab("Show")
        theme = "document.documentElement.dataset.mantineColorScheme"
        opened.check("Dark", True, lambda: opened.page.evaluate(theme) == "dark", "the dark page")
        before = lab.session.frame.number
        wait_until(lambda: lab.session.frame.number > before, "a frame")
        assert lab.page._thread.is_alive()
        assert lab.session._thread.is_alive()
        assert not opened.errors
        opened.close()
    assert "Traceback" not in capfd.readouterr().err
