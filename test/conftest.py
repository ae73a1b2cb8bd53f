"""Settings of all tests: helpers can be imported by name, and hypothesis draws the same examples in every run."""

import sys
from pathlib import Path

from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).parent))  # kane.py and mechanisms.py

settings.register_profile(
    "mbd_sim",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("mbd_sim")
