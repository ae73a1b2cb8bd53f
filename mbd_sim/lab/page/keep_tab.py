"""What can be kept of a motion: a recording, a picture, and a page with the motion."""

from __future__ import annotations

import io
from operator import methodcaller
from pathlib import Path
from typing import Any

from mbd_sim.lab.page.keep import motion_html
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.session import Session


class KeepTab:
    """The buttons that record, and those that send a file to the page."""

    def __init__(self, gui: Any, session: Session, *, dark: bool) -> None:
        self._session, self._dark = session, dark
        self._name = session.bench.simulation.mechanism.name
        path = gui.add_text("Recording", initial_value=f"{self._name}.mcap")
        record = gui.add_button("Record", color="red")
        stop = gui.add_button("End the recording", color="gray")
        record.on_click(lambda _: session.ask("record", lambda session: session.record(Path(path.value).name)))
        stop.on_click(lambda _: session.ask("end", methodcaller("end_recording_told")))
        gui.add_button("Picture").on_click(self._send_picture)
        gui.add_button("Page with the motion").on_click(self._send_motion)
        self._recording = gui.add_markdown("")

    def show(self, frame: Frame) -> None:
        """Say what is being recorded."""
        recording = f"recording to `{frame.recording}`" if frame.recording else ""
        if self._recording.content != recording:
            self._recording.content = recording

    def _send_picture(self, event: Any) -> None:
        import imageio.v3

        if event.client is not None:
            image = event.client.get_render(height=1080, width=1440, transport_format="png", timeout=20.0)
            data = io.BytesIO()
            imageio.v3.imwrite(data, image, extension=".png")
            event.client.send_file_download(f"{self._name}.png", data.getvalue(), save_immediately=True)

    def _send_motion(self, event: Any) -> None:
        if event.client is not None:
            model = self._session.bench.simulation.model
            html = motion_html(model, self._session.history.points(), dark=self._dark)
            event.client.send_file_download(f"{self._name}.html", html.encode(), save_immediately=True)
