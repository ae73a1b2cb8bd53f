"""A page of the lab in a real browser, as a test uses it."""

import numpy as np
import viser.transforms

from test.waiting import PATIENCE, wait_until

SIZE = {"width": 760, "height": 420}  # larger ones take a browser without a GPU longer
LARGE = {"width": 900, "height": 440}


class AnyPage:
    """A page at an address; `requests` are the addresses that it asked for, `errors` what its console reported."""

    def __init__(self, chromium, url, size=SIZE):
        self.page, self.requests, self.errors = chromium.new_page(viewport=size), [], []
        self.page.set_default_timeout(1000.0 * PATIENCE)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.route(lambda asked: not asked.startswith((url, "blob:", "data:")), lambda route: route.abort())
        self.page.goto(url)
        self.page.wait_for_selector("canvas", state="attached")
        self.page.get_by_role("button", name="Play").wait_for()

    def pause(self, seconds):
        """Let the page work."""
        self.page.wait_for_timeout(1000.0 * seconds)

    # Clicks are events of their own: a mouse waits for pictures, of which a loaded machine without a GPU draws few.

    def button(self, name):
        self.page.get_by_role("button", name=name, exact=True).first.dispatch_event("click")

    def check(self, label):
        self.page.get_by_label(label, exact=True).dispatch_event("click")

    def tab(self, name):
        self.page.get_by_role("tab", name=name).press("Enter")

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

    def choose(self, label, option):
        """Choose in a list."""
        self.page.get_by_label(label, exact=True).first.press("ArrowDown")
        self.page.get_by_role("option", name=option, exact=True).dispatch_event("click")

    def field(self, label):
        """The field beside a slider."""
        row = self.page.locator("div", has=self.page.get_by_text(label, exact=True)).last.locator("xpath=..")
        return row.locator("input:not([type=hidden])").last

    def type(self, label, text):
        """Type a number beside a slider."""
        field = self.field(label)
        field.fill(text)
        field.press("Enter")

    def downloaded(self, button):
        """The name and the content of the file that a button sends."""
        with self.page.expect_download() as download:
            self.button(button)
        return download.value.suggested_filename, download.value.path().read_bytes()

    def select(self, label, option, control):
        """Choose in a list until it has arrived: of two changes in a short time, the browser sends the last."""

        def again():
            self.choose(label, option)
            self.page.wait_for_timeout(1000)

        wait_until(lambda: control.value == option, f"the choice of {option}", meanwhile=again)

    def enter(self, label, text, arrived, what, report=lambda: ""):
        """Type a number until it has arrived: a field may be rewritten by the page at the moment of typing."""

        def again():
            self.type(label, text)
            self.pause(1.0)

        wait_until(arrived, what, meanwhile=again, report=report)


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
