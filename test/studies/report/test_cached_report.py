"""Reports from the cache."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.files.checks.override import with_values
from mbd_sim.studies.report import mechanism_report
from mbd_sim.studies.report.text import cached_report


def test_a_report_is_made_once_for_each_mechanism(tmp_path, monkeypatch):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "cache"))
    mechanism = load_mechanism("rod_pendulum")
    changed = with_values(mechanism, {"gravity": [0, 0, -1]})
    first, other = cached_report(mechanism), cached_report(changed)
    assert first != other
    monkeypatch.setattr(mechanism_report, "report", lambda _: pytest.fail("made again"))
    assert (cached_report(mechanism), cached_report(changed)) == (first, other)
