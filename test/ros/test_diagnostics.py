"""What `/diagnostics` says of the mechanics of a run."""

from __future__ import annotations

from pathlib import Path

from test.recording.runs import stepped_node
from test.waiting import wait_until

FAR = """mechanism: far
parts: {wheel: {mass: 1, inertia: [1, 1, 1]}}
joints:
  pin: {type: revolute, between: [ground, wheel], axis: [0, 0, 1], position: POSITION, spring: {force: sin(sqrt(2)*x)}}
"""


def mechanics(folder: Path, position: str) -> str:
    """The status of a node after some steps."""
    file = folder / "far.yaml"
    file.write_text(FAR.replace("POSITION", position), encoding="utf-8")
    with stepped_node(folder, str(file), record=False) as node:
        node.stepping_thread.step(20)
        wait_until(lambda: node.publishing_thread.energies is not None, "energies")
        return str(node.diagnostics._mechanics().message)


def test_energies_beyond_every_table_are_unknown_rather_than_balanced(tmp_path: Path) -> None:
    assert mechanics(tmp_path, "1e3 rad") == "energies balance"
    assert "the energy balance is unknown: at this elongation the potential" in mechanics(tmp_path, "1e9 rad")
