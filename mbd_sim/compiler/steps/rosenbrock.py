"""A step of a Rosenbrock method, as IR: one derivative and one factorization, then a linear solve for each stage.

The linearized system is reduced to a dense system for the speeds. Let z be the components before the core
(coordinates), x the core (speeds), and w the components after it, on which no rate depends (energies). Then
(I − g J) U = r is

    (I − g A) z = r_z + g B x,    (I − g D) x = r_x + g C z,    w = r_w + g E z + g F x.

A is zero, or has small blocks for the rates of quaternions, so that z can be eliminated symbolically. That leaves a
dense system for x, half the size of the whole and so an eighth of the work.

In a step of a Rosenbrock-W method, functions of the caller solve the linear systems instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.compiler.ir.builder import local_array, number
from mbd_sim.compiler.ir.dense_solver import emit_dense_solver
from mbd_sim.compiler.ir.lanes import LaneBuilder, lanes_of
from mbd_sim.compiler.ir.module import Function, Value
from mbd_sim.compiler.ir.vectors import Index, combine, copy, for_each, load, store, total, weighted
from mbd_sim.compiler.steps.emitter import Emit, Prepare, StepEmitter
from mbd_sim.compiler.steps.runge_kutta import CalledStep
from mbd_sim.integrators.explicit import EXPLICIT
from mbd_sim.integrators.implicit import Rosenbrock, RosenbrockW


@dataclass(frozen=True, eq=False)
class Linearized:
    """The three functions of a step, and the numbers of the core and of the memory.

    `at(t, y, inputs, g)` gives the memory (m,) of the other two, the matrix (n, n) of the core, and ∂f/∂t. Then
    `reduce(memory, r)` gives the right side (n,) of the core, and `expand(memory, r, x)` all of U from its solution x.
    If `timeless`, ∂f/∂t vanishes.
    """

    at: Function
    reduce: Function
    expand: Function
    core: int
    memory_size: int
    timeless: bool


def emit_linearized(rates: ca.Function, core: slice, emit: Emit) -> Linearized:
    """Differentiate `rates(t, y, inputs)` exactly; `core` are the components of y that are solved for together."""
    t, y, inputs = (ca.SX.sym(name, rates.nnz_in(index)) for index, name in enumerate(("t", "y", "inputs")))
    g, right = ca.SX.sym("g"), ca.SX.sym("right", y.shape[0])
    slopes = rates.call([t, y, inputs])[0]
    jacobian = ca.sparsify(g * ca.jacobian(slopes, y))
    z, x, w = slice(0, core.start), core, slice(core.stop, y.shape[0])
    inverse = unit_inverse(jacobian[z, z])
    memory = Memory()
    b, c, e, f, inverse = (
        memory.keep(block) for block in (jacobian[z, x], jacobian[x, z], jacobian[w, z], jacobian[w, x], inverse)
    )
    matrix = ca.SX.eye(core.stop - core.start) - jacobian[x, x] - memory.substituted(c @ (inverse @ b))
    solution = ca.SX.sym("solution", matrix.shape[0])
    before = inverse @ (right[z] + b @ solution)
    after = right[w] + e @ before + f @ solution
    time_rates = ca.jacobian(slopes, t)
    small = ca.densify(right[x] + c @ (inverse @ right[z]))
    full = ca.densify(ca.vertcat(before, solution, after))
    options = {"cse": True}
    return Linearized(
        at=emit(
            ca.Function(
                "linearize", [t, y, inputs, g], [memory.values, ca.densify(matrix), ca.densify(time_rates)], options
            ),
            ("t", "y", "in", "g"),
            ("memory", "matrix", "time_rates"),
        ),
        reduce=emit(
            ca.Function("reduce", [memory.symbols, right], [small], options), ("memory", "right"), ("reduced",)
        ),
        expand=emit(
            ca.Function("expand", [memory.symbols, right, solution], [full], options),
            ("memory", "right", "solution"),
            ("increment",),
        ),
        core=matrix.shape[0],
        memory_size=memory.values.shape[0],
        timeless=time_rates.nnz() == 0,
    )


class Memory:
    """Entries of matrices that are computed once in a step and used in every stage; constants are not stored."""

    def __init__(self) -> None:
        self._pairs: list[tuple[ca.SX, ca.SX]] = []

    def keep(self, matrix: ca.SX) -> ca.SX:
        """Keep the entries of a matrix, and return it with symbols in their place."""
        entries = []
        for value in ca.vertsplit(ca.vec(matrix.nz[:])) if matrix.nnz() else []:
            symbol = value if value.is_constant() else ca.SX.sym(f"m{len(self._pairs)}")
            if symbol is not value:
                self._pairs.append((symbol, value))
            entries.append(symbol)
        return ca.SX(matrix.sparsity(), ca.vertcat(ca.SX(0, 1), *entries))

    @property
    def symbols(self) -> ca.SX:
        """The symbols (m,) of the entries."""
        return ca.vertcat(ca.SX(0, 1), *(symbol for symbol, _ in self._pairs))

    @property
    def values(self) -> ca.SX:
        """The values (m,) of the entries."""
        return ca.densify(ca.vertcat(ca.SX(0, 1), *(value for _, value in self._pairs)))

    def substituted(self, expression: ca.SX) -> ca.SX:
        """An expression with the values in place of the symbols."""
        return ca.substitute([expression], [self.symbols], [self.values])[0]


def unit_inverse(blocks: ca.SX) -> ca.SX:
    """(I − `blocks`)⁻¹ by Gauss–Jordan elimination without exchange of rows.

    For the rates of quaternions `blocks` is skew, so that the pivots are never below 1.
    """
    size = blocks.shape[0]
    if blocks.nnz() == 0:
        return ca.SX.eye(size)
    rows = [{j: blocks[i, j] for j in range(size) if blocks.has_nz(i, j)} for i in range(size)]
    left = [{j: -value for j, value in row.items()} for row in rows]
    for i in range(size):
        left[i][i] = 1.0 + left[i].get(i, ca.SX(0))
    right: list[dict[int, ca.SX]] = [{i: ca.SX(1)} for i in range(size)]
    for pivot in range(size):
        inverse = 1.0 / left[pivot].pop(pivot)
        for side in (left, right):
            side[pivot] = {j: inverse * value for j, value in side[pivot].items()}
        for i in range(size):
            if i != pivot and pivot in left[i]:
                factor = left[i].pop(pivot)
                for side in (left, right):
                    for j, value in side[pivot].items():
                        side[i][j] = side[i].get(j, ca.SX(0)) - factor * value
    found = ca.SX(size, size)
    for i, row in enumerate(right):
        for j, value in row.items():
            found[i, j] = value
    return found


def rosenbrock_step(method: Rosenbrock, linearized: Linearized) -> Prepare:
    """The step of a Rosenbrock method, for `emit_advance`.

    In steps that start with ill-conditioned constraints the derivative across the constraints is unbounded, and says
    nothing about the motion along them. Such a step is taken by RK4.
    """
    return lambda emitter: _RosenbrockStep(method, linearized, emitter).step


class _RosenbrockStep:
    """The functions and the arrays of a Rosenbrock step."""

    def __init__(self, method: Rosenbrock, linearized: Linearized, emitter: StepEmitter) -> None:
        b, core = emitter.b, linearized.core
        self._method, self._emitter, self._linearized = method, emitter, linearized
        self._solver = emit_dense_solver(b.module, core, lanes=lanes_of(b))
        self._increments = [emitter.vector(f"u{stage + 1}") for stage in range(method.stages)]
        names = ("trial", "slopes", "right", "time_rates")
        self._trial, self._slopes, self._right, self._time_rates = map(emitter.vector, names)
        self._memory = local_array(b, linearized.memory_size, name="memory")
        self._matrix = local_array(b, core * core, name="matrix")
        self._rows, self._small, self._solution = (
            local_array(b, core, name=name) for name in ("rows", "reduced", "solution")
        )
        self._g = emitter.scalar("g")
        self._emit_estimate = emitter.estimator(method.estimate, self._increments)
        self._explicit = CalledStep(EXPLICIT["rk4"], emitter) if emitter.system.reports_conditioning else None
        if isinstance(b, LaneBuilder):
            self._explicit_y, self._explicit_error = emitter.vector(), emitter.scalar()

    def step(self, t: Value) -> None:
        """Emit the step from time t on."""
        emitter = self._emitter
        emitter.rates(t, emitter.y, self._slopes, first=True)
        if self._explicit is None:
            self._implicit(t)
            return
        if isinstance(emitter.b, LaneBuilder):
            self._members(t, emitter.b, self._explicit)
            return
        with emitter.b.if_else(emitter.is_ill_conditioned(), likely=False) as (ill_conditioned, otherwise):
            with ill_conditioned:
                self._explicit.emit(t, self._slopes)
            with otherwise:
                self._implicit(t)

    def _members(self, t: Value, b: LaneBuilder, explicit: CalledStep) -> None:
        """Take the step both ways if any member needs RK4, and give each member the one it takes alone."""
        emitter, size = self._emitter, self._emitter.system.size
        y, error, explicit_y, explicit_error = emitter.y, emitter.largest_error, self._explicit_y, self._explicit_error
        condition = emitter.is_ill_conditioned()
        any_condition = b.any_lane(condition)

        def exchange(one: Value, other: Value, index: Index) -> None:
            first, second = load(b, one, index), load(b, other, index)
            store(b, second, one, index)
            store(b, first, other, index)

        def selected(one: Value, other: Value, index: Index) -> None:
            store(b, b.select(condition, load(b, one, index), load(b, other, index)), other, index)

        with b.if_then(any_condition, likely=False):
            copy(b, size, y, explicit_y)
            copy(b, 1, error, explicit_error)
            explicit.emit(t, self._slopes)
            for_each(b, size, lambda i: exchange(y, explicit_y, i))
            exchange(error, explicit_error, 0)
        self._implicit(t)
        with b.if_then(any_condition, likely=False):
            for_each(b, size, lambda i: selected(explicit_y, y, i))
            selected(explicit_error, error, 0)

    def _implicit(self, t: Value) -> None:
        """Linearize, factorize, and solve for the increment of each stage."""
        emitter, method, b, linearized = self._emitter, self._method, self._emitter.b, self._linearized
        time, g = b.by_address(t, emitter.time), b.by_address(b.fmul(number(method.gamma), emitter.h), self._g)
        outputs = [self._memory, self._matrix, self._time_rates]
        b.call(linearized.at, [time, emitter.y, emitter.inputs, g, *outputs])
        b.call(self._solver.factorize, [self._matrix, self._rows])
        for stage in range(method.stages):
            if stage > 0:
                stage_slopes(emitter, method, t, stage, self._increments, self._trial, self._slopes)
            time_rates = None if linearized.timeless else self._time_rates
            right_side(emitter, method, stage, self._increments, self._slopes, time_rates, self._right)
            b.call(linearized.reduce, [self._memory, self._right, self._small])
            b.call(self._solver.solve, [self._matrix, self._rows, self._small, self._solution])
            b.call(linearized.expand, [self._memory, self._right, self._solution, self._increments[stage]])
        self._emit_estimate(None)
        combine(b, emitter.system.size, emitter.y, emitter.y, None, weighted(method.m, self._increments))


def stage_slopes(
    emitter: StepEmitter,
    method: Rosenbrock,
    t: Value,
    stage: int,
    increments: Sequence[Value],
    trial: Value,
    slopes: Value,
) -> None:
    """Emit `slopes` = f(t + c h, y + Σ a U) of a stage; `trial` receives the state."""
    weights = method.a[stage]
    time, state = emitter.stage_time(t, method.c[stage]), emitter.y
    if any(weights):
        state, terms = trial, weighted(weights, increments)
        combine(emitter.b, emitter.system.size, state, emitter.y, None, terms)
    emitter.rates(time, state, slopes)


def right_side(
    emitter: StepEmitter,
    method: Rosenbrock,
    stage: int,
    increments: Sequence[Value],
    slopes: Value,
    time_rates: Value | None,
    right: Value,
) -> None:
    """Emit `right` = γ (h f + Σ g U + d h² f_t) of a stage; f_t is zero if `time_rates` is None."""
    b = emitter.b
    sums = weighted(method.g[stage], increments)
    d = 0.0 if time_rates is None else method.d[stage]
    d_h_squared = b.fmul(number(d), b.fmul(emitter.h, emitter.h)) if d else None

    def component(i: Index) -> None:
        value = b.fmul(emitter.h, load(b, slopes, i))
        if sums:
            value = b.fadd(value, total(b, sums, i))
        if time_rates is not None and d_h_squared is not None:
            value = b.fadd(value, b.fmul(d_h_squared, load(b, time_rates, i)))
        store(b, b.fmul(number(method.gamma), value), right, i)

    for_each(b, emitter.system.size, component)


@dataclass(frozen=True, slots=True)
class PartialFunctions:
    """The functions of a partial system as IR: see `emit_partial_system`. The memory has `memory_size` numbers."""

    at: Function
    solve: Function
    memory_size: int


def emit_partial_system(at: ca.Function, solve: ca.Function, emit: Emit) -> PartialFunctions:
    """Emit the functions of a partial system.

    :param at: `at(t, y, inputs, g)` gives the memory (m,) of `solve`.
    :param solve: `solve(memory, r)` gives U with (I - g A) U = r.
    """
    return PartialFunctions(
        emit(at, ("t", "y", "in", "g"), ("memory",)),
        emit(solve, ("memory", "right"), ("increment",)),
        max(1, at.nnz_out(0)),
    )


def rosenbrock_w_step(method: RosenbrockW, system: PartialFunctions) -> Prepare:
    """The step of a method that keeps its order with any approximation A of the Jacobian, for `emit_advance`."""
    return lambda emitter: _RosenbrockWStep(method, system, emitter).step


class _RosenbrockWStep:
    """The functions and the arrays of a step."""

    def __init__(self, method: RosenbrockW, system: PartialFunctions, emitter: StepEmitter) -> None:
        b = emitter.b
        self._method, self._emitter, self._system = method, emitter, system
        self._increments = [emitter.vector(f"u{stage + 1}") for stage in range(method.stages)]
        self._trial, self._slopes, self._right = (emitter.vector(name) for name in ("trial", "slopes", "right"))
        self._memory = local_array(b, system.memory_size, name="memory")
        self._g = emitter.scalar("g")
        self._emit_estimate = emitter.estimator(method.estimate, self._increments)

    def step(self, t: Value) -> None:
        """Emit the step from time t on."""
        emitter, method, b = self._emitter, self._method, self._emitter.b
        emitter.rates(t, emitter.y, self._slopes, first=True)
        time, g = b.by_address(t, emitter.time), b.by_address(b.fmul(number(method.gamma), emitter.h), self._g)
        b.call(self._system.at, [time, emitter.y, emitter.inputs, g, self._memory])
        for stage in range(method.stages):
            if stage > 0:
                stage_slopes(emitter, method, t, stage, self._increments, self._trial, self._slopes)
            right_side(emitter, method, stage, self._increments, self._slopes, None, self._right)
            b.call(self._system.solve, [self._memory, self._right, self._increments[stage]])
        self._emit_estimate(None)
        combine(b, emitter.system.size, emitter.y, emitter.y, None, weighted(method.m, self._increments))
