"""The destinations of recordings, and the errors when they cannot be opened."""

import socket
import urllib.request
from pathlib import Path

import pytest

from mbd_sim import Simulation
from mbd_sim.pictures.rerun import Viewer, ViewerError, sinks
from mbd_sim.pictures.rerun.sinks import SinkConnection
from test.waiting import PATIENCE


@pytest.fixture(scope="module")
def model():
    return Simulation.from_file("rod_pendulum").model


@pytest.fixture
def closed_port():
    with socket.socket() as taken:
        taken.bind((sinks.LOOPBACK, 0))
        yield taken.getsockname()[1]


def listeners(port):
    """The local addresses on which a port is open, as the kernel writes them."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            _, local, _, state, *_ = line.split()
            address, at = local.split(":")
            if state == "0A" and int(at, 16) == port:
                found.add(address)
    return found


def opened(sink):
    import rerun as rr
    import rerun.blueprint as rrb

    return SinkConnection(rr.RecordingStream("test_sinks"), sink, rrb.Blueprint())


@pytest.mark.parametrize("sink", ["", "window", "connect:", "run", "out/run.mcap"])
def test_the_error_for_an_unknown_sink_lists_the_valid_ones(model, sink):
    with pytest.raises(ValueError, match="no viewer sink") as caught:
        Viewer(model, sink)
    assert all(word in str(caught.value) for word in ("'spawn'", "'serve'", "'connect'", "'connect:<url>'", "'.rrd'"))


def test_the_error_for_a_plain_name_suggests_a_file_name(model):
    with pytest.raises(ValueError, match=r"To write a file, use 'run\.rrd'"):
        Viewer(model, "run")


def test_a_file_in_a_missing_folder(model, tmp_path):
    with pytest.raises(ViewerError, match="No such file or directory"):
        Viewer(model, str(tmp_path / "missing" / "run.rrd"))


def test_connecting_where_nothing_listens(closed_port):
    with pytest.raises(ViewerError, match=f"no viewer is listening at 127.0.0.1:{closed_port}"):
        opened(f"connect:rerun+http://127.0.0.1:{closed_port}/proxy")


def test_connecting_to_a_program_that_is_not_a_viewer():
    with socket.create_server((sinks.LOOPBACK, 0)) as mute:
        port = mute.getsockname()[1]
        with pytest.raises(ViewerError, match="no viewer is listening"):
            opened(f"connect:127.0.0.1:{port}")


@pytest.mark.parametrize("url", ["http://127.0.0.1:1", "rerun+http://127.0.0.1:port/proxy", "nonsense://"])
def test_connecting_to_an_invalid_url(url):
    with pytest.raises(ViewerError, match="cannot be opened"):
        opened(f"connect:{url}")


def test_no_window_without_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(OSError, match="no display"):
        sinks.spawn_window(sinks.free_port(0))


def test_no_program_to_start(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("RERUN_CLI_PATH", raising=False)
    monkeypatch.setattr(sinks.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(OSError, match="pip install rerun-sdk"):
        sinks.executable()


def test_without_rerun(model, monkeypatch):
    monkeypatch.setattr(sinks.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ViewerError, match="pip install rerun-sdk"):
        Viewer(model, "serve")


def test_the_server_listens_on_this_machine_only_and_accepts_another_viewers_data():
    sim = Simulation.from_file("rod_pendulum")
    viewer = Viewer(sim.model, "serve")
    web = urllib.parse.urlsplit(viewer.address)
    data = urllib.parse.urlsplit(urllib.parse.parse_qs(web.query)["url"][0])
    try:
        assert listeners(web.port) == {"0100007F"}
        assert listeners(data.port) == {"0100007F"}
        with urllib.request.urlopen(viewer.address, timeout=PATIENCE) as page:
            assert b"rerun" in page.read().lower()
        with Viewer(sim.model, f"connect:{data.hostname}:{data.port}") as second:
            second.offer(sim.time, sim.state, sim.inputs.copy(), sim.energies)
        assert second.failure is None
    finally:
        viewer.close()
    assert viewer.failure is None
    assert not listeners(web.port)
    assert not listeners(data.port)
