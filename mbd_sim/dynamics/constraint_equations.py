"""The constraints of a mechanism in its generalized speeds: G(q, t) u + b(q, t) = 0, and G u' + γ = 0."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.body_symbols import (
    Bodies,
    flat_pose,
    own_wrench,
    world_twist,
)
from mbd_sim.dynamics.constraint_rows import (
    Row,
    constraint_rows,
    loop_ends,
    senses,
)
from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose
from mbd_sim.dynamics.links import Layout, Link
from mbd_sim.dynamics.time_functions import time_functions
from mbd_sim.mechanism.records import Mechanism


@dataclass(frozen=True, eq=False)
class State:
    """The symbols that everything is a function of, with q' (nq,) = N u."""

    t: ca.SX
    q: ca.SX
    u: ca.SX
    q_rates: ca.SX

    def rate(self, expression: ca.SX) -> ca.SX:
        """The time derivative of an expression of t and q, or the part without u' of one of u as well."""
        return ca.jtimes(expression, self.q, self.q_rates) + ca.jtimes(expression, self.t, ca.SX(1))


@dataclass(frozen=True, eq=False)
class Constraints:
    """The rows, all (m,) or (m, nv), as functions of the state.

    `position` is Φ, and zero for nonholonomic rows; `gradient` is G, `velocity` G u + b, and `bias` γ. A unit
    multiplier exerts on each link the `wrenches` (6, m), in its own frame, and on driven coordinates the
    `driven_factors` (m,) by name; through time in its own expression it takes the power `own_rate` (m,).
    `senses` are positive where loops are closed the right way round.
    """

    rows: Sequence[Row]
    position: ca.SX
    gradient: ca.SX
    velocity: ca.SX
    bias: ca.SX
    wrenches: Sequence[ca.SX]
    driven_factors: Mapping[str, ca.SX]
    own_rate: ca.SX
    senses: ca.SX

    def only(self, kept: Sequence[int]) -> Constraints:
        """Some of the rows."""
        kept = list(kept)
        return Constraints(
            rows=[self.rows[index] for index in kept],
            position=self.position[kept, :],
            gradient=self.gradient[kept, :],
            velocity=self.velocity[kept, :],
            bias=self.bias[kept, :],
            wrenches=[wrench[:, kept] for wrench in self.wrenches],
            driven_factors={name: factors[kept, :] for name, factors in self.driven_factors.items()},
            own_rate=self.own_rate[kept, :],
            senses=self.senses,
        )


def constraints_of(
    mechanism: Mechanism,
    chain: Sequence[Link],
    places: Layout,
    state: State,
    motions: Sequence[LinkMotion],
    poses: Sequence[WorldPose],
    turning: Collection[str] = (),
) -> Constraints:
    """Write the rows, see `constraint_rows`, and carry them over to the generalized speeds."""
    bodies, clock = Bodies(chain), ca.SX.sym("clock")
    rows = constraint_rows(mechanism, bodies, clock, turning)
    twists = [world_twist(link, motion, pose) for link, motion, pose in zip(chain, motions, poses, strict=True)]
    symbols = [ca.vertcat(*bodies.poses), ca.vertcat(*bodies.twists), clock]
    values = [ca.vertcat(*map(flat_pose, poses)), ca.vertcat(*twists), state.t]

    def in_motion(expression: ca.SX) -> ca.SX:
        return ca.sparsify(ca.substitute([expression], symbols, [ca.densify(value) for value in values])[0])

    on_bodies = ca.vertcat(ca.SX(0, 1), *(ca.SX(1, 1) if row.position is None else row.position for row in rows))
    slips = ca.vertcat(ca.SX(0, 1), *(ca.SX(1, 1) if row.velocity is None else row.velocity for row in rows))
    on_coordinates = _coupled(chain, state, rows)
    position, slip = in_motion(on_bodies) + on_coordinates, in_motion(slips)
    to_rates = ca.jacobian(state.q_rates, state.u)
    gradient = ca.sparsify(ca.jacobian(position, state.q) @ to_rates + ca.jacobian(slip, state.u))
    velocity = ca.sparsify(ca.jacobian(position, state.q) @ to_rates @ state.u + ca.jacobian(position, state.t) + slip)
    body_velocity = bodies.rate(on_bodies) + ca.jacobian(on_bodies, clock) + slips
    wrenches = in_motion(ca.jacobian(body_velocity, symbols[1])).T
    still = ca.substitute([body_velocity], [symbols[1]], [ca.SX.zeros(*symbols[1].shape)])[0]
    upright = [sense for joint in mechanism.closing.values() for sense in senses(joint, *loop_ends(joint, bodies))]
    return Constraints(
        rows=rows,
        position=position,
        gradient=gradient,
        velocity=velocity,
        bias=state.rate(velocity),
        wrenches=[
            ca.sparsify(own_wrench(link, pose, wrenches[6 * index : 6 * index + 6, :]))
            for index, (link, pose) in enumerate(zip(chain, poses, strict=True))
        ],
        driven_factors={
            name: ca.sparsify(ca.SX(ca.DM([row.factors.get(name, 0.0) for row in rows])))
            for name in mechanism.driven_names
        },
        own_rate=in_motion(still),
        senses=in_motion(ca.vertcat(ca.SX(0, 1), *upright)),
    )


def _coupled(chain: Sequence[Link], state: State, rows: Sequence[Row]) -> ca.SX:
    """What the coordinates themselves contribute to the positions (m,) of the rows."""
    coordinates = coordinates_of(chain, state.t, state.q)
    sums = (sum((k * coordinates[name] for name, k in row.factors.items()), ca.SX(1, 1)) for row in rows)
    return ca.vertcat(ca.SX(0, 1), *sums)


def coordinates_of(chain: Sequence[Link], t: ca.SX, q: ca.SX) -> dict[str, ca.SX]:
    """The coordinates by name, of free and of driven joints."""
    found: dict[str, ca.SX] = {}
    for link in chain:
        joint = link.joint
        values = time_functions(joint.drive, t)[0] if joint.drive else q[link.q, :]
        found |= {name: values[place] for place, name in enumerate(joint.motion_names) if place < values.shape[0]}
    return found
