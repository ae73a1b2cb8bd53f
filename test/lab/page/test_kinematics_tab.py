"""A turn of the drive: what is told agrees with the closed forms of the four-bar linkage."""

import math

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.lab.page.kinematics_tab import NONE, Wanted, analyze
from test.waiting import wait_until

BASE, CRANK, COUPLER, ROCKER = 1.5, 0.5, 1.4, 1.2


def transmission(diagonal):
    """The acute angle between coupler and rocker, by the law of cosines."""
    angle = math.degrees(math.acos((COUPLER**2 + ROCKER**2 - diagonal**2) / (2.0 * COUPLER * ROCKER)))
    return min(angle, 180.0 - angle)


def test_transmission_angles_follow_the_law_of_cosines():
    found = analyze(Wanted(load_mechanism("four_bar"), "crank_pivot", "coupler.tip", 1.0))
    (pin,) = found.transmission
    start = load_mechanism("four_bar").joints["crank_pivot"].position[0]
    turns = start - math.pi + np.radians(found.travel)
    diagonals = np.sqrt(BASE**2 + CRANK**2 - 2.0 * BASE * CRANK * np.cos(turns))
    assert pin == "rocker_pin"
    assert found.transmission[pin] == pytest.approx([transmission(one) for one in diagonals], abs=1e-6)
    assert found.path.shape == (361, 3)


def test_dead_points_of_the_rocker_are_where_crank_and_coupler_are_in_line():
    found = analyze(Wanted(load_mechanism("four_bar"), "rocker_pivot", NONE, 1.0))
    angles = []
    for reach in (COUPLER + CRANK, COUPLER - CRANK):
        angles.append(180.0 - math.degrees(math.acos((BASE**2 + ROCKER**2 - reach**2) / (2.0 * BASE * ROCKER))))
    (line,) = (one for one in found.text.splitlines() if one.startswith("Dead points"))
    for angle in angles:
        assert f"{angle:.4g}"[:5] in line


def test_other_lengths_give_another_path_and_impossible_ones_a_reason():
    longer = with_values(load_mechanism("four_bar"), {"crank": 0.6})
    path = analyze(Wanted(longer, "crank_pivot", "crank.tip", 1.0)).path
    assert np.linalg.norm(path[:, [0, 2]], axis=1) == pytest.approx(np.full(361, 0.6), abs=1e-9)
    assert "there is no part" in analyze(Wanted(longer, "crank_pivot", "no.tip", 1.0)).text


def test_the_page_follows_the_lengths(opened):
    opened.tab("Kinematics")
    tab, scene = opened.lab.page._kinematics, opened.lab.page._scene
    opened.select("Drive", "crank_pivot", tab._drive)
    opened.select("Path of", "coupler.tip", tab._point)
    wait_until(lambda: tab._shown.transmission and len(scene._path.points) == 360, "the analysis")
    opened.page.get_by_text("Transmission angle now").first.wait_for()
    opened.page.get_by_text("Dead points").first.wait_for()
    before = scene._path.points.copy()  # viser changes it in place
    opened.lab.page._preparer.ask("parameters.rocker", 1.3)
    wait_until(lambda: np.any(scene._path.points != before), "the path of the other linkage")
    opened.lab.page._preparer.ask("parameters.rocker", 1.2)
    opened.select("Path of", "none", tab._point)
    wait_until(lambda: not len(scene._path.points), "no path")
    opened.select("Drive", "none", tab._drive)
