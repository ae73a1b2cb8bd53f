"""The start of a mechanism: assembled, with its independent constraints found, or refused with the reason."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.dynamics.assembly import (
    Conditions,
    close_loops,
    fit_speeds,
    independent_rows,
    nearby,
    without_value,
)
from mbd_sim.dynamics.assembly_errors import (
    contradiction,
    no_value,
    open_loops,
    rigid,
    unfitting,
)
from mbd_sim.dynamics.constraint_equations import Constraints, State
from mbd_sim.dynamics.constraint_rows import Row
from mbd_sim.dynamics.links import Layout
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.expression import names_in
from mbd_sim.mechanism.records import Mechanism

ZERO = 1e-9  # of all rows, what counts as none of one row
LATER = (1e-3, 0.1, 0.25, 0.5)  # s, when constraints are looked at besides the start, where time enters them


@dataclass(frozen=True, eq=False)
class Start:
    """Coordinates (nq,) and speeds (nv,) that fit the constraints, the rows to `keep`, and the rank of all of them.

    `ranks` are those in the configurations nearby, the start first.
    """

    q: Array
    u: Array
    keep: Sequence[int] = ()
    ranks: Sequence[int] = (0,)
    nearby: Sequence[tuple[float, Array]] = field(default_factory=tuple)

    @property
    def rank(self) -> int:
        """The rank of the constraint matrix almost everywhere."""
        return max(self.ranks)


def given_start(mechanism: Mechanism, places: Layout) -> tuple[Array, Array]:
    """q (nq,) and u (nv,) as the file gives them."""
    q, u = np.zeros(places.nq), np.zeros(places.nv)
    for name, joint in mechanism.joints.items():
        q[places.q[name]] = joint.position
        u[places.u[name]] = joint.velocity
    return q, u


@np.errstate(over="ignore", invalid="ignore")
def assembled_start(
    mechanism: Mechanism, places: Layout, make_conditions: Callable[[], Conditions], rows: Sequence[Row]
) -> Start:
    """Close the loops and find speeds that fit.

    :raises MechanismError: a loop cannot be closed, given speeds do not fit, drives work against constraints, or
        nothing can move.
    """
    q, u = given_start(mechanism, places)
    if not rows:
        return Start(q, u)
    conditions = make_conditions()
    q = _closed(mechanism, conditions, rows, q)
    if (bad := without_value(conditions, 0.0, q)).any():
        raise no_value(mechanism, rows, bad)
    around = nearby(conditions, q, LATER if rheonomic(mechanism) else ())
    keep, ranks = independent_rows([conditions.gradient(t, at) for t, at in around])
    _require_agreement(mechanism, conditions, rows, keep, around)
    if max(ranks) == places.nv and not rheonomic(mechanism):
        raise rigid(mechanism, rows, places.nv)
    return Start(q, _fitting(mechanism, conditions, rows, q, u), keep, ranks, around)


def start_like(
    mechanism: Mechanism, places: Layout, conditions: Callable[[], Conditions], rows: Sequence[Row]
) -> tuple[Array, Array]:
    """q and u of a mechanism whose constraints are those of another one, with other values.

    :raises MechanismError: a loop cannot be closed, or given speeds do not fit.
    """
    q, u = given_start(mechanism, places)
    if not rows:
        return q, u
    q = _closed(mechanism, conditions(), rows, q)
    return q, _fitting(mechanism, conditions(), rows, q, u)


def _fitting(mechanism: Mechanism, conditions: Conditions, rows: Sequence[Row], q: Array, u: Array) -> Array:
    held = _each(mechanism, "held_speeds")
    speeds = fit_speeds(conditions, 0.0, q, u, held)
    if not speeds.fitting:
        raise unfitting(mechanism, rows, speeds.misses, held)
    return speeds.u


def _closed(mechanism: Mechanism, conditions: Conditions, rows: Sequence[Row], q: Array) -> Array:
    held = _each(mechanism, "held")
    closing = close_loops(conditions, 0.0, q, ~held)
    if closing.closed:
        return closing.q
    if (bad := without_value(conditions, 0.0, closing.q)).any():
        raise no_value(mechanism, rows, bad)
    without = close_loops(conditions, 0.0, q, np.ones(len(held), dtype=bool)) if held.any() else closing
    gaps = closing.gaps if without.closed else without.gaps
    raise open_loops(mechanism, rows, gaps, conditions.size, without.closed)


def _each(mechanism: Mechanism, key: str) -> Any:
    values = [value for joint in mechanism.joints.values() for value in getattr(joint, key)]
    return np.array(values, dtype=bool)


def rheonomic(mechanism: Mechanism) -> bool:
    """Whether time enters the constraints."""
    texts = [getattr(c, key) for c in mechanism.constraints for key in ("length", "value") if hasattr(c, key)]
    texts += [equation for c in mechanism.constraints for equation in getattr(c, "equations", ())]
    return bool(mechanism.driven_names) or any("t" in names_in(expression.text) for expression in texts)


def _require_agreement(
    mechanism: Mechanism,
    conditions: Conditions,
    rows: Sequence[Row],
    keep: Sequence[int],
    around: Sequence[tuple[float, Array]],
) -> None:
    """Refuse drives that ask of redundant rows what the other rows forbid."""
    if not rheonomic(mechanism):
        return
    if all(t == 0.0 for t, _ in around):
        everything = np.ones(len(_each(mechanism, "held")), dtype=bool)
        closing = close_loops(conditions, LATER[0], around[0][1], everything)
        raise contradiction(mechanism, rows, closing.gaps)
    for t, q in around:
        gradient, drift = conditions.gradient(t, q), conditions.drift(t, q)
        dropped = [index for index in range(len(rows)) if index not in keep]
        shares = np.linalg.lstsq(gradient[list(keep)].T, gradient[dropped].T, rcond=1e-9)[0]
        off = np.zeros(len(rows))
        off[dropped] = drift[dropped] - shares.T @ drift[list(keep)]
        if np.max(np.abs(off), initial=0.0) > 1e-7 * max(1.0, float(np.max(np.abs(drift), initial=0.0))):
            raise contradiction(mechanism, rows, off)


def redundant_loops(rows: Sequence[Row], start: Start, conditions: Callable[[], Conditions]) -> list[str]:
    """The closing joints of which a row is dropped that is not zero everywhere."""
    gradients = [conditions().gradient(t, q) for t, q in start.nearby]
    found = [
        str(row.owner[1])
        for index, row in enumerate(rows)
        if index not in start.keep
        and row.owner[0] == "joints"
        and any(np.linalg.norm(gradient[index]) > ZERO * np.linalg.norm(gradient) for gradient in gradients)
    ]
    return list(dict.fromkeys(found))


def conditions_of(
    constraints: Constraints,
    state: State,
    kinetic: ca.SX,
    settled: Callable[[ca.SX], ca.SX],
    size: float,
    symbols: ca.SX,
) -> Callable[[Array], Conditions]:
    """The constraints as functions of numbers, given the values that `symbols` (n,) stand for."""
    t, q, u = state.t, state.q, state.u
    displacement = ca.SX.sym("d", u.shape[0])
    moved = settled(q + ca.jacobian(state.q_rates, u) @ displacement)
    at_rest = ca.SX.zeros(u.shape[0], 1)
    drift = ca.substitute(constraints.velocity, u, at_rest)

    def numbers(name: str, expression: ca.SX, inputs: Sequence[ca.SX]) -> Callable[..., Array]:
        function = ca.Function(name, [*inputs, symbols], [ca.densify(expression)])

        def value(*arguments: float | Array) -> Array:
            return np.array(function(*arguments), dtype=float).reshape(expression.shape)

        return value

    def vector(name: str, expression: ca.SX, inputs: Sequence[ca.SX]) -> Callable[..., Array]:
        value = numbers(name, expression, inputs)
        return lambda *arguments: value(*arguments).ravel()

    position = vector("position", constraints.position, [t, q])
    gradient = numbers("gradient", constraints.gradient, [t, q])
    drifting = vector("drift", drift, [t, q])
    mass = numbers("mass", ca.hessian(kinetic, u)[0], [t, q])
    senses = vector("senses", constraints.senses, [t, q])
    displaced = vector("moved", moved, [q, displacement])
    holonomic = np.array([row.position is not None for row in constraints.rows], dtype=bool)

    def at(values: Array) -> Conditions:
        return Conditions(
            position=lambda t, q: position(t, q, values),
            gradient=lambda t, q: gradient(t, q, values),
            drift=lambda t, q: drifting(t, q, values),
            mass=lambda t, q: mass(t, q, values),
            senses=lambda t, q: senses(t, q, values),
            moved=lambda q, d: displaced(q, d, values),
            size=size,
            holonomic=holonomic,
        )

    return at
