"""Couplings whose value depends on coordinates: cams and curves without bodies."""

from __future__ import annotations

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from test.dynamics.test_against_oracles import check

CAM = """
mechanism: cam
tables: {dwell: {period: 2*pi, points: [[0, 0], [1, 0], [2.5, 0.3], [4, 0.3], [5.5, 0]]}}
parts:
  wheel: {mass: 3, inertia: [0.2, 0.2, 0.3]}
  valve: {mass: 1}
  slave: {mass: 2}
joints:
  turn: {type: revolute, between: [ground, wheel], axis: [0, 0, 1], TURN}
  lift: {type: prismatic, between: [ground, valve], axis: [0, 0, 1]}
  slave: {type: prismatic, between: [ground, slave], axis: [1, 0, 0]}
constraints:
  cam: {type: coupling, terms: {lift: 1}, value: "CURVE"}
  pair: {type: coupling, terms: {slave: 2, lift: 1}, value: 0.1*sin(t) + 0.3*lift*slave + 0.02*turn.position}
"""


def cam(curve="0.1*sin(turn) + 0.02*turn**2", turn="position: 0.4, velocity: 5"):
    return CAM.replace("CURVE", curve).replace("TURN", turn)


@pytest.mark.parametrize("turn", ["position: 0.4, velocity: 5", "drive: 0.4 + 2*t + 0.1*sin(3*t)"])
def test_three_derivations_agree(turn):
    assert check(parse_mechanism(cam(turn=turn)), np.random.default_rng(8), states=4)


def test_a_cam_is_integrated_with_its_reduced_inertia():
    """(I + m y'²) φ'' + m y' y'' φ'² = -m g y' for the cam y(φ) alone, and its first integral: the energy."""
    text = cam(turn="position: 0.4, velocity: 5").split("  pair:")[0]
    text = text.replace("  slave: {mass: 2}\n", "").replace(
        "  slave: {type: prismatic, between: [ground, slave], axis: [1, 0, 0]}\n", ""
    )
    sim = Simulation.from_text(text)
    start = sim.energies.total
    sim.run(until=3.0)
    angle, lift = sim.q
    speed, rate = sim.u
    slope = 0.1 * np.cos(angle) + 0.04 * angle
    assert lift == pytest.approx(0.1 * np.sin(angle) + 0.02 * angle**2, abs=1e-13) and rate == pytest.approx(
        slope * speed, abs=1e-12
    )
    assert 0.5 * (0.3 + slope**2) * speed**2 + 9.81 * lift == pytest.approx(start, rel=1e-12)


def test_the_work_of_a_driven_cam_closes_the_account():
    sim = Simulation.from_text(cam(turn="drive: 0.4 + 2*t + 0.1*sin(3*t)"))
    sim.run(until=2.0)
    assert abs(sim.energies.work_drives) > 0.1 and abs(sim.energies.residual) < 1e-11
    table = Simulation.from_text(cam("table(dwell, turn)", "drive: 3*t"))
    table.run(until=2.5)
    assert abs(table.energies.residual) < 1e-3  # the table's curvature jumps at its points
    assert abs(table.q[0] - table.mechanism.constraints[0].value.value({"turn": 7.5})) < 1e-12


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "0.02*turn.position",
            "turn.velocity",
            "'turn.velocity' is a speed, and this expression can depend on coordinates only",
        ),
        ("0.02*turn.position", "turm", "unknown name 'turm'"),
        (
            "terms: {lift: 1}",
            "terms: {lift: 1}, bound: at_least",
            "has a bound and a value that depends on coordinates",
        ),
        ("terms: {lift: 1}", "terms: {lift: 1}, backlash: 0.1", "has backlash and a value that depends on coordinates"),
    ],
)
def test_a_wrong_value_is_refused(old, new, words):
    with pytest.raises(MechanismError) as caught:
        parse_mechanism(cam().replace(old, new))
    assert words in str(caught.value)
