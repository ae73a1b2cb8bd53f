"""`ros2 run mbd_sim example_identify run.mcap inertia=0.03 damping=0.01`: parameters of a mechanism from a recording.

The recording says which efforts took effect at which step, and what the joints did. The mechanism is simulated with
guessed parameters from recorded states on, a piece at a time, and the guesses are improved until it does the same
(output error with Gauss and Newton; Ljung 1999, sec. 10.2).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from mbd_sim.errors import MbdSimError, nearest
from mbd_sim.geometry.pose import Array
from mbd_sim.load import parse_mechanism
from mbd_sim.simulation.events import EventKind, parse_event
from mbd_sim.simulation.simulation import Simulation

ITERATIONS, CONVERGED = 30, 1e-7
NEAR = 1e-3  # of a parameter, where noise and the differences let it go no further
DIFFERENCE = 1e-4  # of a parameter, for the slopes
TYPES = {"joint_states": JointState, "applied_efforts": Float64MultiArray, "events": String}


@dataclass(frozen=True, eq=False)
class Run:
    """A recording up to its first reset: states (n, nv) at `ticks` (n,), and the efforts (nv,) from their ticks on."""

    text: str
    method: str
    step: float
    ticks: Array
    q: Array
    u: Array
    efforts: list[tuple[int, Array]]


class Found(NamedTuple):
    """A parameter, with its standard error; noise in the states that pieces begin with makes it too small."""

    value: float
    error: float


def read(path: str | Path) -> Run:
    """Read a recording of `sim_node`.

    :raises MbdSimError: it holds no states of a mechanism whose coordinates all have their own joint.
    """
    states: list[tuple[int, list[float], list[float]]] = []
    efforts: list[tuple[int, Array]] = []
    with Path(path).open("rb") as stream:
        reader = make_reader(stream)
        text = next(reader.iter_attachments()).data.decode()
        about = next(record.metadata for record in reader.iter_metadata() if record.name == "mbd_sim")
        names = json.loads(about["coordinates"])
        for _, channel, message in reader.iter_messages():
            kind = channel.topic.rsplit("/", 1)[1]
            if kind not in TYPES:
                continue
            content = deserialize_message(message.data, TYPES[kind])
            if kind == "events" and parse_event(content.data).kind is EventKind.RESET:
                break
            if kind == "applied_efforts":
                efforts.append((message.sequence, np.array(content.data)))
            elif kind == "joint_states":
                states.append((message.sequence, content.position[: len(names)], content.velocity[: len(names)]))
    if len(states) < 3:
        raise MbdSimError(f"'{path}' holds {len(states)} states before its first reset. Record a longer run.")
    ticks, q, u = zip(*states, strict=True)
    return Run(text, about["method"], float.fromhex(about["step"]), np.array(ticks), np.array(q), np.array(u), efforts)


def identify(run: Run, guess: Mapping[str, float], piece: float = 0.5) -> dict[str, Found]:
    """Improve guessed parameters until pieces of `piece` seconds, begun in recorded states, go as they were recorded.

    :raises MbdSimError: an unknown parameter, one that is built into the equations such as a length, or guesses from
        which the search does not come to an end.
    """
    mechanism, keys = parse_mechanism(run.text), [f"parameters.{name}" for name in guess]
    for name in guess:
        if name not in mechanism.parameters:
            raise MbdSimError(f"the mechanism has no parameter '{name}'. {nearest(name, mechanism.parameters)}")
    simulation = Simulation(mechanism, method=run.method, step=run.step, live=keys)
    names, values = tuple(guess), np.array(list(guess.values()), dtype=float)
    scale = np.concatenate([np.std(run.q, axis=0), np.std(run.u, axis=0)])
    scale[scale == 0.0] = 1.0

    def misses(values: Array) -> Array:
        simulation.set_live(dict(zip(keys, values.tolist(), strict=True)))
        predicted = _predicted(simulation, run, piece)
        return np.asarray((predicted - _recorded(run)) / scale).ravel()

    off, damping = misses(values), 1e-3
    for _ in range(ITERATIONS):
        slopes = np.column_stack(
            [(misses(values * (1 + DIFFERENCE * e)) - off) / DIFFERENCE for e in np.eye(len(names))]
        )
        normal = slopes.T @ slopes
        left = float(np.max(np.abs(np.linalg.lstsq(slopes, off, rcond=None)[0])))
        while damping < 1e9:  # Levenberg and Marquardt: relative changes, so that no parameter changes its sign
            change = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), slopes.T @ off)
            better = values * np.exp(np.clip(change, -1.0, 1.0))
            tried = misses(better)
            if tried @ tried <= off @ off:
                break
            damping *= 10.0
        else:
            better, tried = values, off
        stuck = better is values
        values, off, damping = better, tried, damping / 10.0
        if left < (NEAR if stuck else CONVERGED):
            spread = np.sqrt(off @ off / max(off.size - len(names), 1) * np.diag(np.linalg.pinv(normal)))
            errors = (spread * np.abs(values)).tolist()
            return {name: Found(*pair) for name, *pair in zip(names, values.tolist(), errors, strict=True)}
        if stuck:
            break
    raise MbdSimError("the search for the parameters came to no end. Begin with better guesses, or shorter pieces.")


def _recorded(run: Run) -> Array:
    return np.hstack([run.q, run.u])


def _predicted(simulation: Simulation, run: Run, piece: float) -> Array:
    """The states (n, 2 nv) of a simulation that starts anew in the recorded state every `piece` seconds."""
    simulation.reset(run.q[0], run.u[0])
    changes = iter([*run.efforts, (sys.maxsize, np.zeros(0))])
    due, due_efforts = next(changes)
    efforts, began, tick, found = np.zeros(simulation.u.size), -sys.maxsize, int(run.ticks[0]), []
    for at, q, u in zip(run.ticks.tolist(), run.q, run.u, strict=True):
        while tick < at:
            while due <= tick:
                efforts, (due, due_efforts) = due_efforts, next(changes)
                simulation.set_efforts(efforts)
            until = min(at, due)
            simulation.step(until - tick)
            tick = until
        found.append(np.concatenate([simulation.q, simulation.u]))
        if (at - began) * run.step >= piece:
            began = at
            simulation.reset(q, u)
            simulation.set_efforts(efforts)
    return np.array(found)


def main(arguments: Sequence[str] | None = None) -> int:
    """Identify, and print what was found beside what the recording's mechanism says."""
    parser = argparse.ArgumentParser(prog="example_identify", description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("guess", nargs="+", help="name=value of each parameter to find")
    parser.add_argument("--piece", type=float, default=0.5, help="seconds that are simulated at a time")
    options = parser.parse_args(arguments)
    try:
        guess = {name: float(value) for name, _, value in (item.partition("=") for item in options.guess)}
        run = read(options.recording)
        found = identify(run, guess, options.piece)
        truth = parse_mechanism(run.text).parameters
    except (MbdSimError, ValueError, OSError) as error:
        print(f"example_identify: {error}", file=sys.stderr)
        return 1
    print(f"{'parameter':12} {'guess':>10} {'found':>12} {'± error':>10} {'in the run':>12} {'off':>9}")
    for name, parameter in found.items():
        off = abs(parameter.value / truth[name] - 1.0)
        figures = f"{parameter.value:12.8g} {parameter.error:10.1e} {truth[name]:12.8g} {off:9.1e}"
        print(f"{name:12} {guess[name]:10.4g} {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
