"""What the programs print for `--help`: every parameter with its default, without DDS."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy

from mbd_sim.recordings.messages.topics import TOPICS
from mbd_sim.ros.node import sim_node
from mbd_sim.ros.node.help import written
from mbd_sim.ros.replay import replay_node

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
        ("node.ros.replay.replay_node.main", "--help", "1"),
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
