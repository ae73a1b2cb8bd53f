"""Times of `mbd_sim lab` as its user sees them, in Chromium: `python -m benchmarks.lab`.

From the command to the first picture, from a slider to the moved picture, from saving the file to the new picture, and
the load of a core at 60 pictures a second. A picture is one that the browser has composed, and that differs beside the
panel. It needs playwright, a browser and the extra `lab`; without a GPU, the browser itself takes most of the time.
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from PIL import Image

from mbd_sim import load_mechanism
from test.docs import site_browser

SIZE = {"width": 1100, "height": 620}
BESIDE_PANEL = (slice(80, 600), slice(20, 780))  # of a picture: no texts, notices and controls
DIFFERENT, LEAST_PIXELS = 24, 40  # of 256, and how many pixels of a picture must differ
LONGEST = 60.0  # s
PERCENT = 0.05  # by which a length changes


def chain(bodies: int, length: float = 0.1) -> str:
    """A mechanism file of equal rods in a row."""
    part = "shape: {type: rod, to: [l, 0, 0], mass: 0.1}, points: {tip: [l, 0, 0]}"
    parts = "\n".join(f"  b{n}: {{{part}}}" for n in range(bodies))
    joints = "\n".join(
        f"  j{n}: {{type: revolute, between: [{f'b{n - 1}.tip' if n else 'ground'}, b{n}], axis: [0, 1, 0], "
        f"position: {3 if n else 20} deg}}"
        for n in range(bodies)
    )
    return f"mechanism: chain\nparameters: {{l: {length} m}}\nparts:\n{parts}\njoints:\n{joints}\n"


class Watched:
    """A page whose pictures are looked at as the browser composes them."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.shown: NDArray[np.int16] = np.zeros((1, 1, 3), dtype=np.int16)
        self._cast = page.context.new_cdp_session(page)
        self._cast.on("Page.screencastFrame", self._receive)
        self._cast.send("Page.startScreencast", {"format": "jpeg", "quality": 80})

    def _receive(self, event: Any) -> None:
        self._cast.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]})
        image = Image.open(io.BytesIO(base64.b64decode(event["data"]))).convert("RGB")
        self.shown = np.asarray(image, dtype=np.int16)[BESIDE_PANEL]
        self.at = time.perf_counter()

    def settle(self) -> NDArray[np.int16]:
        """The picture as soon as it does not change any more."""
        before, since = self.shown, time.perf_counter()
        while time.perf_counter() - since < 0.5:
            self.page.wait_for_timeout(20)
            if differs(self.shown, before):
                before, since = self.shown, time.perf_counter()
        return self.shown

    def changed(self, before: NDArray[np.int16], began: float) -> float:
        """Seconds from `began` to the first picture that differs."""
        while not differs(self.shown, before):
            if time.perf_counter() - began > LONGEST:
                raise TimeoutError(f"the picture did not change within {LONGEST:g} s")
            self.page.wait_for_timeout(2)
        return self.at - began


def differs(one: NDArray[np.int16], other: NDArray[np.int16]) -> bool:
    """Whether two pictures differ by more than noise."""
    if one.shape != other.shape:
        return True
    return int(np.count_nonzero(np.abs(one - other).max(axis=2) > DIFFERENT)) > LEAST_PIXELS


@contextmanager
def running(file: Path | str, *options: str) -> Iterator[tuple[psutil.Process, str, float]]:
    """A process of `mbd_sim lab`, the address of its page, and when it was started."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "mbd_sim", "lab", str(file), "--port", "0", "--no-open", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        yield psutil.Process(process.pid), next(word for word in line.split() if word.startswith("http")), began
    finally:
        process.terminate()
        process.wait()


def first_picture(browser: Any, rounds: int) -> None:
    """From the command to the address, and to the first picture of the mechanism."""
    addresses, pictures, used_there = [], [], []
    for _ in range(rounds + 1):
        page = browser.new_page(viewport=SIZE)
        page.set_content("<body style='background: white'>")
        watched = Watched(page)
        blank = watched.settle()
        with running("four_bar", "--paused") as (process, url, began):
            addresses.append(time.perf_counter() - began)
            used_there.append(sum(process.cpu_times()[:2]))
            page.goto(url, wait_until="commit")
            pictures.append(watched.changed(blank, began))
        page.close()
    print(f"command to the address          {quantiles(addresses[1:])}", flush=True)  # the first one warms up
    print(f"processor time until then       {quantiles(used_there[1:])}", flush=True)
    print(f"command to the first picture    {quantiles(pictures[1:])}", flush=True)


def slider(browser: Any, count: int) -> None:
    """From a length in a loop that is typed beside its slider to the moved picture, while the mechanism is paused."""
    times = []
    with running("four_bar", "--paused") as (_, url, _), opened(browser, url) as watched:
        field = watched.page.locator("div", has=watched.page.get_by_text("coupler (m)", exact=True)).last
        number = field.locator("xpath=..").locator("input:not([type=hidden])").last
        for turn in range(count):
            before, began = watched.settle(), time.perf_counter()
            number.fill("1.2" if turn % 2 == 0 else "1.4")  # each change of a field counts
            times.append(watched.changed(before, began))
    print(f"slider to the moved picture     {quantiles(times)}", flush=True)


def saving(browser: Any, bodies: int, rounds: int) -> None:
    """From saving a file with another length to the new picture."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        file, length = Path(folder) / "chain.yaml", 0.1
        file.write_text(chain(bodies), encoding="utf-8")
        with running(file, "--paused") as (_, url, _), opened(browser, url) as watched:
            for turn in range(rounds):
                length = 0.1 * (1.0 + PERCENT * (turn + 1) * (-1.0) ** turn)
                before, began = watched.settle(), time.perf_counter()
                file.write_text(chain(bodies, length), encoding="utf-8")
                times.append(watched.changed(before, began))
                watched.page.wait_for_timeout(1500)
    print(f"saving to the picture, {bodies:2d} bodies {quantiles(times)}", flush=True)


def in_the_program(count: int) -> None:
    """The share of the program alone: until a changed length, or a saved file, is in the scene of the server."""
    from mbd_sim.lab.lab import Lab

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "linkage.yaml"
        text = load_mechanism("four_bar").source.text or ""
        file.write_text(text, encoding="utf-8")
        with Lab(load_mechanism(file), port=0, running=False) as lab:
            times = []
            for turn in range(count):
                length, began = (1.2, 1.3, 1.4)[turn % 3], time.perf_counter()
                lab.page._preparer.ask("parameters.coupler", length)
                while lab.session.frame.values["parameters.coupler"] != length:
                    time.sleep(5e-4)
                times.append(time.perf_counter() - began)
                time.sleep(0.02)
    print(f"slider to the frame, no browser {quantiles(times)}", flush=True)
    for bodies in (1, 10, 30):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "chain.yaml"
            file.write_text(chain(bodies), encoding="utf-8")
            with Lab(load_mechanism(file), port=0, running=False) as lab:
                times = []
                for turn in range(max(3, count // 10)):
                    before, began = lab.session.frame.generation, time.perf_counter()
                    file.write_text(chain(bodies, 0.1 + 1e-3 * (turn + 1)), encoding="utf-8")
                    while lab.session.frame.generation == before:
                        time.sleep(1e-3)
                    times.append(time.perf_counter() - began)
                    time.sleep(0.3)
        print(f"saving to the frame, {bodies:2d} bodies  {quantiles(times)}", flush=True)


def load(browser: Any, mechanism: str, seconds: float) -> None:
    """The processor time of the lab for each second, without a page and with one."""
    with running(mechanism) as (process, url, _):
        alone = used(process, seconds)
        with opened(browser, url) as watched:
            watched.page.wait_for_timeout(2000)
            print(
                f"load of a core, {mechanism:16s} {alone:.2f} without a page, "
                f"{used(process, seconds, watched.page.wait_for_timeout):.2f} with one",
                flush=True,
            )


def used(process: psutil.Process, seconds: float, wait: Callable[[float], None] | None = None) -> float:
    """Processor time for each second."""
    before, began = sum(process.cpu_times()[:2]), time.perf_counter()
    (wait or (lambda milliseconds: time.sleep(1e-3 * milliseconds)))(1e3 * seconds)
    return float((sum(process.cpu_times()[:2]) - before) / (time.perf_counter() - began))


@contextmanager
def opened(browser: Any, url: str) -> Iterator[Watched]:
    """A page of the lab that shows its mechanism."""
    page = browser.new_page(viewport=SIZE)
    page.goto(url)
    page.get_by_role("button", name="Play").wait_for()
    page.wait_for_timeout(3000)
    watched = Watched(page)
    watched.settle()
    yield watched
    page.close()


def quantiles(times: list[float]) -> str:
    """The median and the 95 % quantile in s."""
    return f"median {np.median(times):5.2f} s, 95 % {np.quantile(times, 0.95):5.2f} s, of {len(times)}"


def main() -> None:
    """Measure all of it."""
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    rounds, program = options.rounds, site_browser.browser()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(site_browser.FLAGS))
        in_the_program(10 * rounds)
        first_picture(browser, rounds)
        slider(browser, 4 * rounds)
        for bodies in (1, 10, 30):
            saving(browser, bodies, rounds)
        for mechanism in ("four_bar", "six_axis_arm"):
            load(browser, mechanism, 10.0)
        browser.close()
    print(f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
