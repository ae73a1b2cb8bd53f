"""The expressions of a mechanism with one-sided rows, from which its `OneSidedFunctions` are compiled."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property, partial
from itertools import accumulate

import casadi as ca
import numpy as np

from mbd_sim.base.linear_algebra import norm
from mbd_sim.compiler.rows.row_factors import Factors
from mbd_sim.dynamics.accelerations import AppliedForces, ConstrainedMotion, audit_rates, coupling_forces, drive_table
from mbd_sim.dynamics.constraints.equations import ConstraintEquations, joined
from mbd_sim.dynamics.contact.one_sided_equations import OneSidedEquations
from mbd_sim.dynamics.contact.one_sided_readings import gap_values, one_sided_readings
from mbd_sim.dynamics.contact.one_sided_rows import JointLoad, transmitted_force
from mbd_sim.dynamics.kinematics.poses import normalized_quaternions
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.spatial import merged_function, separated
from mbd_sim.dynamics.one_sided_functions import OneSidedFunctions, SolvedPair
from mbd_sim.dynamics.recursion.articulated_body import Accelerations, FactorizedMassMatrix
from mbd_sim.dynamics.recursion.multipliers import ConstraintSolver
from mbd_sim.dynamics.recursion.reactions import transmitted_wrenches
from mbd_sim.dynamics.slot_functions import rows_of_pools, slot_functions, slot_vector, with_wrenches
from mbd_sim.mechanism.natural_units import coordinate_sizes

FACTORED = 13  # rows from which on A is not written out

FARTHEST = 0.5  # of 1 rad, or the size of the mechanism, up to which projections move it in a step: else it jams
GAP_ROUND_OFF = 1e-15  # of the size of the mechanism, or its natural length, in gaps


class OneSidedDynamics:
    """The expressions of a mechanism with one-sided rows.

    :param constraints: the active two-sided rows, and their solver, or None.
    :param size: of the mechanism, in m.
    """

    def __init__(
        self,
        traced: TracedMechanism,
        mass_matrix: FactorizedMassMatrix,
        constraints: ConstraintEquations,
        solver: ConstraintSolver | None,
        forces: AppliedForces,
        one_sided: OneSidedEquations,
        size: float,
    ) -> None:
        self._traced, self._mass_matrix, self._solver = traced, mass_matrix, solver
        self._size = max(one_sided.units.length, size)
        mechanism = traced.numeric
        self._weight = max(one_sided.units.force, mechanism.mass * norm(mechanism.gravity))
        self._constraints, self._forces, self.one_sided = constraints, forces, one_sided
        self._rows = one_sided.combined
        basis = self._rows.basis
        self._slots = slot_vector(one_sided)
        self._has_pools = bool(self._rows.slots.pools)
        self._is_factored = one_sided.layout.rows >= FACTORED or self._has_pools
        self._net_forces = mass_matrix.net_joint_forces(basis.gradient.T)
        # With the combination C of the basis, A without friction is C Lᵀ R Cᵀ, with `_left` and `_right` as L and R.
        self._left, self._right = mass_matrix.factors(self._net_forces)
        self._reaction = self._coupling = ca.SX(0, basis.gradient.shape[0])
        if solver is not None:
            self._coupling = solver.coupling(self._net_forces)
            self._reaction = solver.reaction(self._coupling)
            self._left, self._right = ca.vertcat(self._left, self._coupling), ca.vertcat(self._right, self._reaction)

    @cached_property
    def _matrix(self) -> ca.SX:
        own = self._mass_matrix.product(self._net_forces, self._net_forces)
        whole, combination = ca.sparsify(own + self._coupling.T @ self._reaction), self._rows.combination
        return ca.sparsify(combination @ whole @ combination.T)

    @cached_property
    def _unloaded(self) -> tuple[list[ca.SX], list[ca.SX], ca.SX]:
        """The net joint forces, the links' bias accelerations, and the two-sided multipliers without contact forces."""
        forces = self._forces
        applied, bias = self._mass_matrix.applied(
            forces.joints.generalized, forces.elements.wrenches, self._traced.mechanism.gravity
        )
        multipliers = ca.SX(0, 1) if self._solver is None else self._solver.multipliers(applied)
        return applied, bias, multipliers

    @cached_property
    def _free(self) -> ca.SX:
        """The rates of change (rows,) of the rows' rates without contact forces; of pools without those of parts."""
        return ca.densify(self._free_of(self._rows.combination, self.one_sided.equations.bias))

    def _free_of(self, combination: ca.SX, bias: ca.SX) -> ca.SX:
        """Those of combinations of the basis, with a bias."""
        applied, _, multipliers = self._unloaded
        free = combination @ self._mass_matrix.product(self._net_forces, applied) + bias
        if self._solver is not None:
            free += combination @ (self._solver.coupling(self._net_forces).T @ multipliers)
        return free

    @cached_property
    def _free_parts(self) -> ca.SX:
        """The rates of change (6 parts,) of the twists of the parts of slots, if there are pools."""
        parts = 6 * self.one_sided.layout.parts
        return self._free_of(ca.SX.eye(self._rows.combination.shape[1])[:parts, :], self._rows.basis.bias[:parts])

    def _on_basis(self, forces: ca.SX, carried: ca.SX) -> ca.SX:
        """Forces of the basis from those of rows, and from wrenches on parts."""
        return with_wrenches(self._rows.combination.T @ forces, carried)

    def given_motion(self) -> ConstrainedMotion:
        """The motion under the contact forces among the inputs, in the state."""
        one_sided, combination = self.one_sided, self._rows.slots.written(self._rows.combination)
        carried = one_sided.numbers[one_sided.layout.wrenches]
        return self._motion(with_wrenches(combination.T @ one_sided.given_forces, carried))

    def _motion(self, forces: ca.SX) -> ConstrainedMotion:
        """The motion under forces of the basis; its multipliers are those of the two-sided rows, then these."""
        traced = self._traced
        applied, bias, unloaded = self._unloaded
        loaded = self._loaded(applied, forces)
        multipliers = unloaded + self._reaction @ forces
        at_rest = Accelerations(ca.SX(traced.layout.nv, 1), lambda: bias)
        accelerations = self._accelerations(loaded, multipliers) + at_rest
        both = self._all_columns
        all_multipliers = ca.vertcat(multipliers, forces)
        wrenches = [
            ca.sparsify(own + unit @ all_multipliers)
            for own, unit in zip(self._forces.elements.wrenches, both.wrenches, strict=True)
        ]
        transmitted = cache(lambda: transmitted_wrenches(traced.links, traced.motions, accelerations.links, wrenches))
        drives = drive_table(traced, transmitted, coupling_forces(both, all_multipliers, self._forces))
        return ConstrainedMotion(all_multipliers, accelerations, transmitted, drives)

    @cached_property
    def _all_columns(self) -> ConstraintEquations:
        return joined(self._constraints, self._rows.basis)

    def _loaded(self, applied: Sequence[ca.SX], forces: ca.SX) -> list[ca.SX]:
        return [ca.sparsify(one + own @ forces) for one, own in zip(applied, self._net_forces, strict=True)]

    def _accelerations(self, net_forces: Sequence[ca.SX], multipliers: ca.SX) -> Accelerations:
        if self._solver is None:
            return self._mass_matrix.solve(net_forces)
        return self._solver.accelerations(net_forces, multipliers)

    def _response(self, impulses: ca.SX, carried: ca.SX) -> ca.SX:
        """The change of u (nv,) by impulses (rows,)."""
        impulses = self._on_basis(impulses, carried)
        net_forces = [ca.sparsify(own @ impulses) for own in self._net_forces]
        return self._accelerations(net_forces, self._reaction @ impulses).u_rates

    @cached_property
    def loads(self) -> list[JointLoad]:
        """The loads of joints on which their friction depends."""
        one_sided, found = self.one_sided, list[JointLoad]()
        loaded = [element for element in one_sided.frictions if element.joint is not None]
        if not loaded:
            return found
        forces = ca.SX.sym("forces", one_sided.layout.rows)
        transmitted = self._motion(self._rows.combination.T @ forces).transmitted()
        signs = one_sided.numbers[one_sided.layout.signs]
        for number, element in enumerate(loaded):
            assert element.joint is not None
            across = transmitted_force(self._traced.links, element.joint, transmitted)
            across = across[[index for index in range(across.shape[0]) if across.has_nz(index, 0)], :]
            row = element.rows[0]
            factor = one_sided.stored_direction(element)[0] * element.sliding(one_sided.equations.velocity[row])
            by_force = ca.jacobian(across, forces)
            unloaded = ca.substitute([across], [forces], [ca.SX.zeros(forces.shape[0], 1)])[0]
            near = unloaded + by_force @ one_sided.given_forces
            found.append(JointLoad(row, ca.densify(unloaded), by_force, factor, signs[number], near))
        return found

    def functions(self, open_rates: ca.SX) -> OneSidedFunctions:
        """All functions; `open_rates` are y' with everything open."""
        one_sided, state = self.one_sided, self._traced.state
        inputs = [state.t, self._traced.y, self._traced.inputs]
        given = [*inputs, self._slots.whole]
        solution = ca.SX.sym("solution", one_sided.layout.rows)
        laws = [gap.law.restitution for gap in one_sided.gaps]
        sizes = [
            ca.horzcat(element.sliding(one_sided.equations.velocity[element.rows[0]]), element.static)
            for element in one_sided.frictions
        ]
        numbers = [each for load in self.loads for each in (load.unloaded, ca.vec(ca.densify(load.by_force)))]
        matrix = ca.SX() if self._is_factored else self._matrix
        vectors, factors = self._system(matrix, (self._left, self._right), ca.SX.eye(one_sided.layout.rows))
        rest = ca.vertcat(self._free, ca.vec(ca.densify(ca.vertcat(ca.SX(0, 2), *sizes))))
        gaps = one_sided.layout.gaps
        open_gaps, gap_rates = gap_values(one_sided), gap_values(one_sided, one_sided.equations.velocity[:gaps, :])
        for index, gap in enumerate(one_sided.gaps):
            if gap.numbers is not None:  # what their bodies do before they touch is not known to the slots
                open_gaps[index], gap_rates[index] = 1.0, 0.0
        rates, readings = self._rates(solution)
        terms_of_pools = [ca.SX(0, 1), self._free_parts] if self._has_pools else []
        return OneSidedFunctions(
            equations=one_sided,
            rates=rates,
            project=self._project(solution),
            readings=readings,
            gaps_and_rates=_function(
                "gaps_and_rates", given, ca.vertcat(gap_values(one_sided), one_sided.equations.velocity)
            ),
            open_start=merged_function(
                "open_start", inputs, open_rates, ca.vertcat(open_gaps, gap_rates), *self._margin
            ),
            terms=_function("contact_terms", given, *vectors, rest, *terms_of_pools),
            terms_factors=factors,
            loads=_function("joint_loads", given, ca.vertcat(ca.SX(0, 1), *numbers)),
            load_components=tuple(load.unloaded.shape[0] for load in self.loads),
            response=_function(
                "contact_response",
                [*inputs, solution, self._slots.whole],
                self._response(solution, self._slots.wrenches),
            ),
            restitution=_function("restitution", [self._traced.inputs], ca.vertcat(ca.SX(0, 1), *laws)),
            trace_places=partial(_function, "contact_places", inputs, one_sided.places),
            slots=slot_functions(self._traced, one_sided, self._slots.whole.shape[0]),
            farthest=self._farthest,
        )

    def _system(self, matrix: ca.SX, columns: tuple[ca.SX, ca.SX], last: ca.SX) -> tuple[list[ca.SX], Factors | None]:
        """A as `SolvedPair.system` gives it, and its factors, from the `matrix` A or from L and R as `columns`.

        :param last: a matrix (rows, rows) by which A is multiplied from the right.
        """
        if not self._is_factored:
            return [ca.vec(ca.densify(matrix @ last)), ca.SX(0, 1)], None
        factors, numbers = self._rows.factors(*columns, last)
        return [*numbers], factors

    @property
    def _margin(self) -> list[ca.SX]:
        return [] if self._solver is None or self._solver.margin is None else [ca.densify(self._solver.margin)]

    def _rates(self, solution: ca.SX) -> tuple[SolvedPair, ca.Function]:
        """The rates, and the readings from their memory."""
        one_sided, traced = self.one_sided, self._traced
        n = one_sided.layout.rows
        at_zero = one_sided.forces(ca.SX(n, 1))
        with_friction = ca.jacobian(one_sided.forces(solution), solution)  # λ is affine in the solution
        combination = self._rows.combination
        unloaded = self._left.T @ (self._right @ ca.sparsify(combination.T @ at_zero))
        right = -(self._free + combination @ unloaded)
        forces = one_sided.forces(solution)
        motion = self._motion(self._on_basis(forces, self._slots.wrenches))
        audit = audit_rates(self._all_columns, self._forces, motion)
        friction = one_sided.friction_power(forces)
        audit[2] += friction
        rates = self._forces.actuator_rates
        y_rates = ca.vertcat(traced.state.q_rates, motion.u_rates, rates, ca.SX(1, 1), friction, audit)
        loads = [
            ca.vertcat(
                load.factor,
                load.start,
                load.unloaded + load.by_force @ at_zero,
                ca.vec(ca.densify(load.by_force @ with_friction)),
            )
            for load in self.loads
        ]
        extra = [ca.vertcat(*loads)] if loads else []
        mobility = self._slots.mobility if self._is_factored else ca.diag(self._matrix)
        readings = one_sided_readings(one_sided, self.loads, mobility, self._weight, solution)
        matrix = ca.SX() if self._is_factored else self._matrix
        system = self._system(matrix, (self._left, self._right), with_friction)
        outputs = [*extra, *self._margin, *self._of_pools(with_friction, unloaded)]
        pair, further = self._pair("contact", [y_rates, readings], solution, system, right, outputs)
        return pair, further[0]

    def _of_pools(self, with_friction: ca.SX, unloaded: ca.SX) -> list[ca.SX]:
        """The last outputs of the system of rates, see `SolvedPair`; `unloaded` adds to what the basis does."""
        if not self._has_pools:
            return []
        free = self._free_parts + unloaded[: self._free_parts.shape[0]]
        own = [ca.vec(ca.densify(with_friction[rows, rows])) for rows in map(list, rows_of_pools(self.one_sided))]
        return [ca.vertcat(*own), free]

    def _project(self, solution: ca.SX) -> SolvedPair:
        one_sided, traced = self.one_sided, self._traced
        state, n, gaps = traced.state, one_sided.layout.rows, one_sided.layout.gaps
        holonomic = ca.SX(ca.DM([0.0 if gap.clutch else 1.0 for gap in one_sided.gaps]))
        depths = holonomic * one_sided.equations.position[:gaps, :]
        least = GAP_ROUND_OFF * self._size / one_sided.units.length * ca.DM(one_sided.lengths[:gaps])
        depths = depths * (ca.fabs(depths) > least)  # so that what rests does not move at all
        position = ca.vertcat(-depths, ca.SX(n - gaps, 1))
        right = ca.horzcat(position, -one_sided.equations.velocity)
        keep, slides = ca.SX.ones(n, 1), ca.SX(n, 1)
        for load in self.loads:  # rows that are active while they slide: their equations become λ = 0
            slides[load.row] = load.factor != 0.0
            keep[load.row] = 1.0 - slides[load.row]
        right = right * ca.horzcat(keep, keep)
        if self._is_factored:
            combination = self._rows.combination  # rows with loads have columns of their own
            own, added = (
                combination.T @ (1.0 - keep),
                combination.T @ ca.diag(slides)[:, [load.row for load in self.loads]],
            )
            kept = [each - each * ca.repmat(own.T, each.shape[0], 1) for each in (self._left, self._right)]
            left, factor = (ca.vertcat(each, added.T) for each in kept)
            system = self._system(ca.SX(), (left, factor), ca.SX.eye(n))
        else:
            whole = self._matrix * (keep @ keep.T) + ca.diag(slides)
            system = self._system(whole, (self._left, self._right), ca.SX.eye(n))
        speeds = ca.SX.sym("speeds", n)
        q = state.q + ca.jacobian(state.q_rates, state.u) @ self._response(solution, self._slots.wrenches)
        q = normalized_quaternions(traced.links, q)
        speed_changes = self._response(speeds, self._slots.more_wrenches)
        projected = ca.vertcat(q, state.u + speed_changes, traced.actuator_states, traced.audit)
        return self._pair(
            "contact_project",
            [projected],
            ca.vertcat(solution, speeds),
            system,
            right,
            [ca.SX(0, 1), ca.SX(0, 1)] if self._has_pools else [],
        )[0]

    @property
    def _farthest(self) -> tuple[float, ...]:
        """By how much projections may change each of q and u; those of quaternions are half the sines of angles."""
        traced, state = self._traced, self._traced.state
        sizes = coordinate_sizes(traced.numeric, traced.step)
        pattern, found = ca.jacobian(state.q_rates, state.u).T.sparsity(), list[float]()
        for row in range(state.q.shape[0]):
            own = pattern.row()[pattern.colind(row) : pattern.colind(row + 1)]
            found.append(FARTHEST * max((sizes[column] for column in own), default=np.inf))
        for link in traced.links:
            if (offset := link.joint.kind.quaternion) is not None and not link.joint.drive:
                for row in range(link.q.start + offset, link.q.start + offset + 4):
                    found[row] = 0.5 * FARTHEST
        return (*found, *(FARTHEST * size / traced.step for size in sizes))

    def _pair(
        self,
        name: str,
        results: list[ca.SX],
        solution: ca.SX,
        matrix: tuple[list[ca.SX], Factors | None],
        right: ca.SX,
        further: list[ca.SX],
    ) -> tuple[SolvedPair, list[ca.Function]]:
        """The pair of the first result, and functions of the same memory and solution for the others."""
        state = [self._traced.state.t, self._traced.y, self._traced.inputs]
        given = ca.vertcat(solution, self._slots.whole)
        memory, values, reduced = separated(ca.densify(ca.vertcat(*results)), ca.vertcat(*state), given)
        vectors, factors = matrix
        outputs = [values, *vectors, ca.vec(ca.densify(right)), *further]
        system = _function(f"{name}_system", [*state, self._slots.whole], *outputs)
        sizes = accumulate([0, *(result.shape[0] for result in results)])
        functions = [
            _function(f"{name}_result_{index}", [memory, solution, self._slots.whole], part)
            for index, part in enumerate(ca.vertsplit(reduced, list(sizes)))
        ]
        return SolvedPair(system, functions[0], factors), functions[1:]


def _function(name: str, inputs: list[ca.SX], *outputs: ca.SX) -> ca.Function:
    return ca.Function(name, inputs, [ca.densify(output) for output in outputs], {"cse": True})
