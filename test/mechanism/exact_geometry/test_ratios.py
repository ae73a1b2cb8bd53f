"""Gears, racks and couplings that repeat each other but for the digits of their ratios move as the exact ones."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from test.mechanism.exact_geometry.linkages import rounded
from test.mechanism.exact_geometry.test_snapping import freedoms_of


def ring_text(rng, digits, length=1.0, **more):
    """Wheels, and a rack, that are coupled in a ring by as many relations as there are of them, and a free wheel.

    Each coordinate i is a factor r_i times a common angle plus an offset.
    """
    count = int(rng.integers(3, 6))
    factors, offsets = rng.uniform(0.3, 2.0, count) * rng.choice([-1.0, 1.0], count), rng.uniform(-1.0, 1.0, count)
    factors[0], offsets[0] = 1.0, 0.0
    kinds = ["prismatic" if number == count - 1 else "revolute" for number in range(count)]
    factors[-1], offsets[-1] = factors[-1] * length, offsets[-1] * length
    parts = {f"p{number}": {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]} for number in range(count + 1)}
    joints = {
        f"j{number}": {"type": kind, "between": ["ground", f"p{number}"], "axis": rng.normal(size=3).tolist()}
        for number, kind in enumerate([*kinds, "revolute"])
    }
    joints["j0"]["velocity"] = 1.0
    constraints = {}
    for one in rng.permutation(count).tolist():
        other = (one + 1) % count
        ratio = rounded(float(factors[other] / factors[one]), digits)
        value = rounded(float(offsets[other] - factors[other] / factors[one] * offsets[one]), digits)
        constraints[f"k{one}"] = {"type": "coupling", "terms": {f"j{other}": 1.0, f"j{one}": -ratio}, "value": value}
    data = {"mechanism": "ring", "gravity": [0, 0, 0], "parts": parts, "joints": joints, "constraints": constraints}
    return json.dumps({**data, **more}), factors


@pytest.mark.parametrize(("digits", "length", "seed"), [(4, 1e-6, 0), (12, 1e6, 1), (17, 1.0, 0)])
def test_a_ring_of_couplings_turns_as_the_exact_one(digits, length, seed):
    """Rounded ratios locked it."""
    text, factors = ring_text(np.random.default_rng(seed), digits, length)
    found = parse_mechanism(text)
    assert not (digits == 17 and found.moved)
    assert freedoms_of(found) == 2
    assert all(move.angle < 20.0 * 10.0 ** (1 - digits) for move in found.moved.values())
    assert Kinematics(found).assembled.u[: len(factors)] / factors == pytest.approx(
        1.0, rel=20.0 * 10.0 ** (1 - digits)
    )


def test_gears_and_racks():
    text = """
mechanism: gears
parts: {a: {mass: 1, inertia: [1, 1, 1]}, b: {mass: 1, inertia: [1, 1, 1]}, c: {mass: 1}}
joints:
  ja: {type: revolute, between: [ground, a], axis: [1, 2, 3], velocity: 2}
  jb: {type: revolute, between: [ground, b], axis: [1, 0, 3]}
  jc: {type: prismatic, between: [ground, c], axis: [0, 1, 3]}
constraints:
  gear: {type: gear, joints: [ja, jb], radii: [0.333333, 1]}
  rack: {type: rack, pinion: jb, rack: jc, radius: 0.142857}
  both: {type: rack, pinion: ja, rack: jc, radius: 0.047619, reverse: true}
"""
    assert freedoms_of(parse_mechanism(text)) == 1
    with pytest.raises(MechanismError, match=r"only just.*more digits"):
        freedoms_of(parse_mechanism(text + "tolerance: 0\n"))


@pytest.mark.parametrize("change", [{"terms": {"j1": 1.0, "j0": -0.9}}, {"value": 0.4}])
def test_couplings_that_contradict_each_other_stay_as_written(change):
    data = json.loads(ring_text(np.random.default_rng(1), 17)[0])
    record = data["constraints"]["k0"]
    data["constraints"]["k0"] = {**record, **change}
    found = parse_mechanism(json.dumps(data))
    assert not found.moved
    with pytest.raises(MechanismError):
        freedoms_of(found)


def test_ratios_that_nearly_agree_are_no_slip_of_digits_where_they_move_something():
    """A train that counts turns: its ratios differ by 1 % and a third wheel turns by the difference."""
    text = """
mechanism: counter
parts: {a: {mass: 1, inertia: [1, 1, 1]}, b: {mass: 1, inertia: [1, 1, 1]}, c: {mass: 1, inertia: [1, 1, 1]}}
joints:
  ja: {type: revolute, between: [ground, a], axis: [1, 2, 3]}
  jb: {type: revolute, between: [ground, b], axis: [1, 0, 3]}
  jc: {type: revolute, between: [ground, c], axis: [0, 1, 3]}
constraints:
  one: {type: coupling, terms: {ja: 1, jb: -1}}
  other: {type: coupling, terms: {ja: 1, jb: -1.0001, jc: 0.0001}}
"""
    found = parse_mechanism(text)
    assert not found.moved
    assert freedoms_of(found) == 1
