"""The start of a mechanism as a state, at which its equations must be regular."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError, MechanismError, NoInertiaError, Problem, listed
from mbd_sim.base.geometry.pose import Array, unpack_poses
from mbd_sim.dynamics.accelerations import AppliedForces
from mbd_sim.dynamics.constraints.errors import undefined_constraints
from mbd_sim.dynamics.constraints.start import AssembledStart, Assembly
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.layouts.vectors import coordinate_layout
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.dynamics.recursion.articulated_body import FactorizedMassMatrix
from mbd_sim.mechanism.contents import ForceExpression, expressions_of_forces
from mbd_sim.mechanism.elements.forces import Damper, Spring
from mbd_sim.mechanism.elements.parts import Joint, Part
from mbd_sim.mechanism.mass_properties import state_numbers
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.mechanism.values.expression import TIME
from mbd_sim.mechanism.values.laws import ELONGATION, ELONGATION_RATE

if TYPE_CHECKING:
    from mbd_sim.dynamics.actuators.functions import ActuatorFunctions


def _start_state(traced: TracedMechanism, start: AssembledStart) -> Array:
    return np.concatenate([start.q, start.u, np.zeros(traced.y.shape[0] - len(start.q) - len(start.u))])


def start_with_actuators(
    traced: TracedMechanism, start: AssembledStart, forces: AppliedForces
) -> tuple[Array, ActuatorFunctions | None]:
    """The start state, with the states of the actuators, and their functions."""
    y = _start_state(traced, start)
    if forces.actuators is None:
        return y, None
    from mbd_sim.dynamics.actuators.functions import actuator_functions, require_within_strokes

    functions = actuator_functions(traced, forces.actuators)
    functions.hold(traced.numeric.actuators, y)
    require_within_strokes(traced.numeric, functions, y)
    return y, functions


def require_regular_start(
    traced: TracedMechanism, assembly: Assembly, forces: AppliedForces, mass_matrix: FactorizedMassMatrix
) -> None:
    """Refuse a start at which a constraint or a force is undefined, or the mass matrix singular.

    :raises MechanismError: it names what is undefined, or the parts that can move without inertia.
    """
    elements = [ca.densify(forces.elements.lengths), ca.densify(forces.elements.rates)]
    outputs = [ca.densify(assembly.equations.bias), *elements, mass_matrix.pivots, traced.flat_poses]
    symbols = [traced.state.t, traced.y, traced.parameters.symbols]
    at_start = ca.Function("at_start", symbols, outputs)
    values = at_start(0.0, _start_state(traced, assembly.start), traced.parameters.base)
    bias, lengths, rates, pivots, poses = (np.array(value).ravel() for value in values)
    if not np.all(finite := np.isfinite(bias)):
        raise undefined_constraints(traced.numeric, assembly.equations.rows, ~finite)
    start = StartOfForces(assembly.start.q, assembly.start.u, lengths, rates)
    require_defined_forces(traced.numeric, start)
    links = traced.numeric_links
    require_definite(traced.numeric, links, pivots, poses.reshape(-1, 12))
    if traced.layout.nv:
        require_independent(traced.numeric, links, start_mass_matrix(traced, assembly.start.q))


def start_mass_matrix(traced: TracedMechanism, q: Array) -> Array:
    """The mass matrix (nv, nv) at t = 0, a column for each speed: M e = ∂/∂u (∂T/∂u) e.

    For a hundred joints that takes a tenth of the time of an expression of all its entries.
    """
    u, direction = traced.state.u, ca.SX.sym("e", traced.layout.nv)
    column = ca.jtimes(traced.momenta, u, direction)
    column = ca.substitute(column, u, ca.SX.zeros(u.shape[0], 1))  # which are left in terms that cancel
    symbols = [traced.state.t, traced.state.q, direction, traced.parameters.symbols]
    function = ca.Function("column", symbols, [ca.densify(column)])
    directions = np.eye(traced.layout.nv)
    return np.column_stack([evaluated(function, 0.0, q, each, traced.parameters.base).ravel() for each in directions])


PIVOT_ROUND_OFF = 1e-13  # relative to an inertia: the largest pivot, or eigenvalue, that counts as zero
INVOLVED = 0.1  # the smallest share of a coordinate in a motion without inertia, relative to the largest share


def require_definite(mechanism: Mechanism, links: Sequence[Link], pivots: Array, poses: Array) -> None:
    """Refuse a singular mass matrix.

    A pivot is the inertia that a joint moves while all joints outboard of it move freely. It counts as zero if it is
    no more than round-off of the inertia that the joint carries. So neither units nor the size of other parts matter.

    :param pivots: (nv,) in kg or kg·m², in the order of the coordinates.
    :param poses: the pose rows (links, 12) of each link's part in ground's frame, see `unpack_poses`.
    :raises NoInertiaError: the joints that make it singular are named.
    """
    positions, rotations = unpack_poses(poses)
    bodies = mechanism.bodies
    carried = [_CarriedInertia(0.0, np.zeros(3), 0.0)] * len(links)
    refused = [False] * len(links)  # the link's joint, or one outboard of it
    problems: list[Problem] = []
    for index in reversed(range(len(links))):
        link, p_WB, R_WB = links[index], positions[index], rotations[index]
        part = bodies[link.joint.outboard]
        carried[index] += _CarriedInertia(part.mass, p_WB + R_WB @ part.center, float(np.trace(part.inertia)))
        moves = link.u.stop > link.u.start
        if moves and carried[index].mass == 0.0 and carried[index].trace == 0.0:
            refused[index] = True
            problems.append(_massless(mechanism, link))
        if moves and not refused[index]:
            p_WL = p_WB - R_WB @ link.X_LB.rotation.T @ link.X_LB.position
            scale = np.where(_is_moment(link.joint), carried[index].moment_about(p_WL), carried[index].mass)
            refused[index] = bool(np.any(~(pivots[link.u] > PIVOT_ROUND_OFF * scale)))
            if refused[index]:
                problems.append(_no_inertia(mechanism, link))
        if link.parent >= 0:
            carried[link.parent] += carried[index]
            refused[link.parent] |= refused[index]
    if problems:
        raise NoInertiaError(sorted(problems, key=lambda problem: problem.line))


def require_independent(mechanism: Mechanism, links: Sequence[Link], mass_matrix: Array) -> None:
    """Refuse joints that together can move without moving any inertia, though each of them alone cannot.

    An example is a particle that three joints turn about one point. The mass matrix counts as singular if its smallest
    eigenvalue is no more than round-off, after each coordinate is scaled to an inertia of 1.

    :param mass_matrix: (nv, nv), definite according to `require_definite`.
    :raises NoInertiaError: the joints and the parts without an inertia of their own are named.
    """
    sizes = np.sqrt(np.diag(mass_matrix))
    scaled = mass_matrix / np.outer(sizes, sizes)
    if not len(scaled) or np.linalg.eigvalsh(scaled)[0] > PIVOT_ROUND_OFF:
        return
    shares = np.abs(np.linalg.eigh(scaled).eigenvectors[:, 0])
    joints = [index for index, link in enumerate(links) if np.any(shares[link.u] > INVOLVED * np.max(shares))]
    names = [f"'{links[index].joint.name}'" for index in joints]
    moved: set[int] = set()
    for index, link in enumerate(links):
        if index in joints or link.parent in moved:
            moved.add(index)
    bodies = mechanism.bodies
    parts = [bodies[links[index].joint.outboard] for index in sorted(moved)]
    points = [f"'{part.name}'" for part in parts if part.mass > 0.0 and _is_particle(part)]
    message = f"the joints {listed(names)} together can move without moving any inertia"
    remedy = "Give the parts that they move an inertia, or fix or drive one of the joints."
    if points:
        remedy += f" These parts have none: {listed(points)}."
    raise NoInertiaError([mechanism.source.problem(("joints", links[joints[-1]].joint.name), message, remedy)])


def _is_particle(part: Part) -> bool:
    """Whether the inertia of a part about its center is round-off of that of its mass at 1 m."""
    return float(np.trace(part.inertia)) <= PIVOT_ROUND_OFF * part.mass


def _is_moment(joint: Joint) -> list[bool]:
    """Whether each pivot of a joint is a moment of inertia rather than a mass."""
    return [coordinate.rotation for coordinate in joint.kind.coordinates]


def _massless(mechanism: Mechanism, link: Link) -> Problem:
    message = f"nothing that this joint moves has mass: '{link.joint.outboard}' is a massless chain end"
    remedy = "Give the part a mass, fix it to a part that has one, or give the joint a drive."
    if mechanism.closures:
        remedy += " In place of a massless rod between two parts of a loop, write the constraint 'distance'."
    return mechanism.source.problem(("joints", link.joint.name), message, remedy)


def _no_inertia(mechanism: Mechanism, link: Link) -> Problem:
    message = "this joint moves no inertia of its own: its coordinate has no equation of motion"
    remedy = (
        "Give the part that it moves a mass away from the axis, or an inertia about it (a thin rod has none about "
        "itself). Two joints with the same motion also need a mass between them. In a loop, 'cut: true' at "
        "another joint may help."
    )
    return mechanism.source.problem(("joints", link.joint.name), message, remedy)


@dataclass(frozen=True, eq=False)
class _CarriedInertia:
    """Parts that move together: `mass` in kg, `center` (3,) of mass in ground's frame in m, `trace` in kg·m².

    The trace is that of the inertia matrix about the center of mass.
    """

    mass: float
    center: Array
    trace: float

    def __add__(self, other: _CarriedInertia) -> _CarriedInertia:
        mass = self.mass + other.mass
        if mass == 0.0:
            return self
        arm = other.center - self.center
        share = other.mass / mass
        trace = self.trace + other.trace + 2.0 * self.mass * share * float(arm @ arm)
        return _CarriedInertia(mass, self.center + share * arm, trace)

    def moment_about(self, point: Array) -> float:
        """The trace of the inertia matrix about a point (3,), an upper bound of its moments of inertia, kg·m²."""
        arm = self.center - point
        return self.trace + 2.0 * self.mass * float(arm @ arm)


COINCIDENT = 1e-12  # of the natural length


@dataclass(frozen=True, slots=True)
class StartOfForces:
    """Coordinates q (nq,) and speeds u (nv,) at the start, and the `lengths` (n,) of springs and dampers.

    The lengths are in m, and their `rates` (n,) in m/s.
    """

    q: Array
    u: Array
    lengths: Array
    rates: Array


def require_defined_forces(mechanism: Mechanism, start: StartOfForces) -> None:
    """Refuse forces that are undefined at the start: no direction, or no finite value.

    :raises MechanismError: the elements are named.
    """
    problems = list(_undefined_expressions(mechanism, start))
    least = COINCIDENT * natural_units(mechanism, mechanism.step).length
    for element, length in zip(mechanism.two_point_elements, start.lengths, strict=True):
        if not element.needs_line or length > least:
            continue
        match element:
            case Spring():
                kind, remedy = "spring", "a spring without length or damping needs no direction."
            case Damper():
                kind, remedy = "damper", "a damper with 'along: velocity' needs no direction."
            case _:
                assert_never(element)
        message = f"the ends coincide at the start, where the {kind} has no direction"
        location = ("forces", element.name, "between")
        problems.append(mechanism.source.problem(location, message, f"Move one of the points; {remedy}"))
    if problems:
        raise MechanismError(problems)


def _undefined_expressions(mechanism: Mechanism, start: StartOfForces) -> Iterator[Problem]:
    """Expressions of springs and of the motion that have no finite value at the start."""
    for force in expressions_of_forces(mechanism):
        variables = state_numbers(mechanism, force.expression, 0.0, np.concatenate([start.q, start.u]))
        variables |= _elongation(mechanism, force, start)
        try:
            force.expression.value(variables)
        except InputError:
            shown = {name: value for name, value in variables.items() if name in force.expression.variables - {TIME}}
            where = ", ".join(f"{name} = {value:g}" for name, value in shown.items())
            message = f"has no finite value at the start, where {where}"
            remedy = "Write a force for every elongation that occurs." if force.stretched else _REMEDY
            yield mechanism.source.problem(force.location, message, remedy)


_REMEDY = "Write an expression that is finite over the whole motion."


def _elongation(mechanism: Mechanism, force: ForceExpression, start: StartOfForces) -> dict[str, float]:
    """The elongation of the spring to which an expression belongs, and its rate; empty if it belongs to none."""
    if force.stretched is None:
        return {}
    if isinstance(force.stretched, Spring):
        index = mechanism.springs.index(force.stretched)
        x, rate = start.lengths[index] - force.stretched.length, start.rates[index]
    else:
        layout, joint = coordinate_layout(mechanism), force.stretched
        x, rate = start.q[layout.q[joint.name].start] - joint.rest[0], start.u[layout.u[joint.name].start]
    return {ELONGATION: float(x), ELONGATION_RATE: float(rate)}
