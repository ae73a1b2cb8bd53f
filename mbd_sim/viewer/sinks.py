"""The destinations of a recording: a viewer's window, a browser, a running viewer, or a file."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, urlsplit

from mbd_sim.errors import MbdSimError
from mbd_sim.viewer import rerun_process

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

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
    raise UnknownSinkError(f"there is no viewer sink '{sink}'. Use {VALID}.{remedy}")


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
            port, web_port = rerun_process.free_port(DATA_PORT), rerun_process.free_port(WEB_PORT)
            self._server = rerun_process.start_server(port, web_port)
            url = _data_url(port)
            address = f"http://{rerun_process.LOOPBACK}:{web_port}/?url={quote(url, safe='')}"
        elif sink == "spawn":
            if not rerun_process.listens(rerun_process.LOOPBACK, DATA_PORT):
                rerun_process.spawn_window(DATA_PORT)
            _full_url(url)
        else:
            address = url = _full_url(sink.partition(":")[2])
        recording.connect_grpc(url, default_blueprint=blueprint)
        return address

    def close(self) -> None:
        """Stop the server that was started for this recording; a window stays open."""
        if self._server is not None:
            rerun_process.stop(self._server)
            self._server = None


def _data_url(port: int) -> str:
    return f"rerun+http://{rerun_process.LOOPBACK}:{port}/proxy"


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
    if not (rerun_process.answers(host, port) if plain else rerun_process.listens(host, port)):
        raise OSError(f"no viewer is listening at {host}:{port}. Start one with 'rerun', or use 'spawn'")
    return url
