"""The page in the browser: its controls put requests to the session, and a thread shows the newest frame.

All pages of a server see the same. viser keeps what a slow page has not received yet, and only the newest of it.
"""

from __future__ import annotations

import io
import math
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

from mbd_sim.base.errors import MbdSimError
from mbd_sim.lab.background import Preparer
from mbd_sim.lab.keep import motion_html
from mbd_sim.lab.plots import Plots, readings_of
from mbd_sim.lab.safety import Gate, guarded
from mbd_sim.lab.scene import Scene
from mbd_sim.lab.session import Frame, Session
from mbd_sim.lab.sliders import Setting, as_yaml, settings_of
from mbd_sim.pictures.shapes.extent import extent_of

Theme = Literal["light", "dark"]

PICTURES = 60.0  # a second
NUMBERS = 6.0  # updates of texts, plots and sliders a second
UNTOUCHED = 0.7  # s after which a control that the user has moved follows the session again
OPEN_SLIDERS = 12  # folders with more sliders are closed at first
SPEEDS = {"1/100": 0.01, "1/10": 0.1, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0, "5": 5.0, "fastest": math.inf}
HELP = """
**Look:** drag the background to turn, the wheel or two fingers to come closer, the right button to move.

**Take hold:** drag a part with the mouse or a finger. While it runs, a spring and a damper pull it (the red arrow is
their force, counted as applied work). While it is paused, the mechanism follows the pointer with its loops closed.

**Keys:** space plays and pauses · right arrow takes a step · left arrow goes back · Home returns to the start.

**Change:** move a slider or type a number. *Copy as YAML* shows what to write into the file. Save the file in any
editor: the page follows, and parts of the same names stay where they are.

**Keep:** a recording contains every change, and `mbd_sim verify` recomputes it bit for bit. The page *with motion* is
one file that opens anywhere, without a network.
"""


class Page:
    """The page of a session; `url` opens it."""

    def __init__(
        self, session: Session, *, host: str, port: int, theme: Theme, check: Callable[[], str] | None = None
    ) -> None:
        """Start the server.

        :param check: finds what `mbd_sim check` says about the mechanism; called in a thread of its own.
        """
        import viser
        from viser import _messages

        self.session, self._check, self._dark = session, check, theme == "dark"
        self._gate = Gate(host)
        with guarded(self._gate):
            self.server = viser.ViserServer(host=host, port=port, label="mbd_sim lab", verbose=False)
        self.server._websock_server.unregister_handler(_messages.ShareUrlRequest)  # it would open a tunnel
        self._generation = 0
        self._preparer = Preparer(session)
        self._touched: dict[str, float] = {}
        self._lock, self._stopped = threading.RLock(), threading.Event()
        self._problem = self._note = ""
        self._report: tuple[Any, str] | None = None
        self._build()
        self._thread = threading.Thread(target=self._run, name="lab_page", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address, with the token if there is one."""
        host = self.server.get_host()
        token = f"?token={self._gate.token}" if self._gate.token else ""
        return f"http://{f'[{host}]' if ':' in host else host}:{self.server.get_port()}/{token}"

    def stop(self) -> None:
        """Close the page and the server."""
        self._stopped.set()
        self._thread.join()
        self._preparer.stop()
        self.server.stop()

    def refuse(self, problem: str) -> None:
        """Show what is wrong with the file; the mechanism goes on."""
        self._problem = problem

    def accept(self) -> None:
        """The file is right again."""
        self._problem = ""

    def _build(self) -> None:
        """Build the scene and the panel of the present mechanism."""
        server, session = self.server, self.session
        bench = session.bench
        simulation = bench.simulation
        server.scene.reset()
        server.gui.reset()
        server.gui.configure_theme(
            dark_mode=self._dark,
            show_share_button=False,
            show_logo=False,
            control_width="medium",
            brand_color=(52, 120, 190),
        )
        extent = extent_of(simulation.model)
        self._scene = Scene(server.scene, simulation.model, extent, self._dragged, dark=self._dark)
        self._look(extent)
        self._settings = settings_of(bench, extent.size)
        self._sliders: dict[str, Any] = {}
        self._build_panel()
        self._generation = session.frame.generation

    def _look(self, extent: Any) -> None:
        camera, normal = self.server.initial_camera, extent.normal
        distance = 1.25 * max(float(max(extent.upper - extent.lower)), extent.size)
        toward = (0.55, -1.0, 0.5) if normal is None else (0.12, -1.0, 0.16)
        if normal is not None and abs(normal[0]) > 0.5:
            toward = (1.0, -0.12, 0.16)
        if normal is not None and abs(normal[2]) > 0.5:
            toward = (0.05, -0.3, 1.0)
        camera.position = tuple(extent.center + distance * _unit(toward))
        camera.look_at = tuple(extent.center)

    def _build_panel(self) -> None:
        gui, mechanism = self.server.gui, self.session.bench.simulation.mechanism
        gui.add_markdown(f"**{mechanism.name}** · {mechanism.description or ''}")
        self._build_run(gui)
        self._told = gui.add_markdown("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Change"):
            self._build_sliders(gui)
        with tabs.add_tab("Plots"):
            self._build_plots(gui)
        with tabs.add_tab("Show"):
            self._build_show(gui)
        with tabs.add_tab("Keep"):
            self._build_keep(gui)
        with tabs.add_tab("Help"):
            gui.add_markdown(HELP)
            if self._check is not None:
                with gui.add_folder("What `mbd_sim check` says", expand_by_default=False):
                    report = gui.add_markdown("…")
                threading.Thread(target=self._find_report, args=(report,), daemon=True).start()

    def _find_report(self, shown: Any) -> None:
        """Find what `check` says; it is shown with the next texts."""
        assert self._check is not None
        try:
            self._report = (shown, f"```text\n{self._check()}\n```")
        except MbdSimError as error:
            self._report = (shown, f"```text\n{error}\n```")

    def _build_run(self, gui: Any) -> None:
        ask = self.session.ask
        self._buttons = gui.add_button_group("Run", ("Play", "Pause", "Step", "Reset"))
        actions: dict[str, Callable[[Session], None]] = {
            "Play": Session.play,
            "Pause": Session.pause,
            "Step": lambda session: session.step(session.bench.period),
            "Reset": Session.reset,
        }
        self._buttons.on_click(lambda event: ask("run", actions[event.target.value]))
        speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1", hint="Simulated seconds per second")
        speed.on_update(lambda _: ask("speed", lambda session: session.set_speed(SPEEDS[speed.value])))
        self._time = gui.add_slider("Time (s)", min=0.0, max=1.0, step=0.001, initial_value=0.0, hint="Wind back")
        self._time.on_update(self._wound)
        keys: dict[str, tuple[str, Callable[[Session], None]]] = {
            "space": ("Play or pause", lambda session: session.pause() if session.running else session.play()),
            "arrowright": ("Step", actions["Step"]),
            "arrowleft": ("Step back", lambda session: session.wind_to(session.frame.time - 1.0 / 30.0)),
            "home": ("Reset", Session.reset),
        }
        for key, (label, action) in keys.items():
            command = gui.add_command(label, hotkey=key)
            command.on_trigger(lambda _, label=label, action=action: ask(f"key {label}", action))

    def _wound(self, event: Any) -> None:
        if event.client is not None:
            self._touched["time"] = time.monotonic()
            where = self._time.value
            self.session.ask("wind", lambda session: session.wind_to(where))

    def _build_sliders(self, gui: Any) -> None:
        groups: dict[str, list[Setting]] = {}
        for setting in self._settings:
            groups.setdefault(setting.group, []).append(setting)
        for group, settings in groups.items():
            few = len(settings) <= OPEN_SLIDERS and group in ("Drive", "Parameters", "Commands", "Actuators")
            with gui.add_folder(group, expand_by_default=few):
                for setting in settings:
                    self._add_slider(gui, setting)
                back = gui.add_button("Back to the file", color="gray")
                back.on_click(partial(self._restore, settings))
        if not groups:
            gui.add_markdown("Nothing of this mechanism can change.")
        copied = gui.add_button("Copy as YAML", icon=None)
        text = gui.add_markdown("")

        def show_yaml(_: Any) -> None:
            shown = {key: slider.value for key, slider in self._sliders.items()}
            text.content = f"```yaml\n{as_yaml(self._settings, shown)}```"

        copied.on_click(show_yaml)

    def _add_slider(self, gui: Any, setting: Setting) -> None:
        label = f"{setting.label} ({setting.unit})" if setting.unit else setting.label
        slider = gui.add_slider(
            label, min=setting.low, max=setting.high, step=setting.step, initial_value=_within(setting, setting.value)
        )
        self._sliders[setting.key] = slider

        def moved(event: Any) -> None:
            if event.client is not None:
                self._touched[setting.key] = time.monotonic()
                self._apply(setting, slider.value)

        slider.on_update(moved)

    def _restore(self, settings: list[Setting], _: Any) -> None:
        for setting in settings:
            self._apply(setting, setting.value)

    def _apply(self, setting: Setting, shown: float) -> None:
        if setting.kind == "drive":
            self.session.ask("drive", lambda session: session.drive_to(shown * setting.factor))
        elif setting.kind == "value":
            self._preparer.ask(setting.key, shown * setting.factor)
        else:
            self.session.ask(f"{setting.kind} {setting.key}", lambda session: setting.apply(session.bench, shown))

    def _build_plots(self, gui: Any) -> None:
        bench = self.session.bench
        readings = readings_of(bench)
        chosen = gui.add_dropdown("Reading", ("none", *readings), initial_value="none")

        def choose(_: Any) -> None:
            reading = readings.get(chosen.value)

            def request(session: Session) -> None:
                session.reading = reading
                session.samples.rows.clear()

            self.session.ask("reading", request)

        chosen.on_update(choose)
        self._plots = Plots(gui, bench.simulation, dark=self._dark)

    def _build_show(self, gui: Any) -> None:
        shown = self._scene.shown
        traces = gui.add_checkbox("Traces", initial_value=shown.traces)
        contacts = gui.add_checkbox("Contact forces", initial_value=shown.contacts)
        reactions = gui.add_checkbox("Forces through joints", initial_value=shown.reactions)

        def choose(_: Any) -> None:
            shown.traces, shown.contacts, shown.reactions = traces.value, contacts.value, reactions.value
            wanted = reactions.value
            self.session.ask("reactions", lambda session: setattr(session, "show_reactions", wanted))
            self._redraw = True

        for box in (traces, contacts, reactions):
            box.on_update(choose)
        clear = gui.add_button("Clear the traces", color="gray")
        clear.on_click(lambda _: self._scene.clear_traces())
        dark = gui.add_checkbox("Dark", initial_value=self._dark)

        def darken(_: Any) -> None:
            self._dark, self._generation = dark.value, 0  # builds the page again

        dark.on_update(darken)

    def _build_keep(self, gui: Any) -> None:
        name = self.session.bench.simulation.mechanism.name
        path = gui.add_text("Recording", initial_value=f"{name}.mcap")
        record = gui.add_button("Record", color="red")
        stop = gui.add_button("End the recording", color="gray")
        record.on_click(lambda _: self.session.ask("record", lambda session: session.record(Path(path.value).name)))
        stop.on_click(lambda _: self.session.ask("end", Session.end_recording_told))
        picture = gui.add_button("Picture")
        motion = gui.add_button("Page with the motion")
        picture.on_click(lambda event: self._send_picture(event, name))
        motion.on_click(lambda event: self._send_motion(event, name))
        self._recording = gui.add_markdown("")

    def _send_picture(self, event: Any, name: str) -> None:
        import imageio.v3

        if event.client is not None:
            image = event.client.get_render(height=1080, width=1440, transport_format="png", timeout=20.0)
            data = io.BytesIO()
            imageio.v3.imwrite(data, image, extension=".png")
            event.client.send_file_download(f"{name}.png", data.getvalue(), save_immediately=True)

    def _send_motion(self, event: Any, name: str) -> None:
        if event.client is not None:
            bench = self.session.bench
            html = motion_html(bench.simulation.model, self.session.history.points(), dark=self._dark)
            event.client.send_file_download(f"{name}.html", html.encode(), save_immediately=True)

    def _dragged(self, phase: str, part: str, point: Any, target: Any) -> None:
        """A part is dragged: pulled in a run, moved through its configurations otherwise."""

        def request(session: Session) -> None:
            if phase == "end":
                session.bench.let_go()
            elif not session.running or session.bench.positions_only:
                session.bench.drag(part, point, target)
            elif session.bench.hold is None or phase == "start":
                session.bench.take_hold(part, point, target)
            else:
                session.bench.pull_to(target)

        self.session.ask(f"drag {phase}", request)  # a start and an end are never replaced by a move

    def _run(self) -> None:
        last, told = -1, 0.0
        while not self._stopped.wait(1.0 / PICTURES):
            frame = self.session.frame
            if frame.generation != self._generation:
                self._build()
                last = -1
            now = time.monotonic()
            if frame.number == last and now - told < 1.0 / NUMBERS:
                continue
            last = frame.number
            with self.server.atomic():
                self._scene.show(frame)
                if now - told >= 1.0 / NUMBERS:
                    told = now
                    self._tell(frame)

    def _tell(self, frame: Frame) -> None:
        """Update texts, plots and sliders."""
        if self._report is not None:
            shown, text = self._report
            shown.content, self._report = text, None
        self._plots.show(self.session.samples)
        low, high = frame.span
        high = max(high, low + 1e-3)
        if self._free("time") and frame.number:
            self._time.min, self._time.max = round(low, 3), round(high, 3)
            self._time.value = round(min(max(frame.time, low), high), 3)
        for setting in self._settings:
            slider, value = self._sliders[setting.key], frame.values[setting.key] / setting.factor
            if self._free(setting.key) and abs(slider.value - _within(setting, value)) > 1e-9 * abs(value):
                slider.value = _within(setting, value)
        pace = f"running at {frame.rate:.3g} × real time" if frame.running else "paused"
        account = (
            "positions only" if self.session.bench.positions_only else f"energy residual {frame.energies[6]:.1e} J"
        )
        lines = [f"t = {frame.time:.3f} s · {pace} · {account}"]
        if frame.message:
            lines.append(f"> {frame.message}")
        if self._problem:
            lines.append(f"The file has mistakes; the mechanism before goes on:\n```text\n{self._problem}\n```")
        if (text := "\n\n".join(lines)) != self._note:
            self._told.content = self._note = text
        recording = f"recording to `{frame.recording}`" if frame.recording else ""
        if self._recording.content != recording:
            self._recording.content = recording

    def _free(self, control: str) -> bool:
        return time.monotonic() - self._touched.get(control, -math.inf) > UNTOUCHED


def _within(setting: Setting, value: float) -> float:
    return min(max(value, setting.low), setting.high)


def _unit(vector: tuple[float, float, float]) -> Any:
    import numpy as np

    found = np.array(vector)
    return found / np.linalg.norm(found)
