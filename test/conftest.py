"""Settings of all tests: hypothesis draws the same examples in every run, and the tests of one run share compiled kernels.

`MBD_SIM_TEST_KERNELS` names a folder that keeps the kernels from one run to the next.
"""

import atexit
import os
import shutil
import tempfile

from hypothesis import HealthCheck, settings

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
