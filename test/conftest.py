"""Settings of all tests: hypothesis draws the same examples in every run, and tests share what they build.

`MBD_SIM_TEST_KERNELS` names a folder that keeps the kernels from one run to the next.
"""

import atexit
import os
import shutil
import tempfile

import pytest
from hypothesis import HealthCheck, settings

from test import shared_builds

if "MBD_SIM_TEST_KERNELS" in os.environ:
    os.environ["MBD_SIM_CACHE"] = os.environ["MBD_SIM_TEST_KERNELS"]
elif "PYTEST_XDIST_WORKER" not in os.environ:  # workers use the folder of the process that started them
    _kernels = tempfile.mkdtemp(prefix="mbd_sim_kernels_")
    os.environ["MBD_SIM_CACHE"] = _kernels
    atexit.register(shutil.rmtree, _kernels, ignore_errors=True)

settings.register_profile(
    "mbd_sim",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("mbd_sim")
shared_builds.share_builds()


@pytest.fixture
def own_builds(monkeypatch):
    """Build everything anew in this test."""
    monkeypatch.setattr(shared_builds, "enabled", False)
