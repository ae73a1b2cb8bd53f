"""A turn of the drive: what is told agrees with the closed forms of the four-bar linkage."""

import math
from functools import partial

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.lab.page.kinematics_tab import NONE, Wanted, _as_markdown, analyze, coupler_point
from mbd_sim.studies.kinematic_analysis import motion
from test.waiting import wait_until

BASE, CRANK, COUPLER, ROCKER = 1.5, 0.5, 1.4, 1.2


def transmission(diagonal):
    """The acute angle between coupler and rocker, by the law of cosines."""
    angle = math.degrees(math.acos((COUPLER**2 + ROCKER**2 - diagonal**2) / (2.0 * COUPLER * ROCKER)))
    return min(angle, 180.0 - angle)


@pytest.fixture
def coarse(monkeypatch):
    """A turn has 37 positions in place of 361."""
    monkeypatch.setattr(motion, "driven_motion", partial(motion.driven_motion, positions=37))


@pytest.mark.usefixtures("coarse")
def test_transmission_angles_follow_the_law_of_cosines_and_the_path_is_a_true_coupler_curve():
    """The curve is no arc about one of the pivots, unlike the paths of all other points of the linkage."""
    found = analyze(Wanted(load_mechanism("four_bar"), "crank_pivot", "coupler.P", 1.0))
    (pin,) = found.transmission
    start = load_mechanism("four_bar").joints["crank_pivot"].position[0]
    turns = start - math.pi + np.radians(found.travel)
    diagonals = np.sqrt(BASE**2 + CRANK**2 - 2.0 * BASE * CRANK * np.cos(turns))
    assert pin == "rocker_pin"
    assert found.transmission[pin] == pytest.approx([transmission(one) for one in diagonals], abs=1e-6)
    assert found.path.shape == (37, 3)
    for pivot in ((0.0, 0.0), (BASE, 0.0)):
        assert np.ptp(np.linalg.norm(found.path[:, [0, 2]] - pivot, axis=1)) > 0.3


@pytest.mark.usefixtures("coarse")
def test_dead_points_of_the_rocker_are_where_crank_and_coupler_are_in_line():
    found = analyze(Wanted(load_mechanism("four_bar"), "rocker_pivot", NONE, 1.0))
    angles = []
    for reach in (COUPLER + CRANK, COUPLER - CRANK):
        angles.append(180.0 - math.degrees(math.acos((BASE**2 + ROCKER**2 - reach**2) / (2.0 * BASE * ROCKER))))
    (line,) = (one for one in found.text.splitlines() if one.startswith("Dead points"))
    for angle in angles:
        assert f"{angle:.4g}"[:5] in line


@pytest.mark.usefixtures("coarse")
def test_other_lengths_give_another_path_and_impossible_ones_a_reason():
    longer = with_values(load_mechanism("four_bar"), {"crank": 0.6})
    path = analyze(Wanted(longer, "crank_pivot", "crank.tip", 1.0)).path
    assert np.linalg.norm(path[:, [0, 2]], axis=1) == pytest.approx(np.full(37, 0.6), abs=1e-9)
    assert "there is no part" in analyze(Wanted(load_mechanism("rod_pendulum"), "pin", "no.tip", 1.0)).text


@pytest.mark.parametrize(
    ("name", "point"),
    [("four_bar", "coupler.P"), ("double_rod", "lower.tip"), ("bounce", NONE), ("slider_crank", NONE)],
)
def test_the_point_that_is_offered_has_a_curve_of_its_own(name, point):
    assert coupler_point(load_mechanism(name)) == point


def test_the_panel_rounds_angles_to_a_tenth_of_a_degree():
    line = "Transmission angle  rocker_pin: from 44.4153 deg at crank_pivot = 0 deg to 90 deg at slide = 0.123456 m"
    shown = _as_markdown(line)
    assert shown.startswith("**Transmission angle** rocker_pin: from 44.4 deg at crank_pivot = 0 deg")
    assert shown.endswith("0.123456 m")


@pytest.mark.usefixtures("coarse")
def test_the_page_follows_the_lengths(opened):
    opened.tab("Kinematics")
    tab, scene = opened.lab.page._kinematics, opened.lab.page._scene
    opened.select("Drive", "crank_pivot", lambda: tab._drive.value == "crank_pivot", "the drive")
    wait_until(lambda: tab._point.value == "coupler.P", "the point that is offered")
    opened.select("Path of", "coupler.tip", lambda: tab._point.value == "coupler.tip", "the point")
    wait_until(lambda: tab._shown.transmission and len(scene._path.points) == 36, "the analysis")
    opened.page.get_by_text("Transmission angle now").first.wait_for()
    opened.page.get_by_text("Dead points").first.wait_for()
    before = scene._path.points.copy()  # viser changes it in place
    opened.lab.page._preparer.ask("parameters.rocker", 1.3)
    wait_until(lambda: np.any(scene._path.points != before), "the path of the other linkage")
    opened.press("Keep this curve", lambda: scene._kept, "a kept curve", first=60.0)
    assert [label for _, label in scene._kept] == ["rocker = 1.3 m"]
    wait_until(lambda: np.array_equal(scene._kept_paths.points, scene._path.points), "the kept curve in the scene")
    opened.press("Clear the kept curves", lambda: not len(scene._kept_paths.points), "no kept curve")
    opened.lab.page._preparer.ask("parameters.rocker", 1.2)
    opened.select("Path of", "none", lambda: not len(scene._path.points), "no path")
    opened.select("Drive", "none", lambda: tab._drive.value == "none", "no drive")
