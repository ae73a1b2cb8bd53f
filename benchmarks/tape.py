"""The rates of a mechanism's state as a list of scalar operations, for simulators that take equations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from mbd_sim.simulation.run.simulation import BaseSimulation

OPERATIONS: dict[str, Callable[..., Any]] = {
    "ASSIGN": lambda x: x,
    "NEG": lambda x: -x,
    "SQ": lambda x: x * x,
    "TWICE": lambda x: x + x,
    "INV": lambda x: 1.0 / x,
    "ADD": lambda x, y: x + y,
    "SUB": lambda x, y: x - y,
    "MUL": lambda x, y: x * y,
    "DIV": lambda x, y: x / y,
}
GUARDS: dict[str, Callable[..., Any]] = {
    "LT": lambda x, y: float(x < y),
    "LE": lambda x, y: float(x <= y),
    "FMAX": max,
    "FMIN": min,
}


@dataclass(frozen=True)
class Tape:
    """`steps` are (operation, place of the result, places of the arguments), all places in one list of `places`.

    An INPUT has (its index in [q, u],) as arguments, a CONST its value; an OUTPUT is the rate of that entry.
    """

    places: int
    steps: tuple[tuple[str, int, tuple[Any, ...]], ...]

    def run(self, state: list[Any], sin: Callable[[Any], Any], cos: Callable[[Any], Any]) -> list[Any]:
        """The rates of a state [q, u] of numbers, or of anything that can be added and multiplied."""
        work: list[Any] = [None] * self.places
        outputs: dict[int, Any] = {}
        functions = {**OPERATIONS, "SIN": sin, "COS": cos}
        for operation, target, sources in self.steps:
            if operation == "INPUT":
                work[target] = state[sources[0]]
            elif operation == "CONST":
                work[target] = sources[0]
            elif operation == "OUTPUT":
                outputs[target] = work[sources[0]]
            else:
                work[target] = functions[operation](*(work[place] for place in sources))
        return [outputs[index] for index in sorted(outputs)]


def tape_of(sim: BaseSimulation) -> Tape:
    """The rates of [q, u] without efforts at t = 0.

    Minima, maxima and comparisons, which guard against singular configurations, are evaluated at the start state: the
    tape is valid only away from such configurations.

    :raises ValueError: an operation is not supported by tapes.
    """
    import casadi as ca

    names = {getattr(ca, name): name[3:] for name in dir(ca) if name.startswith("OP_")}
    rates, count = sim.model.equations.rates, sim.model.u_range.stop
    start = np.concatenate([sim.q, sim.u])
    work = [0.0] * rates.sz_w()
    numeric = {**OPERATIONS, **GUARDS, "SIN": math.sin, "COS": math.cos}
    steps: list[tuple[str, int, tuple[Any, ...]]] = []
    for index in range(rates.n_instructions()):
        operation = names[rates.instruction_id(index)]
        target, sources = rates.instruction_output(index), rates.instruction_input(index)
        if operation == "OUTPUT":
            if target[0] == 0 and target[1] < count:
                steps.append(("OUTPUT", target[1], (sources[0],)))
            continue
        into = target[0]
        if operation == "INPUT" and sources[0] == 1 and sources[1] < count:
            steps.append(("INPUT", into, (sources[1],)))
            work[into] = start[sources[1]]
        elif operation in ("INPUT", "CONST"):
            work[into] = rates.instruction_constant(index) if operation == "CONST" else 0.0
            steps.append(("CONST", into, (work[into],)))
        elif operation not in numeric:
            raise ValueError(f"{sim.mechanism.name}: the equations contain {operation}, which tapes do not support")
        else:
            values = [work[place] for place in sources]
            work[into] = numeric[operation](*values)
            if operation in ("FMAX", "FMIN"):
                steps.append(("ASSIGN", into, (sources[values.index(work[into])],)))
            elif operation in GUARDS:
                steps.append(("CONST", into, (work[into],)))
            else:
                steps.append((operation, into, tuple(sources)))
    return Tape(rates.sz_w(), tuple(steps))
