"""Many sets of parameters of a mechanism at once, and how far each is from a goal.

All configurations are closed together by Newton's method, in groups of fixed size, so that the result of one candidate
does not depend on the others, nor on the process that computes it. The motion is followed from the first position of
the drive on, in small steps, from every assembly mode; of the modes, the one that serves the goal best counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.math.expressions import evaluated_for_all
from mbd_sim.studies.kinematic_analysis.modes import modes_at
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem
from mbd_sim.studies.synthesis.conditions import Condition, measured
from mbd_sim.studies.synthesis.problem import DesignProblem, EffortGoal, FunctionGoal, Goal, PathGoal

FIRST, NEXT = 30, 12  # most iterations of Newton's method at the first position, and at the following ones
LONGEST = 0.5  # step of Newton's method, rad or sizes of the mechanism
SETTLED = 1e-5  # step after which the error is about its square
CLOSED = 1e-3  # gap before this step, in natural units: that of loops that can be closed is about as small
STRIDE = 0.35  # of the drive between two positions, rad or sizes of the mechanism
FARTHEST = 1.2  # motion in a stride, rad or sizes: beyond it, another branch was met
REGULAR = 1e-14  # relative to the squared singular values: keeps the equations at dead points solvable
UNREACHED = 1e12  # loss of candidates that cannot be assembled at all positions
PENALTY = 10.0  # typical losses for a violation as large as the value
FREE_POSITIONS = 4  # of the drive for each point of a path with free timing


@dataclass(frozen=True, eq=False)
class ParameterCandidates:
    """The functions of one problem with plain numbers, which other processes can take over.

    `grid` (g,) are the positions of the drive, `rows` (n,) those of the goal in it, and `starts` (k, nq) the
    configurations from which the first position is searched.
    """

    goal: Goal
    norm: str
    grid: Array
    rows: NDArray[np.intp]
    starts: Array
    numbers: ca.Function  # of parameters
    closing: ca.Function  # of q and numbers: gaps and gradient in natural units
    checks: ca.Function  # of q and numbers: positive in the right assembly mode of each joint
    displaced: ca.Function  # of q, a displacement and numbers
    quantity: ca.Function  # of q, u, u' and parameters
    bias: ca.Function  # of q, u and numbers, in natural units
    scales: Array  # (nv,)
    driven: tuple[int, int]  # the place of the drive in u and in q
    output: int  # of a function in q, or -1
    is_angle: bool  # whether the output is one
    conditions: tuple[Condition, ...]
    measured: tuple[tuple[ca.Function, int], ...]  # the quantity of each condition, of q, u, u' and parameters; column
    penalty: float  # added to the loss for a violation as large as the value

    def losses(self, parameters: Array) -> Array:
        """The rms or largest deviation (n,) of candidates (n, np)."""
        return self.best(parameters)[0]

    def best(self, parameters: Array) -> tuple[Array, Array, Array]:
        """The losses (n,), with the configurations (n, rows, nq) and positions of the drive (n, rows) that go there."""
        modes, count = len(self.starts), len(parameters)
        repeated = np.repeat(parameters, modes, axis=0)
        paths, reached = self._followed(repeated, np.tile(self.starts, (count, 1)))
        losses, chosen = self._losses(paths, repeated)
        losses = losses + self.penalty * self._violations(paths, repeated)
        losses = np.where(reached == len(self.grid), losses, UNREACHED * (2.0 - reached / len(self.grid)))
        losses = np.where(np.isfinite(losses), losses, 2.0 * UNREACHED).reshape(count, modes)
        place = np.arange(count) * modes + np.argmin(losses, axis=1)
        found = paths[place[:, None], chosen[place]]
        if self.is_angle and not (isinstance(self.goal, FunctionGoal) and self.goal.free_offset):
            found[:, :, self.output] += self._turns(found[:, :, self.output])[:, None]
        return np.min(losses, axis=1), found, self.grid[chosen[place]]

    def _followed(self, parameters: Array, first: Array) -> tuple[Array, NDArray[np.intp]]:
        """The configurations (n, g, nq) over the grid, and at how many positions (n,) they could be closed."""
        values = evaluated_for_all(self.numbers, parameters)
        paths = np.tile(first[:, None], (1, len(self.grid), 1))
        reached = np.zeros(len(first), dtype=np.intp)
        alive = np.arange(len(first))
        for place, drive in enumerate(self.grid):
            q = (first if place == 0 else paths[:, place - 1])[alive]
            found, closed = self._closed(q, drive, values[alive], FIRST if place == 0 else NEXT)
            if place == 0:
                closed &= np.all(evaluated_for_all(self.checks, found, values[alive]) > 0.0, axis=1)
            else:
                closed &= np.max(np.abs(found - q), axis=1, initial=0.0) < FARTHEST * max(1.0, float(self.scales.max()))
            alive = alive[closed]
            paths[alive, place] = found[closed]
            reached[alive] += 1
            if not len(alive):
                break
        return paths, reached

    def _closed(self, q: Array, drive: float, values: Array, most: int) -> tuple[Array, NDArray[np.bool_]]:
        """The configurations (n, nq) near others at a position of the drive, and whether they are closed (n,)."""
        q = q.copy()
        q[:, self.driven[1]] = drive
        others = np.arange(len(self.scales)) != self.driven[0]
        active, closed = np.arange(len(q)), np.zeros(len(q), dtype=bool)
        for _ in range(most):
            gaps, slopes = self._rows(q[active], values[active])
            step = -_solved(slopes[:, :, others], gaps)
            size = np.max(np.abs(step), axis=1, initial=0.0)
            whole = np.zeros((len(active), len(others)))
            whole[:, others] = step * np.minimum(1.0, LONGEST / np.maximum(size, LONGEST))[:, None]
            q[active] = self._displaced(q[active], whole * self.scales, values[active])
            finite = np.all(np.isfinite(q[active]), axis=1)
            settled = finite & (size <= SETTLED)
            closed[active[settled]] = np.max(np.abs(gaps[settled]), axis=1, initial=0.0) <= CLOSED
            active = active[finite & ~settled]
            if not len(active):
                break
        return q, closed

    def _displaced(self, q: Array, step: Array, values: Array) -> Array:
        if q.shape[1] == step.shape[1]:  # no quaternions: coordinates are displacements
            return q + step
        return evaluated_for_all(self.displaced, q, step, values)

    def _rows(self, q: Array, values: Array) -> tuple[Array, Array]:
        """The gaps (n, m) and the gradient (n, m, nv) in natural units."""
        flat, nv = evaluated_for_all(self.closing, q, values), len(self.scales)
        m = flat.shape[1] // (nv + 1)
        return flat[:, :m], np.ascontiguousarray(flat[:, m:].reshape(len(flat), nv, m).swapaxes(1, 2))

    def _losses(self, paths: Array, parameters: Array) -> tuple[Array, NDArray[np.intp]]:
        """The losses (n,), and the places (n, rows) in the grid that belong to the rows of the goal."""
        count, goal = len(paths), self.goal
        rows = np.tile(self.rows, (count, 1))
        if isinstance(goal, PathGoal) and goal.free_timing:
            every = self._values(paths, parameters)
            apart = every[:, None] - goal.positions[None, :, None]  # (n, rows, g, 3)
            squares = np.nansum(apart**2, axis=3)
            return self._measure(np.sqrt(np.min(squares, axis=2))), np.argmin(squares, axis=2)
        chosen = paths[:, self.rows]
        values = self._values(chosen, parameters)
        match goal:
            case PathGoal(positions=positions):
                wanted = np.isfinite(positions)
                return self._measure((values - positions)[:, wanted]), rows
            case FunctionGoal(values=given, free_offset=free):
                apart = values[:, :, 0] - given
                if free:
                    return self._measure(apart - self._middle(apart)[:, None]), rows
                return self._measure(apart + (self._turns(values[:, :, 0])[:, None] if self.is_angle else 0.0)), rows
            case EffortGoal():
                return self._measure(values[:, :, 0]), rows

    def _violations(self, paths: Array, parameters: Array) -> Array:
        """The sum (n,) of the relative violations of the conditions."""
        total = np.zeros(len(paths))
        if not self.conditions:
            return total
        chosen = paths[:, self.rows]
        count, places, nq = chosen.shape
        q, given = chosen.reshape(-1, nq), np.repeat(parameters, places, axis=0)
        nothing = np.zeros((len(q), len(self.scales)))
        for condition, (function, column) in zip(self.conditions, self.measured, strict=True):
            values = evaluated_for_all(function, q, nothing, nothing, given)[:, column].reshape(count, places)
            no_slopes = np.zeros((places, 0))
            found = [measured(condition, row, no_slopes)[0] for row in values]
            total += [condition.violation(value) for value in found]
        return total

    def _values(self, paths: Array, parameters: Array) -> Array:
        """The quantity (n, k, …) of configurations (n, k, nq)."""
        count, places, nq = paths.shape
        q, given = paths.reshape(-1, nq), np.repeat(parameters, places, axis=0)
        u = np.zeros((len(q), len(self.scales)))
        rates = u
        if isinstance(self.goal, EffortGoal):
            u, rates = self._rates(q, evaluated_for_all(self.numbers, given), self.goal.speed)
            unit = (
                u / self.goal.speed
                if self.goal.speed
                else self._rates(q, evaluated_for_all(self.numbers, given), 1.0)[0]
            )
            efforts = evaluated_for_all(self.quantity, q, u, rates, given)
            power: Array = np.sum(unit * efforts, axis=1).reshape(count, places, 1)
            return power
        reached: Array = evaluated_for_all(self.quantity, q, u, rates, given).reshape(count, places, -1)
        return reached

    def _rates(self, q: Array, values: Array, speed: float) -> tuple[Array, Array]:
        """u and u' (n, nv) at a constant speed of the drive."""
        at = self.driven[0]
        _, slopes = self._rows(q, values)
        others = np.delete(slopes, at, axis=2)
        scaled = -_solved(others, slopes[:, :, at] * (speed / self.scales[at]))
        u = np.insert(scaled, at, speed / self.scales[at], axis=1) * self.scales
        bias = evaluated_for_all(self.bias, q, u, values)
        return u, np.insert(-_solved(others, bias), at, 0.0, axis=1) * self.scales

    def _turns(self, angles: Array) -> Array:
        """The full turns (n,) in rad that bring angles (n, rows) to the values of the goal."""
        assert isinstance(self.goal, FunctionGoal)
        apart = np.mean(self.goal.values - angles, axis=1)
        turns: Array = 2.0 * np.pi * np.round(apart / (2.0 * np.pi))
        return turns

    def _middle(self, apart: Array) -> Array:
        if self.norm == "rms":
            return np.asarray(np.mean(apart, axis=1))
        return np.asarray(0.5 * (np.max(apart, axis=1) + np.min(apart, axis=1)))

    def _measure(self, deviations: Array) -> Array:
        if self.norm == "rms":
            return np.asarray(np.sqrt(np.mean(deviations**2, axis=1)))
        return np.asarray(np.max(np.abs(deviations), axis=1))


def candidates_of(problem: DesignProblem, norm: str, size: float = 1.0) -> ParameterCandidates:
    """The candidates of a problem.

    :param size: a typical loss, by which violations of conditions are weighed.

    :raises InputError: the mechanism cannot be assembled at the first position of the drive, nor at its own start.
    """
    parametric, goal = problem.parametric, problem.goal
    system = parametric.system
    driven = int(system.u_driven[0]), int(system.q_driven[0])
    grid, rows = _grid(goal, STRIDE * float(system.scale[driven[0]]))
    q, values = ca.SX.sym("q", system.layout.nq), ca.SX.sym("v", len(system.values))
    u = ca.SX.sym("u", system.layout.nv)
    traced = system.constraints.traced
    sizes = traced.row_sizes(0.0, q, values)
    inverse = ca.if_else(sizes > 0.0, 1.0 / ca.if_else(sizes > 0.0, sizes, 1.0), 0.0)
    gradient = ca.diag(inverse) @ traced.gradient(0.0, q, values) @ ca.diag(ca.DM(system.scale))
    closing = ca.vertcat(inverse * traced.position(0.0, q, values), ca.vec(gradient))
    bias = inverse * system.bias_function(0.0, q, u, values)
    output = problem.output_column
    return ParameterCandidates(
        goal,
        norm,
        grid,
        rows,
        _starts(system, grid[0]),
        parametric.numbers_function,
        ca.Function("closing", [q, values], [ca.densify(closing)], {"cse": True}),
        ca.Function("checks", [q, values], [ca.densify(ca.vertcat(1.0, traced.branch_checks(0.0, q, values)))]),
        traced.displaced,
        problem.value_function,
        ca.Function("bias", [q, u, values], [ca.densify(bias)], {"cse": True}),
        system.scale,
        driven,
        output,
        output >= 0 and bool(system.angles[output]),
        problem.conditions,
        tuple(problem.condition_functions()),
        PENALTY * size,
    )


def _grid(goal: Goal, stride: float) -> tuple[Array, NDArray[np.intp]]:
    """Positions of the drive that contain those of the goal, at most a stride apart, and where these are in it."""
    wanted = np.unique(goal.drives)
    if isinstance(goal, PathGoal) and goal.free_timing:
        least = FREE_POSITIONS * len(goal.drives)
        wanted = np.union1d(wanted, np.linspace(wanted[0], wanted[-1], least))
    pieces = [wanted[:1]]
    for low, high in pairwise(wanted):
        pieces.append(np.linspace(low, high, int(np.ceil((high - low) / stride)) + 1)[1:])
    grid = np.concatenate(pieces)
    return grid, np.searchsorted(grid, goal.drives)


def _starts(system: KinematicSystem, drive: float) -> Array:
    """All assembly modes at a position of the drive, or those at the start of the file."""
    for place in (drive, float(system.start[system.q_driven][0])):
        try:
            return modes_at(system, np.array([place])).q
        except InputError:
            continue
    return system.start[None]


def _solved(matrices: Array, right: Array) -> Array:
    """The least squares solutions (n, k) of matrices (n, m, k) and right sides (n, m)."""
    transposed = matrices.swapaxes(1, 2)
    square = transposed @ matrices
    count = square.shape[1]
    size = np.trace(square, axis1=1, axis2=2)[:, None, None]
    ridge = REGULAR * np.where(size > 0.0, size, 1.0)
    regular = np.where(np.isfinite(square), square, 0.0) + ridge * np.eye(count)
    return np.asarray(np.linalg.solve(regular, transposed @ right[:, :, None])[:, :, 0], dtype=np.float64)
