"""The constraints of a mechanism in its generalized speeds: G(q, t) u + b(q, t) = 0, and G u' + γ = 0."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.constraints.rows import (
    ConstraintRow,
    IteratedNormal,
    branch_checks,
    constraint_rows,
    joint_frames,
)
from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.poses import BodySymbols, flat_pose, link_wrench, world_twist
from mbd_sim.dynamics.kinematics.state_variables import function_of_coordinates
from mbd_sim.dynamics.kinematics.tracing import StateSymbols, TracedMechanism


@dataclass(frozen=True, eq=False)
class ConstraintEquations:
    """The rows as functions of the state, all (m,) or (m, nv).

    `position` is Φ, zero for nonholonomic rows. `gradient` is G, `velocity` is G u + b, and `bias` is γ. A unit
    multiplier exerts the `wrenches` F_L (6, m) on each link, and the `driven_factors` (m,) on driven coordinates by
    name. A constraint whose expression holds time takes up the power `own_rate` (m,) for a unit multiplier.
    `branch_checks` are positive where all loops are closed in the right assembly mode.
    """

    rows: Sequence[ConstraintRow]
    position: ca.SX
    gradient: ca.SX
    velocity: ca.SX
    bias: ca.SX
    wrenches: Sequence[ca.SX]
    driven_factors: Mapping[str, ca.SX]
    own_rate: ca.SX
    branch_checks: ca.SX

    def select(self, indices: Sequence[int]) -> ConstraintEquations:
        """The equations of some of the rows."""
        chosen = list(indices)
        return ConstraintEquations(
            rows=[self.rows[index] for index in chosen],
            position=self.position[chosen, :],
            gradient=self.gradient[chosen, :],
            velocity=self.velocity[chosen, :],
            bias=self.bias[chosen, :],
            wrenches=[wrench[:, chosen] for wrench in self.wrenches],
            driven_factors={name: factors[chosen, :] for name, factors in self.driven_factors.items()},
            own_rate=self.own_rate[chosen, :],
            branch_checks=self.branch_checks,
        )


def joined(one: ConstraintEquations, other: ConstraintEquations) -> ConstraintEquations:
    """The rows of both."""
    return ConstraintEquations(
        rows=[*one.rows, *other.rows],
        position=ca.vertcat(one.position, other.position),
        gradient=ca.vertcat(one.gradient, other.gradient),
        velocity=ca.vertcat(one.velocity, other.velocity),
        bias=ca.vertcat(one.bias, other.bias),
        wrenches=[ca.horzcat(a, b) for a, b in zip(one.wrenches, other.wrenches, strict=True)],
        driven_factors={
            name: ca.vertcat(factors, other.driven_factors[name]) for name, factors in one.driven_factors.items()
        },
        own_rate=ca.vertcat(one.own_rate, other.own_rate),
        branch_checks=one.branch_checks,
    )


def constraint_equations(traced: TracedMechanism, own_axes: Collection[str] = ()) -> ConstraintEquations:
    """Write all rows, and express them in the generalized coordinates and speeds.

    :param own_axes: closing joints whose gap is measured along their own axes, see `constraint_rows`.
    """
    mechanism, bodies, time = traced.mechanism, BodySymbols(traced.links), ca.SX.sym("time")
    rows = constraint_rows(mechanism, bodies, time, own_axes)
    checks = [
        check for joint in mechanism.closures.values() for check in branch_checks(joint, *joint_frames(joint, bodies))
    ]
    return equations_of_rows(traced, bodies, time, rows, checks)


def equations_of_rows(
    traced: TracedMechanism,
    bodies: BodySymbols,
    time: ca.SX,
    rows: Sequence[ConstraintRow],
    checks: Sequence[ca.SX] = (),
) -> ConstraintEquations:
    """Express rows, and `branch_checks`, in the generalized coordinates and speeds.

    :param time: the symbol of time in the rows, which are written on the symbols of the `bodies`.
    """
    if not rows and not checks:
        return _no_equations(traced)
    mechanism, links, state, poses = traced.mechanism, traced.links, traced.state, traced.poses
    in_state, twists = expressed_in_state(traced, bodies, time), ca.vertcat(*bodies.twists)
    curves = coordinate_curves(links, state, rows)
    body_position = _stacked([row.position if row.normal is None else None for row in rows])
    body_slip = _stacked([row.velocity for row in rows])
    position = in_state(body_position) + _coupled_coordinates(links, state, rows) - curves.values
    slip = in_state(body_slip)
    to_rates = ca.jacobian(state.q_rates, state.u)
    gradient = ca.sparsify(ca.jacobian(position, state.q) @ to_rates + ca.jacobian(slip, state.u))
    velocity = ca.jacobian(position, state.q) @ to_rates @ state.u + ca.jacobian(position, state.t) + slip
    velocity = ca.sparsify(velocity + ca.jtimes(position, state.q, state.drive_rates))
    body_velocity = bodies.rate(body_position) + ca.jacobian(body_position, time) + body_slip
    wrenches = in_state(ca.jacobian(body_velocity, twists)).T
    own_rate = ca.substitute([body_velocity], [twists], [ca.SX.zeros(*twists.shape)])[0]
    normals = _iterated_normals(rows, bodies, in_state)
    apart = _stacked([None if row.normal is None else row.position for row in rows])
    return ConstraintEquations(
        rows=rows,
        position=position + normals.inserted(in_state(apart)),
        gradient=normals.inserted(gradient),
        velocity=normals.inserted(velocity),
        bias=normals.inserted(state.rate(velocity) + ca.jacobian(velocity, normals.symbols) @ normals.step),
        wrenches=[
            normals.inserted(ca.sparsify(link_wrench(link, X_WB, wrenches[6 * index : 6 * index + 6, :])))
            for index, (link, X_WB) in enumerate(zip(links, poses, strict=True))
        ],
        driven_factors={
            name: ca.sparsify(ca.SX(ca.DM([row.factors.get(name, 0.0) for row in rows]))) - curves.slopes(name)
            for name in mechanism.driven_names
        },
        own_rate=normals.inserted(in_state(own_rate)) - curves.time_rates,
        branch_checks=in_state(ca.vertcat(ca.SX(0, 1), *checks)),
    )


def _iterated_normals(
    rows: Sequence[ConstraintRow], bodies: BodySymbols, in_state: Callable[[ca.SX], ca.SX]
) -> IteratedNormal:
    """All iterated normals of rows in one vector, in the state, with their rates in place of the step."""
    found = list({id(row.normal): row.normal for row in rows if row.normal is not None}.values())
    none = ca.SX(0, 1)
    symbols, values = (ca.vertcat(none, *each) for each in ([n.symbols for n in found], [n.value for n in found]))
    rates = bodies.rate(ca.vertcat(none, *(normal.step for normal in found))) if found else none
    return IteratedNormal(symbols, in_state(values), in_state(rates))


def _no_equations(traced: TracedMechanism) -> ConstraintEquations:
    """The equations without rows and checks; writing them in the state of long chains takes a twentieth of tracing."""
    none = ca.SX(0, 1)
    return ConstraintEquations(
        rows=(),
        position=none,
        gradient=ca.SX(0, traced.layout.nv),
        velocity=none,
        bias=none,
        wrenches=[ca.SX(6, 0)] * len(traced.links),
        driven_factors=dict.fromkeys(traced.mechanism.driven_names, none),
        own_rate=none,
        branch_checks=none,
    )


def expressed_in_state(traced: TracedMechanism, bodies: BodySymbols, time: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """A function that expresses expressions of the symbols of the `bodies` and of `time` in the state."""
    poses = traced.poses
    twists = [
        world_twist(link, motion, X_WB) for link, motion, X_WB in zip(traced.links, traced.motions, poses, strict=True)
    ]
    symbols = [ca.vertcat(*bodies.poses), ca.vertcat(*bodies.twists), time]
    values = [ca.vertcat(*map(flat_pose, poses)), ca.vertcat(*twists), traced.state.t]
    dense = [ca.densify(value) for value in values]
    return lambda expression: ca.sparsify(ca.substitute([expression], symbols, dense)[0])


def _stacked(expressions: Sequence[ca.SX | None]) -> ca.SX:
    """The expressions as a column (m,), with zeros for those that are None."""
    return ca.vertcat(ca.SX(0, 1), *(ca.SX(1, 1) if one is None else one for one in expressions))


def _coupled_coordinates(links: Sequence[Link], state: StateSymbols, rows: Sequence[ConstraintRow]) -> ca.SX:
    """The contribution of joint coordinates to the positions (m,) of the rows, through the rows' factors."""
    coordinates = coordinates_by_name(links, state.t, state.q)
    sums = (sum((k * coordinates[name] for name, k in row.factors.items()), ca.SX(1, 1)) for row in rows)
    return ca.vertcat(ca.SX(0, 1), *sums)


@dataclass(frozen=True, eq=False)
class CoordinateCurves:
    """The `values` (m,) of the expressions of coordinates that rows subtract, and their partial derivatives in time."""

    values: ca.SX
    time_rates: ca.SX
    slopes_by_name: Mapping[str, ca.SX]

    def slopes(self, coordinate: str) -> ca.SX:
        """The partial derivatives (m,) of the values in a coordinate."""
        return self.slopes_by_name.get(coordinate, ca.SX(*self.values.shape))


def coordinate_curves(links: Sequence[Link], state: StateSymbols, rows: Sequence[ConstraintRow]) -> CoordinateCurves:
    """The expressions of coordinates in the rows; zeros for rows without one."""
    coordinates = coordinates_by_name(links, state.t, state.q)
    values, time_rates, slopes = ca.SX(len(rows), 1), ca.SX(len(rows), 1), dict[str, ca.SX]()
    for index, row in enumerate(rows):
        if row.less is None:
            continue
        values[index], time_rates[index], partial = function_of_coordinates(row.less, coordinates, state.t)
        for name, slope in partial.items():
            slopes.setdefault(name, ca.SX(len(rows), 1))[index] = slope
    return CoordinateCurves(ca.sparsify(values), ca.sparsify(time_rates), slopes)


def coordinates_by_name(links: Sequence[Link], t: ca.SX, q: ca.SX) -> dict[str, ca.SX]:
    """The coordinates of free and of driven joints in m and rad."""
    coordinates: dict[str, ca.SX] = {}
    for link in links:
        joint = link.joint
        values = driven_motion(link, t, q)[0] if joint.drive else q[link.q, :]
        coordinates |= dict(zip(joint.motion_names, ca.vertsplit(values), strict=False))
    return coordinates
