"""The symbols of a mechanism's state and inputs, and the motion of its parts as expressions of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca

from mbd_sim.dynamics.kinematics.drives import (
    disturbance_count,
    disturbed,
    drive_command_count,
    drive_command_slices,
    drive_rates,
    require_resolved,
    with_room,
)
from mbd_sim.dynamics.kinematics.links import Link, build_links, rotor_inertias
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters, no_parameters, with_symbols
from mbd_sim.dynamics.kinematics.poses import (
    LinkMotion,
    SymbolicPose,
    coordinate_rates,
    flat_pose,
    link_motions,
    part_poses,
)
from mbd_sim.dynamics.layouts.actuators import ActuatorLayout, actuator_layout
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout, InputLayout, audit_states, coordinate_layout
from mbd_sim.dynamics.math.spatial import constant, inlined
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class StateSymbols:
    """The symbols t, q (nq,) and u (nv,) of which everything is a function, and q' (nq,).

    q' is N(q) u plus the `drive_rates` (nq,), those of the states of commanded drives.
    """

    t: ca.SX
    q: ca.SX
    u: ca.SX
    q_rates: ca.SX
    drive_rates: ca.SX

    def rate(self, expression: ca.SX) -> ca.SX:
        """The time derivative of an expression of t and q; for one of u as well, its part without u'."""
        return ca.jtimes(expression, self.q, self.q_rates) + ca.jtimes(expression, self.t, ca.SX(1))


@dataclass(frozen=True, eq=False)
class TracedMechanism:
    """A mechanism whose motion is traced as a function of symbols.

    `numeric` is the mechanism in numbers; `mechanism` and `links` hold symbols in place of its `parameters`. The
    integrated state `y` is q (nq,), u (nv,), the `actuator_states` in the order of the layout `actuators`, and the
    energies `audit` in J, see `audit_states`. `inputs` are described in `input_layout`; the `efforts` (nv,) are their
    first part. `motions` and `poses` are those of the links. `rotor_inertia` (nv,) adds to the diagonal of the mass
    matrix, in kg·m² or kg; None without any. `step` is in s.
    """

    numeric: Mechanism
    mechanism: Mechanism
    links: Sequence[Link]
    layout: CoordinateLayout
    parameters: SymbolicParameters
    input_layout: InputLayout
    state: StateSymbols
    y: ca.SX
    audit: ca.SX
    inputs: ca.SX
    efforts: ca.SX
    motions: Sequence[LinkMotion]
    poses: Sequence[SymbolicPose]
    kinetic_energy: ca.SX
    actuators: ActuatorLayout
    actuator_states: ca.SX
    rotor_inertia: ca.SX | None
    step: float

    @cached_property
    def momenta(self) -> ca.SX:
        """The generalized momenta ∂T/∂u (nv,), in N·s or N·m·s."""
        return ca.gradient(self.kinetic_energy, self.state.u)

    @cached_property
    def flat_poses(self) -> ca.SX:
        """The poses of the links, (12,) each, one after the other: see `Equations.poses`."""
        return ca.densify(ca.vertcat(*map(flat_pose, self.poses)))

    @property
    def part_names(self) -> tuple[str, ...]:
        """The parts of the first links; those after them carry pieces of split parts."""
        return tuple(link.joint.outboard for link in self.links if not link.joint.splits)

    @property
    def numeric_links(self) -> Sequence[Link]:
        """The links without symbols."""
        return build_links(self.numeric) if len(self.parameters.base) else self.links

    @property
    def core(self) -> slice:
        """The components of y that rates depend on, after the coordinates: the speeds, and states of actuators."""
        first = self.layout.nq
        return slice(first, first + self.layout.nv + len(self.actuators.core))


def trace(
    mechanism: Mechanism,
    loaded: Sequence[str] = (),
    parameters: SymbolicParameters | None = None,
    step: float | None = None,
    *,
    disturb: bool = False,
) -> TracedMechanism:
    """Introduce the symbols and trace poses, velocities and the kinetic energy.

    :param loaded: parts on which external wrenches act.
    :param parameters: the numbers of the mechanism that are inputs; none by default.
    :param step: in s; by default that of the mechanism.
    :param disturb: whether the inputs include changes of the motion of drives and of ground, see `disturbances`.
    :raises MechanismError: the step does not divide the period of a servo, or a delay, or is too long for a drive.
    """
    parameters = parameters or no_parameters()
    disturbances = disturbance_count(mechanism) if disturb else 0
    parameters = with_room(parameters, disturbances)
    symbolic, links = with_symbols(mechanism, parameters)
    symbolic, links = disturbed(symbolic, links, parameters.symbols[len(parameters.base) - disturbances :])
    layout = coordinate_layout(mechanism)
    nq, nv = layout.nq, layout.nv
    input_layout = InputLayout(nv, tuple(loaded), len(parameters.base), disturbance_count=disturbances)
    step = step or mechanism.step
    actuators = actuator_layout(symbolic, nq + nv, input_layout.values.start, step)
    drive_commands = drive_command_slices(mechanism, input_layout.values.start + actuators.command_count)
    count = actuators.command_count + drive_command_count(mechanism)
    input_layout = replace(input_layout, command_count=count)
    require_resolved(mechanism, step)
    t, efforts = ca.SX.sym("t"), ca.SX.sym("e", nv)
    commands = ca.SX.sym("w", input_layout.values.start - nv)
    y = ca.SX.sym("y", nq + nv + actuators.size + len(audit_states(mechanism)))
    q, u, states, audit = ca.vertsplit(y, [0, nq, nq + nv, nq + nv + actuators.size, y.shape[0]])
    motions = link_motions(links, t, q, u)
    kinetic, rotors = kinetic_energy(links, motions), rotor_inertias(symbolic.actuators, links, nv)
    if rotors is not None:
        kinetic += 0.5 * ca.dot(rotors, u**2)
    inputs = ca.vertcat(efforts, commands, parameters.symbols)
    from_drives = _rates_of_drives(links, q, inputs, drive_commands)
    return TracedMechanism(
        numeric=mechanism,
        mechanism=symbolic,
        links=links,
        layout=layout,
        parameters=parameters,
        input_layout=input_layout,
        state=StateSymbols(t, q, u, coordinate_rates(links, motions, nq) + from_drives, from_drives),
        y=y,
        audit=audit,
        inputs=inputs,
        efforts=efforts,
        motions=motions,
        poses=part_poses(links, [motion.joint for motion in motions]),
        kinetic_energy=kinetic,
        actuators=actuators,
        actuator_states=states,
        rotor_inertia=rotors,
        step=step,
    )


def _rates_of_drives(links: Sequence[Link], q: ca.SX, inputs: ca.SX, commands: Mapping[str, slice]) -> ca.SX:
    """The rates (nq,) of the states of commanded drives, with zeros for all other coordinates."""
    rates = ca.SX(q.shape[0], 1)
    for link in links:
        if isinstance(link.joint.drive, CommandedDrive):
            rates[link.drive] = drive_rates(link.joint.drive, q[link.drive], inputs[commands[link.joint.name]])
    return rates


def kinetic_energy(links: Sequence[Link], motions: Sequence[LinkMotion]) -> ca.SX:
    """T in J, in ground's frame."""
    energy = ca.SX(1, 1)
    for link, motion in zip(links, motions, strict=True):
        energy += _kinetic_energy(constant(link.inertia), motion.V_WL)
    return energy


@inlined
def _kinetic_energy(inertia: ca.SX, velocity: ca.SX) -> ca.SX:
    return 0.5 * ca.dot(velocity, inertia @ velocity)
