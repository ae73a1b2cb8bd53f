"""Small motions about a state: the equations linearized exactly, equilibria, and natural frequencies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from mbd_sim.dynamics.assembly import close_loops, null_space
from mbd_sim.dynamics.constraint_functions import ConstraintFunctions
from mbd_sim.dynamics.equations import Equations
from mbd_sim.geometry.pose import Array

STARTS, ITERATIONS, LONGEST = 12, 80, 0.3
STILL = 1e-4  # 1/s, below which an eigenvalue is a zero that round-off has split
UNDAMPED = 1e-12  # damping ratios of round-off
BALANCED = 1e-9  # of the largest free acceleration, what an equilibrium may leave


@dataclass(frozen=True, eq=False)
class Linearization:
    """x' = A x + B e about a state, where x = (p, w): displacements and speeds along the free directions.

    `a` is (n, n) and `b` (n, efforts), found by exact differentiation. A displacement is q_rates(d) with
    d = `displacements` (nv, k) p, and a change of the speeds `speeds` (nv, l) w. Without constraints both are the
    identity, so that x is the change of q (along the speeds) and of u.
    """

    a: Array
    b: Array
    displacements: Array
    speeds: Array


class Mode(NamedTuple):
    """One natural motion: undamped `frequency` in Hz, `damping` ratio, and the `eigenvalue` in 1/s.

    A real eigenvalue is a motion that does not oscillate: its frequency is 0 and its damping ratio 1, or -1 where
    it grows.
    """

    frequency: float
    damping: float
    eigenvalue: complex


def linearize(equations: Equations, q: Array, u: Array, efforts: Array, t: float = 0.0) -> Linearization:
    """Linearize about a state that meets the constraints."""
    constraints, (nq, nv) = equations.constraints, (equations.layout.nq, equations.layout.nv)
    by_state, by_efforts, to_rates = _derivatives(equations)(t, q, u, efforts)
    slopes, forces, n = np.array(by_state), np.array(by_efforts), np.array(to_rates)
    gradient = constraints.gradient(t, q)
    displacements = null_space(gradient[constraints.holonomic])
    speeds = null_space(gradient)
    if not len(gradient):
        displacements = speeds = np.eye(nv)
    along, across = slopes[:, :nq] @ n @ displacements, slopes[:, nq:]
    # Speeds that fit the displaced constraints are not only combinations of the free directions.
    turning = _turning(constraints, t, q, u, displacements)
    back, on = np.linalg.pinv(displacements), np.linalg.pinv(speeds)
    a = np.block([[back @ turning, back @ speeds], [on @ (along + across @ turning), on @ across @ speeds]])
    return Linearization(a, np.vstack([np.zeros((displacements.shape[1], nv)), on @ forces]), displacements, speeds)


def _derivatives(equations: Equations) -> ca.Function:
    nq, nv = equations.layout.nq, equations.layout.nv
    t, q, u, efforts = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv), ca.SX.sym("e", nv)
    y = ca.vertcat(q, u, ca.SX.zeros(equations.start_state.size - nq - nv))
    rates = equations.rates.call([t, y, efforts])[0]
    accelerations = rates[nq : nq + nv]
    outputs = [
        ca.jacobian(accelerations, ca.vertcat(q, u)),
        ca.jacobian(accelerations, efforts),
        ca.jacobian(rates[:nq], u),
    ]
    return ca.Function("derivatives", [t, q, u, efforts], [ca.densify(output) for output in outputs])


def _turning(constraints: ConstraintFunctions, t: float, q: Array, u: Array, displacements: Array) -> Array:
    """How the speeds must change (nv, k) with a displacement for the constraints to hold; zero where nothing moves."""
    gradient = constraints.gradient(t, q)
    if not len(gradient) or not u.any():
        return np.zeros((len(u), displacements.shape[1]))
    columns, h = [], 1e-6
    for direction in displacements.T:
        ahead, behind = (constraints.displaced(q, sign * h * direction) for sign in (1.0, -1.0))
        slope = [constraints.gradient(t, at) @ u + constraints.drift(t, at) for at in (ahead, behind)]
        columns.append(-np.linalg.lstsq(gradient, (slope[0] - slope[1]) / (2.0 * h), rcond=None)[0])
    return np.array(columns).T


def equilibrium(equations: Equations) -> Array | None:
    """Coordinates (nq,) near the start in which the mechanism can stay at rest, or None where none is found.

    From the start and some places around it, the state is moved along the free directions by Gauss and Newton until
    no acceleration is left; a stable equilibrium is preferred.
    """
    constraints, nv = equations.constraints, equations.layout.nv
    random = np.random.default_rng(2)
    found: list[tuple[float, Array]] = []
    for attempt in range(STARTS):
        balanced = _balance(equations, _wandered(constraints, equations.start.q, random, 2 * attempt))
        if balanced is None:
            continue
        rates = np.linalg.eigvals(linearize(equations, balanced, np.zeros(nv), np.zeros(nv)).a).real
        growth = float(np.max(rates, initial=0.0))
        if growth < STILL:
            return balanced
        found.append((growth, balanced))
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _wandered(constraints: ConstraintFunctions, q: Array, random: np.random.Generator, steps: int) -> Array:
    """A configuration some steps away along one of the free directions."""
    everything, direction = np.ones(constraints.gradient(0.0, q).shape[1], dtype=bool), None
    for _ in range(steps):
        free = null_space(constraints.gradient(0.0, q))
        wish = random.normal(size=free.shape[1]) if direction is None else free.T @ direction
        direction = free @ wish
        direction *= LONGEST / max(float(np.max(np.abs(direction), initial=0.0)), 1e-300)
        closing = close_loops(constraints, 0.0, constraints.displaced(q, direction), everything)
        if not closing.closed:
            break
        q = closing.q
    return q


def _balance(equations: Equations, q: Array) -> Array | None:
    constraints, (nq, nv) = equations.constraints, (equations.layout.nq, equations.layout.nv)
    look, at_rest = _derivatives(equations), np.zeros(nv)
    everything = np.ones(nv, dtype=bool)

    def defect(q: Array) -> Array:
        y = np.concatenate([q, at_rest, np.zeros(3)])
        return np.array(equations.rates.call([0.0, y, at_rest])[0]).ravel()[nq : nq + nv]

    best, least, scale = None, math.inf, 1.0
    for iteration in range(ITERATIONS):
        closing = close_loops(constraints, 0.0, q, everything) if equations.rows else None
        if closing is not None:
            if not closing.closed:
                break
            q = closing.q
        off = defect(q)
        size = float(np.linalg.norm(off))
        scale = max(scale, size) if iteration == 0 else scale
        if not math.isfinite(size) or (least <= BALANCED * scale and size >= 0.5 * least):
            break
        if size < least:
            best, least = q, size
        free = null_space(constraints.gradient(0.0, q))
        by_state, _, to_rates = (np.array(value) for value in look(0.0, q, at_rest, at_rest))
        slope = by_state[:, :nq] @ to_rates @ free
        step = -free @ np.linalg.lstsq(slope, off, rcond=1e-10)[0]
        step *= min(1.0, LONGEST / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
        q = constraints.displaced(q, step)
    return best if least <= BALANCED * scale else None


def is_autonomous(equations: Equations) -> bool:
    """Whether accelerations and constraints are the same at all times, as far as some moments after the start show."""
    constraints, q = equations.constraints, equations.start.q
    moments = (0.0, 0.137, 0.71, 1.9)
    if any(np.abs(constraints.drift(t, q)).max(initial=0.0) > 1e-9 for t in moments):
        return False
    y = equations.start_state
    still = np.zeros(equations.layout.nv)
    first, *others = (np.array(equations.rates.call([t, y, still])[0]) for t in moments)
    return all(np.allclose(first, other, rtol=1e-9, atol=1e-9) for other in others)


def modes(linearization: Linearization) -> list[Mode]:
    """The natural motions, the slowest first; of a pair of conjugates one."""
    values = np.linalg.eigvals(linearization.a)
    found = []
    for value in values:
        if value.imag < -1e-9 * abs(value):
            continue
        size = float(abs(value))
        oscillates = abs(value.imag) > 1e-7 * max(size, 1e-9)
        if size < STILL:
            found.append(Mode(0.0, 0.0, 0j))
        elif oscillates:
            damping = float(-value.real / size)
            found.append(Mode(size / (2.0 * math.pi), damping if abs(damping) > UNDAMPED else 0.0, complex(value)))
        else:
            found.append(Mode(0.0, -math.copysign(1.0, value.real), complex(value.real)))
    return sorted(found, key=lambda mode: (mode.frequency, abs(mode.eigenvalue), mode.eigenvalue.real))
