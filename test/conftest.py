"""Settings of all tests: hypothesis draws the same examples in every run, and
kernels are kept for this run only, so that tests share them and none comes from an older version.
"""

import atexit
import os
import shutil
import tempfile

from hypothesis import HealthCheck, settings

if "PYTEST_XDIST_WORKER" not in os.environ:  # workers use the folder of the process that started them
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
