"""Random use of the lab: whatever users do, the recording of it is recomputed bit for bit."""

import pytest

from mbd_sim.recordings.run.verification import verify
from test.lab.random_use import RandomUse


@pytest.mark.parametrize("name", ["four_bar", "bounce", "motor_drive"])
def test_a_recording_of_random_use_is_recomputed(name, tmp_path):
    (tmp_path / "use").mkdir()
    user = RandomUse(name, tmp_path / "use", seed=3)
    user.session.record(tmp_path / "use" / "run.mcap")
    for _ in range(10):
        user.act(seconds=0.05)
    paths = user.recordings()
    assert len(paths) > 1
    for found in (found for path in paths for found in verify(path)):
        assert found.agrees, (found.first, found.failure)
        assert found.compared
        assert found.tolerance is None
