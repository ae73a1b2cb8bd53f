"""The equations of motion of a mechanism, traced once into functions that the compiler turns into machine code.

The integrated state y is q (nq,), u (nv,), and three energies that the audit needs: the work of the applied forces,
the work of the drives, and the dissipated energy, in J.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from mbd_sim.dynamics.articulated_body import Accelerations, Articulated
from mbd_sim.dynamics.assembly import Conditions
from mbd_sim.dynamics.assembly_errors import no_value
from mbd_sim.dynamics.constraint_equations import Constraints, State, constraints_of
from mbd_sim.dynamics.constraint_rows import Row
from mbd_sim.dynamics.element_forces import element_loads, require_lines
from mbd_sim.dynamics.initial_conditions import (
    Start,
    assembled_start,
    conditions_of,
    redundant_loops,
)
from mbd_sim.dynamics.input_layout import InputLayout
from mbd_sim.dynamics.joint_forces import joint_loads
from mbd_sim.dynamics.kinematics import LinkMotion, WorldPose, link_motions, part_poses
from mbd_sim.dynamics.links import Layout, Link, layout, links
from mbd_sim.dynamics.mass_matrix_check import require_definite
from mbd_sim.dynamics.multipliers import ConstraintSolver, usual_sizes
from mbd_sim.dynamics.reactions import joint_reactions, transmitted_wrenches
from mbd_sim.dynamics.spatial_algebra import constant
from mbd_sim.dynamics.symbolic_parameters import (
    Values,
    numbers_of,
    values_among,
    with_symbols,
)
from mbd_sim.dynamics.time_functions import require_smooth, time_functions
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism

AUDIT = ("work_applied", "work_drives", "dissipated")


@dataclass(frozen=True, eq=False)
class Equations:
    """What the compiler turns into machine code, and what is computed on request.

    The inputs are described in `InputLayout`; without loaded parts and values they are the efforts.
    `rates(t, y, inputs)` gives y' and, where there are constraints, a number that is negative
    where they are nearly singular;
    `settle(t, y)`, where there are quaternions or constraints, leads y back to them;
    `energies(t, y)` gives T and V; `poses(t, y)` gives (12,) a part: position and rotation, column by column;
    `drives(t, y, inputs)` gives the coordinates (n,) of driven joints in declared order, their speeds, and the
    forces that the drives exert. `multipliers(t, y, inputs)` (m,) has one of each of all constraint `rows`, zero for
    the redundant ones; `violation(t, y)` (m, 2) is Φ and G u + b. `reactions(t, y, inputs)` (6, joints) is described
    in `joint_reactions`. Where there are values among the inputs, all of these take the inputs as well.
    """

    layout: Layout
    inputs: InputLayout
    values: Values
    rates: ca.Function
    energies: ca.Function
    poses: ca.Function
    drives: ca.Function
    settle: ca.Function | None
    multipliers: ca.Function
    violation: ca.Function
    reactions: Callable[[], ca.Function]
    rows: tuple[Row, ...]
    start: Start
    start_state: Array
    part_names: tuple[str, ...]
    make_conditions: Callable[[Array], Conditions]

    @cached_property
    def conditions(self) -> Conditions:
        """The constraints and the mass matrix as functions of numbers."""
        return self.make_conditions(self.values.base)


def derive(mechanism: Mechanism, loaded: Sequence[str] = (), values: Values | None = None) -> Equations:
    """Trace the equations of a mechanism.

    :param loaded: parts on which external wrenches act.
    :param values: the numbers of the mechanism that are inputs, if any are.
    :raises MechanismError: the mass matrix is singular at the start, a spring has no direction there, a drive no
        velocity or acceleration, or the constraints cannot be met; joints, springs and constraints are named.
    """
    require_smooth(mechanism)
    values = values or values_among(numbers_of(mechanism), ())
    plain, (mechanism, chain) = mechanism, with_symbols(mechanism, values)
    places = layout(mechanism)
    taken = InputLayout(places.nv, tuple(loaded), len(values.base))
    t, efforts = ca.SX.sym("t"), ca.SX.sym("e", places.nv)
    inputs = ca.vertcat(efforts, ca.SX.sym("w", taken.of_values.start - places.nv), values.symbols)
    y = ca.SX.sym("y", places.nq + places.nv + len(AUDIT))
    q, u, audit = ca.vertsplit(y, [0, places.nq, places.nq + places.nv, y.shape[0]])

    motions = link_motions(chain, t, q, u)
    poses = part_poses(chain, t, q)
    state = State(t, q, u, _q_rates(chain, motions, places.nq))
    kinetic = _kinetic_energy(chain, motions)
    world = _World(plain, mechanism, chain, places, state, motions, poses, kinetic, values)
    everything, start, conditions = _closed(world)
    start_state = np.concatenate([start.q, start.u, np.zeros(len(AUDIT))])

    loads = joint_loads(chain, q, u, efforts)
    elements = element_loads(mechanism, chain, motions, poses, t, taken.external(inputs))
    matrix = Articulated(chain, motions, places.nv)
    flat = ca.densify(ca.vertcat(*(ca.vertcat(pose.position, ca.vec(pose.rotation)) for pose in poses)))
    looked_at = [matrix.pivots, flat, elements.lengths, ca.densify(everything.bias)]
    at_start = ca.Function("at", [t, y, values.symbols], looked_at)
    pivots, poses_at, lengths, bias = at_start(0.0, start_state, values.base)
    if not np.all(finite := np.isfinite(np.array(bias).ravel())):
        raise no_value(plain, everything.rows, ~finite)
    require_lines(plain, np.array(lengths).ravel())
    require_definite(plain, links(plain), np.array(pivots).ravel(), np.array(poses_at).reshape(-1, 12))

    kept = everything.only(start.keep)
    loading = (loads.generalized, elements.wrenches, mechanism.gravity)
    margin: list[ca.SX] = []
    if kept.rows:
        solver = ConstraintSolver(matrix, kept, usual_sizes(conditions(values.base), start))
        margin = [ca.densify(solver.margin)]
        acting, still = matrix.acting(*loading)
        multipliers = solver.multipliers(acting)
        moving = solver.accelerations(acting, multipliers) + Accelerations(ca.SX(places.nv, 1), still)
        wrenches = [own + unit @ multipliers for own, unit in zip(elements.wrenches, kept.wrenches, strict=True)]
    else:
        multipliers, moving, wrenches = ca.SX(0, 1), matrix.accelerations(*loading), elements.wrenches
    transmitted = transmitted_wrenches(chain, motions, moving.links, wrenches)
    coupling = {name: ca.dot(factors, multipliers) for name, factors in kept.driven_factors.items()}
    drives = _drives(mechanism, chain, motions, transmitted, coupling, t)
    audit_rates = ca.vertcat(
        loads.applied_power + elements.applied_power,
        ca.dot(drives[:, 1], drives[:, 2]) - ca.dot(kept.own_rate, multipliers),
        loads.dissipated_power + elements.dissipated_power,
    )
    y_rates = ca.vertcat(state.q_rates, moving.u_rates, audit_rates)
    potential = loads.potential + elements.potential + _weight_potential(mechanism, chain, poses)
    all_multipliers = ca.SX(len(everything.rows), 1)
    all_multipliers[list(start.keep)] = multipliers
    settled = ca.vertcat(_settled(chain, q), u, audit)
    if kept.rows:
        displacement, change = solver.corrections(state)
        back = q + ca.jacobian(state.q_rates, u) @ displacement
        settled = ca.vertcat(_settled(chain, back), u + change, audit)

    given = [t, y, inputs]
    here = given if len(values.base) else [t, y]

    def reactions() -> ca.Function:
        found = joint_reactions(mechanism, chain, motions, poses, transmitted, everything, all_multipliers)
        return _function("reactions", given, [ca.densify(found)])

    return Equations(
        layout=places,
        inputs=taken,
        values=values,
        rates=_function("rates", given, [ca.densify(y_rates), *margin]),
        energies=_function("energies", here, [ca.densify(ca.vertcat(kinetic, potential))]),
        poses=_function("poses", here, [flat]),
        drives=_function("drives", given, [ca.densify(ca.vec(drives))]),
        settle=None if ca.is_equal(settled, y) else _function("settle", here, [ca.densify(settled)]),
        multipliers=_function("multipliers", given, [ca.densify(all_multipliers)]),
        violation=_function("violation", here, [ca.densify(ca.horzcat(everything.position, everything.velocity))]),
        reactions=reactions,
        rows=tuple(everything.rows),
        start=start,
        start_state=start_state,
        part_names=tuple(link.joint.outboard for link in chain),
        make_conditions=conditions,
    )


@dataclass(frozen=True, eq=False)
class _World:
    """A mechanism in numbers and, as `mechanism`, with symbols for its values; and how it moves."""

    plain: Mechanism
    mechanism: Mechanism
    chain: Sequence[Link]
    places: Layout
    state: State
    motions: Sequence[LinkMotion]
    poses: Sequence[WorldPose]
    kinetic: ca.SX
    values: Values


def _closed(world: _World) -> tuple[Constraints, Start, Callable[[Array], Conditions]]:
    """The constraints, a start that meets them, and their conditions.

    Rows are dropped once and for all, so each must stay redundant. Where one that is dropped is not simply zero, as
    out of the plane of a plane loop, the rows of its loop are written along axes that turn with it.
    """

    def write(turning: Collection[str]) -> tuple[Constraints, Start, Callable[[Array], Conditions]]:
        everything = constraints_of(
            world.mechanism, world.chain, world.places, world.state, world.motions, world.poses, turning
        )

        @functools.cache
        def traced() -> Callable[[Array], Conditions]:
            settled = functools.partial(_settled, world.chain)
            symbols, size = world.values.symbols, _size(world.plain)
            return conditions_of(everything, world.state, world.kinetic, settled, size, symbols)

        def conditions(values: Array) -> Conditions:
            return traced()(values)

        at_base = functools.partial(conditions, world.values.base)
        return everything, assembled_start(world.plain, world.places, at_base, everything.rows), conditions

    everything, start, conditions = write(())
    at_base = functools.partial(conditions, world.values.base)
    turning = redundant_loops(everything.rows, start, at_base) if everything.rows else []
    return write(turning) if turning else (everything, start, conditions)


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, inputs, outputs, {"cse": True})


def _q_rates(chain: Sequence[Link], motions: Sequence[LinkMotion], nq: int) -> ca.SX:
    rates = ca.SX(nq, 1)
    for link, motion in zip(chain, motions, strict=True):
        rates[link.q] = motion.joint.q_rates
    return rates


def _drives(
    mechanism: Mechanism,
    chain: Sequence[Link],
    motions: Sequence[LinkMotion],
    wrenches: Sequence[ca.SX],
    coupling: Mapping[str, ca.SX],
    t: ca.SX,
) -> ca.SX:
    """(n, 3): coordinates, speeds and forces of the drives, in declared order.

    :param wrenches: (6,) transmitted by each link's joint.
    :param coupling: what constraints of the coordinates themselves already exert on some of them, by name.
    """
    driven = {}
    for link, motion, wrench in zip(chain, motions, wrenches, strict=True):
        if (drive := motion.joint.drive) is not None:
            given = ca.vertcat(*(coupling.get(name, ca.SX(1, 1)) for name in link.joint.motion_names))
            force = drive.partial_velocities.T @ wrench - given
            driven[link.joint.name] = ca.horzcat(time_functions(link.joint.drive, t)[0], drive.speeds, force)
    return ca.vertcat(ca.SX(0, 3), *(driven[name] for name in mechanism.joints if name in driven))


def _kinetic_energy(chain: Sequence[Link], motions: Sequence[LinkMotion]) -> ca.SX:
    energy = ca.SX(1, 1)
    for link, motion in zip(chain, motions, strict=True):
        energy += 0.5 * ca.dot(motion.velocity, constant(link.inertia) @ motion.velocity)
    return energy


def _weight_potential(mechanism: Mechanism, chain: Sequence[Link], poses: Sequence[WorldPose]) -> ca.SX:
    """-Σ m g·r of the mass centres, zero with all of them at ground's origin."""
    potential = ca.SX(1, 1)
    for link, pose in zip(chain, poses, strict=True):
        part = mechanism.parts[link.joint.outboard]
        center = pose.position + pose.rotation @ constant(part.center)
        potential -= part.mass * ca.dot(constant(mechanism.gravity), center)
    return potential


def _settled(chain: Sequence[Link], q: ca.SX) -> ca.SX:
    """Coordinates with unit quaternions."""
    settled = ca.SX(q)
    for link in chain:
        if (offset := link.joint.kind.quaternion) is not None and not link.joint.drive:
            first = link.q.start + offset
            p = q[first : first + 4]
            settled[first : first + 4] = p / ca.sqrt(ca.dot(p, p))
    return settled


def _size(mechanism: Mechanism) -> float:
    """How far the points of the mechanism's parts lie from their origins at most, m."""
    poses = [pose for joint in mechanism.all_joints.values() for pose in (joint.parent_pose, joint.child_pose)]
    poses += [pose for part in mechanism.parts.values() for pose in part.points.values()]
    points = [*(pose.position for pose in poses), *(part.center for part in mechanism.parts.values())]
    return max((float(np.linalg.norm(point)) for point in points), default=0.0) or 1.0
