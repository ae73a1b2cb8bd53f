"""What the node's parameters mean for the mechanisms that ship."""

import re

from mbd_sim.load import load_mechanism
from mbd_sim.mechanism_file.library import shipped
from mbd_sim.ros.sim_parameters import PARAMETERS
from mbd_sim.simulation.live_values import LiveValues


def test_the_default_live_values_exist_in_every_shipped_mechanism_and_meet_no_parameter_of_the_node():
    own = {declared.name for declared in PARAMETERS}
    patterns = next(declared.default for declared in PARAMETERS if declared.name == "live").split(", ")
    for name in shipped():
        found = LiveValues(load_mechanism(name), patterns).current
        assert {f"gravity[{axis}]" for axis in range(3)} <= set(found) or not any("gravity" in key for key in found), (
            name
        )
        assert not own & {re.sub(r"\[\d+\]$", "", key) for key in found}


def test_every_parameter_says_what_it_means():
    assert all(len(declared.description) > 10 for declared in PARAMETERS)
    assert len({declared.name for declared in PARAMETERS}) == len(PARAMETERS)
