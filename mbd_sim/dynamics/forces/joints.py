"""Generalized forces of joints: efforts, springs, dampers, friction and stops, their potential and their powers.

They include the efforts and potentials of the file that act along joint coordinates. The potential of some springs,
those of points too, has a part that is added in Python: see `DistantPotential`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.kinematics.state_variables import StateVariables, function_of_coordinates
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.kinematics.wrenches import PowerSplit
from mbd_sim.dynamics.math.laws import distant_potential, elastic, friction, power_law
from mbd_sim.dynamics.math.spatial import is_absent
from mbd_sim.mechanism.elements.parts import Joint, Limits
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.laws import Linear, Varying

if TYPE_CHECKING:
    from mbd_sim.dynamics.math.distant_potentials import DistantPotential


@dataclass(frozen=True, eq=False)
class CoordinateForces:
    """The efforts and potentials of the file as forces in N or N·m: `generalized` (nv,), and `on_driven` ones by name.

    `potential` is in J, and the powers are in W.
    """

    generalized: ca.SX
    on_driven: Mapping[str, ca.SX]
    potential: ca.SX
    power: PowerSplit


def coordinate_forces(
    mechanism: Mechanism, state: StateVariables, q: ca.SX, q_rates: ca.SX, u: ca.SX
) -> CoordinateForces:
    """All efforts and potentials of the file; drives take up those on driven coordinates.

    :param q_rates: (nq,) N(q) u.
    """
    generalized, potential, power = ca.SX(u.shape[0], 1), ca.SX(1, 1), PowerSplit()
    on_driven: dict[str, ca.SX] = {}
    for effort in mechanism.efforts:
        value = state.value(effort.effort)
        power.add([effort.effort], value * state.speeds[effort.coordinate])
        if (row := state.rows.get(effort.coordinate)) is None:
            on_driven[effort.coordinate] = on_driven.get(effort.coordinate, ca.SX(1, 1)) + value
        else:
            generalized[row] += value
    for element in mechanism.potentials:
        found = function_of_coordinates(element.energy, state.positions, state.t)
        potential += found.value
        generalized -= ca.jacobian(q_rates, u).T @ ca.gradient(found.value, q)
        power.applied += found.time_slope  # a potential that changes with time is changed from outside
        for name, slope in found.slopes.items():
            if name not in state.rows:
                on_driven[name] = on_driven.get(name, ca.SX(1, 1)) - slope
    return CoordinateForces(ca.sparsify(generalized), on_driven, potential, power)


@dataclass(frozen=True, eq=False)
class JointForces:
    """The forces within joints, and those of the file along their coordinates.

    They are in N or N·m, positive with the speeds: `own` (nv,), each of which depends on its own coordinate only, and
    `varying` (nv,), which are given by expressions, as are those `on_driven` coordinates by name. `potential` is in J.
    `applied_power` is that of the efforts and `dissipated_power` that of dampers, friction and stops, in W; both
    include that of the `varying` forces, see `PowerSplit`.
    """

    own: ca.SX
    varying: ca.SX
    on_driven: Mapping[str, ca.SX]
    potential: ca.SX
    applied_power: ca.SX
    dissipated_power: ca.SX

    @property
    def generalized(self) -> ca.SX:
        """The sum of the forces (nv,)."""
        return self.own + self.varying


def joint_forces(
    links: Sequence[Link],
    q: ca.SX,
    u: ca.SX,
    efforts: ca.SX,
    state: StateVariables,
    along: CoordinateForces | None = None,
) -> JointForces:
    """All joint forces: effort - spring - dampers - friction - stops (Géradin & Rixen, virtual power).

    :param along: efforts and potentials of the file.
    """
    along = along or CoordinateForces(ca.SX(u.shape[0], 1), {}, ca.SX(1, 1), PowerSplit())
    own, varying, power = ca.SX(efforts), ca.SX(along.generalized), along.power
    potential = dissipated = ca.SX(1, 1)
    for link in links:
        for offset, row in enumerate(range(link.u.start, link.u.stop)):
            # For joints with quaternions q and u do not correspond entry by entry; such joints have no springs.
            coordinate = q[link.q.start + offset]
            elastic_force, energy = _spring(link.joint, offset, coordinate)
            if isinstance(link.joint.spring, Varying):
                x = coordinate - link.joint.rest[offset]
                force = -state.stretched(link.joint.spring.force, x, u[row])
                varying[row] += force
                power.add([link.joint.spring.force], force * u[row])
            dissipative_force = _resistance(link.joint, offset, u[row])
            limits = link.joint.limits_of(offset)
            if limits is not None and not is_absent(_stop_stiffness(limits)):
                push, stored, damping = stop_forces(limits, coordinate, u[row])
                elastic_force, energy = elastic_force + push, energy + stored
                dissipative_force = dissipative_force + damping
            own[row] -= elastic_force + dissipative_force
            potential += energy
            dissipated += dissipative_force * u[row]
    return JointForces(
        own=own,
        varying=varying,
        on_driven=along.on_driven,
        potential=potential + along.potential,
        applied_power=ca.dot(efforts, u) + power.applied,
        dissipated_power=dissipated + power.dissipated,
    )


def _spring(joint: Joint, offset: int, coordinate: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The force of a joint's spring against its coordinate, and the potential."""
    if isinstance(joint.spring, Varying) or (joint.spring is None and is_absent(joint.stiffness[offset])):
        return ca.SX(1, 1), ca.SX(1, 1)
    return elastic(joint.spring or Linear(joint.stiffness[offset]), coordinate - joint.rest[offset])


def _resistance(joint: Joint, offset: int, speed: ca.SX) -> ca.SX:
    """The force of the dampers and of dry friction against a speed."""
    force = ca.SX(1, 1) if is_absent(joint.damping[offset]) else joint.damping[offset] * speed
    if joint.damper is not None:
        force += power_law(joint.damper, speed**2)[0] * speed
    if joint.friction is not None and not joint.friction.sticks:
        force += friction(joint.friction, speed)
    elif joint.friction is not None and not is_absent(joint.friction.viscous):
        force += joint.friction.viscous * speed
    return force


def joint_dissipation(links: Sequence[Link], u: ca.SX) -> ca.SX:
    """Rayleigh's dissipation function in W of the dampers in joints, whose forces are minus its derivatives by u."""
    total = ca.SX(1, 1)
    for link in links:
        joint = link.joint
        for offset, row in enumerate(range(link.u.start, link.u.stop)):
            if not is_absent(joint.damping[offset]):
                total += 0.5 * joint.damping[offset] * u[row] ** 2
            if joint.damper is not None:
                total += power_law(joint.damper, u[row] ** 2)[1]
    return total


def stop_forces(limits: Limits, coordinate: ca.SX, speed: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The elastic force against the coordinate, its potential, and the force against the speed.

    A stop pushes back with k δ (1 + c δ') at the penetration δ, and never pulls (Hunt & Crossley 1975). The force
    k δ + d δ' would jump at the contact, where the speed is largest, and no method keeps its order across a jump.
    """
    k, c = _stop_stiffness(limits), limits.damping
    over = ca.fmax(coordinate - limits.upper, 0.0)
    under = ca.fmax(limits.lower - coordinate, 0.0)
    push, energy = k * (over - under), 0.5 * k * (over**2 + under**2)
    if is_absent(c):
        return push, energy, ca.SX(1, 1)
    # At a separation faster than 1 / c contact is lost: the force against the speed cancels the elastic force.
    return push, energy, k * (over * ca.fmax(c * speed, -1.0) + under * ca.fmin(c * speed, 1.0))


def _stop_stiffness(limits: Limits) -> float:
    return 0.0 if limits.stiffness is None else limits.stiffness


@dataclass(frozen=True, eq=False)
class DistantSprings:
    """`elongations(t, y)` (n,) in m or rad, of the springs with these potentials (n,)."""

    elongations: ca.Function
    potentials: tuple[DistantPotential, ...]

    def __len__(self) -> int:
        return len(self.potentials)

    def potential(self, elongations: Array) -> float:
        """What they add to V, in J."""
        return sum(
            potential(elongation) for potential, elongation in zip(self.potentials, elongations.tolist(), strict=True)
        )


def distant_springs(traced: TracedMechanism, lengths: ca.SX, inputs: Sequence[ca.SX]) -> DistantSprings | None:
    """Those of all joints and springs; None if there are none.

    :param lengths: (springs and dampers,) the distances between the ends in m.
    :param inputs: of the function `elongations`.
    """
    found = list(_found(traced, lengths))
    if not found:
        return None
    elongations, potentials = zip(*found, strict=True)
    return DistantSprings(ca.Function("elongations", list(inputs), [ca.densify(ca.vertcat(*elongations))]), potentials)


def _found(traced: TracedMechanism, lengths: ca.SX) -> Iterator[tuple[ca.SX, DistantPotential]]:
    for link in traced.links:
        joint = link.joint
        for offset in range(link.u.stop - link.u.start):
            if joint.spring is not None and (potential := distant_potential(joint.spring)) is not None:
                yield traced.state.q[link.q.start + offset] - joint.rest[offset], potential
    for index, spring in enumerate(traced.mechanism.springs):
        if (potential := distant_potential(spring.law)) is not None:
            yield lengths[index] - spring.length, potential
