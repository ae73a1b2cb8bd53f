"""`mbd_sim check --inertia` against worked examples (Huston & Liu, ch. 7)."""

import json

import numpy as np
import pytest

from mbd_sim.cli.main import main

# Particles of 2, 3 and 4 kg at (1, 1, 1), (2, 2, 4) and (0, 5, 2) m: sums written out by hand.
PARTICLES = """
mechanism: particles
gravity: [0, 0, 0]
parts:
  three:
    shapes:
      - {type: particle, mass: 2, at: [1, 1, 1]}
      - {type: particle, mass: 3, at: [2, 2, 4]}
      - {type: particle, mass: 4, at: [0, 5, 2]}
  frame: {mass: 0}
  block: {mass: 12, shape: {type: block, size: [2, 4, 3]}}
joints:
  a: {type: free, between: [ground, three]}
  b: {type: fixed, between: [three, frame]}
  c: {type: fixed, between: [frame, block]}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "particles.yaml"
    path.write_text(PARTICLES, encoding="utf-8")
    return str(path)


def reported(capsys, *arguments):
    assert main(["check", *arguments]) == 0
    return capsys.readouterr().out


def test_the_records_hold_the_worked_numbers(file, capsys):
    three, block, whole = json.loads(reported(capsys, file, "--inertia", "--json"))["inertia"]
    assert three["mass"] == 9.0
    assert three["center"] == pytest.approx([8 / 9, 28 / 9, 22 / 9], rel=1e-15)
    # I_xx = 2 (1+1) + 3 (4+16) + 4 (25+4), I_yy = 2 (1+1) + 3 (4+16) + 4 (0+4), I_zz = 2 (1+1) + 3 (4+4) + 4 (0+25);
    # I_xy = -(2 + 3·4 + 0), I_xz = -(2 + 3·8 + 0), I_yz = -(2 + 3·8 + 4·10)
    origin = np.array([[180.0, -14.0, -26.0], [-14.0, 80.0, -66.0], [-26.0, -66.0, 128.0]])
    assert np.array(three["inertia_at_origin"]) == pytest.approx(origin, rel=1e-14)
    assert block["principal_moments"] == pytest.approx([12 * (4 + 9) / 12, 12 * (4 + 16) / 12, 12 * (16 + 9) / 12])
    assert np.abs(block["principal_axes"]) == pytest.approx(np.eye(3)[[1, 2, 0]])
    assert whole["mass"] == 21.0
    assert whole["center"] == pytest.approx(np.array([8, 28, 22]) / 21)
    together = origin + np.diag([25.0, 13.0, 20.0])
    assert np.array(whole["inertia_at_origin"]) == pytest.approx(together, rel=1e-13)
    for record in (three, block, whole):
        axes, inertia = np.array(record["principal_axes"]), np.array(record["inertia"])
        assert axes @ inertia @ axes.T == pytest.approx(np.diag(record["principal_moments"]), abs=1e-12)


def test_the_text_names_parts_and_frames(file, capsys):
    text = reported(capsys, file, "--inertia")
    assert "three: 9 kg, center of mass [0.888889, 3.11111, 2.44444] m, in the frame of the part" in text
    assert "whole mechanism: 21 kg" in text
    assert "principal moment 13 kg·m² about [0, 1, 0]" in text
    assert "frame:" not in text
