"""Settings of all tests: hypothesis draws the same examples in every run, and tests share what they build.

The first process removes the shared memory of killed nodes, before and after the tests.

`MBD_SIM_TEST_KERNELS` names a folder that keeps the kernels from one run to the next.
"""

import atexit
import fcntl
import functools
import gc
import math
import os
import shutil
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers

from mbd_sim.base import disk_cache
from mbd_sim.compiler import kernel
from mbd_sim.compiler.code import host_module, machine_code
from mbd_sim.files.text.library import shipped
from mbd_sim.simulation.contact.compiled import library
from test import shared_builds, without_ros
from test.shared_memory import remove_unused_shared_memory

# Folders whose tests build many mechanisms and take few steps: level 0 compiles them in a tenth of the time. The
# kernels of all other folders are those that users run; test/compiler compares the two.
QUICKLY_COMPILED = {
    "analysis",
    "benchmarks",
    "cli",
    "docs",
    "dynamics",
    "examples",
    "exports",
    "files",
    "imports",
    "integrators",
    "lab",
    "many",
    "mechanism",
    "notebook",
    "physics",
    "pictures",
    "recordings",
    "ros",
    "simulation",
    "studies",
    "system",
    "test_docs.py",
    "test_representations.py",
}
# Within `compiler`, those of methods and histories, which compare the two levels as well.
QUICKLY_COMPILED_PARTS = ("compiler/steps/", "compiler/taylor/", "compiler/test_kernel")
WAITING = ("system", "examples", "lab/page")  # whose tests start nodes, or share a browser, and wait for them
LONG_TESTS = {
    "test_a_process_with_other_hashes_and_linear_algebra_derives_and_computes_the_same",
    "test_random_mechanisms_with_loops_and_constraints",
}

if "MBD_SIM_TEST_KERNELS" in os.environ:
    os.environ["MBD_SIM_CACHE"] = os.environ["MBD_SIM_TEST_KERNELS"]
elif "PYTEST_XDIST_WORKER" not in os.environ:  # workers use the folder of the process that started them
    _kernels = tempfile.mkdtemp(prefix="mbd_sim_kernels_")
    os.environ["MBD_SIM_CACHE"] = _kernels
    atexit.register(shutil.rmtree, _kernels, ignore_errors=True)

# The processes of a test run take turns at compiling what all contacts share: the first one does, for all others.
CONTACTS_TURN = Path(os.environ["MBD_SIM_CACHE"], "contacts.turn")
CONTACTS_TURN.parent.mkdir(mode=0o700, parents=True, exist_ok=True)

settings.register_profile(
    "mbd_sim",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("mbd_sim")
# Hypothesis also draws constants from all modules that are imported so far: it parses these, which takes seconds in each
# process, and the examples depend on which tests ran before.
if hasattr(providers, "_get_local_constants"):
    providers._get_local_constants = lambda: providers._local_constants
shared_builds.share_builds()


def _compile_as_for_users(contents, emit):
    """What all contacts share is compiled once for all tests; where they run it for seconds, that takes a third less."""
    level, machine_code.LEVEL = machine_code.LEVEL, 1
    try:
        with CONTACTS_TURN.open("w") as turn:
            fcntl.flock(turn, fcntl.LOCK_EX)
            return host_module.compile_once(contents, emit)
    finally:
        machine_code.LEVEL = level


library.compile_once = _compile_as_for_users
# Tests compare code that is emitted in different ways from the same equations.
kernel.compiled_before, kernel.records_digest = lambda compile_, *_: compile_(), lambda _: ""
disk_cache.LARGEST = math.inf  # to look at all entries takes as long as to compile one


# Tests start some hundred processes, each of which would compile all modules of the package again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

gc.disable()  # during the collection of the tests, whose objects stay


def pytest_ignore_collect(collection_path):
    return True if collection_path in set(without_ros.left_out()) else None


def pytest_report_header():
    left_out = len(without_ros.left_out())
    return f"ROS 2 is not installed: {left_out} files of tests that need nodes are left out" if left_out else None


def pytest_configure():
    if "PYTEST_XDIST_WORKER" not in os.environ:
        remove_unused_shared_memory()


def pytest_unconfigure():
    if "PYTEST_XDIST_WORKER" not in os.environ:
        remove_unused_shared_memory()


@functools.cache
def place_of(path):
    """Where a file of tests is in this folder."""
    return path.relative_to(Path(__file__).parent).as_posix()


def pytest_collection_modifyitems(items):
    """Begin with tests that wait for processes, beside which others can compute, and with those that take longest.

    The tests of each shipped mechanism or linkage are together, so that it is mostly one process that builds it for all
    of them.
    """
    from test.generators.overconstrained import LINKAGES

    places = {name: place for place, name in enumerate([*sorted(shipped()), *LINKAGES])}

    def place(item):
        if place_of(item.path).startswith(WAITING) or item.name.partition("[")[0] in LONG_TESTS:
            return -2
        values = item.callspec.params.values() if hasattr(item, "callspec") else ()
        return next((places[value] for value in values if isinstance(value, str) and value in places), -1)

    items.sort(key=place)


def pytest_collection_finish():
    gc.freeze()  # nothing of the collection is searched for garbage again
    gc.set_threshold(1_000_000, 20, 100)  # the shared builds are many objects, which stay as well
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Choose the level before the first fixture builds something."""
    place = place_of(item.path)
    is_quick = place.partition("/")[0] in QUICKLY_COMPILED or place.startswith(QUICKLY_COMPILED_PARTS)
    machine_code.LEVEL = 0 if is_quick else 1


@pytest.fixture
def own_builds(monkeypatch):
    """Build everything anew in this test."""
    monkeypatch.setattr(shared_builds, "enabled", False)
