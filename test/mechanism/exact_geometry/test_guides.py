"""Loops closed by lines, planes, rods and cables, written with the digits that people write, move as the exact ones."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from test.mechanism.exact_geometry.guided import GUIDED, guided_file, guided_text
from test.mechanism.exact_geometry.test_snapping import freedoms_of, rates_at_start

# Each kind of guide, on axes and beside them, in pairs and within rigid groups.
LOCKED = (
    "slider-crank", "four-bar on a plane", "six-bar", "door in a second bearing", "door on an oblique line",
    "door on an oblique plane", "door on a rod to its axis", "door on a cable", "telescope on its axis", "rod in a rigid group",
    "line in a rigid group", "plane at a ball joint", "wrist on a line",
)  # fmt: skip


@pytest.mark.parametrize(("name", "digits"), [(name, (4, 9)[index % 2]) for index, name in enumerate(LOCKED)])
def test_a_linkage_written_with_few_digits_has_the_freedoms_of_the_exact_one(name, digits):
    """Rounding locked it, kept it open, or left a nearly dependent row to the solver."""
    found, freedoms = guided_file(name, digits, digits)
    assert freedoms_of(found) == freedoms
    assert 0.0 < max(max(move.angle, move.distance) for move in found.moved.values()) < 20.0 * 10.0 ** (1 - digits)


@pytest.mark.parametrize("name", [*GUIDED][1::3])
def test_an_exact_linkage_stays_as_written(name):
    assert not guided_file(name, 3)[0].moved


@pytest.mark.parametrize("name", [*GUIDED][::6])
def test_a_linkage_that_is_kept_as_written_says_so(name):
    """Some loaded with fewer degrees of freedom without a word."""
    (remark,) = guided_file(name, 4, 4, tolerance=0)[0].source.remarks
    assert remark.startswith("tolerance: 0 keeps '") and not guided_file(name, 3, tolerance=0)[0].source.remarks


@pytest.mark.parametrize("name", ["door on a rod", "carriage on a plane"])
def test_it_moves_as_the_exact_one_within_the_digits(name):
    exact, found = (rates_at_start(guided_file(name, 5, digits)[0]) for digits in (17, 6))
    assert found == pytest.approx(exact, abs=3e-4 * np.max(np.abs(exact)))


@pytest.mark.parametrize("name", ["door on a rod", "plane in a rigid group"])
def test_with_tolerance_0_the_error_says_that_digits_may_be_the_cause(name):
    found, _ = guided_file(name, 1, 6, tolerance=0)
    assert not found.moved
    with pytest.raises(MechanismError, match=r"(?s)only just.*more digits"):
        freedoms_of(found)


def test_a_rod_that_is_too_long_for_its_group_is_no_slip_of_digits():
    data = json.loads(guided_text("rod in a rigid group", 2)[0])
    data["constraints"]["k0"]["length"] *= 1.01
    found = parse_mechanism(json.dumps(data))
    assert not found.moved
    with pytest.raises(MechanismError, match="violated by"):
        freedoms_of(found)
