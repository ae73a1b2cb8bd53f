"""Every control of the page is used once, on a contact, a motor and a robot; those of a loop have tests of their own."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.files.urdf.writer import to_urdf
from mbd_sim.lab.lab import Lab
from test.waiting import wait_until

BrowserPage = pytest.importorskip("test.lab.page.browser_page").BrowserPage
TABS = ("Change", "Plots", "Kinematics", "Show", "Keep")
SENT = ("Picture", "Page with the motion", "Animation")  # their files are looked at in test_keep_tab
NARROW = {"width": 640, "height": 320}


class Controls:
    """The controls of a page, and which of them the server has heard of."""

    def __init__(self, opened):
        self._opened, self.heard = opened, set()
        inputs = opened.lab.page.server.gui._gui_input_handle_from_uuid
        self.handles = {
            uuid: handle
            for uuid, handle in inputs.items()
            if handle.visible and handle.label not in (*SENT, "Dark", "Recording", "Reset")
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
                field.fill(f"{aim if abs(aim - handle.value) > handle.step else aim + handle.step:.6f}")
            case "GuiButtonGroupHandle":
                for option in handle.options:
                    self._opened.button(option)
            case "GuiDropdownHandle":
                option = next(one for one in handle.options if one != handle.value)
                element.press("ArrowDown")
                self._opened.page.get_by_role("option", name=option, exact=True).dispatch_event("click")
            case _:
                element.dispatch_event("click")

    def use_all(self):
        """Use what each tab shows, with all folders opened."""
        opened = self._opened
        for tab in TABS:
            opened.tab(tab)
            if tab == "Change":
                self._open_folders()
            here = [u for u, h in self.handles.items() if u not in self.heard and self._is_here(u, h)]
            wait_until(
                lambda here=here: self.heard.issuperset(here),
                f"what the server hears of {tab}",
                meanwhile=lambda here=here: [self.use(uuid) for uuid in here if uuid not in self.heard],
                report=lambda here=here: str([self.handles[u].label for u in here if u not in self.heard]),
            )

    def _open_folders(self):
        handles = self._opened.lab.page.server.gui._container_handle_from_uuid.values()
        for folder in handles:
            if (
                type(folder).__name__ == "GuiFolderHandle"
                and not folder.expand_by_default
                and "check" not in folder.label
            ):
                self._opened.folder(folder.label)

    def _is_here(self, uuid, handle):
        if type(handle).__name__ == "GuiButtonGroupHandle":
            return handle.label == "Run"
        return self.element(uuid).count() > 0 and self.element(uuid).evaluate("e => e.checkVisibility()")


def mechanism_of(name, folder):
    """A shipped mechanism; a robot is read from its URDF."""
    mechanism = load_mechanism(name.partition(".")[0])
    if name.endswith(".urdf"):
        (folder / name).write_text(to_urdf(mechanism), encoding="utf-8")
        mechanism = load_mechanism(folder / name)
    return mechanism


@pytest.mark.parametrize("name", ["bounce", "motor_drive", "six_axis_arm.urdf"])
def test_every_control_is_used_once(name, chromium, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    with Lab(mechanism_of(name, tmp_path), port=0) as lab:
        opened = BrowserPage(chromium, lab, NARROW)
        controls = Controls(opened)
        controls.use_all()
        unused = {handle.label for uuid, handle in controls.handles.items() if uuid not in controls.heard}
        assert unused <= {"Back to the file"}
        wait_until(lambda: lab.session.frame.number > 0, "a frame")
        assert lab.page._thread.is_alive()
        assert lab.session._thread.is_alive()
        assert not opened.errors
        opened.close()
    assert "Traceback" not in capfd.readouterr().err
