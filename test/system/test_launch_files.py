"""The launch files, run by `launch_runner`: what they start runs, with the parameters that were given."""

from __future__ import annotations

import ast
import importlib
import os
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from mbd_sim.files.load import load_mechanism
from mbd_sim.ros.node.parameters import ParameterSpec
from mbd_sim.ros.node.sim_parameters import PARAMETERS as SIM_PARAMETERS
from mbd_sim.ros.replay.replay_node import PARAMETERS as REPLAY_PARAMETERS
from test.recordings.runs import record_run
from test.system.launch_runner import ROOT, launched, launching
from test.system.nodes import Listener, new_domain
from test.waiting import wait_until

SIMULATION, REPLAY = ROOT / "launch" / "sim.launch.py", ROOT / "launch" / "replay.launch.py"
EXAMPLES = sorted(file for file in ROOT.glob("launch/*.launch.py") if file not in (SIMULATION, REPLAY))


def test_the_simulation_runs_with_arguments_and_a_file_of_parameters(tmp_path: Path) -> None:
    (tmp_path / "live.yaml").write_text('{"/**": {ros__parameters: {joints.pin.damping: 0.25, publish_rate: 50.0}}}')
    arguments = {"mechanism": "rod_pendulum", "namespace": "lab", "record": "false", "publish_rate": "20"}
    domain = new_domain()
    listener = Listener(domain, "lab")
    try:
        arguments["params_file"] = str(tmp_path / "live.yaml")
        with launching(SIMULATION, tmp_path, domain, forked=True, **arguments):
            listener.until(lambda: len(listener.states) > 5, "states")
            assert listener.states[-1].name == ["pin"]
            assert listener.parameter("joints.pin.damping") == 0.25
            assert listener.parameter("publish_rate") == 50.0  # the file has the last word
            assert listener.parameter("record") is False
    finally:
        listener.close()


def status(address: str) -> int:
    """How a server answers a request."""
    try:
        with urllib.request.urlopen(address) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        with error:
            return error.code


def test_the_lab_listens_for_other_machines_with_a_token(tmp_path: Path) -> None:
    """127.0.0.2 is no name of the loopback that the gate knows, so that it counts as another machine's address."""
    arguments = {"mechanism": "rod_pendulum", "record": "false", "lab": "true", "lab_port": "0"}
    log = tmp_path / "sim_node.log"

    def address() -> re.Match[str] | None:
        return re.search(r"the lab is at (http://127\.0\.0\.2:\d+/)(\?token=\S+)\n", log.read_text())

    with launching(SIMULATION, tmp_path, new_domain(), forked=True, lab_host="127.0.0.2", **arguments):
        wait_until(lambda: address() is not None, "the address of the lab", report=log.read_text)
        found = address()
        assert found is not None
        page, token = found.groups()
        assert (status(page), status(f"{page}?token=other"), status(page + token)) == (403, 403, 200)
    assert "Traceback" not in log.read_text()


def other(spec: ParameterSpec) -> Any:
    """A value that differs from the default of a parameter and is valid."""
    match spec.default:
        case bool(value):
            return not value
        case int(value) | float(value):
            return value + 1 if spec.high is None or value + 1 <= spec.high else value / 2
        case _:
            return f"other_{spec.name}"


@pytest.mark.parametrize(
    ("file", "specs", "node"),
    [(SIMULATION, SIM_PARAMETERS, "sim_node"), (REPLAY, REPLAY_PARAMETERS, "replay_node")],
    ids=["sim", "replay"],
)
def test_every_launch_argument_reaches_its_node(
    tmp_path: Path, file: Path, specs: Sequence[ParameterSpec], node: str
) -> None:
    given = {spec.name: other(spec) for spec in specs}
    texts = {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in given.items()}
    (command,) = launched(file, tmp_path, **texts).commands
    assert Path(command[0]).name == node
    (written,) = [Path(word) for word in command if word.endswith(".yaml")]
    passed = yaml.safe_load(written.read_text())["/**"]["ros__parameters"]
    assert passed == given
    assert {name: type(value) for name, value in passed.items()} == {spec.name: type(spec.default) for spec in specs}


def settings(file: Path) -> dict[str, str]:
    """The arguments that the launch file of an example gives to the simulator."""
    (line,) = [line for line in file.read_text(encoding="utf-8").splitlines() if line.startswith("SIM = ")]
    found: dict[str, str] = ast.literal_eval(line.removeprefix("SIM = "))
    return found


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.name.partition(".")[0])
def test_an_example_names_programs_and_parameters_that_there_are(tmp_path: Path, file: Path) -> None:
    assert settings(file).keys() <= {spec.name for spec in SIM_PARAMETERS}
    load_mechanism(settings(file)["mechanism"])
    simulator, *programs = launched(file, tmp_path).commands
    assert Path(simulator[0]).name == "sim_node" and len(programs) == 1
    for name, *words in programs:
        (path,) = ROOT.glob(f"mbd_sim/examples/*/{Path(name).name.removeprefix('example_')}.py")
        assert os.access(name, os.X_OK)
        module = importlib.import_module(f"mbd_sim.examples.{path.parent.name}.{path.stem}")
        nodes = [one for one in vars(module).values() if isinstance(one, type) and one.__module__ == module.__name__]
        known = {spec.name for one in nodes for spec in getattr(one, "PARAMETERS", ())}
        given = [yaml.safe_load(Path(word).read_text(encoding="utf-8")) for word in words if word.endswith(".yaml")]
        assert {key for one in given for key in one["/**"]["ros__parameters"]} <= known


def test_an_example_starts_its_simulation_and_its_program(tmp_path: Path) -> None:
    """As users start it, in processes of their own."""
    file, domain = ROOT / "launch" / "pd_hold.launch.py", new_domain()
    listener = Listener(domain)
    try:
        with launching(file, tmp_path, domain, record_dir=str(tmp_path)) as processes:
            assert len(processes) == 2
            listener.until(lambda: len(listener.node.get_node_names()) == 3, "both nodes")
            listener.until(lambda: len(listener.states) > 2, "states")
            assert all(process.poll() is None for process in processes)
            mechanism = load_mechanism(settings(file)["mechanism"])
            assert list(listener.states[-1].name) == list(mechanism.coordinate_names)
        assert list(tmp_path.glob("*.mcap"))
    finally:
        listener.close()


def test_a_recording_is_played(tmp_path: Path) -> None:
    bag = record_run(tmp_path, "double_rod", seconds=0.3, seed=1, resets=False)
    with launching(REPLAY, tmp_path, new_domain(), forked=True, bag=str(bag), rate="0") as (player,):
        wait_until(lambda: player.poll() is not None, "the end of the recording")


def test_what_rviz_needs_and_is_not_installed_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    context = launched(SIMULATION, tmp_path, rviz="true")
    programs = [Path(command[0]).name for command in context.commands]
    assert programs[0] == "sim_node"
    missing = {"rviz2", "robot_state_publisher"} - set(programs)
    assert [message for message in context.messages if all(name in message for name in missing)] or not missing
