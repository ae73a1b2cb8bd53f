"""The search for unreachable cycles is as before after a pause, also after an exception."""

import gc
import subprocess
import sys

import pytest

from mbd_sim.base.collection_pause import paused_collection


@pytest.mark.parametrize("was_on", [True, False])
@pytest.mark.parametrize("fails", [True, False])
def test_it_is_off_in_a_pause_and_as_before_afterwards(was_on, fails):
    before = gc.isenabled()
    try:
        (gc.enable if was_on else gc.disable)()
        try:
            with paused_collection():
                with paused_collection():
                    assert not gc.isenabled()
                assert not gc.isenabled()
                if fails:
                    raise KeyError
        except KeyError:
            assert fails
        assert gc.isenabled() == was_on
    finally:
        (gc.enable if before else gc.disable)()


def test_cycles_made_before_a_pause_and_while_names_are_looked_up_are_freed():
    """What a host program drops is found by Python's own search, whatever is used of the package beside it."""
    program = """
import gc, weakref, mbd_sim
class Cycle:
    def __init__(self):
        self.own = self
dropped = [weakref.ref(Cycle()) for _ in range(50)]
for _ in range(2000):
    mbd_sim.Pose, mbd_sim.Simulation
made = [[] for _ in range(3 * gc.get_threshold()[0])]
print(sum(one() is not None for one in dropped))
"""
    found = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert found == "0\n"


def test_a_public_name_is_looked_up_once():
    program = "import mbd_sim; first = mbd_sim.Pose; print(mbd_sim.__dict__['Pose'] is first)"
    found = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    assert found == "True\n"
