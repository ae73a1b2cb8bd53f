"""A node whose mechanism was never built before: it begins with code that is not optimized, and changes over."""

from __future__ import annotations

import fcntl
import signal
from pathlib import Path

from mbd_sim.recording.verification import verify
from test.system.nodes import running


def has_built(cache: Path) -> bool:
    """Whether the process in the background has built the model, and has ended."""
    file = cache / "optimizing"
    if len(list(cache.glob("*"))) < 4 or not file.exists():  # the mechanism, its object code, and the model
        return False
    with file.open() as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def test_a_recording_of_a_run_that_changes_over_to_optimized_code_verifies(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    variables = {"MBD_SIM_CACHE": str(cache), "MBD_SIM_QUICK_START": "on"}
    options = {"mechanism": "four_bar", "record": True, "record_dir": "logs", "publish_rate": 1000.0}
    with running(tmp_path, variables=variables, **options) as (process, listener):
        listener.until(lambda: has_built(cache), "the optimized code")
        listener.spin(0.5)
        assert process.end(signal.SIGINT) == 0
        assert "optimized" not in process.text  # nothing has failed
    (path,) = (tmp_path / "logs").glob("four_bar_*.mcap")
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees, verification.first
