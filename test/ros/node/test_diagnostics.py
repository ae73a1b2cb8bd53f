"""What `/diagnostics` says of the mechanics of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.views.table import read_table
from test.recordings.runs import stepped_node
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


ZERO = """mechanism: through_zero
gravity: [0, 0, 0]
parts: {cart: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], position: 1}}
forces: {s: {type: spring, between: [ground, cart], stiffness: 100, length: 0.3}}
"""


def test_an_open_energy_account_is_warned_of_once_and_stands_in_the_diagnostics(tmp_path: Path) -> None:
    """Its steps have no error that an estimate sees: the force jumps within them."""
    file = tmp_path / "through_zero.yaml"
    file.write_text(ZERO, encoding="utf-8")
    with stepped_node(tmp_path, str(file)) as node:
        node.stepping_thread.step(1500)
        wait_until(lambda: node.publishing_thread.energies is not None, "energies")
        message = str(node.diagnostics._mechanics().message)
        advice = node.stepping_thread.run.advice
    assert message == advice and "the force of 's' reverses where its length passes zero" in advice
    recording = node.publishing_thread.recorder.path
    texts = [text for _, text in read_table(open_recording(recording)).events]
    assert sum("the energy account of through_zero" in text for text in texts) == 1


def test_dropped_messages_are_those_of_the_last_second_also_when_a_recording_has_ended(tmp_path: Path) -> None:
    """With the recording, the number of messages that it dropped is gone: the sum decreases."""
    with stepped_node(tmp_path, "rod_pendulum", record=False) as node:
        diagnostics, now = node.diagnostics, node.diagnostics._sample()
        messages = []
        for before in (now.dropped + 5, now.dropped, now.dropped - 1):
            diagnostics._last = replace(now, dropped=before)
            messages.append(str(diagnostics._output(now).message))
        assert messages == ["not recorded"] * 2 + [
            "1 message dropped in the last second: lower publish_rate, or request fewer outputs"
        ]
