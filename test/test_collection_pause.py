"""The search for unreachable cycles is as before after a pause, also after an exception."""

import gc

import pytest

from mbd_sim.collection_pause import paused_collection


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
