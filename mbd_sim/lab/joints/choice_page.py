"""The page on which the joints of an imported assembly are chosen."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable, Mapping
from typing import Any

from mbd_sim.base.errors import MbdSimError, counted, listed
from mbd_sim.imports.build import Import
from mbd_sim.imports.choice import NONE, Choice, choose
from mbd_sim.imports.joints import NEED_AXIS, OFFERED, Candidate, word_of
from mbd_sim.lab.joints.assembly_scene import AssemblyScene
from mbd_sim.lab.page.style import style
from mbd_sim.lab.scene.camera import aim, keep_aimed
from mbd_sim.lab.server.server import PageServer
from mbd_sim.mechanism.elements.joint_types import JointType

PANEL = 400.0  # px of width
FOUND = " (found)"  # after the type that the faces leave
FREE = "none: all parts are free"
REPLACE = "Replace the file"
HELP = """Each number in the scene is a joint that the faces of two parts offer. Take those that you want, as the type
that was found or as another one. *Ground* is the part that does not move; it is transparent. Click a part for its name.
"""


class ChoicePage:
    """The panel and the scene of a choice, which begins with one; `build` is called with the choice of the user."""

    def __init__(
        self,
        found: Import,
        choice: Choice,
        server: PageServer,
        build: Callable[[Choice, bool], None],
        *,
        dark: bool,
    ) -> None:
        """Show it in place of what the server showed before.

        :param build: takes the choice, and whether a file that was changed meanwhile is replaced; raises MbdSimError.
        """
        self._found, self._build, self._closed = found, build, threading.Event()
        self._busy = threading.Lock()
        viser = server.viser
        viser.scene.reset()
        viser.gui.reset()
        viser.gui.configure_theme(
            dark_mode=dark,
            show_share_button=False,
            show_logo=False,
            control_width="medium",
            brand_color=(52, 120, 190),
        )
        self._scene = AssemblyScene(viser.scene, found, self._name_part)
        aim(viser.initial_camera, self._scene.extent)
        self._types: dict[int, Any] = {}
        self._add_panel(viser.gui, choice)
        viser.gui.main_panel.dock_right()
        viser.gui.main_panel.set_width(PANEL)
        self._show()
        viser.on_client_connect(
            lambda client: keep_aimed(
                client.camera,
                viser.initial_camera,
                lambda: None if self._closed.is_set() else self._scene.extent,
            )
        )

    def close(self) -> None:
        """The server shows something else from here on."""
        self._closed.set()

    def choice(self) -> Choice:
        """What the controls say."""
        picks = [f"{number}={_kind_of(box.value)}" for number, box in self._types.items()]
        ground = NONE if self._ground.value == FREE else self._ground.value
        return choose(self._found.assembly, self._found.candidates, False, picks, ground)

    def _add_panel(self, gui: Any, choice: Choice) -> None:
        found = self._found
        parts = [part.name for part in found.assembly.parts]
        gui.add_html(style(large=False))
        gui.add_markdown(f"**{found.assembly.name}** · {'. '.join(found.assembly.notes)}\n\n{HELP}")
        self._ground = gui.add_dropdown(
            "Ground", (*parts, FREE), initial_value=FREE if choice.is_free else choice.held[0]
        )
        self._opacity = gui.add_slider("Opacity", min=0.1, max=1.0, step=0.05, initial_value=1.0)
        self._told = gui.add_markdown("")
        self._replace = gui.add_checkbox(REPLACE, initial_value=False, visible=False)
        build = gui.add_button("Build", hint=f"write {found.out} and run it")
        build.on_click(lambda _: self._start())
        self._problem = gui.add_markdown("")
        with gui.add_folder("Joints"):
            if not found.candidates:
                gui.add_markdown("No joints were found: no two parts share a face (`--gap` is how near they must be).")
            else:
                every = gui.add_button_group("Take", ("as found", NONE))
                every.on_click(lambda event: self._take(event.target.value))
            for one in found.candidates:
                self._types[one.number] = self._add_joint(gui, one, choice.types)
        with gui.add_folder("Parts and masses", expand_by_default=False):
            gui.add_markdown(_masses(found))
        self._ground.on_update(lambda _: self._show())
        self._opacity.on_update(lambda _: self._show())

    def _add_joint(self, gui: Any, one: Candidate, taken: Mapping[int, JointType]) -> Any:
        box = gui.add_dropdown(
            f"{one.number}: {' – '.join(one.parts)}",
            _options(one),
            initial_value=_label(one, taken.get(one.number)),
            hint=f"They {one.why}.",
        )
        box.on_update(lambda event: None if event.client is None else self._show())
        return box

    def _take(self, which: str) -> None:
        """Take all joints as they were found, or none."""
        for one in self._found.candidates:
            self._types[one.number].value = _label(one, None if which == NONE else one.type)
        self._show()

    def _show(self) -> None:
        """Show the choice in the scene, and what it holds."""
        try:
            choice = self.choice()
        except MbdSimError as error:  # a hostile page may send any text
            self._problem.content = str(error)
            return
        self._scene.show(choice.types, None if choice.is_free else choice.held[0], self._opacity.value)
        held = f"{counted(len(choice.types), 'joint')} taken."
        if others := choice.held[1:]:
            held += f" Not connected, and held until a joint is taken: {listed(others)}."
        self._told.content = held

    def _name_part(self, name: str) -> None:
        part = next(one for one in self._found.assembly.parts if one.name == name)
        numbers = [str(one.number) for one in self._found.candidates if name in one.parts]
        joints = f", joints {listed(numbers)}" if numbers else ", no joints"
        self._problem.content = f"**{name}**: {self._found.table.properties(part).mass:.4g} kg{joints}"

    def _start(self) -> None:
        """Build the mechanism; what is wrong is told."""
        if self._closed.is_set() or not self._busy.acquire(blocking=False):
            return
        try:
            self._problem.content = "The mechanism is being built …"
            self._build(self.choice(), self._replace.value)
        except (MbdSimError, OSError) as error:
            self._replace.visible = self._found.out.exists()
            self._problem.content = f"<pre style='white-space: pre-wrap'>{html.escape(str(error))}</pre>"
        finally:
            self._busy.release()


def _options(one: Candidate) -> tuple[str, ...]:
    """The labels of the types that a joint can have, that which was found first."""
    possible = [kind for kind in OFFERED if one.axis is not None or kind not in NEED_AXIS]
    first = [one.type] if one.type in possible else []
    return tuple(_label(one, kind) for kind in (None, *first, *(kind for kind in possible if kind != one.type)))


def _label(one: Candidate, kind: JointType | None) -> str:
    return word_of(kind) + (FOUND if kind is not None and kind == one.type else "")


def _kind_of(label: str) -> str:
    return label.removesuffix(FOUND)


def _masses(found: Import) -> str:
    """Markdown: a table of the parts."""
    masses = ((part.name.replace("|", "/"), found.table.properties(part).mass) for part in found.assembly.parts)
    return "\n".join(["| part | mass |", "|:--|--:|", *(f"| {name} | {mass:.4g} kg |" for name, mass in masses)])
