"""The equations of motion of a mechanism, traced once into functions that the compiler turns into machine code.

The integrated state y is q (nq,), u (nv,), and three energies of the audit in J: the work of the applied forces, the
work of the drives, and the dissipated energy (`AUDIT_STATES`). With one-sided elements two of their losses come before
these, see `audit_states`; the states of actuators come right after u, see `ActuatorLayout`.

Small motions are described from the derivatives of the rates by the state and the inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from mbd_sim.base.errors import quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.accelerations import (
    AppliedForces,
    ConstrainedMotion,
    applied_forces,
    audit_rates,
    solve_accelerations,
)
from mbd_sim.dynamics.constraints.functions import ConstraintFunctions
from mbd_sim.dynamics.constraints.rows import ConstraintRow
from mbd_sim.dynamics.constraints.start import AssembledStart, Assembly, assemble
from mbd_sim.dynamics.forces.joints import DistantSprings, distant_springs
from mbd_sim.dynamics.joint_linearization import JointLinearization
from mbd_sim.dynamics.kernel_functions import (
    KernelFunctions,
    LoadPaths,
    kernel_functions,
    load_paths,
    reaction_function,
    reactions_at,
    without_commands,
)
from mbd_sim.dynamics.kinematics.drives import hold_drives
from mbd_sim.dynamics.kinematics.links import like_branches
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism, trace
from mbd_sim.dynamics.layouts.actuators import ActuatorLayout
from mbd_sim.dynamics.layouts.state_scales import state_scales
from mbd_sim.dynamics.layouts.vectors import AUDIT_STATES, CoordinateLayout, InputLayout
from mbd_sim.dynamics.math.expressions import require_smooth
from mbd_sim.dynamics.measurements import Measurements
from mbd_sim.dynamics.recursion.articulated_body import FactorizedMassMatrix
from mbd_sim.dynamics.recursion.multipliers import ConstraintSolver, TypicalMatrices, typical_matrices
from mbd_sim.dynamics.regular_start import require_regular_start, start_with_actuators
from mbd_sim.mechanism.contents import has_one_sided
from mbd_sim.mechanism.elements.joint_types import STATES
from mbd_sim.mechanism.mechanism import Mechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.actuators.functions import ActuatorFunctions
    from mbd_sim.dynamics.contact.compliant import ComplianceFunctions
    from mbd_sim.dynamics.one_sided_functions import OneSidedFunctions


@dataclass(frozen=True)
class DerivativeLayout:
    """Where the derivatives of several quantities are in a matrix: its columns, one for each variable.

    `displacements` (nv,) are ν, which change q by N ν, with q' = N u. `speeds` (nv,) are u, and `states` those of
    actuators. `acting` are the inputs in `InputLayout.acting`, and `drives` the states of commanded drives.
    """

    displacements: slice
    speeds: slice
    states: slice
    acting: slice
    drives: slice

    @property
    def size(self) -> int:
        """The number of columns."""
        return int(self.drives.stop)


def derivative_layout(equations: Equations) -> DerivativeLayout:
    """The columns of the derivatives of a mechanism."""
    nq, nv = equations.layout.nq, equations.layout.nv
    states, drives = equations.core.stop - nq - nv, STATES * len(equations.layout.drives)
    ends = accumulate([nv, nv, states, len(equations.inputs.acting), drives], initial=0)
    return DerivativeLayout(*(slice(start, stop) for start, stop in pairwise(ends)))


def rate_derivatives(equations: Equations) -> ca.Function:
    """(t, y, inputs) -> the derivatives of several quantities, with the columns of `DerivativeLayout`, row by row.

    These are u' and the rates of the states of actuators, then those of the states of commanded drives, and G u + b.
    """
    t, y, inputs = (ca.SX.sym(name, equations.rates.size_in(index)) for index, name in enumerate("tye"))
    rates = equations.rates.call([t, y, inputs])[0]
    nq = equations.layout.nq
    quantities = [rates[equations.core], rates[nq - STATES * len(equations.layout.drives) : nq]]
    if equations.rows:
        given = [t, y, inputs][: equations.violation.n_in()]
        quantities.append(equations.violation.call(given)[0][:, 1])
    return derivative_function(equations, "derivatives", (t, y, inputs), ca.vertcat(*quantities))


def derivative_function(
    equations: Equations, name: str, symbols: tuple[ca.SX, ca.SX, ca.SX], quantities: ca.SX
) -> ca.Function:
    """(t, y, inputs) -> the derivatives of `quantities` (n,), expressions of `symbols`: see `rate_derivatives`."""
    _, y, inputs = symbols
    nq, nv = equations.layout.nq, equations.layout.nv
    kinematic = ca.jacobian(equations.rates.call(list(symbols))[0][:nq], y[nq : nq + nv])
    by_state, by_inputs = ca.jacobian(quantities, y), ca.jacobian(quantities, inputs)
    drives = nq - STATES * len(equations.layout.drives)
    columns = [
        by_state[:, :nq] @ kinematic,
        by_state[:, nq : equations.core.stop],
        by_inputs[:, equations.inputs.acting],
        by_state[:, drives:nq],
    ]
    return ca.Function(name, list(symbols), [ca.densify(ca.horzcat(*columns).T)], {"cse": True})


@record
class Equations:
    """The functions that the compiler turns into machine code, and functions that are evaluated on request.

    `inputs` describes the inputs; without loaded parts and parameters they are the efforts (nv,). If there are
    parameters, the functions of (t, y) take the inputs as well. SI units throughout.

    - `rates(t, y, inputs)`: y', and with constraints a margin that is negative where they are nearly singular.
    - `project(t, y)`: y with unit quaternions, projected onto the constraints; None if there are neither.
    - `energies(t, y)`: T and V, without the `distant_springs`, which are None in most mechanisms.
    - `poses(t, y)`: X_WB of each of `part_names`, (12,) each: the position, then the rotation column by column.
    - `drives(t, y, inputs)`: coordinates (n,) of driven joints in declared order, their speeds, and their forces.
    - `multipliers(t, y, inputs)`: λ (m,) of all `rows`, zero for those that are zero everywhere.
    - `violation(t, y)`: Φ and G u + b (m, 2).
    - `reactions(t, y, inputs)`: (6, joints), see `joint_reactions`.
    - `measurements`: accelerations, and what else is evaluated only on request.

    With one-sided elements `rates` are those with everything open, and `one_sided` are their other functions; forces
    in all other functions include the contact forces among the inputs. With actuators, `actuators` are their functions.
    `core` are the components of y that rates depend on, after the coordinates. `step` is in s. `like_branches` have
    joints of the same types, see the function of that name.

    `joint_linearization` is for methods that treat only the forces within joints implicitly.

    `compliances` are the functions of compliant contacts; None without these.

    `constraints` are the constraints and the mass matrix as functions of numbers. `start` and `start_state` satisfy
    them.
    """

    mechanism: Mechanism
    layout: CoordinateLayout
    inputs: InputLayout
    parameters: SymbolicParameters
    rates: ca.Function
    energies: ca.Function
    distant_springs: DistantSprings | None
    poses: ca.Function
    drives: ca.Function
    project: ca.Function | None
    violation: ca.Function
    rows: tuple[ConstraintRow, ...]
    constraints: ConstraintFunctions
    start: AssembledStart
    start_state: Array
    part_names: tuple[str, ...]
    measurements: Measurements
    joint_linearization: JointLinearization
    trace_multipliers: Callable[[], ca.Function]
    trace_reactions: Callable[[], ca.Function]
    trace_load_paths: Callable[[], LoadPaths]
    core: slice
    like_branches: Sequence[Sequence[Sequence[tuple[int, int]]]]
    step: float
    one_sided: OneSidedFunctions | None = None
    compliances: ComplianceFunctions | None = None
    actuators: ActuatorFunctions | None = None

    @property
    def inputs_without_commands(self) -> Array:
        """The inputs (size,) at the start, without wrenches: see `inputs_at_start`."""
        return self.inputs_at_start([np.zeros(3)] * len(self.inputs.loaded))

    def inputs_at_start(self, centers: Sequence[Array]) -> Array:
        """The inputs (size,) with zero efforts and wrenches, and the mechanism's own commands and parameters.

        :param centers: (3,) center of mass of each loaded part in m, the point at which its wrench acts.
        """
        inputs = self.inputs.without_commands(centers, self.parameters.base)
        self.hold(self.mechanism, self.start_state.copy(), inputs)
        return inputs

    @cached_property
    def actuator_layout(self) -> ActuatorLayout:
        """Where the states of actuators are in y; empty without actuators."""
        return ActuatorLayout() if self.actuators is None else self.actuators.layout

    @cached_property
    def scales(self) -> tuple[float, ...]:
        """What the errors of the components of y are compared with, see `state_scales`."""
        size = len(self.start_state)
        return state_scales(self.mechanism, self.layout, self.actuator_layout, self.step, self.core.stop, size)

    def has_contact(self, inputs: Array) -> bool:
        """Whether something is closed, sticks or slides."""
        if self.one_sided is None:
            return False
        layout = self.one_sided.equations.layout
        modes = inputs[self.inputs.one_sided]
        return bool(np.any(modes[: layout.signs.start] != 0.0))

    def hold(self, mechanism: Mechanism, y: Array | ca.SX, inputs: Array | ca.SX) -> None:
        """Set states and commands of actuators and drives in place to those before the first command.

        :param mechanism: this one, or a variant with other start commands.
        :param y: the state, whose positions are those that are held; numbers or symbols.
        """
        hold_drives(mechanism, self.layout, self.inputs, y, inputs)
        if self.actuators is not None:
            self.actuators.hold(mechanism.actuators, y, inputs)

    @cached_property
    def multipliers(self) -> ca.Function:
        """The multipliers of all rows; traced when they are first read."""
        return self.trace_multipliers()

    @cached_property
    def reactions(self) -> ca.Function:
        """The wrenches across the joints; traced when they are first read."""
        return self.trace_reactions()

    @cached_property
    def derivatives(self) -> ca.Function:
        """(t, y, inputs) -> the derivatives of rates and of constraints, see `rate_derivatives`."""
        return rate_derivatives(self)

    @cached_property
    def derivative_layout(self) -> DerivativeLayout:
        """The columns of `derivatives`."""
        return derivative_layout(self)

    def disturbed(self, loaded: tuple[str, ...]) -> Equations:
        """These equations with disturbances among the inputs, and wrenches on these parts as well; traced once."""
        parts = tuple(dict.fromkeys((*self.inputs.loaded, *loaded)))
        if parts not in self._disturbed:
            self._disturbed[parts] = derive(self.mechanism, parts, self.parameters, self.step, disturb=True)
        return self._disturbed[parts]

    @cached_property
    def _disturbed(self) -> dict[tuple[str, ...], Equations]:
        return {}

    @cached_property
    def load_paths(self) -> LoadPaths:
        """The loads and their derivatives by the multipliers; traced when they are first read."""
        return self.trace_load_paths()


def require_equations(given: object) -> None:
    """Refuse what is not `Equations`.

    :raises TypeError: with the remedy.
    """
    if not isinstance(given, Equations):
        raise TypeError(f"{quoted(given)} is not Equations. Give those of a simulation: simulation.model.equations.")


@interruptible()
def derive(
    mechanism: Mechanism,
    loaded: Sequence[str] = (),
    parameters: SymbolicParameters | None = None,
    step: float | None = None,
    *,
    disturb: bool = False,
) -> Equations:
    """Trace the equations of a mechanism.

    :param loaded: parts on which external wrenches act.
    :param parameters: the numbers of the mechanism that are inputs; none by default.
    :param step: in s, for sampled servos and delayed commands; by default that of the mechanism.
    :param disturb: whether the inputs include changes of the motion of drives and of ground, see `disturbances`.
    :raises MechanismError: the mass matrix is singular at the start, a spring has no direction there, a drive has no
        velocity or acceleration, the constraints cannot be satisfied, or the step does not divide the period of a
        servo or a delay, or a cam cannot be followed; joints, springs, constraints, actuators and cams are named.
    """
    require_smooth(mechanism)
    if mechanism.contacts:
        from mbd_sim.dynamics.contact.cams import require_followable_cams

        require_followable_cams(mechanism)
    traced = trace(mechanism, loaded, parameters, step, disturb=disturb)
    rows = None
    if has_one_sided(mechanism):
        # Contacts are imported only where they are needed: their modules take a fifth of the time of a start.
        from mbd_sim.dynamics.contact.one_sided_equations import one_sided_equations, with_one_sided_inputs

        rows = one_sided_equations(traced)
        traced = with_one_sided_inputs(traced, rows)
    assembly = assemble(traced)
    forces = applied_forces(traced)
    mass_matrix = FactorizedMassMatrix(traced.links, traced.motions, traced.layout.nv, traced.rotor_inertia)
    require_regular_start(traced, assembly, forces, mass_matrix)
    constraints = assembly.active
    solver, typical = None, TypicalMatrices(np.zeros(0), ())
    if constraints.rows:
        typical = typical_matrices(assembly.functions, assembly.start)
        solver = ConstraintSolver(mass_matrix, constraints, typical, assembly.dependent)
    motion = solve_accelerations(traced, mass_matrix, constraints, solver, forces)
    open_losses = ca.SX(traced.audit.shape[0] - len(AUDIT_STATES), 1)
    audit = ca.vertcat(open_losses, audit_rates(constraints, forces, motion))
    y_rates = ca.vertcat(traced.state.q_rates, motion.u_rates, forces.actuator_rates, audit)
    one_sided = None
    if rows is not None:
        from mbd_sim.dynamics.one_sided_dynamics import OneSidedDynamics

        dynamics = OneSidedDynamics(traced, mass_matrix, constraints, solver, forces, rows, assembly.functions.size)
        one_sided, motion = dynamics.functions(y_rates), dynamics.given_motion()
    linearized = JointLinearization(traced, mass_matrix, constraints, typical, assembly.dependent, forces)
    functions = kernel_functions(traced, assembly, forces, solver, motion, y_rates)
    return _packaged(traced, assembly, forces, motion, functions, linearized, one_sided)


def _packaged(
    traced: TracedMechanism,
    assembly: Assembly,
    forces: AppliedForces,
    motion: ConstrainedMotion,
    functions: KernelFunctions,
    linearized: JointLinearization,
    one_sided: OneSidedFunctions | None,
) -> Equations:
    """The functions, with what describes them."""
    start, actuators = start_with_actuators(traced, assembly.start, forces)
    loads = (traced, assembly, motion, functions.multipliers)
    return Equations(
        mechanism=traced.numeric,
        layout=traced.layout,
        inputs=traced.input_layout,
        parameters=traced.parameters,
        rates=functions.rates,
        energies=functions.energies,
        distant_springs=distant_springs(traced, forces.elements.lengths, without_commands(traced)),
        poses=functions.poses,
        drives=functions.drives,
        project=functions.project,
        violation=functions.violation,
        rows=tuple(assembly.equations.rows),
        constraints=assembly.functions,
        start=assembly.start,
        start_state=start,
        part_names=traced.part_names,
        measurements=Measurements(traced, motion, assembly.equations, partial(reactions_at, *loads)),
        joint_linearization=linearized,
        trace_multipliers=functions.trace_multipliers,
        trace_reactions=partial(reaction_function, *loads),
        trace_load_paths=partial(load_paths, *loads),
        core=traced.core,
        like_branches=like_branches(traced.links, traced.layout.nq),
        step=traced.step,
        one_sided=one_sided,
        compliances=functions.compliances,
        actuators=actuators,
    )
