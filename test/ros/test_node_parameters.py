"""What the node's parameters mean for the mechanisms that ship."""

import re

from mbd_sim.load import load_mechanism
from mbd_sim.mechanism_file.library import shipped
from mbd_sim.mechanism_file.override import matching
from mbd_sim.ros.sim_parameters import PARAMETERS
from mbd_sim.simulation.live_search import names_with_matches
from mbd_sim.simulation.live_values import LiveValues
from test.generators.shipped_features import mechanisms_with_all_features

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
