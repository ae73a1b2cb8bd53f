"""Opens the pages of a built site in a real browser, each in a frame as wide as a phone, and returns what it found.

The site is served on this machine, with a script in each page that reports its errors; another page loads the pages one after the
other and sends the findings to the server. This needs no package that drives browsers.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import threading
import time
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
WIDTH = 390  # of the frame, in CSS pixels
OPTIONS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--in-process-gpu", "--single-process", "--no-zygote", "--no-first-run",
    "--disable-dev-shm-usage", "--disable-background-networking", "--disable-component-update",
)  # fmt: skip
FLAGS = (  # with which a browser without a GPU draws in three dimensions, and only that as a GPU would
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-webgl",
    "--ignore-gpu-blocklist", "--disable-gpu-compositing", "--disable-gpu-rasterization",
)  # fmt: skip
REPORTER = b"""<script>window.failures = [];
addEventListener("error", e => failures.push(e.message || "not loaded: " + (e.target.src || e.target.href)), true);
addEventListener("unhandledrejection", e => failures.push(String(e.reason)));</script>"""
DRIVER = """<!DOCTYPE html><body><script>
const pause = ms => new Promise(done => setTimeout(done, ms));
async function visit(page) {
  const frame = document.createElement("iframe");
  frame.style = "width: WIDTHpx; height: 800px";
  const loaded = new Promise(done => frame.onload = done);
  frame.src = page;
  document.body.append(frame);
  await loaded;
  const view = frame.contentWindow, root = view.document.documentElement;
  if (view.MathJax?.startup?.promise) await view.MathJax.startup.promise;
  if (page.includes("?q=")) for (let i = 0; i < 100 && view.document.querySelectorAll("ul.search li").length < 4; i++) await pause(50);
  const found = {failures: view.failures, overflow: root.scrollWidth - view.innerWidth, title: view.document.title,
    hits: view.document.querySelectorAll("ul.search li").length, formulas: view.document.querySelectorAll("mjx-container").length,
    wrong_formulas: view.document.querySelectorAll("mjx-merror, [data-mjx-error]").length,
    unloaded: [...view.document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src)};
  frame.remove();
  return found;
}
(async () => {
  const found = {};
  for (const page of PAGES) found[page] = await visit(page);
  await fetch("/found", {method: "POST", body: JSON.stringify(found)});
})();
</script></body>"""


def browser():
    """The path of a browser: that in MBD_SIM_TEST_BROWSER, or one on the PATH; None if there is none."""
    return os.environ.get("MBD_SIM_TEST_BROWSER") or next(filter(None, map(shutil.which, PROGRAMS)), None)


class _Handler(SimpleHTTPRequestHandler):
    def do_GET(self):
        path = Path(self.translate_path(self.path))
        if self.path == "/driver":
            self._send(self.server.driver)
        elif path.suffix == ".html" and path.exists():
            self._send(path.read_bytes().replace(b"<head>", b"<head>" + REPORTER, 1))
        else:
            super().do_GET()

    def do_POST(self):
        self.server.found = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self._send(b"")
        self.server.finished.set()

    def _send(self, content):
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_):
        pass


def visited(program, site, pages, profile, timeout=120):
    """What the browser found on each page; None if it did not finish. One that crashes is started again, twice at most."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, directory=str(site))) as server:
        server.driver = DRIVER.replace("WIDTH", str(WIDTH)).replace("PAGES", json.dumps(pages)).encode()
        server.found, server.finished = None, threading.Event()
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/driver"
        for attempt in range(3):
            if _opened(program, address, profile / str(attempt), server.finished, timeout):
                break
        server.shutdown()
        return server.found


def _opened(program, address, profile, finished, timeout):
    """Open a page until it says that it has finished; false if the browser ends before."""
    profile.mkdir()
    command = [program, *OPTIONS, f"--user-data-dir={profile}", "--remote-debugging-port=0", address]
    with (profile / "output").open("wb") as output:
        process = subprocess.Popen(command, stdout=output, stderr=output, start_new_session=True)
        try:
            end = time.monotonic() + timeout
            while not finished.wait(0.2) and time.monotonic() < end:
                if process.poll() is not None:
                    return False
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return True
