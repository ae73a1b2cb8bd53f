"""Equilibria: configurations near the start in which a mechanism can stay at rest."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.analysis.linearization import ZERO_EIGENVALUE, linearize
from mbd_sim.dynamics.assembly import close_loops, is_short
from mbd_sim.dynamics.constraint_functions import ConstraintFunctions
from mbd_sim.dynamics.equations import Equations, require_equations
from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.geometry.pose import Array

ATTEMPTS, ITERATIONS = 12, 80
LONGEST_STEP = 0.3  # m or rad
BALANCED = 1e-9  # the acceleration that may remain, relative to that at the first guess
TIMES = (0.0, 0.137, 0.71, 1.9)  # s, at which accelerations are compared


def equilibrium(equations: Equations, inputs: Array | None = None) -> Array | None:
    """Coordinates (nq,) near the start in which the mechanism can stay at rest, or None if none is found.

    From the start and from other configurations around it, Gauss–Newton steps along the free directions reduce the
    accelerations to zero. A stable equilibrium is preferred to an unstable one.

    :param inputs: all inputs of the equations, for efforts, wrenches, commands and live values; by default there are no
        efforts and wrenches, commands are those at the start, and live values those of the mechanism.
    :raises TypeError: `equations` are none, for example a simulation.
    """
    require_equations(equations)
    given, nv = _given(equations, inputs), equations.layout.nv
    constraints = equations.constraints.with_values(given[equations.inputs.values])
    random, efforts = np.random.default_rng(2), given[equations.inputs.efforts]
    unstable: list[tuple[float, Array]] = []
    for attempt in range(ATTEMPTS):
        balanced = _balanced(equations, _scattered(constraints, equations.start.q, random, 2 * attempt), given)
        if balanced is None:
            continue
        rates = np.linalg.eigvals(linearize(equations, balanced, np.zeros(nv), efforts, inputs=given).a).real
        growth = float(np.max(rates, initial=0.0))
        if growth < ZERO_EIGENVALUE:
            return balanced
        unstable.append((growth, balanced))
    if not unstable:
        return _balanced(equations, equations.start.q, given, far=True)
    return min(unstable, key=lambda pair: pair[0])[1]


def equilibrium_near(equations: Equations, q: Array, inputs: Array | None = None) -> Array | None:
    """The equilibrium (nq,) next to coordinates q (nq,), stable or not, or None if none is found: see `equilibrium`."""
    given = _given(equations, inputs)
    found = _balanced(equations, q, given)
    return _balanced(equations, q, given, far=True) if found is None else found


def _given(equations: Equations, inputs: Array | None) -> Array:
    return equations.inputs_without_commands if inputs is None else inputs


def is_autonomous(equations: Equations) -> bool:
    """Whether accelerations and constraints do not depend on time, judged by their values at the start at `TIMES`."""
    constraints, q = equations.constraints, equations.start.q
    if any(np.abs(constraints.drift(t, q)).max(initial=0.0) > 1e-9 for t in TIMES):
        return False
    y = equations.start_state
    inputs = equations.inputs_without_commands
    first, *others = (np.array(equations.rates.call([t, y, inputs])[0]) for t in TIMES)
    return all(np.allclose(first, other, rtol=1e-9, atol=1e-9) for other in others)


def _scattered(constraints: ConstraintFunctions, q: Array, random: np.random.Generator, steps: int) -> Array:
    """A configuration (nq,) some steps away from q, in a random free direction."""
    all_free, direction = np.ones(constraints.gradient(0.0, q).shape[1], dtype=bool), None
    for _ in range(steps):
        free = constraints.free_directions(0.0, q)
        components = random.normal(size=free.shape[1]) if direction is None else free.T @ direction
        direction = free @ components
        direction *= LONGEST_STEP / max(float(np.max(np.abs(direction), initial=0.0)), 1e-300)
        closing = close_loops(constraints, 0.0, constraints.displaced(q, direction), all_free)
        if not closing.closed:
            break
        q = closing.q
    return q


def _balanced(equations: Equations, q: Array, inputs: Array, far: bool = False) -> Array | None:
    """The configuration (nq,) near q without accelerations, by Gauss–Newton, or None if there is none.

    If it may be `far` away, the longest step doubles after each one that it limits, and the last one has to be short:
    accelerations that only vanish at infinity, as 1/x² does, have no equilibrium.
    """
    nq, nv = equations.layout.nq, equations.layout.nv
    constraints, all_free = equations.constraints.with_values(inputs[equations.inputs.values]), np.ones(nv, dtype=bool)

    def at_rest(q: Array) -> Array:
        return np.concatenate([q, np.zeros(equations.start_state.size - nq)])

    def accelerations(q: Array) -> Array:
        y = at_rest(q)
        return np.array(equations.rates.call([0.0, y, inputs])[0]).ravel()[nq : nq + nv]

    best, least, scale, longest, converged = None, math.inf, 1.0, LONGEST_STEP, False
    for iteration in range(ITERATIONS):
        closing = close_loops(constraints, 0.0, q, all_free) if equations.rows else None
        if closing is not None:
            if not closing.closed:
                break
            q = closing.q
        remaining = accelerations(q)
        size = float(np.linalg.norm(remaining))
        scale = max(scale, size) if iteration == 0 else scale
        if not math.isfinite(size) or (least <= BALANCED * scale and size >= 0.5 * least):
            break
        if size < least:
            best, least = q, size
        free = constraints.free_directions(0.0, q)
        slope = evaluated(equations.derivatives, 0.0, at_rest(q), inputs)[:nv, :nv].T @ free
        step = -free @ np.linalg.lstsq(slope, remaining, rcond=1e-10)[0]
        if best is q:
            converged = not far or is_short(constraints, step, q)
        factor = min(1.0, longest / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
        longest *= 2.0 if far and factor < 1.0 else 1.0
        q = constraints.displaced(q, factor * step)
    return best if converged and least <= BALANCED * scale else None
