"""The destinations of a recording: a viewer's window, a browser, a running viewer, or a file.

For a window or a browser, Rerun's own program is started so that it listens on this machine only.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING
from urllib.parse import quote, urlsplit

from mbd_sim.base.errors import MbdSimError

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint


LOOPBACK = "127.0.0.1"
START_TIMEOUT = 20.0  # s


def executable() -> str:
    """The path of Rerun's program: the one in the Python package, or one on the PATH.

    :raises OSError: there is none.
    """
    package = importlib.util.find_spec("rerun_cli")
    bundled = [Path(location) / "rerun" for location in (package.submodule_search_locations or [])] if package else []
    candidates = [os.environ.get("RERUN_CLI_PATH"), *bundled, shutil.which("rerun")]
    for candidate in candidates:
        if candidate and Path(candidate).is_file():
            return str(candidate)
    raise OSError("the program 'rerun' is not installed. Install it with: pip install rerun-sdk")


def _start(arguments: list[str], log: IO[bytes]) -> subprocess.Popen[bytes]:
    """Start Rerun's program in its own session: Ctrl-C in the terminal reaches the node, which then ends it."""
    command = [executable(), *arguments]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)  # noqa: S603


def start_server(port: int, web_port: int) -> subprocess.Popen[bytes]:
    """Start a server for data on `port` and for browsers on `web_port`; it runs until it is stopped.

    :raises OSError: it does not start.
    """
    arguments = ["--serve-web", "--bind", LOOPBACK, "--port", str(port), "--web-viewer-port", str(web_port)]
    with tempfile.TemporaryFile() as log:
        server = _start(arguments, log)
        deadline = time.monotonic() + START_TIMEOUT
        while not (listens(LOOPBACK, port) and listens(LOOPBACK, web_port)):
            if server.poll() is not None or time.monotonic() > deadline:
                server.kill()
                server.wait()
                log.seek(0)
                raise OSError(f"Rerun's server did not start: {_last_line(log.read())}")
            time.sleep(0.02)
    return server


def spawn_window(port: int) -> None:
    """Open a window that takes data on `port` and stays open when this process ends.

    :raises OSError: it does not open, or there is no display to open it on.
    """
    if sys.platform == "linux" and not any(os.environ.get(key) for key in ("DISPLAY", "WAYLAND_DISPLAY")):
        raise OSError("there is no display to open a window on. Use 'serve' for a browser, or a path ending in '.rrd'")
    arguments = ["--bind", LOOPBACK, "--port", str(port), "--expect-data-soon", "--detach-process"]
    done = subprocess.run(  # noqa: S603  (own arguments)
        [executable(), *arguments], stdin=subprocess.DEVNULL, capture_output=True, check=False, timeout=START_TIMEOUT
    )
    if done.returncode != 0:
        raise OSError(f"Rerun's window did not open: {_last_line(done.stderr)}")
    deadline = time.monotonic() + START_TIMEOUT
    while not listens(LOOPBACK, port):
        if time.monotonic() > deadline:
            raise OSError(f"Rerun's window does not accept data on port {port}")
        time.sleep(0.02)


def stop(server: subprocess.Popen[bytes]) -> None:
    """Stop a server."""
    server.terminate()
    try:
        server.wait(5.0)
    except subprocess.TimeoutExpired:
        server.kill()
        server.wait()


def listens(host: str, port: int, timeout: float = 2.0) -> bool:
    """Whether something accepts connections at this address."""
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError:
        return False
    return True


def answers(host: str, port: int, timeout: float = 3.0) -> bool:
    """Whether the program that listens there speaks HTTP, as viewers do; Rerun would wait forever for anything else."""
    try:
        with socket.create_connection((host, port), timeout) as connection:
            connection.settimeout(timeout)
            connection.sendall(f"GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
            return connection.recv(5) == b"HTTP/"
    except OSError:
        return False


def free_port(preferred: int) -> int:
    """The preferred port on the loopback interface if it is free, otherwise another one.

    :raises OSError: no port is free.
    """
    for port in (preferred, 0):
        with socket.socket() as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(trial.getsockname()[1])
    raise OSError(f"no port is free on {LOOPBACK}")


def _last_line(output: bytes) -> str:
    lines = output.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "it printed no message"


DATA_PORT, WEB_PORT = 9876, 9090  # Rerun's own defaults
VALID = (
    "'spawn' (opens a window), 'serve' (for a browser on this machine), 'connect' or 'connect:<url>' "
    "(a running viewer), or a path ending in '.rrd' (a file)"
)


class ViewerError(MbdSimError):
    """The viewer cannot be started, reached or written to."""


class UnknownSinkError(ViewerError, ValueError):
    """There is no such sink."""


def checked_sink(sink: str) -> str:
    """The sink, if it is one.

    :raises UnknownSinkError: there is no such sink; the message lists those that exist.
    """
    if sink in ("spawn", "serve", "connect") or sink.endswith(".rrd") or sink.partition("connect:")[2]:
        return sink
    remedy = f" To write a file, use '{sink}.rrd'." if sink and ":" not in sink else ""
    raise UnknownSinkError(f"there is no viewer sink '{sink}'", f"Use {VALID}.{remedy}")


def is_live(sink: str) -> bool:
    """Whether somebody watches while the data arrive: true for all sinks but files."""
    return not sink.endswith(".rrd")


class SinkConnection:
    """The connection of a recording to its sink. `address` is where to view it: a URL, or the path of the file.

    :raises ViewerError: the sink cannot be opened.
    """

    def __init__(self, recording: RecordingStream, sink: str, blueprint: Blueprint, *, footer: bool = True) -> None:
        """Open the sink.

        :param footer: write a list of all chunks at the end of a file; it is kept in memory until then.
        """
        self._server: subprocess.Popen[bytes] | None = None
        try:
            self.address = self._open(recording, sink, blueprint, footer)
        except (OSError, RuntimeError, subprocess.SubprocessError) as error:
            self.close()
            raise ViewerError(f"the viewer sink '{sink}' cannot be opened: {error}") from error

    def _open(self, recording: RecordingStream, sink: str, blueprint: Blueprint, footer: bool) -> str:
        if not is_live(sink):
            recording.save(sink, default_blueprint=blueprint, write_footer=footer)
            return str(Path(sink).resolve())
        address = url = _data_url(DATA_PORT)
        if sink == "serve":
            # RecordingStream.serve_grpc listens on all network interfaces (rerun 0.41); Rerun's program need not.
            port, web_port = free_port(DATA_PORT), free_port(WEB_PORT)
            self._server = start_server(port, web_port)
            url = _data_url(port)
            address = f"http://{LOOPBACK}:{web_port}/?url={quote(url, safe='')}"
        elif sink == "spawn":
            if not listens(LOOPBACK, DATA_PORT):
                spawn_window(DATA_PORT)
            _full_url(url)
        else:
            address = url = _full_url(sink.partition(":")[2])
        recording.connect_grpc(url, default_blueprint=blueprint)
        return address

    def close(self) -> None:
        """Stop the server that was started for this recording; a window stays open."""
        if self._server is not None:
            stop(self._server)
            self._server = None


def _data_url(port: int) -> str:
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def _full_url(url: str) -> str:
    """The URL of a running viewer; `host:port` is enough.

    :raises OSError: nothing listens there.
    """
    if not url:
        url = _data_url(DATA_PORT)
    elif "://" not in url:
        url = f"rerun+http://{url.rstrip('/')}/proxy"
    parsed = urlsplit(url)
    try:
        host, port = parsed.hostname or "", parsed.port or DATA_PORT
    except ValueError as error:
        raise OSError(f"{error} in '{url}'") from error
    plain = parsed.scheme == "rerun+http"
    if not (answers(host, port) if plain else listens(host, port)):
        raise OSError(f"no viewer is listening at {host}:{port}. Start one with 'rerun', or use 'spawn'")
    return url
