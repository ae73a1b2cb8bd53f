"""The package as it is installed."""

import ast
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

import mbd_sim

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The folder into which setup.py installs the package, as colcon has it do; pip makes a wheel of the same files.

    That takes three times as long, most of it to install setuptools.
    """
    folder = tmp_path_factory.mktemp("installed")
    copy = folder / "source"
    tracked = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard"], check=True, capture_output=True, text=True
    ).stdout.splitlines()
    for name in tracked:
        if (ROOT / name).is_file() and not name.startswith(("benchmarks/", "docs/", "test/")):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            (copy / name).write_bytes((ROOT / name).read_bytes())
            (copy / name).chmod((ROOT / name).stat().st_mode)
    options = ["--no-compile", "--single-version-externally-managed", "--record", "files.txt"]
    command = [sys.executable, "setup.py", "-q", "install", *options, "--root", str(folder / "root")]
    subprocess.run(command, cwd=copy, check=True, capture_output=True)
    return folder.joinpath("root", *Path(sys.prefix).parts[1:])


def test_ros2_run_and_ros2_launch_find_what_they_look_for(installed):
    for name in (
        "share/ament_index/resource_index/packages/mbd_sim",
        "share/mbd_sim/package.xml",
        "share/mbd_sim/launch/sim.launch.py",
        "share/mbd_sim/config/open_chains/double_rod.yaml",
    ):
        assert (installed / name).is_file(), name


def test_every_shipped_mechanism_is_installed(installed):
    packed = {path.name for path in (installed / "share/mbd_sim/config").rglob("*.yaml")}
    assert packed == {path.name for path in (ROOT / "config").rglob("*.yaml")}


def test_the_sources_of_fmus_are_installed(installed):
    (folder,) = installed.rglob("mbd_sim/exports/fmu/sources")
    assert {"fmi3_functions.c", "fmi3_types.h"} <= {path.name for path in folder.iterdir()}


def test_the_version_is_the_same_everywhere(installed):
    described = ElementTree.parse(ROOT / "package.xml").getroot()
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)[1]
    assert mbd_sim.__version__ == described.findtext("version") == cited
    (metadata,) = installed.rglob("mbd_sim-*-info")
    assert metadata.name.startswith(f"mbd_sim-{mbd_sim.__version__}")
    assert f"\n{mbd_sim.__version__} (" in (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")


def test_the_page_of_licenses_names_every_dependency():
    named = set(re.findall(r"^\| `([\w-]+)`", (ROOT / "docs" / "licenses.md").read_text("utf-8"), re.MULTILINE))
    required = {
        re.match(r"[\w-]+", requirement)[0] for requirement in ast.literal_eval(setup_keyword("install_requires"))
    }
    assert required <= named


def test_every_ros_package_that_is_imported_is_declared():
    described = ElementTree.parse(ROOT / "package.xml").getroot()
    declared = {element.text for element in described.iter("exec_depend")}
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "mbd_sim" / "ros").glob("*.py"))
    used = set(re.findall(r"^from ([a-z_]+_(?:msgs|srvs|interfaces))\.", sources, re.MULTILINE)) | {"rclpy"}
    assert used <= declared


def setup_keyword(name):
    """The value of a keyword of setup(...) in setup.py."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    (call,) = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup"
    ]
    (value,) = [keyword.value for keyword in call.keywords if keyword.arg == name]
    return value


def test_package_xml_names_every_dependency_of_setup_py():
    described = (ROOT / "package.xml").read_text(encoding="utf-8")
    needed = [text for text in ast.literal_eval(setup_keyword("install_requires")) if "sys_platform !=" not in text]
    required = [re.match(r"[\w-]+", text)[0] for text in needed]
    assert not [name for name in required if name.removeprefix("py") not in described]


def test_the_readme_names_every_dependency_of_setup_py():
    """For a ROS 2 workspace, in which colcon installs none of them."""
    (line,) = re.findall("^pip install .*rosbags.*$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    needed = [text for text in ast.literal_eval(setup_keyword("install_requires")) if "sys_platform !=" not in text]
    assert [text for text in needed if f'"{text}"' not in line] == []


EVALUATED_SETUP = """
import json, runpy, setuptools
setuptools.setup = lambda **keywords: print(json.dumps([keywords["entry_points"], keywords["data_files"]]))
runpy.run_path("setup.py")
"""


@pytest.fixture(scope="module")
def evaluated_setup():
    """The entry points and data files that setup.py computes."""
    command = [sys.executable, "-c", EVALUATED_SETUP]
    return json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)


def test_entry_points_exist(evaluated_setup):
    scripts = "\n".join(evaluated_setup[0]["console_scripts"])
    modules = [f"mbd_sim.{path}" for path in re.findall(r"= mbd_sim\.programs:\w+\.([\w.]+)\.main", scripts)]
    assert {"mbd_sim.cli.main", "mbd_sim.ros.node.sim_node", "mbd_sim.ros.replay.replay_node"} <= set(modules)
    for module in modules:
        source = ROOT / f"{module.replace('.', '/')}.py"
        assert "\ndef main(" in source.read_text(encoding="utf-8")


def test_setup_finds_the_programs_and_pages_of_all_examples(evaluated_setup):
    entry_points, data_files = evaluated_setup
    examples = ROOT / "mbd_sim" / "examples"
    programs = {
        f"example_{path.stem} = mbd_sim.programs:node.examples.{path.parent.name}.{path.stem}.main"
        for path in examples.glob("*/*.py")
        if path.stem != "__init__"
    }
    assert programs == {program for program in entry_points["console_scripts"] if program.startswith("example_")}
    shared = dict(data_files)
    for folder in (path.parent for path in examples.glob("*/README.md")):
        files = {f"mbd_sim/examples/{folder.name}/{name}" for name in ("README.md", f"{folder.name}.png")}
        assert files == set(shared[f"share/mbd_sim/examples/{folder.name}"])
        assert f"launch/{folder.name}.launch.py" in shared["share/mbd_sim/launch"]


def test_ros2_run_finds_the_programs(installed, evaluated_setup):
    programs = {program.partition(" = ")[0] for program in evaluated_setup[0]["console_scripts"]}
    found = list((installed / "lib/mbd_sim").iterdir())
    assert {path.name for path in found} == programs
    assert all(path.stat().st_mode & 0o111 for path in found)


def programs_outside_the_package():
    """Python programs that no other test imports."""
    scripts = [path for path in (ROOT / "scripts").iterdir() if path.is_file()]
    scripts = [path for path in scripts if "python" in path.read_text(encoding="utf-8").splitlines()[0]]
    return sorted([*scripts, *(ROOT / "benchmarks").rglob("*.py"), *(ROOT / "launch").glob("*.py")])


@pytest.mark.parametrize("path", programs_outside_the_package(), ids=lambda path: str(path.relative_to(ROOT)))
def test_names_that_programs_import_exist(path):
    imports = [
        node
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in {"mbd_sim", "test"}
    ]
    for node in imports:
        module = importlib.import_module(node.module)
        for alias in node.names:
            if not hasattr(module, alias.name):
                importlib.import_module(f"{node.module}.{alias.name}")


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
@pytest.mark.parametrize(("target", "builds"), [("run", False), ("docs", False), ("setup", True), ("tests", True)])
def test_only_tests_build_the_message_packages_that_only_they_need(target, builds):
    command = ["make", "--dry-run", "--no-print-directory", "VENV=not_there", target]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    listed = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True).stdout
    assert "scripts/setup_venv not_there" in listed
    assert ("test.ros_interfaces.build" in listed) is builds
