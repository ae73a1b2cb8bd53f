"""The page in a real browser, without a network: every control is used once."""

import re
import time

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.lab import Lab
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.recordings.run.verification import verify
from test.docs.site_browser import browser
from test.waiting import PATIENCE, wait_until

viser_transforms = pytest.importorskip("viser.transforms")
playwright = pytest.importorskip("playwright.sync_api")

FLAGS = (
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-webgl",
    "--ignore-gpu-blocklist",
)
SIZE = {"width": 1100, "height": 560}  # larger ones take a browser without a GPU longer


@pytest.fixture(scope="module")
def chromium():
    if browser() is None:
        pytest.skip("there is no browser: install chromium, or name one in MBD_SIM_TEST_BROWSER")
    with playwright.sync_playwright() as program:
        opened = program.chromium.launch(executable_path=browser(), args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    file = folder / "linkage.yaml"
    file.write_text(load_mechanism("four_bar").source.text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        with Lab(load_mechanism(file), port=0, running=False) as lab:
            yield lab


# Without a GPU a browser that draws as often as it can takes whole processors from what is tested.
FEW_FRAMES = """
const draw = window.requestAnimationFrame.bind(window);
window.requestAnimationFrame = frame => setTimeout(() => draw(frame), 100);
window.cancelAnimationFrame = clearTimeout;
"""


class Opened:
    """A page of the lab that was opened in the browser; `requests` are the addresses that it asked for."""

    def __init__(self, chromium, lab, size=SIZE):
        self.page, self.lab, self.requests, self.size = chromium.new_page(viewport=size), lab, [], size
        self.page.set_default_timeout(1000.0 * PATIENCE)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.route(lambda url: not url.startswith((lab.url, "blob:", "data:")), lambda route: route.abort())
        self.page.add_init_script(FEW_FRAMES)
        self.page.goto(lab.url)
        self.page.wait_for_selector("canvas")
        self.page.get_by_role("button", name="Play").wait_for()

    @property
    def frame(self):
        return self.lab.session.frame

    def button(self, name):
        self.page.get_by_role("button", name=name, exact=True).first.click()

    def tab(self, name):
        self.page.get_by_role("tab", name=name).click()

    def type(self, label, text):
        """Type a number beside a slider."""
        row = self.page.locator("div", has=self.page.get_by_text(label, exact=True)).last.locator("xpath=..")
        field = row.locator("input:not([type=hidden])").last
        field.fill(text)
        field.press("Enter")

    def pixel(self, point):
        """Where a point (3,) is on the screen."""
        camera = list(self.lab.page.server.get_clients().values())[-1].camera
        rotation = viser_transforms.SO3(np.array(camera.wxyz)).as_matrix()
        x, y, z = rotation.T @ (np.array(point) - camera.position)
        focal = 0.5 * camera.image_height / np.tan(0.5 * camera.fov)
        return 0.5 * camera.image_width + focal * x / z, 0.5 * camera.image_height + focal * y / z

    def drag(self, part, point, right, down, release=True):
        """Drag a point (3,) of a part over the screen."""
        pose = self.lab.session.bench.simulation.poses()[part]
        x, y = self.pixel(pose.position + pose.rotation @ point)
        mouse = self.page.mouse
        mouse.move(x - 2, y)
        time.sleep(0.15)
        mouse.move(x, y)
        mouse.down()
        for step in range(1, 9):
            mouse.move(x + right * step / 8, y + down * step / 8)
            time.sleep(0.03)
        if release:
            mouse.up()


@pytest.fixture(scope="module")
def opened(chromium, lab):
    return Opened(chromium, lab)


def test_dragging_a_paused_mechanism_moves_it_with_loops_closed(opened):
    time.sleep(1.0)  # until the browser has drawn the scene
    before = opened.frame.positions
    opened.drag("rocker", np.array([0.8, 0.0, 0.0]), 60, 10)
    wait_until(lambda: abs(opened.frame.positions - before).max() > 0.05, "the mechanism to move")
    assert opened.lab.session.bench.simulation.violation.position < 1e-9
    assert opened.frame.time == 0.0


def test_play_pause_step_and_reset(opened):
    opened.button("Play")
    wait_until(lambda: opened.frame.running and opened.frame.time > 0.1, "the run")
    opened.button("Pause")
    wait_until(lambda: not opened.frame.running, "the pause")
    time_ = opened.frame.time
    opened.button("Step")
    wait_until(lambda: opened.frame.time > time_, "the step")
    opened.button("Reset")
    wait_until(lambda: opened.frame.time == 0.0, "the reset")


def test_keys(opened):
    opened.page.mouse.click(300, 650)
    opened.page.keyboard.press("Space")
    wait_until(lambda: opened.frame.running and opened.frame.time > 0.2, "the run")
    opened.page.keyboard.press("Space")
    wait_until(lambda: not opened.frame.running, "the pause")
    paused = opened.frame.time
    opened.page.keyboard.press("ArrowRight")
    wait_until(lambda: opened.frame.time > paused, "the step")
    opened.page.keyboard.press("ArrowLeft")
    wait_until(lambda: opened.frame.time < paused, "the step back")
    opened.page.keyboard.press("Home")
    wait_until(lambda: opened.frame.time == 0.0, "the reset")


def test_a_typed_length_changes_the_linkage_and_goes_back(opened):
    opened.type("coupler (m)", "1.3")
    wait_until(lambda: opened.frame.values["parameters.coupler"] == 1.3, "the length")
    tip = opened.lab.session.bench.simulation.point("coupler.tip").position
    crank = opened.lab.session.bench.simulation.point("crank.tip").position
    assert np.linalg.norm(tip - crank) == pytest.approx(1.3, abs=1e-9)
    opened.page.get_by_text(re.compile("coupler: 1.3 m")).first.wait_for()
    opened.button("Copy as YAML")
    assert "coupler: 1.3 m" in opened.page.evaluate("getSelection().toString()")
    opened.button("coupler: 1.4")
    wait_until(lambda: opened.frame.values["parameters.coupler"] == 1.4, "the file's value")


def test_a_typed_value_may_lie_outside_of_its_slider(opened):
    (density,) = (one for one in opened.lab.page._change._settings if one.key == "parameters.density")
    opened.type("density", "7.25")
    wait_until(lambda: opened.frame.values["parameters.density"] == 7.25, "the value")
    assert density.high < 7.25
    opened.type("crank (m)", "0.6")
    wait_until(lambda: opened.frame.values["parameters.crank"] == 0.6, "the length")
    opened.button("all")
    wait_until(lambda: opened.frame.values["parameters.density"] == 1.0, "the file's density")
    wait_until(lambda: opened.frame.values["parameters.crank"] == 0.5, "the file's length")


def test_pulling_exerts_a_force_until_the_hand_lets_go(opened):
    opened.lab.session.ask("speed", lambda session: session.set_speed(0.02))
    opened.button("Play")
    wait_until(lambda: opened.frame.running, "the run")
    opened.drag("rocker", np.array([0.5, 0.0, 0.0]), 80, -20, release=False)
    wait_until(lambda: opened.frame.pull is not None, "the pull")
    opened.page.mouse.up()
    wait_until(lambda: opened.frame.pull is None, "the hand to let go")
    opened.lab.session.ask("speed", lambda session: session.set_speed(1.0))
    assert opened.frame.energies[3] != 0.0
    assert abs(opened.frame.energies[6]) < 1e-6


def test_two_pages_see_the_same(opened, chromium, lab):
    lab.session.ask("run", OwnSession.pause)
    second = Opened(chromium, lab)
    second.type("rocker (m)", "1.25")
    wait_until(lambda: opened.frame.values["parameters.rocker"] == 1.25, "the length")
    field = opened.page.locator("input[value='1.25']").first
    field.wait_for(state="attached")
    second.page.close()


def test_winding_back_by_the_time_line(opened):
    opened.button("Play")
    wait_until(lambda: opened.frame.time > 0.5, "the run")
    opened.button("Pause")
    wait_until(lambda: not opened.frame.running, "the pause")
    reached = opened.frame.time
    wait_until(lambda: abs(opened.lab.page._run_bar.time.value - reached) < 1e-3, "the paused time in the page")
    opened.type("Time (s)", "0.2")
    wait_until(
        lambda: opened.frame.time < 0.5 * (0.2 + reached),
        "the wound back time",
        report=lambda: f"{reached:g} s were reached; now {opened.frame.time:g} s",
    )


def test_plots_and_what_is_shown(opened):
    opened.tab("Plots")
    opened.page.get_by_text("Phase portrait").first.wait_for()
    opened.tab("Show")
    opened.page.get_by_text("Forces through joints", exact=True).first.click()
    wait_until(lambda: "reactions" in opened.frame.watched, "the forces")
    opened.tab("Help")
    opened.page.get_by_text("Take hold:").first.wait_for()


def test_a_recording_of_the_page_is_recomputed(opened):
    opened.tab("Keep")
    opened.button("Record")
    wait_until(lambda: opened.frame.recording, "the recording")
    name = opened.frame.recording
    opened.button("Play")
    start = opened.frame.time
    wait_until(lambda: opened.frame.time > start + 0.3, "the run")
    opened.button("End the recording")
    wait_until(lambda: not opened.frame.recording, "the end")
    assert all(one.agrees for one in verify(name))


def test_a_page_with_the_motion_opens_without_a_server(opened, chromium, tmp_path):
    opened.tab("Keep")
    with opened.page.expect_download() as download:
        opened.button("Page with the motion")
    download.value.save_as(tmp_path / "motion.html")
    page = chromium.new_page()
    page.set_default_timeout(1000.0 * PATIENCE)
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"file://{tmp_path}/motion.html")
    page.wait_for_selector("canvas")
    page.locator("svg[width]").first.wait_for()
    assert not [url for url in asked if url.startswith("http")]
    page.close()


def test_the_page_follows_the_file_and_shows_its_mistakes(opened, lab):
    file = next(iter([lab._watch._path]))
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("density*coupler", "density*kupler"), encoding="utf-8")
    opened.page.get_by_text(re.compile("unknown name .?kupler|kupler")).first.wait_for()
    assert opened.frame.generation == 1
    file.write_text(text.replace("density: 1 ", "density: 3 "), encoding="utf-8")
    wait_until(lambda: opened.frame.generation == 2, "the new mechanism")
    opened.page.get_by_text("kupler").first.wait_for(state="detached")
    assert isinstance(lab.session.bench, Bench)


def test_no_other_address_was_asked_for(opened):
    assert all(url.startswith((opened.lab.url, "blob:", "data:")) for url in opened.requests)


def test_on_a_phone_everything_fits(opened, chromium, lab):
    opened.page.close()
    phone = Opened(chromium, lab, {"width": 390, "height": 844})
    assert phone.page.evaluate("document.documentElement.scrollWidth") <= 390
    phone.page.close()
