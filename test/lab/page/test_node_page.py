"""The page of a running node, over DDS and in a real browser: every control goes the way of messages."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from test.system.growing_recordings import MAGIC, STEP_NS, stop_recording, verified
from test.system.nodes import nanoseconds, running
from test.waiting import wait_until

browser_page = pytest.importorskip("test.lab.page.browser_page")

SIZE = {"width": 1000, "height": 420}  # wider than a phone beside the panel
BENCH = """
mechanism: bench
gravity: [0, 0, 0]
parameters: {d: 0.05}
parts:
  arm: {shape: {type: rod, to: [0.5, 0, 0], radius: 4 cm, mass: 1 kg}, points: {tip: [0.5, 0, 0]}}
  wheel: {mass: 0.5, inertia: [0.001, 0.002, 0.001]}
joints:
  pin: {type: revolute, between: [ground, arm], axis: [0, -1, 0], damping: d}
  hub: {type: revolute, between: [arm.tip, wheel], axis: [0, -1, 0], damping: 0.05}
actuators:
  spin: {type: effort, joint: hub}
"""


class NodePage(browser_page.AnyPage):
    """A page of the node; whoever waits for it takes messages meanwhile."""

    def __init__(self, chromium, url, listener):
        self.listener, self.until = listener, listener.until
        super().__init__(chromium, url, SIZE)

    def pause(self, seconds):
        """Take messages while the page works."""
        self.listener.spin(seconds)

    def drag(self, condition, what):
        """Drag the middle of the arm, at which the camera looks at the start, until this has an effect; hold it."""
        mouse, box = self.page.mouse, self.page.locator("canvas").first.bounding_box()
        across, down = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]

        moved = 0

        def attempt():
            nonlocal moved
            if moved % 12 == 0:  # the browser may not have drawn the arm yet
                mouse.up()
                mouse.move(across - 2, down)
                self.listener.spin(0.2)
                mouse.move(across, down)
                mouse.down()
            moved += 1
            mouse.move(across, down - 80 * (moved % 12) / 12)
            self.listener.spin(0.1)

        wait_until(condition, what, meanwhile=attempt, report=lambda: self.listener.process.text)

    def shows(self, label, value):
        """Wait until the number beside a slider is this one."""
        self.until(lambda: float(self.field(label).input_value() or "nan") == value, f"{label} = {value} on the page")


@pytest.fixture(scope="module")
def node(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab_node")
    (folder / "bench.yaml").write_text(BENCH, encoding="utf-8")
    options = {"mechanism": "bench.yaml", "start_paused": True, "record": True, "lab": True, "lab_port": 0}
    options["command_timeout"] = 3.0  # a browser without a GPU may repeat commands late
    with running(folder, **options) as (process, listener):
        listener.ready_to_command()
        listener.until(lambda: "the lab is at" in process.text, "the address")
        pulls = []
        listener.node.create_subscription(
            Float64MultiArray, "sim_node/applied_wrenches", lambda message: pulls.append(list(message.data)), 1000
        )
        listener.all_matched()

        def back_to_the_start():
            listener.reset()
            listener.until(lambda: listener.states[-1].position[0] == 0.0, "the start, in which nothing moves")

        yield SimpleNamespace(
            folder=folder, process=process, listener=listener, pulls=pulls,
            back_to_the_start=back_to_the_start,
        )  # fmt: skip


@pytest.fixture(scope="module")
def opened(node, chromium):
    address = re.search(r"the lab is at (http://\S+)", node.process.text)
    page = NodePage(chromium, address[1], node.listener)
    page.folder("Efforts")
    return page


def test_play_pause_step_and_reset(node, opened):
    listener = node.listener
    opened.press("Play", lambda: nanoseconds(listener.states[-1].header.stamp) > 2e8, "the run")
    opened.press("Pause", listener.repeats, "the pause")
    paused = listener.until_paused()
    opened.press("Step", lambda: nanoseconds(listener.states[-1].header.stamp) > paused, "a step", first=60.0)
    assert nanoseconds(listener.states[-1].header.stamp) == paused + STEP_NS
    opened.press("Reset", lambda: "reset" in listener.events, "the reset")
    opened.until(lambda: "time of a node is not wound back" in opened.page.content(), "the reason")


def test_keys(node, opened):
    listener, keyboard = node.listener, opened.page.keyboard
    opened.page.evaluate("document.activeElement.blur()")  # no control takes the keys
    opened.press("Pause", listener.repeats, "the pause")
    node.back_to_the_start()
    begun = nanoseconds(listener.states[-1].header.stamp)
    keyboard.press("Space")
    opened.until(lambda: nanoseconds(listener.states[-1].header.stamp) > begun + 2e8, "the run")
    keyboard.press("Space")
    paused = listener.until_paused()
    keyboard.press("ArrowLeft")  # time of a node does not go back
    keyboard.press("ArrowRight")
    opened.until(lambda: nanoseconds(listener.states[-1].header.stamp) == paused + STEP_NS, "one step")
    resets = listener.events.count("reset")
    keyboard.press("Home")
    opened.until(lambda: listener.events.count("reset") == resets + 1, "the reset")


def test_speed_is_the_parameter_of_the_node(node, opened):
    for name, factor in (("1/4", 0.25), ("1", 1.0)):
        opened.select("Speed", name, lambda one=factor: node.listener.parameter("real_time_factor") == one, name)


def test_sliders_are_parameters_and_commands(node, opened):
    opened.enter("d", "0.08", lambda: node.listener.parameter("parameters.d") == 0.08, "the parameter")
    opened.press("Play", lambda: not node.listener.repeats(), "the run")
    opened.enter("pin (N*m)", "0.15", lambda: node.listener.states[-1].effort[0] == 0.15, "the effort")
    opened.enter(
        "spin.effort (N*m)", "0.5", lambda: list(node.listener.states[-1].effort) == [0.15, 0.5], "the command"
    )
    opened.shows("pin (N*m)", 0.15)


def test_an_effort_is_held_as_long_as_a_page_is_open(node, opened):
    """It would expire after three seconds if nobody repeated it."""
    listener = node.listener
    opened.press("Play", lambda: not listener.repeats(), "the run")
    opened.enter("pin (N*m)", "0.15", lambda: listener.states[-1].effort[0] == 0.15, "the effort")
    now = nanoseconds(listener.states[-1].header.stamp)
    opened.until(lambda: nanoseconds(listener.states[-1].header.stamp) > now + 4e9, "4 s of the run")
    assert listener.states[-1].effort[0] == 0.15
    assert not [event for event in listener.events if "expired" in event]


def test_commands_of_others_arrive_on_the_page(node, opened):
    opened.press("Pause", node.listener.repeats, "the pause")
    node.listener.by_name.publish(JointState(name=["pin"], effort=[-0.1]))
    node.listener.set_parameter("parameters.d", 0.03)
    opened.shows("pin (N*m)", -0.1)
    opened.shows("d", 0.03)


def test_a_recording_is_ended_and_begun(node, opened):
    opened.tab("Keep")
    recording = opened.page.get_by_text(re.compile("recording to"))
    recording.wait_for()
    opened.press("End the recording", lambda: not recording.count(), "the end")
    opened.press("Record", recording.count, "the recording", first=60.0)
    assert len(list(node.folder.rglob("*.mcap"))) == 2
    opened.tab("Change")


def test_dragging_a_paused_mechanism_sets_its_state(node, opened):
    opened.press("Pause", node.listener.repeats, "the pause")
    node.back_to_the_start()
    opened.drag(lambda: node.listener.states[-1].position[0] > 0.05, "another position")
    opened.page.mouse.up()
    assert list(node.listener.states[-1].velocity) == [0.0, 0.0]


def test_inverse_kinematics_puts_the_mechanism_of_the_node(node, opened):
    """A search in the process of the page that the node never hears of, or that leaves it running."""
    opened.press("Pause", node.listener.repeats, "the pause")
    node.back_to_the_start()
    opened.tab("Kinematics")
    put = opened.page.get_by_role("button", name="Put it there", exact=True)
    opened.select("Point", "arm.tip", put.count, "the target")
    opened.enter("x, y, z (m)", "2.5", lambda: opened.field("x, y, z (m)").input_value() == "2.5", "its height")
    opened.press(
        "Put it there",
        lambda: abs(node.listener.states[-1].position[0] - math.atan2(2.5, 0.5)) < 1e-6,
        "the nearest position to (0.5, 0, 2.5)",
        first=60.0,
    )
    assert list(node.listener.states[-1].velocity) == [0.0, 0.0]
    opened.page.get_by_text("Not reached:").first.wait_for()
    opened.tab("Change")


def test_pulling_is_a_wrench_that_ends_with_the_page(node, opened):
    """That it is repeated, and ends when the hand lets go, is tested without a browser in session/test_node_session.py."""
    node.back_to_the_start()
    opened.press("Play", lambda: not node.listener.repeats(), "the run")
    opened.drag(lambda: node.pulls and any(node.pulls[-1][:6]), "a wrench")
    opened.enter("pin (N*m)", "0.1", lambda: node.listener.states[-1].effort[0] == 0.1, "an effort")
    opened.page.close()
    opened.until(
        lambda: "commands expired: effort of pin set to zero" in node.listener.events and not any(node.pulls[-1][:6]),
        "the end of what nobody repeats",
    )


@pytest.mark.usefixtures("chromium")  # whose page begins one
def test_the_recordings_are_recomputed(node):
    """That from the start, which a page has ended, and that which the page has begun."""
    stop_recording(node.listener, node.folder)
    for path in node.folder.rglob("*.mcap"):
        node.listener.until(lambda path=path: path.read_bytes().endswith(MAGIC), f"the end of {path.name}")
        assert verified(path).compared
    assert node.process.end() == 0
    assert "Traceback" not in node.process.text
