"""What can be kept of a motion: a recording, a picture, an animation, and a page with the motion."""

from __future__ import annotations

import io
import tempfile
from operator import methodcaller
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import MbdSimError
from mbd_sim.lab.scene.keep import mechanisms_at, motion_html
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.scene.traces import TIPS
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.session import Session
from mbd_sim.pictures.shapes.joints import default_traces
from mbd_sim.pictures.shapes.touching import touching
from mbd_sim.simulation.run.run_point import RunPoint

PICTURE = (1440, 1080)  # px
LONGEST = 120.0  # s, in which a browser without a GPU draws it
ANIMATION = (640, 480)  # px
FORMATS = ("gif", "mp4", "webp", "html")
LASTS = {"2 s": 2.0, "5 s": 5.0, "10 s": 10.0, "30 s": 30.0}  # of the motion


class KeepTab:
    """The buttons that record, and those that send a file to the page."""

    def __init__(self, gui: Any, session: Session, scene: Scene, *, dark: bool) -> None:
        self._session, self._scene, self._dark = session, scene, dark
        self._name = session.bench.simulation.mechanism.name
        path = None if session.of_node else gui.add_text("Recording", initial_value=f"{self._name}.mcap")
        record = gui.add_button("Record", color="red")
        stop = gui.add_button("End the recording", color="gray")

        def record_now(_: Any) -> None:
            name = "" if path is None else Path(path.value).name  # a node names its recordings itself
            session.ask("record", lambda session: session.record(name))

        record.on_click(record_now)
        stop.on_click(lambda _: session.ask("end", methodcaller("end_recording_told")))
        self._recording = gui.add_markdown("")
        gui.add_button("Picture").on_click(self._send_picture)
        gui.add_button("Page with the motion").on_click(self._send_motion)
        self._last = gui.add_dropdown("Last", tuple(LASTS), initial_value="5 s", hint="of the motion, in the animation")
        self._format = gui.add_dropdown("Format", FORMATS, initial_value="gif")
        gui.add_button("Animation").on_click(self._send_animation)

    def show(self, frame: Frame) -> None:
        """Say what is being recorded."""
        recording = f"recording to `{frame.recording}`" if frame.recording else ""
        if self._recording.content != recording:
            self._recording.content = recording

    def _send_picture(self, event: Any) -> None:
        import imageio.v3

        if event.client is None:
            return
        width, height = PICTURE
        self._tell("The picture is being drawn.")
        try:
            image = event.client.get_render(height=height, width=width, transport_format="png", timeout=LONGEST)
        except TimeoutError:
            self._tell(f"The browser has drawn no picture in {LONGEST:.0f} s.")
            return
        data = io.BytesIO()
        imageio.v3.imwrite(data, image, extension=".png")
        self._send(event, f"{self._name}.png", data.getvalue())

    def _send_motion(self, event: Any) -> None:
        if event.client is not None and (points := self._points()):
            self._tell("The page with the motion is being written.")
            html = motion_html(self._session.bench.simulation.model, points, dark=self._dark, page=self._scene)
            self._send(event, f"{self._name}.html", html.encode())

    def _send_animation(self, event: Any) -> None:
        if event.client is None or not (points := self._points()):
            return
        name, end = f"{self._name}.{self._format.value}", points[-1][0]
        points = [one for one in points if one[0] >= end - LASTS[self._last.value]]
        self._tell("The animation is being drawn.")
        try:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / name
                self._write_animation(file, points)
                self._send(event, name, file.read_bytes())
        except MbdSimError as error:
            self._tell(str(error))

    def _write_animation(self, file: Path, points: list[tuple[float, RunPoint]]) -> None:
        from mbd_sim.pictures.drawing.animation import (
            FRAME_RATE,
            Animation,
            require_animation_packages,
            write_animation,
        )

        require_animation_packages(file)
        model = self._session.bench.simulation.model
        samples = [(time, model.poses(time, point.state, point.inputs)) for time, point in points]
        chosen = self._scene.traces.chosen
        traced = list(default_traces(model.mechanism)) if chosen == TIPS else [chosen]
        drawn = Animation(
            model, *ANIMATION, [poses for _, poses in samples], traced if self._scene.shown.traces else ()
        )
        contacts = [touching(model, time, point.state, point.inputs) for time, point in points]
        frames = drawn.frames(samples, FRAME_RATE, mechanisms_at(model, points), contacts)
        write_animation(file, frames, self._name)

    def _send(self, event: Any, name: str, data: bytes) -> None:
        event.client.send_file_download(name, data, save_immediately=True)
        self._tell(f"saved as `{name}`, where the browser puts downloads")

    def _points(self) -> list[tuple[float, RunPoint]]:
        """The points of the motion that is kept."""
        points = self._session.history.points()
        if not points:
            self._tell("There is no motion yet. Play it first.")
        return points

    def _tell(self, message: str) -> None:
        self._session.ask("tell", lambda session: session.tell(message))
