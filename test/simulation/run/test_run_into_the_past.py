"""`run` does not go back in time."""

import pytest

from mbd_sim import Simulation


def test_running_until_an_earlier_time_is_refused_with_a_remedy():
    sim = Simulation.from_file("rod_pendulum")
    sim.run(until=0.5)
    sim.run(until=0.5)  # nothing to do
    before = sim.state
    with pytest.raises(
        ValueError, match=r"cannot run until t = 0.2 s: the time is already 0.5 s\. .* or call reset\(\) first"
    ):
        sim.run(until=0.2)
    assert sim.time == 0.5 and sim.state.tobytes() == before.tobytes()
