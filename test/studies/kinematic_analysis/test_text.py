"""The report on a prescribed motion."""

import numpy as np

from mbd_sim.files.load import parse_mechanism
from mbd_sim.studies.kinematic_analysis import drive_loads, driven_motion
from mbd_sim.studies.kinematic_analysis.text import motion_text

PUNCH = """mechanism: punch
parts: {ram: {mass: 2}}
joints: {slide: {type: prismatic, between: [ground, ram], axis: [1, 0, 0]}}
forces: {sheet: {type: effort, coordinate: slide, effort: FORCE}}
"""


def text_of(force, positions):
    motion = driven_motion(parse_mechanism(PUNCH.replace("FORCE", force)), {"slide": (0.0, 0.1)}, positions)
    return motion_text(motion, (), (), drive_loads(motion))


def test_an_effort_that_jumps_between_two_positions_is_remarked():
    for positions in (5, 41):
        text = text_of('"where(slide > 0.081, -800, 0)"', positions)
        edges = np.linspace(0.0, 0.1, positions)
        below, above = edges[edges < 0.081][-1], edges[edges > 0.081][0]
        assert f"changes by 800 N between slide = {below:.6g} m and {above:.6g} m" in text


def test_an_effort_that_changes_gradually_is_not_remarked_if_there_are_enough_positions():
    wave = "100*sin(60*slide)"
    assert "take more positions than 5," in text_of(wave, 5)
    assert "changes by" not in text_of(wave, 41)
    assert "changes by" not in text_of("-7", 5)
