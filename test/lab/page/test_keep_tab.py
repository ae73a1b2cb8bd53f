"""What the page keeps: a recording, a picture, an animation, and the motion as a page."""

import io
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from PIL import Image

from mbd_sim import load_mechanism
from mbd_sim.lab.page import keep_tab
from mbd_sim.lab.page.keep_tab import PICTURE, KeepTab
from mbd_sim.lab.scene.scene import Scene
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.recordings.run.verification import verify
from test.lab.scene.recording_scene import RecordingScene
from test.waiting import PATIENCE


@pytest.mark.parametrize(
    ("button", "mechanism", "ending", "begins"),
    [
        ("picture", "four_bar", "png", b"\x89PNG"),
        ("motion", "motor_drive", "html", b"<!"),
        ("animation", "bounce", "gif", b"GIF"),
    ],
)
def test_what_is_being_made_is_said_and_then_its_name(button, mechanism, ending, begins):
    pytest.importorskip("viser")
    session, told = OwnSession(Bench.of(load_mechanism(mechanism)), running=False), []
    for _ in range(3):
        session.step(20)
    session.ask = lambda _, request: request(SimpleNamespace(tell=told.append))
    model = session.bench.simulation.model
    scene = Scene(RecordingScene(), model, extent_of(model), None, dark=False)
    if mechanism == "four_bar":
        scene.traces.choose("coupler.P")
    gui = MagicMock()
    gui.add_dropdown.side_effect = lambda *_, initial_value, **__: SimpleNamespace(value=initial_value)
    tab = KeepTab(gui, session, scene, dark=False)
    client = MagicMock()
    client.get_render.return_value = np.zeros((*PICTURE[::-1], 3), dtype=np.uint8)
    getattr(tab, f"_send_{button}")(SimpleNamespace(client=client))
    (name, data), _ = client.send_file_download.call_args
    assert name == f"{mechanism}.{ending}"
    assert data.startswith(begins)
    assert button in told[0]
    assert told[1:] == [f"saved as `{name}`, where the browser puts downloads"]


@pytest.fixture
def keep(opened, monkeypatch):
    monkeypatch.setattr(keep_tab, "PICTURE", (480, 360))  # a browser without a GPU draws large ones slowly
    opened.tab("Keep")
    opened.press("Play", lambda: opened.frame.time > 0.3, "the run")
    opened.press("Pause", lambda: not opened.frame.running, "the pause")
    return opened


def test_a_recording_of_the_page_is_recomputed(keep):
    keep.press("Record", lambda: keep.frame.recording, "the recording")
    name, start = keep.frame.recording, keep.frame.time
    keep.press("Play", lambda: keep.frame.time > start + 0.3, "the run")
    keep.press("End the recording", lambda: not keep.frame.recording, "the end")
    assert all(one.agrees for one in verify(name))


def test_a_picture_shows_the_mechanism(keep):
    with keep.drawing():
        name, data = keep.downloaded("Picture")
    picture = Image.open(io.BytesIO(data))
    assert (name, picture.format, picture.size) == ("four_bar.png", "PNG", (480, 360))
    colors = np.asarray(picture.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(colors, axis=0)) > 100


def test_an_animation_moves(keep):
    tab = keep.lab.page._keep
    keep.select("Last", "2 s", lambda: tab._last.value == "2 s", "the choice of 2 s")
    keep.select("Format", "webp", lambda: tab._format.value == "webp", "the choice of webp")
    name, data = keep.downloaded("Animation")
    animation = Image.open(io.BytesIO(data))
    assert name == "four_bar.webp"
    # A busy machine takes few steps in the time of a frame.
    assert 2 <= animation.n_frames <= min(51, len(keep.lab.session.history.points()))
    first = np.asarray(animation.convert("RGB"))
    animation.seek(animation.n_frames - 1)
    assert np.any(first != np.asarray(animation.convert("RGB")))


def test_without_a_motion_there_is_nothing_to_send(opened):
    opened.tab("Keep")
    opened.press("Animation", lambda: "no motion yet" in opened.frame.message, "the message")


def test_a_page_with_the_motion_opens_without_a_server(keep, chromium, tmp_path):
    name, data = keep.downloaded("Page with the motion")
    file = tmp_path / name
    file.write_bytes(data)
    page, asked = chromium.new_page(viewport={"width": 400, "height": 300}), []
    page.set_default_timeout(1000.0 * PATIENCE)
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"file://{file}")
    page.wait_for_function("[...document.querySelectorAll('canvas')].some(one => one.width > 100)")
    page.locator("svg[width]").first.wait_for()
    assert not [url for url in asked if url.startswith("http")]
    page.close()
