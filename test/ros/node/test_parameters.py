"""What the node's parameters mean for the mechanisms that ship."""

import importlib
import os
import re
import subprocess
import sys
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import rclpy
from rclpy.parameter import Parameter

from mbd_sim import Simulation
from mbd_sim.files.checks.override import matching
from mbd_sim.files.load import load_mechanism
from mbd_sim.recordings.messages.topics import TOPICS
from mbd_sim.ros.node import sim_node
from mbd_sim.ros.node.parameters import written
from mbd_sim.ros.node.sim_parameters import PARAMETERS
from mbd_sim.ros.replay import replay_node
from mbd_sim.simulation.model.live_values import LiveValues, names_with_matches
from test.recordings.runs import stepped_node
from test.system.nodes import as_in_the_node

LIVE = next(declared.default for declared in PARAMETERS if declared.name == "live").split(", ")


def test_the_default_live_values_meet_no_parameter_of_the_node():
    patterns = [re.sub(r"\[\*\]$", "", pattern) for pattern in LIVE]
    assert patterns and not [one.name for one in PARAMETERS if any(fnmatchcase(one.name, own) for own in patterns)]


def test_gravity_is_among_the_default_live_values_unless_nothing_depends_on_it():
    for name in ("double_rod", "four_bar", "bounce", "rotating_frame_mass"):
        mechanism = load_mechanism(name)
        found = LiveValues(mechanism, names_with_matches(mechanism, LIVE)).current
        assert found.keys() <= set(matching(load_mechanism(name), LIVE))
        axes = {f"gravity[{axis}]" for axis in range(3)}
        assert axes <= found.keys() or not axes & found.keys(), name


def test_every_parameter_says_what_it_means():
    assert all(len(declared.description) > 10 for declared in PARAMETERS)
    assert len({declared.name for declared in PARAMETERS}) == len(PARAMETERS)


@pytest.mark.parametrize("mechanism", ["double_rod", "four_bar"])
def test_without_wrenches_and_live_values_a_node_has_the_bits_of_a_plain_simulation(tmp_path, mechanism):
    """With them it has those of a simulation with the same options: what is an input is not folded into constants."""
    for options, simulation in (
        ({"wrenches": "''", "live": "''"}, Simulation.from_file(mechanism)),
        ({}, as_in_the_node(mechanism)),
    ):
        with stepped_node(tmp_path, mechanism, record=False, **options) as node:
            node.stepping_thread.step(300)
            simulation.step(300)
            assert node.simulation.state.tobytes() == simulation.state.tobytes()


EXAMPLES = Path(sim_node.__file__).parents[2] / "examples"
MODULES = [
    f"mbd_sim.examples.{path.parent.name}.{path.stem}"
    for path in sorted(EXAMPLES.glob("*/*.py"))
    if "\ndef main(" in path.read_text(encoding="utf-8")
]


def printed(main, capsys, monkeypatch, word="--help"):
    monkeypatch.setattr(sys, "argv", ["program", word])
    try:
        assert main() == 0
    except SystemExit as end:  # of argparse
        assert end.code == 0
    assert not rclpy.ok()
    return capsys.readouterr().out


@pytest.mark.parametrize("module", [sim_node, replay_node], ids=["sim_node", "replay_node"])
def test_the_help_of_a_node_has_all_parameters_with_their_defaults(module, capsys, monkeypatch):
    text = printed(module.main, capsys, monkeypatch)
    words = " ".join(text.split())
    for spec in module.PARAMETERS:
        assert f"\n  {spec.name}" in text
        assert f"(default: {written(spec.default)}" in words
    for name, _ in module.SERVICES:
        assert f"\n  {name} " in text
    assert max(map(len, text.splitlines())) <= 110


def test_the_help_of_sim_node_has_all_topics(capsys, monkeypatch):
    text = printed(sim_node.main, capsys, monkeypatch, "-h")
    assert all(f"\n  {topic.name} " in text or f"\n  {topic.name}\n" in text for topic in TOPICS)
    assert "~/poses/<part>" in text and "~/wrench/<part>" in text
    assert "{part}" not in text


@pytest.mark.parametrize("name", MODULES)
def test_an_example_has_help(name, capsys, monkeypatch):
    module = importlib.import_module(name)
    text = printed(module.main, capsys, monkeypatch)
    assert f"example_{name.rsplit('.', 1)[1]}" in text
    (node_class,) = [
        one
        for one in vars(module).values()
        if isinstance(one, type) and one.__name__.endswith("Node") and one.__module__ == name
    ] or [None]
    for spec in getattr(node_class, "PARAMETERS", ()):
        assert f"\n  {spec.name}" in text and f"(default: {written(spec.default)}" in " ".join(text.split())


ENTRY = "import sys; from mbd_sim.programs import {0}; sys.exit({0}.{1}())"


@pytest.mark.parametrize(
    ("program", "word", "unbuffered"),
    [
        ("node.ros.node.sim_node.main", "--help", ""),
        ("command.cli.main.main", "list", "1"),
    ],
)
def test_output_that_nobody_reads_prints_no_error(program, word, unbuffered):
    """As in `sim_node --help | head -1`, when `head` has ended before the output is complete."""
    kind, _, path = program.partition(".")
    reading, writing = os.pipe()
    os.close(reading)
    try:
        ended = subprocess.run(
            [sys.executable, "-c", ENTRY.format(kind, path), word],
            stdout=writing, stderr=subprocess.PIPE, env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    finally:
        os.close(writing)
    assert (ended.returncode, ended.stderr) == (1, b"")


FILE = """mechanism: following
parameters: {d: 0.1, k: 2}
parts: {arm: {mass: 1, center: [0, 0, -1]}}
joints: {hip: {type: revolute, between: [ground, arm], axis: [0, 1, 0], damping: d, stiffness: k}}
"""
PARAMETER, DAMPING = "parameters.d", "joints.hip.damping"


def test_a_parameter_of_the_file_moves_the_values_that_follow_it_and_the_node_shows_them(tmp_path: Path) -> None:
    file = tmp_path / "following.yaml"
    file.write_text(FILE, encoding="utf-8")
    with stepped_node(tmp_path, str(file), record=False, **{PARAMETER: 0.2}) as node:

        def shown() -> list[float]:
            return [node.get_parameter(name).value for name in (PARAMETER, DAMPING)]

        assert shown() == [0.2, 0.2] and node.simulation.live[DAMPING] == 0.2
        (result,) = node.set_parameters([Parameter(PARAMETER, value=0.5)])
        assert result.successful, result.reason
        assert shown() == [0.5, 0.5] and node.simulation.live[DAMPING] == 0.5
        node.set_parameters([Parameter(DAMPING, value=0.3)])
        node.set_parameters([Parameter(PARAMETER, value=0.7)])
        assert shown() == [0.7, 0.3] and node.simulation.live[DAMPING] == 0.3
