"""The panels of a prescribed motion: titles, groups and values."""

import numpy as np
import pytest

from mbd_sim.cli.studies.kinematics import CURVES
from mbd_sim.files.load import load_mechanism
from mbd_sim.studies.kinematic_analysis import couplers_and_followers, drive_loads, driven_motion
from mbd_sim.studies.kinematic_analysis.picture import GROUPS, MECHANISM, _places, motion_panels


@pytest.fixture(scope="module")
def motion():
    """A slider-crank, which has angles and a displacement."""
    return driven_motion(load_mechanism("slider_crank"), {"pivot": (0.2, 1.4)}, positions=5, speed=3.0)


def test_each_panel_has_a_title_of_its_own_and_groups_come_in_the_order_in_which_they_are_named(motion):
    loads, pins = drive_loads(motion), couplers_and_followers(motion.mechanism, ["pivot"])
    every = motion_panels(motion, ["coupler.far"], pins, loads)
    titles = [panel.title for panel in every]
    assert len(titles) == len(set(titles)) == 12
    chosen = motion_panels(motion, ["coupler.far"], pins, loads, ["reactions", MECHANISM, "velocities"])
    assert [panel.title for panel in chosen] == ["Forces on joints", "Angular velocities", "Velocities"]
    assert (MECHANISM, *CURVES) == GROUPS


def test_values_are_those_of_the_motion_with_angles_in_degrees(motion):
    angles, displacements = motion_panels(motion, show=["positions"])
    assert angles.unit == "deg" and displacements.unit == "m"
    for panel, factor in ((angles, 180.0 / np.pi), (displacements, 1.0)):
        for name, values in panel.lines.items():
            np.testing.assert_allclose(values, factor * motion.coordinate(name)[0], rtol=1e-15)


@pytest.mark.parametrize(("panels", "rows"), [(1, 2), (2, 2), (3, 3), (6, 4)])
def test_the_mechanism_takes_two_places_beside_the_first_panels(panels, rows):
    places = _places(panels, with_mechanism=True)
    assert places[:2] == [(0, 0), (1, 0)] and len(set(places)) == len(places) == panels + 2
    assert max(row for row, _ in places) == rows - 1
    assert _places(panels, with_mechanism=False)[0] == (0, 0)
