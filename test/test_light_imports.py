"""What a first step from the cache imports."""

import subprocess
import sys

FIRST_STEP = """
import sys
from mbd_sim.compiler.code import machine_code
machine_code.LEVEL = 0
from mbd_sim import Simulation
simulation = Simulation.from_file("four_bar", live=("gravity[*]", "joints.*.damping"))
simulation.step()
print(*sys.modules)
"""


def test_a_first_step_from_the_cache_traces_and_compiles_nothing(tmp_path, monkeypatch):
    """It needs the records, the data of the model and its machine code, but nothing that computes these."""
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "cache"))
    program = [sys.executable, "-c", FIRST_STEP]
    cold, warm = (subprocess.run(program, check=True, capture_output=True, text=True).stdout.split() for _ in range(2))
    for heavy in ("casadi", "mbd_sim.dynamics.equations", "mbd_sim.compiler.kernel"):
        assert heavy in cold
    own = {name.removeprefix("mbd_sim.") for name in warm if name.startswith("mbd_sim.")}
    needed = {name for name in own if name.partition(".")[0] in ("dynamics", "compiler", "integrators")}
    assert needed == {
        "compiler", "compiler.code", "compiler.code.machine_code", "compiler.code.object_code", "compiler.python",
        "compiler.python.bound_kernel", "dynamics", "dynamics.layouts",
        "dynamics.layouts.coordinate_names", "dynamics.layouts.vectors",
    }  # fmt: skip
    assert not {"casadi", "pydantic", "yaml", "logging"} & set(warm)


def test_check_of_a_known_mechanism_reads_neither_recordings_nor_compilers(tmp_path, monkeypatch):
    """Whose modules took as long as all the rest; most subcommands need none of them."""
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "cache"))
    text = "import sys; from mbd_sim.cli.main import main; main(['check', 'spherical_top']); print(*sys.modules)"
    program = [sys.executable, "-c", text]
    cold, warm = (subprocess.run(program, check=True, capture_output=True, text=True).stdout for _ in range(2))
    assert "mbd_sim.dynamics.equations" in cold
    for heavy in ("casadi", "llvmlite", "mbd_sim.recordings"):
        assert heavy not in warm.splitlines()[-1].split()
