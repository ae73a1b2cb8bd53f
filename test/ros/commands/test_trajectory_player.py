"""How goals end: by their tolerances, on the way, at the end, and after it."""

import pytest

from mbd_sim.ros.commands.trajectory import JointMotion
from mbd_sim.ros.commands.trajectory_player import Outcome, Tolerance, TrajectoryGoal

GOAL = TrajectoryGoal(2.0, {"hip": Tolerance(0.1, 0.5)}, {"hip": Tolerance(0.01)}, 0.3)


@pytest.mark.parametrize(
    ("elapsed", "position", "velocity", "outcome"),
    [
        (1.0, 0.09, 0.4, None),
        (1.0, -0.11, 0.0, Outcome.LEFT_PATH),
        (1.0, 0.0, 0.6, Outcome.LEFT_PATH),
        (2.0, 0.005, 9.0, Outcome.SUCCEEDED),  # the velocity is not among the tolerances of the end
        (2.2, 0.02, 0.0, None),
        (2.4, 0.02, 0.0, Outcome.MISSED_GOAL),
        (2.4, -0.005, 0.0, Outcome.SUCCEEDED),
    ],
)
def test_a_goal_ends_by_its_tolerances(elapsed, position, velocity, outcome):
    verdict = GOAL.verdict(elapsed, {"hip": JointMotion(position, velocity)})
    assert (None if verdict is None else verdict.outcome) is outcome


def test_the_verdict_says_how_far_which_joint_is_off():
    verdict = GOAL.verdict(1.0, {"hip": JointMotion(0.2)})
    assert verdict.text == "the position of 'hip' is 0.2 off, more than 0.1, at 1.000 s"
