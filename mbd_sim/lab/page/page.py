"""The page in the browser: its controls put requests to the session, and a thread shows the newest frame.

All pages of a server see the same. viser keeps what a slow page has not received yet, and only the newest of it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from mbd_sim.base.errors import listed
from mbd_sim.lab.page.change_tab import ChangeTab
from mbd_sim.lab.page.help_tab import HelpTab
from mbd_sim.lab.page.keep_tab import KeepTab
from mbd_sim.lab.page.kinematics_tab import KinematicsTab
from mbd_sim.lab.page.plots_tab import PlotsTab
from mbd_sim.lab.page.reach_panel import ReachPanel
from mbd_sim.lab.page.run_bar import RunBar
from mbd_sim.lab.page.show_tab import ShowTab
from mbd_sim.lab.page.style import style
from mbd_sim.lab.page.touched import Touched
from mbd_sim.lab.scene.camera import aim, keep_aimed
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.server.server import PageServer
from mbd_sim.lab.session.background import Preparer
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.reaching import Reacher
from mbd_sim.lab.session.session import Session
from mbd_sim.lab.session.sliders import settings_of
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.pictures.shapes.meshes import undrawn_meshes

Theme = Literal["light", "dark"]

PICTURES = 60.0  # a second
NUMBERS = 6.0  # updates of texts, plots and sliders a second
PANEL = 370.0  # px of width


class Page:
    """The page of a session on a server, in place of what this showed before."""

    def __init__(
        self,
        session: Session,
        server: PageServer,
        *,
        theme: Theme,
        check: Callable[[], str] | None = None,
        back: tuple[str, Callable[[], None]] | None = None,
    ) -> None:
        """Build the page and begin to show frames.

        :param check: finds what `mbd_sim check` says about the mechanism; called in a thread of its own.
        :param back: the label of a button that leads to another page, and what it calls.
        """
        self.session, self._check, self._dark = session, check, theme == "dark"
        self.server, self._back = server.viser, back
        self._preparer = Preparer(session) if isinstance(session, OwnSession) else None
        self._reacher = Reacher(session)
        self._touched, self._stopped = Touched(), threading.Event()
        self._problem = self._note = ""
        self._build()
        self.server.on_client_connect(self._opened)
        self.server.on_client_disconnect(self._closed)
        self._thread = threading.Thread(target=self._run, name="lab_page", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop to show frames and to prepare values; the server goes on."""
        self._stopped.set()
        self._thread.join()
        if self._preparer is not None:
            self._preparer.stop()
        self._reacher.stop()

    def refuse(self, problem: str) -> None:
        """Show what is wrong with the file; the mechanism goes on."""
        self._problem = problem

    def accept(self) -> None:
        """The file is right again."""
        self._problem = ""

    def _build(self) -> None:
        """Build the scene and the panel of the present mechanism."""
        server, simulation = self.server, self.session.bench.simulation
        self._generation, self._outdated, self._note = self.session.generation, False, ""
        server.scene.reset()
        server.gui.reset()
        server.gui.configure_theme(
            dark_mode=self._dark,
            show_share_button=False,
            show_logo=False,
            control_width="medium",
            brand_color=(52, 120, 190),
        )
        extent = self._extent = extent_of(simulation.model)
        aim(server.initial_camera, extent)
        self._scene = Scene(server.scene, simulation.model, extent, self._dragged, dark=self._dark)
        self._build_panel(server.gui, extent.size)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(PANEL)

    def _build_panel(self, gui: Any, size: float) -> None:
        session, mechanism = self.session, self.session.bench.simulation.mechanism
        settings = settings_of(session.bench, size, with_state=not session.of_node)
        css = gui.add_html(style(large=False))
        gui.add_markdown(" · ".join([f"**{mechanism.name}**", *filter(None, [mechanism.description])]))
        if missing := undrawn_meshes(mechanism):
            gui.add_markdown(f"Not drawn: {listed(missing)}.")
        if self._back is not None:
            label, action = self._back
            gui.add_button(label, color="gray").on_click(lambda _: action())
        self._run_bar = RunBar(gui, session, self._touched)
        self._told = gui.add_markdown("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Change"):
            self._change = ChangeTab(gui, session, self._preparer, settings, self._touched)
        with tabs.add_tab("Plots"):
            self._plots = PlotsTab(gui, session, dark=self._dark)
        with tabs.add_tab("Kinematics"):
            self._reach = ReachPanel(gui, self.server.scene, session, self._reacher, size)
            self._kinematics = KinematicsTab(gui, session, self._scene, settings, size)
        with tabs.add_tab("Show"):
            ShowTab(gui, session, self._scene, css, dark=self._dark, darken=self._darken)
        with tabs.add_tab("Keep"):
            self._keep = KeepTab(gui, session, self._scene, dark=self._dark)
        with tabs.add_tab("Help"):
            self._help = HelpTab(gui, self._check, of_node=session.of_node)

    def _darken(self, dark: bool) -> None:
        self._dark, self._outdated = dark, True

    def _dragged(self, page: int, phase: str, part: str, point: Any, target: Any) -> None:
        if phase == "start":
            self._reach.hold(part, point)
        # A start and an end are never replaced by a move.
        self.session.ask(f"drag {phase}", lambda session: session.drag(page, phase, part, point, target))

    def _opened(self, client: Any) -> None:
        if self._stopped.is_set():  # another page is shown
            return
        keep_aimed(client.camera, self.server.initial_camera, lambda: None if self._stopped.is_set() else self._extent)
        self.session.ask(f"page {client.client_id}", lambda session: session.enter(client.client_id))

    def _closed(self, client: Any) -> None:
        self.session.ask(f"page {client.client_id}", lambda session: session.leave(client.client_id))

    def _run(self) -> None:
        last, told = -1, 0.0
        while not self._stopped.wait(1.0 / PICTURES):
            frame, now = self.session.frame, time.monotonic()
            if self._outdated or frame.generation > self._generation:
                self._build()
                continue
            if frame.generation < self._generation or (frame.number == last and now - told < 1.0 / NUMBERS):
                continue
            last = frame.number
            with self.server.atomic():
                self._scene.show(frame)
                if now - told >= 1.0 / NUMBERS:
                    told = now
                    self._tell(frame)

    def _tell(self, frame: Frame) -> None:
        """Update texts, plots and sliders."""
        for shown in (self._run_bar, self._change, self._plots, self._reach, self._kinematics, self._keep, self._help):
            shown.show(frame)
        if (text := self._status(frame)) != self._note:
            self._told.content = self._note = text

    def _status(self, frame: Frame) -> str:
        pace = f"running at {frame.rate:.3g} × real time" if frame.running else "paused"
        if frame.pull is not None:
            force, most = (float(f"{one:.3g}") for one in (np.linalg.norm(frame.pull[2]), frame.pull[3]))
            account = f"pulled with {force:g} N of at most {most:g} N"
        elif self.session.bench.positions_only:
            account = "positions only"
        else:
            account = f"energy residual {frame.energies[6]:.1e} J"
        # Always two lines, so that the tabs below stay where they are.
        lines = [f"t = {frame.time:.3f} s · {pace}  \n{account}"]
        if frame.message:
            lines.append(f"> {frame.message}")
        if self._problem:
            lines.append(f"The file has mistakes; the mechanism before goes on:\n```text\n{self._problem}\n```")
        return "\n\n".join(lines)
