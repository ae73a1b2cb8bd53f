"""`ros2 run mbd_sim example_identify run.mcap inertia=0.03 damping=0.01`: identifies parameters from a recording.

The recording holds the states, and the efforts with the steps at which they took effect. The mechanism is simulated
with guessed parameters over short intervals, each from a recorded state on, and the guesses are improved until the
simulation agrees with the recording (output error with the Gauss-Newton method; Ljung 1999, sec. 10.2).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
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
from mbd_sim.simulation.events import RESTARTS, parse_event
from mbd_sim.simulation.simulation import Simulation

WORDS = "recordings of the same mechanism, and a guess for each parameter to identify"
MAX_ITERATIONS, CONVERGED = 30, 1e-7  # relative change of the parameters at which the search ends
NOISE_LIMIT = 1e-3  # the same where noise and finite differences allow no further improvement
DIFFERENCE = 1e-4  # relative step of the finite differences
TYPES = {"joint_states": JointState, "applied_efforts": Float64MultiArray, "events": String}


@dataclass(frozen=True, eq=False)
class Run:
    """A recording up to its first reset: states (n, nv) at `ticks` (n,), and efforts (nv,) with their first ticks."""

    text: str
    method: str
    step: float
    ticks: Array
    q: Array
    u: Array
    efforts: list[tuple[int, Array]]


class ParameterEstimate(NamedTuple):
    """An identified parameter and its standard error; noise in the intervals' initial states makes it too small."""

    value: float
    error: float


Estimates = dict[str, ParameterEstimate]


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
        if "inputs" in about:  # those of the first state, the efforts first
            inputs = [float.fromhex(value) for value in json.loads(about["inputs"])]
            efforts.append((int(about["first_tick"]), np.array(inputs[: len(names)])))
        for _, channel, message in reader.iter_messages():
            name = channel.topic.rsplit("/", 1)[1]
            if name not in TYPES:
                continue
            content = deserialize_message(message.data, TYPES[name])
            if name == "events" and parse_event(content.data).kind in RESTARTS:
                break
            if name == "applied_efforts":
                efforts.append((message.sequence, np.array(content.data)))
            elif name == "joint_states":
                states.append((message.sequence, content.position[: len(names)], content.velocity[: len(names)]))
    if len(states) < 3:
        raise MbdSimError(f"'{path}' holds {len(states)} states before its first reset. Record a longer run.")
    ticks, q, u = zip(*states, strict=True)
    return Run(text, about["method"], float.fromhex(about["step"]), np.array(ticks), np.array(q), np.array(u), efforts)


def identify(runs: Run | Sequence[Run], guess: Mapping[str, float], interval: float = 0.5) -> Estimates:
    """Improve guessed parameters until simulations over intervals (s) from recorded states on match the recordings.

    Several runs must be of the same mechanism, method and step.

    :raises MbdSimError: an unknown parameter, one that is built into the equations such as a length, or guesses from
        which the search does not converge.
    """
    runs = [runs] if isinstance(runs, Run) else list(runs)
    run = runs[0]
    if any((other.text, other.method, other.step) != (run.text, run.method, run.step) for other in runs):
        raise MbdSimError("the recordings differ in mechanism, method or step. Give recordings of the same mechanism.")
    mechanism, keys = parse_mechanism(run.text), [f"parameters.{name}" for name in guess]
    for name in guess:
        if name not in mechanism.parameters:
            raise MbdSimError(f"the mechanism has no parameter '{name}'. {nearest(name, mechanism.parameters)}")
    simulation = Simulation(mechanism, method=run.method, step=run.step, live=keys)
    recorded = [np.hstack([one.q, one.u]) for one in runs]
    scale = np.std(np.concatenate(recorded), axis=0)
    scale[scale == 0.0] = 1.0

    def residuals(values: Array) -> Array:
        simulation.set_live(dict(zip(keys, values.tolist(), strict=True)))
        errors = [
            (_predicted(simulation, one, interval) - q_u) / scale for one, q_u in zip(runs, recorded, strict=True)
        ]
        return np.concatenate([error.ravel() for error in errors])

    values, errors = _least_squares(residuals, np.array(list(guess.values()), dtype=float))
    return {name: ParameterEstimate(*pair) for name, *pair in zip(guess, values.tolist(), errors.tolist(), strict=True)}


def _least_squares(residuals: Callable[[Array], Array], values: Array) -> tuple[Array, Array]:
    """The parameters that minimize the sum of squared residuals, and their standard errors.

    Levenberg-Marquardt iteration on the logarithms of the parameters, so that none changes its sign.

    :raises MbdSimError: no convergence.
    """
    current, damping = residuals(values), 1e-3
    for _ in range(MAX_ITERATIONS):
        jacobian = np.column_stack(
            [(residuals(values * (1 + DIFFERENCE * e)) - current) / DIFFERENCE for e in np.eye(len(values))]
        )
        normal = jacobian.T @ jacobian
        remaining = float(np.max(np.abs(np.linalg.lstsq(jacobian, current, rcond=None)[0])))
        while damping < 1e9:
            change = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), jacobian.T @ current)
            candidate = values * np.exp(np.clip(change, -1.0, 1.0))
            tried = residuals(candidate)
            if tried @ tried <= current @ current:
                break
            damping *= 10.0
        else:
            candidate, tried = values, current
        stuck = candidate is values
        values, current, damping = candidate, tried, damping / 10.0
        if remaining < (NOISE_LIMIT if stuck else CONVERGED):
            variance = current @ current / max(current.size - len(values), 1)
            return values, np.sqrt(variance * np.diag(np.linalg.pinv(normal))) * np.abs(values)
        if stuck:
            break
    raise MbdSimError("the search for the parameters did not converge. Use better guesses, or shorter intervals.")


def _predicted(simulation: Simulation, run: Run, interval: float) -> Array:
    """The states (n, 2 nv) of a simulation that restarts from the recorded state every `interval` seconds."""
    simulation.reset(run.q[0], run.u[0])
    changes = iter([*run.efforts, (sys.maxsize, np.zeros(0))])
    next_tick, next_efforts = next(changes)
    efforts, start, tick, states = np.zeros(simulation.u.size), -sys.maxsize, int(run.ticks[0]), []
    for recorded_tick, q, u in zip(run.ticks.tolist(), run.q, run.u, strict=True):
        while tick < recorded_tick:
            while next_tick <= tick:
                efforts, (next_tick, next_efforts) = next_efforts, next(changes)
                simulation.set_efforts(efforts)
            until = min(recorded_tick, next_tick)
            simulation.step(until - tick)
            tick = until
        states.append(np.concatenate([simulation.q, simulation.u]))
        if (recorded_tick - start) * run.step >= interval:
            start = recorded_tick
            simulation.reset(q, u)
            simulation.set_efforts(efforts)
    return np.array(states)


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
            raise MbdSimError(f"{name}={text}: '{text}' is not a positive number. Write for example {name}=0.03.")
    if not paths or not guess:
        missing = "recording" if not paths else "guess"
        raise MbdSimError(f"no {missing} is given. Write for example: example_identify run.mcap inertia=0.03")
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
        estimates = identify(runs, guess, options.piece)
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
