"""`mbd_sim lab` on the command line."""

import socket
from types import SimpleNamespace

import pytest

from mbd_sim.cli.main import main
from mbd_sim.cli.shared import page_options


def test_another_port_than_the_one_asked_for_is_said(monkeypatch, capsys):
    pytest.importorskip("viser")
    monkeypatch.setattr(page_options, "threading", SimpleNamespace(Event=lambda: SimpleNamespace(wait=lambda: None)))
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert main(["lab", "four_bar", "--port", str(port), "--no-open", "--paused"]) == 0
    taken, address = capsys.readouterr().out.splitlines()
    assert taken == f"Port {port} is taken by another program, so another one is used."
    assert f":{port}/" not in address
    assert main(["lab", "four_bar", "--port", "0", "--no-open", "--paused"]) == 0
    assert "taken" not in capsys.readouterr().out
