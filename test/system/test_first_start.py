"""A node whose mechanism was never built before: it begins with code that is not optimized, and changes over."""

from __future__ import annotations

import signal
from pathlib import Path

from mbd_sim.recording.verification import verify
from test.system.nodes import running


def test_a_recording_of_a_run_that_changes_over_to_optimized_code_verifies(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    variables = {"MBD_SIM_CACHE": str(cache), "MBD_SIM_QUICK_START": "on"}
    options = {"mechanism": "four_bar", "record": True, "record_dir": "logs", "publish_rate": 1000.0}

    def has_model() -> bool:
        """Whether the model is in the cache, where only the process in the background stores it."""
        entries = [path for path in cache.iterdir() if not path.name.startswith("tmp")]  # which are being written
        return any(b"PreparedModel" in path.read_bytes() for path in entries)

    with running(tmp_path, variables=variables, **options) as (process, listener):
        listener.until(has_model, "the optimized code")
        listener.spin(0.5)
        assert process.end(signal.SIGINT) == 0
        assert "optimized" not in process.text  # nothing has failed
    (path,) = (tmp_path / "logs").glob("four_bar_*.mcap")
    (verification,) = verify(path)
    assert verification.is_intact and verification.agrees, verification.first
