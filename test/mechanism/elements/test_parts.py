"""What is not a mechanism is refused where one is needed, with the call that loads it."""

from pathlib import Path

import pytest

from mbd_sim import Ensemble, InverseDynamics, Kinematics, Simulation, load_mechanism, symbolic_equations
from mbd_sim.mechanism.mechanism import require_mechanism
from mbd_sim.studies.kinematic_analysis import driven_motion
from mbd_sim.studies.optimization import SensitivityModel, casadi_functions
from mbd_sim.studies.synthesis import EffortGoal, synthesize

NEEDING = [
    Simulation, lambda given: Ensemble(given, 2), InverseDynamics, Kinematics, symbolic_equations, casadi_functions,
    SensitivityModel, lambda given: driven_motion(given, {"elbow": (0.0, 1.0)}),
    lambda given: synthesize(given, "elbow", EffortGoal([0.0, 1.0], 1.0), {"l": (0.5, 2.0)}),
]  # fmt: skip


@pytest.mark.parametrize("call", NEEDING)
def test_the_name_of_a_mechanism_is_not_a_mechanism(call):
    with pytest.raises(TypeError, match=r"'double_rod' is not a Mechanism.*load_mechanism\('double_rod'\)"):
        call("double_rod")


def test_a_mechanism_is_one():
    mechanism = load_mechanism("double_rod")
    assert require_mechanism(mechanism) is mechanism
    with pytest.raises(TypeError, match=r"load_mechanism\('a\.yaml'\)"):
        require_mechanism(Path("a.yaml"))
    with pytest.raises(TypeError, match=r"3 is not a Mechanism.*load_mechanism\(…\)"):
        require_mechanism(3)
