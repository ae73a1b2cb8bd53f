"""What is imported: by the package, by a first step, from the cache and without it, by `check` and by the node."""

import importlib.util
import os
import subprocess
import sys

import pytest

FIRST_STEP = """
import sys
from mbd_sim.compiler.code import machine_code
machine_code.LEVEL = 0
from mbd_sim import Simulation
simulation = Simulation.from_file("four_bar", live=("gravity[*]", "joints.*.damping"))
simulation.step()
assert simulation.remarks == ()
simulation.momentum()
"""
CHECK = "import sys; from mbd_sim.cli.main import main; main(['check', 'spherical_top']);"
NOT_NEEDED = ("rclpy", "rerun", "scipy", "mcap", "pyarrow", "matplotlib", "dask")
FIRST = f"import sys; missing = dict.fromkeys({NOT_NEEDED!r}); sys.modules |= missing"
REST = "for name in missing: del sys.modules[name]"
NOTED = """
import numpy  # whose own import sets a variable
changes = []
sys.addaudithook(lambda event, given: event in ("os.putenv", "os.unsetenv") and changes.append(given))
"""


def modules(program, cache):
    """What is loaded when a program ends in a process of its own."""
    command = [sys.executable, "-c", f"{program}\nprint(*sys.modules)"]
    environment = {**os.environ, "MBD_SIM_CACHE": str(cache)}
    return subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout.split()


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A cache that a first step, which needs neither ROS nor SciPy, and a check have filled."""
    folder = tmp_path_factory.mktemp("cache")
    cold = modules(f"{FIRST}\n{FIRST_STEP}\n{REST}\n{CHECK}", folder)
    for heavy in ("casadi", "mbd_sim.dynamics.equations", "mbd_sim.compiler.kernel"):
        assert heavy in cold
    return folder


def test_a_first_step_from_the_cache_traces_and_compiles_nothing(cache):
    """It needs the records, the data of the model and its machine code, but nothing that computes these."""
    warm = modules(FIRST_STEP, cache)
    own = {name.removeprefix("mbd_sim.") for name in warm if name.startswith("mbd_sim.")}
    needed = {name for name in own if name.partition(".")[0] in ("dynamics", "compiler", "integrators")}
    assert needed == {
        "compiler", "compiler.code", "compiler.code.machine_code", "compiler.code.object_code", "compiler.python",
        "compiler.python.bound_call", "compiler.python.bound_kernel", "dynamics", "dynamics.layouts",
        "dynamics.layouts.coordinate_names", "dynamics.layouts.vectors",
    }  # fmt: skip
    assert not {"casadi", "pydantic", "yaml", "logging"} & set(warm)
    rare = {"files.urdf.reader", "simulation.run.advice", "analysis.mechanics.load_sharing"}
    assert not rare & own


def test_check_of_a_known_mechanism_reads_neither_recordings_nor_compilers(cache):
    """Whose modules took as long as all the rest; most subcommands need none of them."""
    assert not {"casadi", "llvmlite", "mbd_sim.recordings", "argcomplete"} & set(modules(CHECK, cache))


def test_the_package_and_what_few_runs_need_are_loaded_late():
    """Also not by a first build of a mechanism with joints alone, and SymPy only to derive.

    Nor does reading a file change the environment, which other threads and child processes of a program see.
    """
    steps = {
        "import mbd_sim": [
            "rclpy", "rerun", "scipy", "casadi", "llvmlite", "numpy", "pydantic", "mcap", "pyarrow", "mbd_sim.base.errors",
        ],
        "from mbd_sim import Simulation": ["mbd_sim.mechanism.elements.actuators", "mbd_sim.files.text.parameters"],
        "import mbd_sim.pictures.rerun": ["rerun", "rclpy", "scipy", "casadi"],
        "from mbd_sim.dynamics.equations import derive; derive(mbd_sim.load_mechanism('double_rod'))": [
            "mbd_sim.dynamics.actuators.forces", "mbd_sim.dynamics.contact.one_sided_rows",
        ],
        "import mbd_sim.studies.optimization, mbd_sim.cli.main": ["sympy"],
        "import mbd_sim.pictures.drawing": ["matplotlib", "rerun"],
    }  # fmt: skip
    lines = [
        f"{statement}\nprint([name for name in {names} if name in sys.modules])" for statement, names in steps.items()
    ]
    command = [sys.executable, "-c", "\n".join(["import sys", lines[0], NOTED, *lines[1:], "print(changes)"])]
    done = subprocess.run(
        command, env=os.environ | {"MBD_SIM_CACHE": "off"}, capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n" * (len(steps) + 1)


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="ROS 2 is not installed")
def test_the_node_loads_neither_what_compiles_nor_the_viewer(cache):
    rare = {
        "mbd_sim.pictures.rerun", "mbd_sim.files.urdf.reader", "mbd_sim.recordings.mcap.check", "numpy.polynomial",
        "casadi", "mbd_sim.dynamics.equations", "mbd_sim.compiler.kernel", "pydantic",
    }  # fmt: skip
    assert not rare & set(modules("import sys, mbd_sim.ros.node.sim_node", cache))
