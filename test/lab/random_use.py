"""Random use of a session, as users of the page might: `python -m test.lab.random_use FILE … --actions 200`.

It plays, pauses, steps, winds back, resets, changes the speed, moves sliders, commands and efforts, pulls, drags, and
saves other files, while a clock of its own goes on. What is recorded must be recomputed bit for bit.
"""

from __future__ import annotations

import argparse
import math
import random
import re
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mbd_sim.files.load import load_mechanism
from mbd_sim.lab.session.background import FileWatch
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.own_session import OwnSession
from mbd_sim.lab.session.sliders import settings_of
from mbd_sim.recordings.run.verification import verify

NUMBER = re.compile(r"(?<=: )\d+\.?\d*|(?<=\")\d+\.\d+(?=\")")  # in a mechanism file, or in a URDF
TURN = 1.0 / 60.0  # s


class Clock:
    """A clock that moves by itself a little with each look, so that a run as fast as possible ends its turn."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 1e-4
        return self.now


class RandomUse:
    """A user of a mechanism whose file lies in a folder of its own, in which the recordings are, too."""

    def __init__(self, mechanism: str, folder: Path, seed: int) -> None:
        loaded = load_mechanism(mechanism)
        source = Path(loaded.source.file)
        self.text, self.file = source.read_text(encoding="utf-8"), folder / source.name
        self.file.write_text(self.text, encoding="utf-8")
        self.folder, self.choose, self.clock = folder, random.Random(seed), Clock()
        self.session = OwnSession(Bench.of(load_mechanism(self.file)), clock=self.clock)
        self.refused, self.counts = list[str](), Counter[str]()
        self.watch = FileWatch(
            self.session.bench.simulation.mechanism,
            Bench.of,
            lambda bench: self.session.ask("adopt", lambda session: session.adopt(bench)),
            self.refused.append,
        )
        self._recordings, self._held = 0, None
        self.actions: dict[str, Callable[[], Callable[[OwnSession], object]]] = {
            "play": lambda: OwnSession.play,
            "pause": lambda: OwnSession.pause,
            "step": lambda: lambda session: session.step(session.bench.period),
            "reset": lambda: OwnSession.reset,
            "back": self._back,
            "speed": self._speed,
            "slider": self._slider,
            "hold": self._hold,
            "pull": self._pull,
            "let go": self._let_go,
            "record": self._record,
            "end": lambda: OwnSession.end_recording_told,
            "save": self._save,
        }
        weights = {"slider": 6, "play": 9, "hold": 4, "pull": 6, "back": 2, "save": 1.5, "end": 0.4}
        self.weights = [weights.get(name, 1) for name in self.actions]

    def act(self, seconds: float) -> None:
        """Do one thing, and let some time pass."""
        (name,) = self.choose.choices(list(self.actions), self.weights)
        self.counts[name] += 1
        self.session.ask(name, self.actions[name]())
        self.wait(seconds)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        end = self.clock.now + seconds
        while self.clock.now < end:
            self.clock.now += TURN
            self.session.turn()

    def recordings(self) -> list[Path]:
        """End, and give what was recorded."""
        self.session.stop()
        return sorted(self.folder.glob("*.mcap"))

    def _point(self) -> np.ndarray:
        return np.array([self.choose.uniform(-0.5, 0.5) for _ in range(3)])

    def _back(self) -> Callable[[OwnSession], object]:
        part = self.choose.random()
        return lambda session: session.wind_to(session.frame.span[0] + part * np.ptp(session.frame.span))

    def _speed(self) -> Callable[[OwnSession], object]:
        speed = self.choose.choice([0.1, 0.5, 1.0, 2.0, math.inf])
        return lambda session: session.set_speed(speed)

    def _slider(self) -> Callable[[OwnSession], object]:
        share, factor = self.choose.random(), self.choose.uniform(0.9, 1.1)

        def move(session: OwnSession) -> None:
            setting = self.choose.choice(settings_of(session.bench, 1.0))
            if setting.kind == "value":  # small changes: large ones open loops, or let the motion diverge
                value = setting.value * factor if setting.value else 0.05 * setting.high * share
                session.change(setting.key, value * setting.factor)
            else:
                middle = 0.5 * (setting.low + setting.high)
                setting.apply(session, middle + 0.1 * (share - 0.5) * (setting.high - setting.low))

        return move

    def _hold(self) -> Callable[[OwnSession], object]:
        """Take hold in a run, or drag a paused mechanism."""
        point, target = 0.1 * self._point(), self._point()

        def hold(session: OwnSession) -> None:
            self._held = self.choose.choice(list(session.bench.simulation.wrench_map.slices)), point
            session.drag(1, "start", *self._held, target)

        return hold

    def _pull(self) -> Callable[[OwnSession], object]:
        target = self._point()
        return lambda session: self._held and session.drag(1, "update", *self._held, target)

    def _let_go(self) -> Callable[[OwnSession], object]:
        target = self._point()
        return lambda session: self._held and session.drag(1, "end", *self._held, target)

    def _record(self) -> Callable[[OwnSession], object]:
        self._recordings += 1
        path = self.folder / f"run{self._recordings}.mcap"
        return lambda session: session.record(path)

    def _save(self) -> Callable[[OwnSession], object]:
        """Save the file with another number, or with a mistake."""
        found = self.choose.choice(list(NUMBER.finditer(self.text)))
        number = "?:" if self.choose.random() < 0.3 else f"{float(found[0]) * self.choose.uniform(0.95, 1.05):.4g}"
        self.file.write_text(self.text[: found.start()] + number + self.text[found.end() :], encoding="utf-8")
        self.watch.look()
        return lambda session: None


def main() -> None:
    """Use mechanisms at random, and recompute what was recorded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mechanisms", nargs="+")
    parser.add_argument("--actions", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for mechanism in options.mechanisms:
        with tempfile.TemporaryDirectory() as folder:
            user = RandomUse(mechanism, Path(folder), options.seed)
            user.session.record(Path(folder) / "run0.mcap")
            for _ in range(options.actions):
                user.act(60.0 * options.minutes / options.actions)
            paths = user.recordings()
            counts = ", ".join(f"{count} {name}" for name, count in sorted(user.counts.items()))
            print(f"{mechanism}: {counts}; {len(user.refused)} files with mistakes", flush=True)
            for path in paths:
                for found in verify(path):
                    what = "agrees" if found.agrees else f"DIFFERS: {found.first or found.failure}"
                    print(f"  {path.name}: {sum(found.compared.values())} rows, {what}", flush=True)


if __name__ == "__main__":
    main()
