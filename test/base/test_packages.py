"""Where a package is missing, the program says which one, and prints the line that installs it."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys

BLOCKED = {"matplotlib", "sympy", "plotly", "pyarrow", "rerun", "av", "rclpy"}

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocker())
from mbd_sim.compiler.code import machine_code
machine_code.LEVEL = 0
from mbd_sim.cli.main import main
from mbd_sim.programs import node

for line in sys.stdin.read().splitlines():
    print("CODE", main(line.split()), file=sys.stderr, flush=True)
try:
    node.ros.node.sim_node.main()
except SystemExit as error:
    print("ROS", error)
"""
COMMANDS = {
    "run double_rod --plot p.png": "A picture of plots needs matplotlib, which is not installed. Install it with: pip "
    "install matplotlib; or choose an .html file.",
    "run double_rod --plot p.html": "An HTML page of plots needs plotly, which is not installed. Install it with: pip "
    "install plotly; or choose a .png, .svg or .pdf file.",
    "run double_rod --out t.parquet": "pip install pyarrow; or choose a .csv or .npz file.",
    "run double_rod --animate m.gif": "An animation needs matplotlib",
    "run double_rod --rerun m.rrd": "The viewer needs rerun, which is not installed. Install it with: pip install rerun-sdk",
    "check double_rod --draw p.png": "A drawing needs matplotlib",
    "check double_rod --latex": "Deriving equations as formulas needs sympy, which is not installed. Install it with: pip "
    "install sympy",
    "plot double_rod --out p.png": "pip install matplotlib",
    "view double_rod --save v.rrd": "pip install rerun-sdk",
    "rerun-with double_rod --set l=0.5 --plot p.png": "pip install matplotlib",
    "sweep double_rod --vary l=0.5:1:2 --out t.parquet": "A Parquet file needs pyarrow",
    "sweep double_rod --vary l=0.5:1:2 --plot p.png": "A picture of plots needs matplotlib",
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """What each command prints to standard error, in a process in which the packages cannot be imported."""
    folder = tmp_path_factory.mktemp("packages")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        input="\n".join(COMMANDS),
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    assert not list(folder.iterdir())
    return dict(zip(COMMANDS, done.stderr.split("CODE 1\n"), strict=False)), done.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_a_missing_package_is_named_before_anything_is_computed(answers, command):
    assert COMMANDS[command] in answers[0][command]
    assert "Traceback" not in answers[0][command]


def test_a_node_without_ros_names_the_remedy(answers):
    assert "ROS This needs ROS 2 (" in answers[1]
    assert "Source a ROS 2 environment, or install the wheels" in answers[1]
