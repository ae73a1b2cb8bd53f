"""`ros2 run mbd_sim example_identify run.mcap inertia=0.03 damping=0.01`: identifies parameters from a recording.

The recording holds the states, and the efforts with the steps at which they took effect: what `identify` of
`mbd_sim.studies.optimization` needs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, MbdSimError, counted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.load import parse_mechanism
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.simulation.run.events import RESTARTS, parse_event
from mbd_sim.studies.optimization.identification import Identification, identify
from mbd_sim.studies.optimization.measured_runs import MeasuredRun

WORDS = "recordings of the same mechanism, and a guess for each parameter to identify"


@dataclass(frozen=True, eq=False)
class RecordedStates:
    """A recording up to its first reset: states (n, nv) at `ticks` (n,), and efforts (nv,) with their first ticks."""

    text: str
    method: str
    step: float
    ticks: NDArray[np.int64]
    q: Array
    u: Array
    efforts: list[tuple[int, Array]]


def read(path: str | Path) -> RecordedStates:
    """Read a recording of `sim_node`.

    :raises MbdSimError: it holds no states of a mechanism whose coordinates all have their own joint.
    """
    states: list[tuple[int, Array, Array]] = []
    efforts: list[tuple[int, Array]] = []
    recording = open_recording(path)
    about = recording.about
    if not about:
        raise InputError(f"'{path}' is not the recording of a mechanism", "Record a run with sim_node.")
    count = len(json.loads(about["coordinates"]))
    if "inputs" in about:  # those of the first state, the efforts first
        inputs = [float.fromhex(value) for value in json.loads(about["inputs"])]
        efforts.append((int(about["first_tick"]), np.array(inputs[:count])))
    for message in recording.messages():
        name = message.topic.rsplit("/", 1)[1]
        if name == "events" and parse_event(recording.decoded(message)).kind in RESTARTS:
            break
        if name == "applied_efforts":
            efforts.append((message.sequence, recording.decoded(message).values))
        elif name == "joint_states":
            state = recording.decoded(message)
            states.append((message.sequence, state.position[:count], state.velocity[:count]))
    if len(states) < 3:
        held = counted(len(states), "state")
        raise InputError(f"'{path}' holds {held} before its first reset", "Record a longer run.")
    ticks, q, u = (np.array(column) for column in zip(*states, strict=True))
    step = float.fromhex(about["step"])
    return RecordedStates(recording.mechanism_text or "", about["method"], step, ticks, q, u, efforts)


def measured(run: RecordedStates) -> MeasuredRun:
    """A recorded run as `identify` takes it: nan at the steps whose states were not recorded."""
    steps = run.ticks - run.ticks[0]
    states = np.full((steps[-1] + 1, run.q.shape[1] + run.u.shape[1]), np.nan)
    states[steps] = np.hstack([run.q, run.u])
    efforts = np.zeros((steps[-1], run.u.shape[1]))
    for tick, values in run.efforts:
        efforts[max(tick - run.ticks[0], 0) :] = values
    return MeasuredRun(run.step, states, efforts, start=float(run.ticks[0]) * run.step)


def identified(runs: Sequence[RecordedStates], guess: Mapping[str, float], piece: float) -> Identification:
    """The parameters from recordings that are cut into pieces (s), each from a start state of its own on.

    :raises MbdSimError: the recordings are of different mechanisms, or see `identify`.
    """
    run = runs[0]
    if any((other.text, other.method, other.step) != (run.text, run.method, run.step) for other in runs):
        raise InputError("the recordings differ in mechanism, method or step", "Give recordings of the same mechanism.")
    data, interval = [measured(one) for one in runs], max(round(piece / run.step), 1)
    return identify(parse_mechanism(run.text), data, guess, interval=interval, method=run.method)


def recordings_and_guesses(words: Sequence[str]) -> tuple[list[str], dict[str, float]]:
    """The recordings, and the guesses of the parameters, which contain an equals sign.

    :raises MbdSimError: one of them is missing, or a guess is not a positive number.
    """
    paths = [word for word in words if "=" not in word]
    guess: dict[str, float] = {}
    for name, _, text in (word.partition("=") for word in words if "=" in word):
        try:
            guess[name] = float(text)
        except ValueError:
            guess[name] = 0.0
        if not 0.0 < guess[name] < float("inf"):
            raise InputError(f"{name}={text}: '{text}' is not a positive number", f"Write for example {name}=0.03.")
    if not paths or not guess:
        missing = "recording" if not paths else "guess"
        raise InputError(f"no {missing} is given", "Write for example: example_identify run.mcap inertia=0.03")
    return paths, guess


def main(arguments: Sequence[str] | None = None) -> int:
    """Identify parameters, and print them beside the values of the recorded mechanism."""
    parser = argparse.ArgumentParser(prog="example_identify", description="Identifies parameters from recordings.")
    parser.add_argument("words", nargs="+", metavar="RUN.mcap | NAME=VALUE", help=WORDS)
    parser.add_argument("--piece", type=float, default=0.5, help="length in s of the simulated intervals (default 0.5)")
    options = parser.parse_args(arguments)
    try:
        paths, guess = recordings_and_guesses(options.words)
        runs = [read(path) for path in paths]
        estimates = identified(runs, guess, options.piece).estimates
        truth = parse_mechanism(runs[0].text).parameters
    except (MbdSimError, ValueError, OSError) as error:
        print(f"example_identify: {error}", file=sys.stderr)
        return 1
    print(f"{'parameter':12} {'guess':>10} {'found':>12} {'± error':>10} {'in the run':>12} {'off':>9}")
    for name, parameter in estimates.items():
        off = abs(parameter.value / truth[name] - 1.0)
        figures = f"{parameter.value:12.8g} {parameter.error:10.1e} {truth[name]:12.8g} {off:9.1e}"
        print(f"{name:12} {guess[name]:10.4g} {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
