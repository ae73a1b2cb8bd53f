"""The comparison of MJCF models with MuJoCo, and of shipped mechanisms with its readers."""

import sys
from pathlib import Path

import gymnasium
import pytest

pytest.importorskip("mujoco", reason="needs MuJoCo: pip install '.[test]'")

from benchmarks import exchange_formats

REACHER = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets" / "reacher.xml"


def test_models_are_compared(tmp_path, monkeypatch, capsys):
    (tmp_path / "empty.xml").write_text("<mujoco/>")
    monkeypatch.setattr(sys, "argv", ["exchange_formats", str(REACHER), str(tmp_path / "empty.xml")])
    exchange_formats.main()
    reacher, empty = capsys.readouterr().out.splitlines()
    assert float(reacher.split()[1]) < 1e-12
    assert "refused" in empty and "has no <body>" in empty


def test_shipped_mechanisms_are_read(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["exchange_formats"])
    monkeypatch.setattr(exchange_formats, "shipped", lambda: ["double_rod", "four_bar"])
    exchange_formats.main()
    rod, linkage = capsys.readouterr().out.splitlines()
    assert "MuJoCo: 2 speeds  mbd_sim: 2 speeds" in rod
    assert "MuJoCo: 3 speeds  mbd_sim: 3 speeds" in linkage
