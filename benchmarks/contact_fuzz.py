"""Random mechanisms with contacts: whether each run ends in time, without an error, and never gains energy.

Three series are run: mechanisms of all kinds, each for a while; linkages with loops, whose speeds are thrown again
and again until many impacts have been made; and scenes of bodies of all shapes, four of each mechanism. Half of the
linkages are elastic and without friction. Results are appended to a file, one line per mechanism or scene; seeds that
are already there are left out, so that a series can be continued. Where an energy is wrong by more than round-off, the
mechanism is run again with an eighth of the step: the error of the integration of a fast motion vanishes then, that of
an event does not.

    python -m benchmarks.contact_fuzz --runs 2000 --time 5 --impacts 100000 --scenes 2000
"""

from __future__ import annotations

import argparse
import collections
import json
import multiprocessing
import re
import resource
import signal
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from mbd_sim import Simulation
from mbd_sim.base.errors import MbdSimError, MechanismError
from mbd_sim.compiler.code import machine_code
from mbd_sim.dynamics.constraints.start import rheonomic
from mbd_sim.simulation.contact.records import ContactChange, ContactEvent
from mbd_sim.simulation.contact.stepper import EventError
from test.generators import body_scenes
from test.generators.contact_mechanisms import ALL_KINDS, LOOPS, contact_mechanism

RESULTS = Path(__file__).parent / "results" / "contact_fuzz.jsonl"
FINER = 8  # times, where the energy is wrong
LIMIT = 120.0  # s of processor time for a mechanism, beyond which it counts as a hang
RESIDUAL, GAIN, ELASTIC = 1e-9, 1e-12, 1e-10  # of the energies that occur, at least 1 J
DEPTH = 1e-8  # m or rad
EPISODE, EPISODES, ENOUGH = 0.4, 60, 200  # s between throws, throws, and impacts of a linkage
NO_CONTACT_FORCES = "no contact forces"  # an honest end: Painlevé's paradox or jamming, told with its cause
REFUSED = "start refused"  # that random mechanism begins beyond a bound, and the error names it; it was not run
FILE_REFUSED = "file refused"  # as one with shapes that would pass through each other, and the error says so
STARTS = 4  # scenes of a mechanism


@dataclass
class Found:
    """The result of one mechanism. `gain` is the largest relative gain of energy in an impact."""

    series: str
    seed: int
    kind: str
    outcome: str = "ended"
    message: str = ""
    impacts: int = 0
    events: int = 0
    bounded: int = 0  # steps that had too many events
    gain: float = 0.0
    residual: float = 0.0
    drift: float = 0.0  # change of the total energy of an elastic one, relative
    seconds: float = 0.0  # of processor time
    step: float = 0.0  # s
    coarse: float = 0.0  # the largest of the errors with the step of the file, where that was too long

    @property
    def is_good(self) -> bool:
        """Whether it ended, or said why it cannot go on or begin, and the energies are right."""
        return self.outcome in ("ended", NO_CONTACT_FORCES, REFUSED, FILE_REFUSED) and not self.faults

    @property
    def faults(self) -> list[str]:
        """What is wrong with the energies."""
        limits = {"residual": RESIDUAL, "gain": GAIN, "drift": ELASTIC}
        return [name for name, limit in limits.items() if not getattr(self, name) <= limit]


def main() -> None:
    """Run what is not in the file of results yet, and print a summary of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=2000, help="mechanisms of all kinds")
    parser.add_argument("--time", type=float, default=5.0, help="s that each of them runs")
    parser.add_argument("--impacts", type=int, default=100_000, help="of linkages with loops")
    parser.add_argument("--scenes", type=int, default=2000, help="of bodies of all shapes")
    parser.add_argument("--first", type=int, default=0, help="the first seed of all series")
    parser.add_argument("--results", type=Path, default=RESULTS, help="file to which results are appended")
    options = parser.parse_args()
    options.results.parent.mkdir(exist_ok=True)
    known = read(options.results)
    done = {(found.series, found.seed) for found in known}
    with options.results.open("a", encoding="utf-8") as file:
        for found in series(options, done, known):
            file.write(json.dumps(asdict(found)) + "\n")
            file.flush()
            known.append(found)
            if not found.is_good:
                print(f"{found.series} {found.seed} {found.kind}: {found.outcome} {found.faults} {found.message}")
    print(summary(known, options))


def series(options: argparse.Namespace, done: set[tuple[str, int]], known: list[Found]) -> Iterator[Found]:
    """The results of all series, without those `done`; `known` are all results until now."""
    worker: Worker | None = None
    seed = options.first
    while True:
        runs_left = seed < options.first + options.runs
        impacts = sum(found.impacts for found in known if found.series == "loop" and found.seed >= options.first)
        wanted = ["run"] * runs_left + ["loop"] * (impacts < options.impacts)
        wanted += ["scene"] * (seed < options.first + options.scenes)
        if not wanted:
            break
        for name in wanted:
            if (name, seed) not in done:
                worker = worker or Worker(options.time)
                yield worker.result(name, seed)
        seed += 1
    if worker:
        worker.end()


def read(path: Path) -> list[Found]:
    """The results in a file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [Found(**json.loads(line)) for line in lines]


def summary(known: list[Found], options: argparse.Namespace) -> str:
    """The counts of a file of results."""
    lines = []
    for name, count in (("run", options.runs), ("loop", None), ("scene", options.scenes)):
        chosen = [found for found in known if found.series == name and found.seed >= options.first]
        if count is not None:
            chosen = [found for found in chosen if found.seed < options.first + count]
        if not chosen:
            continue
        outcomes = {
            text: sum(found.outcome == text for found in chosen) for text in sorted({f.outcome for f in chosen})
        }
        worst = {key: max(getattr(found, key) for found in chosen) for key in ("gain", "residual", "drift", "seconds")}
        lines += [
            f"{name}: {len(chosen)} mechanisms, {sum(found.impacts for found in chosen)} impacts, "
            f"{sum(found.events for found in chosen)} events, {sum(found.seconds for found in chosen):.0f} s",
            f"  outcomes  {', '.join(f'{text}: {count}' for text, count in outcomes.items())}",
            f"  largest   {', '.join(f'{key} {value:.2g}' for key, value in worst.items())}",
            f"  with a finer step: {sum(found.coarse > 0.0 for found in chosen)}, whose largest error was "
            f"{max(found.coarse for found in chosen):.2g}",
            f"  steps with too many events: {sum(found.bounded for found in chosen)}",
            f"  faulty    {sum(not found.is_good for found in chosen)}: "
            + ", ".join(f"{found.seed}" for found in chosen if not found.is_good),
            *reasons(chosen),
        ]
    return "\n".join(lines)


def reasons(chosen: list[Found]) -> list[str]:
    """What the errors of files and starts that are refused say, apart from names and numbers, with their counts."""
    texts = [found.message for found in chosen if found.outcome in (REFUSED, FILE_REFUSED)]
    plain = (re.sub(r"'[^']*'|[-\d.]+(e-?\d+)?|\b[bf]\d\b|\S+\.\S+", "…", text)[:160] for text in texts)
    return [f"  refused   {count}: {text}" for text, count in sorted(collections.Counter(plain).items())]


class Worker:
    """A process of its own, which is replaced when it crashes or exceeds its processor time."""

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=serve, args=(other, self._duration), daemon=True)
        self._process.start()
        other.close()

    def result(self, name: str, seed: int) -> Found:
        """The result of one mechanism."""
        self._connection.send((name, seed))
        try:
            found: Found = self._connection.recv()
            return found
        except EOFError:
            self._process.join()
            code = self._process.exitcode or 0
            self._start()
            outcome = f"no end within {LIMIT:g} s" if code == -signal.SIGXCPU else f"crash {code}"
            return Found(name, seed, kind_of(name, seed), outcome)

    def end(self) -> None:
        """Let the process end."""
        self._connection.close()
        self._process.join()


def serve(connection: Connection, duration: float) -> None:
    """Answer series and seeds with results, until the connection is closed."""
    machine_code.LEVEL = 0  # the same results in half the time of compilation
    while True:
        try:
            name, seed = connection.recv()
        except EOFError:
            return
        limit = int(time.process_time() + LIMIT) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))
        connection.send(result(name, seed, duration))


def kind_of(name: str, seed: int) -> str:
    """All kinds in turn."""
    if name == "scene":
        return body_scenes.SCENES[seed // STARTS % len(body_scenes.SCENES)]
    kinds = ALL_KINDS if name == "run" else LOOPS
    return kinds[seed % len(kinds)]


def result(name: str, seed: int, duration: float) -> Found:
    """Run one mechanism in this process."""
    found = attempt(name, seed, duration)
    if found.outcome == "ended" and found.faults:
        coarse = found
        found = attempt(name, seed, duration, found.step / FINER)
        found.coarse = max(coarse.residual, coarse.gain, coarse.drift)
        found.seconds += coarse.seconds
    return found


def attempt(name: str, seed: int, duration: float, step: float | None = None) -> Found:
    """Run one mechanism with a step in s, or with its own."""
    found, began = Found(name, seed, kind_of(name, seed)), time.process_time()
    try:
        if name == "run":
            run(found, duration, step)
        elif name == "scene":
            scene(found, duration, step)
        else:
            throw(found, step)
    except EventError as error:
        found.outcome = NO_CONTACT_FORCES if "no contact forces are possible" in str(error) else "no impulses"
        found.message = str(error)
    except MbdSimError as error:
        found.outcome, found.message = type(error).__name__, str(error)
        if isinstance(error, MechanismError) and name == "scene":
            found.outcome = FILE_REFUSED
        if ": at the start " in str(error) or "Give positions in which they are apart" in str(error):
            found.outcome = REFUSED
    except Exception as error:
        found.outcome, found.message = f"traceback {type(error).__name__}", str(error)
    found.seconds = round(time.process_time() - began, 3)
    return found


def run(found: Found, duration: float, step: float | None) -> None:
    """One run of a mechanism with any coefficients."""
    sim = Simulation.from_text(contact_mechanism(found.seed, found.kind), step=step)
    measure = Measure(sim, found)
    try:
        sim.run(until=duration)
    finally:
        measure.end()


@lru_cache(maxsize=1)
def built(kind: str, number: int, step: float | None) -> Simulation:
    """The simulation of a mechanism of scenes, which the next scene takes as well."""
    return Simulation.from_text(body_scenes.scene(number, kind), step=step)


def scene(found: Found, duration: float, step: float | None) -> None:
    """One scene: a start of a mechanism."""
    sim = built(found.kind, found.seed // STARTS // len(body_scenes.SCENES), step)
    body_scenes.throw(sim, np.random.default_rng([found.seed, 2]))
    measure = Measure(sim, found)
    try:
        sim.run(until=duration)
    finally:
        measure.end()
        sim.observe_contacts(None)


def throw(found: Found, step: float | None) -> None:
    """A linkage with loops whose speeds are thrown again and again."""
    rng = np.random.default_rng([found.seed, 1])
    elastic, same = found.seed // len(LOOPS) % 2 == 1, found.seed // len(LOOPS) % 4 == 2
    e = 1.0 if elastic else round(float(rng.uniform()), 3) if same else None
    mu = 0.0 if elastic else round(float(rng.uniform()), 3) if same else None
    sim = Simulation.from_text(contact_mechanism(found.seed, found.kind, e, mu), step=step)
    measure = Measure(sim, found)
    sizes = np.maximum(np.abs(sim.u), 2.0)
    for _ in range(EPISODES):
        if found.impacts >= ENOUGH:
            break
        sim.reset(sim.q, rng.normal(size=sim.u.size) * sizes, nearest_speeds=True)
        start = sim.start_energy  # the speeds are those before the impacts of the start
        sim.run(until=EPISODE)
        measure.end()
        if elastic:
            found.drift = max(found.drift, abs(sim.energies.total - start) / measure.scale)


class Measure:
    """Observes the contacts of a simulation: the energies before and after each impact, apart from its stated loss."""

    def __init__(self, sim: Simulation, found: Found) -> None:
        self._sim, self._found, self._driven = sim, found, rheonomic(sim.mechanism)
        found.step = sim.step_size
        sim.observe_contacts(self)

    def impact(self, time: float, before: float, after: float) -> None:
        """Count an impact and what it gains, unless a drive works in it."""
        self._found.impacts += 1
        if not self._driven:
            self._found.gain = max(self._found.gain, (after - before) / (1.0 + abs(before)))

    def event(self, event: ContactEvent) -> None:
        """Count an event."""
        self._found.events += 1
        self._found.bounded += event.change is ContactChange.BOUND

    @property
    def scale(self) -> float:
        """The energies that have occurred in J, and 1 J."""
        energies = self._sim.energies
        parts = energies.kinetic, energies.potential, energies.dissipated, energies.work_applied, energies.work_drives
        return 1.0 + max(map(abs, (self._sim.start_energy, *parts)))

    def end(self) -> None:
        """Read what the run has led to."""
        sim, found = self._sim, self._found
        found.residual = max(found.residual, abs(sim.energies.residual) / self.scale)
        depth = max((-state.gap for state in sim.contacts().values()), default=0.0)
        if not np.all(np.isfinite(sim.state)) or not np.isfinite(found.residual):
            raise FloatingPointError("the state is not finite")
        if depth > DEPTH:
            raise ArithmeticError(f"a gap is {-depth:g}")


if __name__ == "__main__":
    main()
