"""The file is saved while the mechanism runs."""

import random

import numpy as np
import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.session.background import FileWatch
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.session import Session


class Edited:
    """A copy of a shipped mechanism's file, a session that runs it, and the watch on it."""

    def __init__(self, folder, name):
        self.file = folder / "edited.yaml"
        self.text = load_mechanism(name).source.text
        self.file.write_text(self.text, encoding="utf-8")
        self.session = Session(Bench.of(load_mechanism(self.file)), running=False)
        self.problems = []
        self.watch = FileWatch(self.file, Bench.of, self._adopt, self.problems.append)

    def _adopt(self, bench):
        self.session.ask("adopt", lambda session: session.adopt(bench))

    def save(self, text):
        self.file.write_text(text, encoding="utf-8")
        self.watch.look()
        self.session.turn()


@pytest.fixture
def edited(tmp_path):
    return Edited(tmp_path, "four_bar")


def test_the_state_of_what_has_the_same_names_is_kept(edited):
    edited.session.step(700)
    before = edited.session.bench.simulation
    edited.save(edited.text.replace("density: 1 ", "density: 2 "))
    after = edited.session.bench.simulation
    assert after is not before
    assert after.mechanism.mass == pytest.approx(2.0 * before.mechanism.mass)
    assert after.q == pytest.approx(before.q, abs=1e-9)
    assert after.u == pytest.approx(before.u, abs=1e-8)
    assert after.time == before.time
    assert edited.session.frame.generation == 2


def test_other_lengths_are_assembled_near_the_present_positions(edited):
    edited.session.step(300)
    before = edited.session.bench.simulation.q.copy()
    edited.save(edited.text.replace("coupler: 1.4 m", "coupler: 1.45 m"))
    simulation = edited.session.bench.simulation
    assert simulation.violation.position < 1e-9
    assert np.max(np.abs(simulation.q - before)) < 0.3


def test_wrong_files_are_told_and_the_mechanism_goes_on(edited):
    """Thirty files with mistakes: lines cut off, words changed, numbers replaced."""
    choose, wrong = random.Random(5), 0
    running = edited.session.bench
    while wrong < 30:
        lines = edited.text.splitlines()
        at = choose.randrange(8, len(lines))
        lines[at] = choose.choice(
            [lines[at][: len(lines[at]) // 2] + " [", lines[at].replace("crank", "krank"), "  ?: }"]
        )
        text = "\n".join(lines) + "\n"
        count = len(edited.problems)
        edited.save(text)
        if len(edited.problems) > count:
            wrong += 1
            assert str(edited.file) in edited.problems[-1]
            assert edited.session.bench is running
        running = edited.session.bench
        edited.session.step(10)
    edited.save(edited.text + "\n")
    assert edited.session.bench is not running


def test_a_recording_goes_on_in_the_next_file(edited, tmp_path):
    edited.session.record(tmp_path / "run.mcap")
    edited.session.step(50)
    edited.save(edited.text.replace("density: 1 ", "density: 2 "))
    edited.session.step(50)
    edited.session.stop()
    assert sorted(path.name for path in tmp_path.glob("*.mcap")) == ["run.mcap", "run_part2.mcap"]
