"""A page of the lab in a real browser, as a test uses it."""

import contextlib
import re
import time

import numpy as np
import viser.transforms
from playwright import sync_api

from test.waiting import PATIENCE, wait_until

OPENS = 5000.0  # ms, in which a list opens that the page is not too busy to open
AT_ONCE = 10_000  # ms; what takes longer, the page has replaced meanwhile: it is tried again
LONGEST = 30.0  # s, between two attempts
SIZE = {"width": 760, "height": 420}  # larger ones take a browser without a GPU longer
LARGE = {"width": 900, "height": 440}
# The page computes 6 frames a second, of which nothing is drawn unless `window.drawing` is true.
PAINTLESS = """
window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 160);
window.cancelAnimationFrame = clearTimeout;
for (const name of ["clear", "drawArrays", "drawArraysInstanced", "drawElements", "drawElementsInstanced"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function(...given) { if (window.drawing) draw.apply(this, given); };
}
"""


class AnyPage:
    """A page at an address: the addresses that it asked for, what its console reported, and the files that it downloaded.

    Without a GPU, an open page that moves takes more than a whole processor to draw a few pictures a second, and all
    other tests wait for it. So nothing is drawn: the scene is the same, as are the controls and what the mouse takes
    hold of, which the page computes from the shapes and not from the picture. A test that looks at a picture draws it
    in `drawing`.
    """

    def __init__(self, chromium, url, size=SIZE, ready="Play"):
        self.page, self.requests, self.errors, self.files = chromium.new_page(viewport=size), [], [], []
        self.page.set_default_timeout(1000.0 * PATIENCE)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("download", lambda download: self.files.append(download))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.route(lambda asked: not asked.startswith((url, "blob:", "data:")), lambda route: route.abort())
        self.page.add_init_script(PAINTLESS)
        self.page.goto(url)
        self.page.wait_for_selector("canvas", state="attached")
        self.page.get_by_role("button", name=ready).wait_for()

    @contextlib.contextmanager
    def drawing(self):
        """Draw the scene, for a test that looks at its picture."""
        self.page.evaluate("window.drawing = true")
        yield
        self.page.evaluate("window.drawing = false")

    def pause(self, seconds):
        """Let the page work."""
        self.page.wait_for_timeout(1000.0 * seconds)

    # Clicks are events of their own: a mouse waits for pictures, of which a loaded machine without a GPU draws few. What
    # the page is just drawing may lose a click or a text. `press`, `check`, `select` and `enter` repeat them until they
    # have arrived, each time after twice as long as before, so that what is merely late is not undone.

    def act(self, action, arrived, what, report=lambda: "", first=5.0):
        """Act until this has arrived; `first` is how long to wait before acting again (s)."""
        patience = first

        def again():
            nonlocal patience
            action()
            end, look = time.monotonic() + patience, 0.05
            while not arrived() and time.monotonic() < end:
                self.pause(look)
                look = min(1.5 * look, 1.0)  # some conditions ask a node
            patience = max(first, min(2.0 * patience, LONGEST))

        wait_until(arrived, what, meanwhile=again, report=report)

    def button(self, name):
        self.page.get_by_role("button", name=name, exact=True).first.dispatch_event("click")

    def press(self, name, arrived, what, first=5.0):
        """Click a button until this has arrived; one that has gone was clicked."""
        button = self.page.get_by_role("button", name=name, exact=True)
        self.act(lambda: self.button(name) if button.count() else None, arrived, what, first=first)

    def check(self, label, on, arrived, what):
        """Check a box, or remove its check, until this has arrived."""
        box = self.page.get_by_label(label, exact=True)

        def click():
            if box.is_checked() == on:  # on the page, but it has not been sent
                box.dispatch_event("click")
                self.pause(0.3)
            box.dispatch_event("click")

        self.act(click, arrived, what)

    def tab(self, name):
        """Open a tab."""
        tab = self.page.get_by_role("tab", name=name)
        self.act(lambda: tab.press("Enter"), lambda: tab.get_attribute("aria-selected") == "true", f"the tab {name}")

    def has_tabs_in_one_line(self):
        """Whether all tabs are beside each other, and none is cut off."""
        boxes = [tab.bounding_box() for tab in self.page.get_by_role("tab").all()]
        if None in boxes:  # the page is drawing them
            return False
        ends = [box["x"] + box["width"] for box in boxes]
        return (
            len(boxes) == 6 and len({box["y"] for box in boxes}) == 1 and max(ends) <= self.page.viewport_size["width"]
        )

    def folder(self, name):
        """Open or close a folder."""
        self.page.get_by_text(name, exact=True).last.dispatch_event("click")

    def choose(self, box, option):
        """Try to choose in a list that opens at an element, and may close again or change when the page is drawn."""
        with contextlib.suppress(sync_api.TimeoutError):
            if box.input_value(timeout=AT_ONCE) == option:  # on the page, but it has not been sent
                self._click_option(box, {"has_not_text": re.compile(f"^{re.escape(option)}$")})
                self.pause(0.3)
            self._click_option(box, {"has_text": re.compile(f"^{re.escape(option)}$")})

    def _click_option(self, box, which):
        """Click the first such option of a list that opens at an element."""
        box.press("ArrowDown", timeout=AT_ONCE)
        self.page.get_by_role("option").filter(**which).first.dispatch_event("click", timeout=OPENS)

    def select(self, label, option, arrived, what):
        """Choose in a list until this has arrived: of two changes in a short time, the browser sends the last."""
        box = self.page.get_by_label(label, exact=True).first
        self.act(lambda: self.choose(box, option), arrived, what, first=1.0)

    def field(self, label):
        """The field beside a slider."""
        row = self.page.locator("div", has=self.page.get_by_text(label, exact=True)).last.locator("xpath=..")
        return row.locator("input:not([type=hidden])").last

    def fill(self, field, text):
        """Write into a field, also what it shows but the page has not sent."""
        if field.input_value(timeout=AT_ONCE) == text:
            field.fill("", timeout=AT_ONCE)
        field.fill(text, timeout=AT_ONCE)

    def type(self, label, text):
        """Type a number beside a slider."""
        field = self.field(label)
        with contextlib.suppress(sync_api.TimeoutError):
            self.fill(field, text)
            field.press("Enter", timeout=AT_ONCE)

    def enter(self, label, text, arrived, what, report=lambda: ""):
        """Type a number until it has arrived: a field may be rewritten by the page at the moment of typing."""

        def reported():
            return f"{label} on the page: {self.field(label).input_value()}\n{report()}"

        self.act(lambda: self.type(label, text), arrived, what, reported, first=2.0)

    def downloaded(self, button):
        """The name and the content of the file that a button sends."""
        self.files.clear()
        self.press(button, lambda: self.files, f"the file of {button}", first=60.0)
        return self.files[0].suggested_filename, self.files[0].path().read_bytes()


class BrowserPage(AnyPage):
    """A page of a lab in this process."""

    def __init__(self, chromium, lab, size=SIZE):
        self.lab, known = lab, set(lab.page.server.get_clients())
        # Without a GPU, the picture of the surroundings, which bodies reflect, costs more than all else that is drawn.
        lab.page.server.scene.configure_environment_map(hdri=None)
        super().__init__(chromium, lab.url, size)
        wait_until(lambda: set(lab.page.server.get_clients()) - known, "the connection")
        (self.client,) = set(lab.page.server.get_clients()) - known

    def close(self):
        self.page.close()
        wait_until(lambda: self.client not in self.lab.page.server.get_clients(), "the page to be closed")

    @property
    def frame(self):
        return self.lab.session.frame

    def camera(self):
        return self.lab.page.server.get_clients()[self.client].camera

    def pixel(self, point):
        """Where a point (3,) is on the screen."""
        camera = self.camera()
        rotation = viser.transforms.SO3(np.array(camera.wxyz)).as_matrix()
        x, y, z = rotation.T @ (np.array(point) - camera.position)
        focal = 0.5 * camera.image_height / np.tan(0.5 * camera.fov)
        return 0.5 * camera.image_width + focal * x / z, 0.5 * camera.image_height + focal * y / z

    def drag(self, part, point, right, down, began):
        """Drag a point (3,) of a part over the screen, until something has begun; the button stays down."""
        mouse, moved = self.page.mouse, 0

        def again():
            nonlocal moved
            if moved % 8 == 0:  # the browser may not have drawn the part yet
                mouse.up()
                pose = self.lab.session.bench.simulation.poses()[part]
                x, y = self.pixel(pose.position + pose.rotation @ point)
                self.start = x, y
                mouse.move(x - 2, y)
                self.page.wait_for_timeout(100)
                mouse.move(x, y)
                mouse.down()
            moved += 1
            x, y = self.start
            mouse.move(x + right * (moved % 8) / 8, y + down * (moved % 8) / 8)
            self.page.wait_for_timeout(30)

        wait_until(began, "the drag to begin", meanwhile=again)
