"""The start of a mechanism: assembly, independent constraints, consistent speeds, or an error."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.batch import of_all
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import product
from mbd_sim.dynamics.constraints.assembly import (
    close_loops,
    configurations_of_drives,
    fit_speeds,
    nearby_configurations,
    undefined_rows,
)
from mbd_sim.dynamics.constraints.equations import ConstraintEquations, constraint_equations
from mbd_sim.dynamics.constraints.errors import (
    conflict_with_drives,
    inconsistent_speeds,
    isolated_position,
    no_mobility,
    open_loops,
    undefined_constraints,
)
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions, constraint_functions
from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.dynamics.constraints.singular_start import is_isolated, speeds_of_a_branch
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout
from mbd_sim.dynamics.math.rank import dependent_rows, independent_rows, least_solution, nonzero_rows
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.constraints import expressions_of
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.mechanism.values.expression import names_in

COMPATIBLE = 1e-7  # error of the rates of redundant rows, relative to those of drives
LATER = (1e-3, 0.1, 0.25, 0.5)  # natural times after the start, at which constraints that depend on it are examined


@dataclass(frozen=True, eq=False)
class AssembledStart:
    """Coordinates q (nq,) and speeds u (nv,) at t = 0 that satisfy the constraints.

    `independent` are the indices of rows that span all others around the start. `active` are those of the rows that are
    used: the independent ones and, because other rows may be needed elsewhere, every row that is not simply zero.
    `nearby` are pairs (t, q) of configurations, the start first, and `ranks` those of the constraint matrix G in each.
    """

    q: Array
    u: Array
    independent: Sequence[int] = ()
    active: Sequence[int] = ()
    ranks: Sequence[int] = (0,)
    nearby: Sequence[tuple[float, Array]] = field(default_factory=tuple)

    @property
    def rank(self) -> int:
        """The rank of the constraint matrix almost everywhere."""
        return max(self.ranks)


@dataclass(frozen=True, eq=False)
class Assembly:
    """The constraints of a mechanism as `equations` and as `functions` of numbers, and a `start` that satisfies them.

    `active` are the equations that are used, and `dependent` (m,) marks those among them that depend on others.
    """

    equations: ConstraintEquations
    functions: ConstraintFunctions
    start: AssembledStart

    @property
    def active(self) -> ConstraintEquations:
        """The rows that are used."""
        return self.equations.select(self.start.active)

    @cached_property
    def dependent(self) -> NDArray[np.bool_]:
        """Which active rows take part in a linear dependence, in some configuration around the start."""
        rows = list(self.start.active)
        return dependent_rows([self.functions.scaled_gradient(t, q)[rows] for t, q in self.start.nearby])


def assemble(traced: TracedMechanism) -> Assembly:
    """Write the constraints, close the loops, and drop the rows that are zero everywhere.

    Rows out of the plane of a plane loop are zero if they are written along axes that rotate with the loop. So where a
    row is redundant and not zero, the rows of its loop are written again along such axes. Redundant rows that are not
    zero then stay: which of them the others replace may change with the configuration.

    :raises MechanismError: see `assembled_start`.
    """
    assembly = _assembled(traced, ())
    own_axes = _doubtful_loops(assembly)
    return _assembled(traced, own_axes) if own_axes else assembly


def _assembled(traced: TracedMechanism, own_axes: Collection[str]) -> Assembly:
    equations = constraint_equations(traced, own_axes)
    functions = constraint_functions(traced, equations)
    return Assembly(equations, functions, assembled_start(traced.numeric, traced.layout, functions, equations.rows))


def _doubtful_loops(assembly: Assembly) -> list[str]:
    """The closing joints of which a row is dropped that is not zero everywhere."""
    rows, start = assembly.equations.rows, assembly.start
    names = [
        str(row.owner[1])
        for index, row in enumerate(rows)
        if index in start.active and index not in start.independent and row.owner[0] == "joints"
    ]
    return list(dict.fromkeys(names))


def given_start(mechanism: Mechanism, layout: CoordinateLayout) -> tuple[Array, Array]:
    """The start coordinates q (nq,) and speeds u (nv,) of the file."""
    q, u = given_starts(mechanism, layout, 1)
    return q[0], u[0]


def given_starts(mechanism: Mechanism, layout: CoordinateLayout, count: int) -> tuple[Array, Array]:
    """The start coordinates (count, nq) and speeds (count, nv) of a mechanism whose numbers are batches."""
    q, u = np.zeros((count, layout.nq)), np.zeros((count, layout.nv))
    for name, joint in mechanism.joints.items():
        q[:, layout.q[name]] = of_all(joint.position, count)
        u[:, layout.u[name]] = of_all(joint.velocity, count)
    for name, drive in commanded_drives(mechanism).items():
        q[:, layout.drives[name].start] = of_all(drive.start, count)
    return q, u


@np.errstate(over="ignore", invalid="ignore")
def assembled_start(
    mechanism: Mechanism, layout: CoordinateLayout, constraints: ConstraintFunctions, rows: Sequence[ConstraintRow]
) -> AssembledStart:
    """Close the loops, determine the independent rows, and find consistent speeds.

    :raises MechanismError: a loop cannot be closed, given speeds violate the constraints, drives contradict them, or
        nothing can move.
    """
    q, u = given_start(mechanism, layout)
    if not rows:
        return AssembledStart(q, u)
    q = _closed(mechanism, constraints, rows, q)
    nearby = nearby_configurations(constraints, q, later_times(mechanism) if rheonomic(mechanism) else ())
    nearby += configurations_of_drives(constraints, q, [states.start for states in layout.drives.values()])
    gradients = [constraints.scaled_gradient(t, at) for t, at in nearby]
    independent, ranks = independent_rows(gradients)
    active = sorted({*independent, *nonzero_rows(gradients)})
    moving = [(t, _with_moving_drives(layout, at)) for t, at in nearby]
    _require_compatible_drives(mechanism, constraints, rows, independent, moving)
    if not rheonomic(mechanism):
        if is_isolated(constraints, nearby):
            raise isolated_position(mechanism, rows)
        if max(ranks) == layout.nv:
            raise no_mobility(mechanism, rows, layout.nv, *_weakest(gradients[0]))
    u = _consistent_speeds(mechanism, constraints, rows, q, u, max(ranks))
    return AssembledStart(q, u, independent, active, ranks, nearby)


def _weakest(gradient: Array) -> tuple[float, Array]:
    """How much the rows prevent the motion that they prevent least, in natural units, and their shares (m,) in that."""
    left, values, _ = np.linalg.svd(gradient, full_matrices=False)
    if not values.size:
        return np.inf, np.zeros(len(gradient))
    return float(values[-1]), np.abs(left[:, -1])


def start_like(
    mechanism: Mechanism,
    layout: CoordinateLayout,
    constraints: ConstraintFunctions,
    rows: Sequence[ConstraintRow],
    rank: int,
) -> tuple[Array, Array]:
    """The start q (nq,) and u (nv,) of a mechanism that shares its constraints with another one, with other values.

    :param rank: of the constraint matrix almost everywhere, see `AssembledStart`.
    :raises MechanismError: a loop cannot be closed, or given speeds violate the constraints.
    """
    q, u = given_start(mechanism, layout)
    if not rows:
        return q, u
    q = _closed(mechanism, constraints, rows, q)
    return q, _consistent_speeds(mechanism, constraints, rows, q, u, rank)


def _consistent_speeds(
    mechanism: Mechanism,
    constraints: ConstraintFunctions,
    rows: Sequence[ConstraintRow],
    q: Array,
    u: Array,
    rank: int,
) -> Array:
    """Speeds (nv,) that satisfy the constraints, whose matrix has this `rank` almost everywhere."""
    fixed = _flags([joint.fixed_speeds for joint in mechanism.joints.values()])
    speeds = fit_speeds(constraints, 0.0, q, u, fixed)
    if not speeds.consistent:
        raise inconsistent_speeds(mechanism, rows, speeds.errors, fixed)
    if not speeds.u.any() or constraints.rank(0.0, q) >= rank:
        return speeds.u
    return speeds_of_a_branch(constraints, 0.0, q, speeds.u, fixed)


def _closed(mechanism: Mechanism, constraints: ConstraintFunctions, rows: Sequence[ConstraintRow], q: Array) -> Array:
    fixed = _flags([joint.fixed_in_assembly for joint in mechanism.joints.values()])
    closure = close_loops(constraints, 0.0, q, ~fixed)
    if (undefined := undefined_rows(constraints, 0.0, closure.q)).any():
        raise undefined_constraints(mechanism, rows, undefined)
    if closure.closed:
        return closure.q
    unfixed = close_loops(constraints, 0.0, q, np.ones(len(fixed), dtype=bool)) if fixed.any() else closure
    worst = closure if unfixed.closed else unfixed
    sizes = constraints.row_sizes(0.0, worst.q)
    raise open_loops(mechanism, rows, worst.gaps, sizes, constraints.size, given_positions_at_fault=unfixed.closed)


def _flags(flags_of_joints: Sequence[Sequence[bool]]) -> NDArray[Any]:
    return np.array([flag for flags in flags_of_joints for flag in flags], dtype=bool)


def later_times(mechanism: Mechanism) -> tuple[float, ...]:
    """Times in s after the start, at which constraints that depend on time are examined."""
    return tuple(time / natural_units(mechanism, mechanism.step).rate for time in LATER)


def rheonomic(mechanism: Mechanism) -> bool:
    """Whether the constraints depend on time."""
    expressions = [expression for constraint in mechanism.constraints for expression in expressions_of(constraint)]
    return bool(mechanism.driven_names) or any("t" in names_in(expression.text) for expression in expressions)


def _with_moving_drives(layout: CoordinateLayout, q: Array) -> Array:
    """The coordinates with a speed of 1 of each drive that follows commands."""
    moving = q.copy()
    moving[[states.start + 1 for states in layout.drives.values()]] = 1.0
    return moving


def _require_compatible_drives(
    mechanism: Mechanism,
    constraints: ConstraintFunctions,
    rows: Sequence[ConstraintRow],
    independent: Sequence[int],
    nearby: Sequence[tuple[float, Array]],
) -> None:
    """Refuse drives that demand a motion from redundant rows that the independent rows forbid."""
    if not rheonomic(mechanism):
        return
    if all(t == 0.0 for t, _ in nearby):
        q = nearby[0][1]
        all_free = np.ones(constraints.gradient(0.0, q).shape[1], dtype=bool)
        later, *_ = later_times(mechanism)
        raise conflict_with_drives(mechanism, rows, close_loops(constraints, later, q, all_free).gaps)
    kept = list(independent)
    dropped = [index for index in range(len(rows)) if index not in independent]
    for t, q in nearby:
        sizes = constraints.row_sizes(t, q)
        gradient = constraints.scaled_gradient(t, q)
        drift = np.divide(constraints.drift(t, q), sizes, out=np.zeros(len(rows)), where=sizes > 0.0)
        combinations = least_solution(gradient[kept].T, gradient[dropped].T)
        errors = np.zeros(len(rows))
        errors[dropped] = drift[dropped] - product(combinations.T, drift[kept])
        rate = max(constraints.rate_of_drives(t, q), float(np.max(np.abs(drift), initial=0.0)))
        if np.max(np.abs(errors), initial=0.0) > COMPATIBLE * rate:
            errors *= sizes
            raise conflict_with_drives(mechanism, rows, errors)
