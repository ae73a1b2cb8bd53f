"""What the node's parameters mean for the mechanisms that ship."""

import re

import pytest

from mbd_sim import Simulation
from mbd_sim.files.checks.override import matching
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped
from mbd_sim.ros.node.sim_parameters import PARAMETERS
from mbd_sim.simulation.model.live_values import LiveValues, names_with_matches
from test.generators.shipped_features import mechanisms_with_all_features
from test.recordings.runs import stepped_node
from test.system.nodes import as_in_the_node

LIVE = next(declared.default for declared in PARAMETERS if declared.name == "live").split(", ")


def test_the_default_live_values_of_shipped_mechanisms_meet_no_parameter_of_the_node():
    own = {declared.name for declared in PARAMETERS}
    for name in shipped():
        assert not own & {re.sub(r"\[\d+\]$", "", key) for key in matching(load_mechanism(name), LIVE)}


def test_gravity_is_among_the_default_live_values_unless_nothing_depends_on_it():
    for name in mechanisms_with_all_features(most_joints=6):
        mechanism = load_mechanism(name)
        found = LiveValues(mechanism, names_with_matches(mechanism, LIVE)).current
        assert found.keys() <= set(matching(load_mechanism(name), LIVE))
        axes = {f"gravity[{axis}]" for axis in range(3)}
        assert axes <= found.keys() or not axes & found.keys(), name


def test_every_parameter_says_what_it_means():
    assert all(len(declared.description) > 10 for declared in PARAMETERS)
    assert len({declared.name for declared in PARAMETERS}) == len(PARAMETERS)


@pytest.mark.parametrize("mechanism", ["double_rod", "four_bar", "six_axis_servo_arm"])
def test_without_wrenches_and_live_values_a_node_has_the_bits_of_a_plain_simulation(tmp_path, mechanism):
    """With them it has those of a simulation with the same options: what is an input is not folded into constants."""
    for options, simulation in (
        ({"wrenches": "''", "live": "''"}, Simulation.from_file(mechanism)),
        ({}, as_in_the_node(mechanism)),
    ):
        with stepped_node(tmp_path, mechanism, record=False, **options) as node:
            node.stepping_thread.step(300)
            simulation.step(300)
            assert node.simulation.state.tobytes() == simulation.state.tobytes()
