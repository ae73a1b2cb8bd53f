"""A prescribed motion as a differentiable function of parameters of the file: its states and its efforts.

At given values of the drives, coordinates q, speeds u and accelerations u' satisfy Φ(q, p) = 0, G u = 0 and G u' + γ =
0. Their derivatives by the parameters p follow by implicit differentiation, from exact derivatives of these equations
(Haug, ch. 3): the same matrix serves all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.dynamics.kinematics.frames import FrameQuantity, frame_function
from mbd_sim.dynamics.math.expressions import all_evaluated, evaluated
from mbd_sim.dynamics.terms import term_function
from mbd_sim.mechanism.contents import require_two_sided
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.spanning_tree import split_reference
from mbd_sim.simulation.run.moving_points import points_of
from mbd_sim.studies.algebra.samples import with_forces_alone
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion
from mbd_sim.studies.kinematic_analysis.system import (
    SINGULAR,
    KinematicSystem,
    coordinate_columns,
    coordinate_index,
    in_natural_units,
    undriven,
)
from mbd_sim.studies.optimization.parameter_inputs import parameter_inputs

CONSISTENT = 1e-7  # error of the derivatives of redundant equations, relative


@dataclass(frozen=True, eq=False)
class States:
    """Coordinates q (n, nq), speeds u (n, nv) and accelerations u' (n, nv) at n values of the drives."""

    q: Array
    u: Array
    u_rates: Array


@dataclass(frozen=True, eq=False)
class StateDerivatives:
    """The derivatives by the parameters: of displacements along the speeds, of u and of u', (n, nv, np) each."""

    q: Array
    u: Array
    u_rates: Array


Quantity = Callable[[States, StateDerivatives, Array], tuple[Array, Array]]
# Of q, u, u' and p: values, each with its derivatives by displacements (nv), u (nv), u' (nv) and p (np) side by side.
_WithDerivatives = Callable[[Array, Array, Array, Array], list[tuple[Array, Array]]]


class ParametricMotion:
    """A mechanism with prescribed drives and parameters.

    `keys` (np,) are those of the file, and `values` (np,) what the file gives. `numbers_function` of parameters (np,)
    gives the numbers of the equations.
    """

    def __init__(
        self, mechanism: Mechanism, drives: Sequence[str], keys: Sequence[str], *, with_forces: bool = False
    ) -> None:
        """Trace the equations.

        :param with_forces: also those of the efforts, see `efforts`.
        :raises MechanismError: a key does not exist, or cannot be a parameter of the equations.
        :raises InputError: see `KinematicSystem`.
        """

        def reduced(whole: Mechanism) -> Mechanism:
            alone = undriven(with_forces_alone(whole), drives)
            return alone if with_forces else without_forces(alone)

        self._inputs = inputs = parameter_inputs(mechanism, keys, reduced)
        self.keys, self.values = inputs.keys, inputs.values
        self.system = KinematicSystem(reduced(mechanism), drives, inputs.numbers)
        layout = self.system.layout
        self._q, self._u = ca.SX.sym("q", layout.nq), ca.SX.sym("u", layout.nv)
        self._a, self._p = ca.SX.sym("a", layout.nv), ca.SX.sym("p", len(keys))
        self._numbers = inputs.numbers_at(self._p)
        self.numbers_function = ca.Function("numbers", [self._p], [ca.densify(self._numbers)])
        traced, equations = self.system.traced, self.system.assembly.equations
        state = traced.state
        outputs = [equations.position, equations.gradient, equations.bias, ca.jacobian(state.q_rates, state.u)]
        symbols = [state.t, state.q, state.u, traced.parameters.symbols]
        base = ca.Function("base", symbols, [ca.densify(one) for one in outputs])
        position, gradient, bias, self._to_rates = base.call([0.0, self._q, self._u, self._numbers])
        self._rows = self._derivatives("rows", [position, gradient @ self._u, gradient @ self._a + bias])

    def at(self, parameters: Array) -> KinematicSystem:
        """The mechanism with these parameters (np,)."""
        (values,) = all_evaluated(self.numbers_function, parameters)
        return self.system.with_values(values.ravel())

    def states(
        self, parameters: Array, drives: Array, guesses: Array, speeds: Array, accelerations: Array | None = None
    ) -> States | None:
        """The states at drives (n, drives) near configurations (n, nq); None where one of them cannot be assembled.

        :param speeds: (drives,) of the drives, and their `accelerations`, zero by default.
        """
        system, found = self.at(parameters), []
        given = np.zeros(len(speeds)) if accelerations is None else accelerations
        for guess, place in zip(guesses, drives, strict=True):
            q = system.closed_at(guess, place)
            rates = None if q is None else system.rates(q, speeds, given)
            if q is None or rates is None:
                return None
            found.append((q, *rates))
        return States(*(np.array([row[index] for row in found]) for index in range(3)))

    def derivatives(self, parameters: Array, states: States) -> StateDerivatives:
        """The derivatives of states by the parameters, at constant drives.

        :raises MbdSimError: redundant constraints contradict a change of the parameters.
        """
        system, count = self.system, len(self.keys)
        nv, found = system.layout.nv, []
        system = self.at(parameters)
        zeros = np.zeros((len(system.drives), count))
        for q, u, a in zip(states.q, states.u, states.u_rates, strict=True):
            (_, of_position), (_, of_velocity), (_, of_acceleration) = self._rows(q, u, a, parameters)
            solve = _Solver(system, q)
            by_p = slice(3 * nv, None)
            dq = solve(-of_position[:, by_p], zeros)
            du = solve(-(of_velocity[:, by_p] + of_velocity[:, :nv] @ dq), zeros)
            moved = of_acceleration[:, :nv] @ dq + of_acceleration[:, nv : 2 * nv] @ du
            found.append((dq, du, solve(-(of_acceleration[:, by_p] + moved), zeros)))
        return StateDerivatives(*(np.array([row[index] for row in found]) for index in range(3)))

    def point(self, name: str) -> Quantity:
        """Position, velocity and acceleration (n, 9) of a point in ground's axes, and their derivatives (n, 9, np).

        :raises InputError: there is no such point.
        """
        part, local = self._local(name)
        if part == GROUND:
            return self._quantity(ca.vertcat(local, ca.SX.zeros(6, 1)))
        jacobian = self._frame(part, "jacobian", local).T[:3, :]
        acceleration = jacobian @ self._a + self._frame(part, "bias_acceleration", local)[:3]
        return self._quantity(ca.vertcat(self._frame(part, "pose", local)[:3], jacobian @ self._u, acceleration))

    def place(self, name: str) -> Callable[[Array, Array], Array]:
        """The position (3,) of a point in a configuration (nq,) with parameters (np,).

        :raises InputError: there is no such point.
        """
        function = self.place_function(name)
        nothing = np.zeros(self.system.layout.nv)
        return lambda q, parameters: evaluated(function, q, nothing, nothing, parameters).ravel()

    def place_function(self, name: str) -> ca.Function:
        """The position (3,) of a point as a function of q, u, u' and p."""
        part, local = self._local(name)
        return self._value("place", local if part == GROUND else self._frame(part, "pose", local)[:3])

    def coordinate_function(self, name: str) -> ca.Function:
        """The position (1,) of a coordinate as a function of q, u, u' and p."""
        return self._value("coordinate", self._q[coordinate_columns(self.system.mechanism)[self._index(name)]])

    def tree_function(self) -> ca.Function:
        """The efforts (nv,) of the open tree as a function of q, u, u' and p, see `efforts`.

        :raises MechanismError: the mechanism has one-sided elements.
        :raises InputError: forces depend on time.
        """
        return self._value("tree", self._tree_efforts())

    def coordinate(self, name: str) -> Quantity:
        """Position, velocity and acceleration (n, 3) of a coordinate, and their derivatives (n, 3, np).

        :raises InputError: there is no such coordinate, or it is a component of a rotation in space.
        """
        index = self._index(name)
        column = coordinate_columns(self.system.mechanism)[index]
        return self._quantity(ca.vertcat(self._q[column], self._u[index], self._a[index]))

    def _index(self, name: str) -> int:
        index = coordinate_index(self.system.mechanism, name)
        if coordinate_columns(self.system.mechanism)[index] < 0:
            raise InputError(f"'{name}' is a component of a rotation in space", "Take a point of the part.")
        return index

    @cached_property
    def efforts(self) -> Quantity:
        """The efforts (n, drives) of the drives, and their derivatives (n, drives, np): for motions `with_forces`.

        With speeds W of unit drives, G W = 0 and S W = 1, they are Wᵀ r, r being the efforts of the open tree.

        :raises MechanismError: the mechanism has one-sided elements.
        :raises InputError: forces depend on time.
        """
        tree = self._derivatives("tree", [self._tree_efforts()])
        nv = self.system.layout.nv

        def value_and_slope(states: States, derivatives: StateDerivatives, parameters: Array) -> tuple[Array, Array]:
            system, values, slopes = self.at(parameters), [], []
            drives, count = len(system.drives), len(self.keys)
            for row, (q, u, a) in enumerate(zip(states.q, states.u, states.u_rates, strict=True)):
                ((forces, by),) = tree(q, u, a, parameters)
                solve = _Solver(system, q)
                units = solve(np.zeros((len(system.constraints.gradient(0.0, q)), drives)), np.eye(drives))
                dq, du, da = derivatives.q[row], derivatives.u[row], derivatives.u_rates[row]
                change = by[:, 3 * nv :] + by[:, :nv] @ dq + by[:, nv : 2 * nv] @ du + by[:, 2 * nv : 3 * nv] @ da
                slope = units.T @ change
                for index in range(drives):
                    _, (_, moved), _ = self._rows(q, units[:, index], a, parameters)
                    tilt = solve(-(moved[:, 3 * nv :] + moved[:, :nv] @ dq), np.zeros((drives, count)))
                    slope[index] += forces.ravel() @ tilt
                values.append(units.T @ forces.ravel())
                slopes.append(slope)
            return np.array(values), np.array(slopes)

        return value_and_slope

    def _tree_efforts(self) -> ca.SX:
        require_two_sided(self.system.mechanism, "has no efforts that follow from its motion")
        time = ca.SX.sym("t")
        function = term_function(self.system.traced, self.system.assembly.equations, "tree_efforts")
        (efforts,) = function.call([time, self._state(), self._all_inputs(), self._a])
        if ca.depends_on(efforts, time):
            raise InputError("efforts have no derivatives here, because forces depend on time", "Make them constant.")
        return efforts

    def _value(self, name: str, expression: ca.SX) -> ca.Function:
        arguments = [self._q, self._u, self._a, self._p]
        return ca.Function(name, arguments, [ca.densify(expression)], {"cse": True})

    def _local(self, name: str) -> tuple[str, ca.SX]:
        """The part of a point, and its position (3,) in it."""
        part, point = split_reference(name, points_of(self.system.mechanism))
        return part, self._inputs.point_at(part, point, self._p) if point else ca.SX.zeros(3)

    def _frame(self, part: str, quantity: FrameQuantity, local: ca.SX) -> ca.SX:
        function = frame_function(self.system.traced, part, quantity)
        return function.call([0.0, self._state(), self._all_inputs(), local])[0]

    def _state(self) -> ca.SX:
        rest = self.system.traced.y.shape[0] - self._q.shape[0] - self._u.shape[0]
        return ca.vertcat(self._q, self._u, ca.SX.zeros(rest, 1))

    def _all_inputs(self) -> ca.SX:
        inputs = ca.SX.zeros(self.system.traced.input_layout.size, 1)
        if self._numbers.shape[0]:
            inputs[self.system.traced.input_layout.values] = self._numbers
        return inputs

    def _derivatives(self, name: str, expressions: Sequence[ca.SX]) -> _WithDerivatives:
        arguments = [self._q, self._u, self._a, self._p]
        outputs = []
        for expression in expressions:
            one = ca.densify(expression)
            along = ca.jacobian(one, self._q) @ self._to_rates
            slopes = [along, ca.jacobian(one, self._u), ca.jacobian(one, self._a), ca.jacobian(one, self._p)]
            outputs += [one, ca.densify(ca.horzcat(*slopes))]
        function = ca.Function(name, arguments, outputs, {"cse": True})

        def evaluate(*at: Array) -> list[tuple[Array, Array]]:
            found = all_evaluated(function, *at)
            return list(zip(found[::2], found[1::2], strict=True))

        return evaluate

    def _quantity(self, expression: ca.SX) -> Quantity:
        function, nv = self._derivatives("quantity", [expression]), self.system.layout.nv

        def value_and_slope(states: States, derivatives: StateDerivatives, parameters: Array) -> tuple[Array, Array]:
            values, slopes = [], []
            for row, (q, u, a) in enumerate(zip(states.q, states.u, states.u_rates, strict=True)):
                ((value, by),) = function(q, u, a, parameters)
                slope = by[:, 3 * nv :] + by[:, :nv] @ derivatives.q[row] + by[:, nv : 2 * nv] @ derivatives.u[row]
                values.append(value.ravel())
                slopes.append(slope + by[:, 2 * nv : 3 * nv] @ derivatives.u_rates[row])
            return np.array(values), np.array(slopes)

        return value_and_slope


class _Solver:
    """Solves G x = rows and S x = driven in a configuration."""

    def __init__(self, system: KinematicSystem, q: Array) -> None:
        self._system, self._matrix, self._sizes = system, system.stacked(q), system.constraints.row_sizes(0.0, q)
        self._left, self._values, self._right = np.linalg.svd(self._matrix, full_matrices=False)
        if self._values[-1] <= SINGULAR * self._values[0]:
            raise MbdSimError(f"{system.mechanism.name}: there are no derivatives at a dead point.")

    def __call__(self, rows: Array, driven: Array) -> Array:
        """x (nv, k) for right sides (m, k) and (drives, k)."""
        system = self._system
        wanted = np.vstack([in_natural_units(rows, self._sizes), driven / system.scale[system.u_driven][:, None]])
        found = np.zeros((len(self._values), wanted.shape[1]))
        for _ in range(2):
            left = self._left.T @ (wanted - self._matrix @ found)
            found += self._right.T @ (left / self._values[:, None])
        miss = np.max(np.abs(wanted - self._matrix @ found), initial=0.0)
        if miss > CONSISTENT * max(1.0, float(np.max(np.abs(wanted), initial=0.0))):
            raise MbdSimError(
                f"{system.mechanism.name}: redundant constraints contradict a change of the parameters: the mechanism "
                "can only be assembled with the lengths it has."
            )
        return system.scale[:, None] * found


def without_forces(mechanism: Mechanism) -> Mechanism:
    """The mechanism without masses and forces, on which its positions do not depend."""
    nothing: Mapping[str, Any] = {"mass": 0.0, "center": np.zeros(3), "inertia": np.zeros((3, 3))}
    parts = {name: replace(part, **nothing) for name, part in mechanism.parts.items()}
    return replace(
        mechanism, parts=parts, springs=(), dampers=(), applied=(), efforts=(), potentials=(), bushings=(),
        contacts=(), actuators=(), bases=(), sensors=(),
    )  # fmt: skip


@record
class Sensitivity:
    """Derivatives by the parameters, for each row of a motion: (n, ..., np); nan at dead points and change points."""

    position: Array
    velocity: Array
    acceleration: Array


class MotionSensitivity:
    """The exact derivatives of a motion by parameters, at the same drives. `keys` (np,) are those of the file."""

    __repr__ = short_repr

    def __init__(
        self, mechanism: Mechanism, motion: DrivenMotion, keys: Sequence[str], *, with_forces: bool = False
    ) -> None:
        """Differentiate.

        :param mechanism: that of the motion, as it was loaded.
        :param with_forces: also what `efforts` needs.
        :raises MechanismError: a key does not exist, or cannot be a parameter: see `ParametricMotion`.
        """
        self.motion = motion
        self.parametric = ParametricMotion(mechanism, motion.system.drives, keys, with_forces=with_forces)
        self.keys, self.values = self.parametric.keys, self.parametric.values
        self._regular = np.flatnonzero(np.all(np.isfinite(motion.ratios), axis=1))
        rows = self._regular
        self._states = States(motion.q[rows], motion.u[rows], motion.u_rates[rows])
        self._derivatives: StateDerivatives = self.parametric.derivatives(self.values, self._states)

    @property
    def displacements(self) -> Array:
        """The displacements along the speeds for unit changes of the parameters: (n, nv, np)."""
        return self._in_rows(self._derivatives.q)

    def coordinate(self, name: str) -> Sensitivity:
        """Of a coordinate of the spanning tree: (n, np) each.

        :raises InputError: there is no such coordinate, or it is a component of a rotation in space.
        """
        slopes = self._slopes(self.parametric.coordinate(name))
        return Sensitivity(slopes[:, 0], slopes[:, 1], slopes[:, 2])

    def point(self, name: str) -> Sensitivity:
        """Of a point: (n, 3, np) each.

        :raises InputError: there is no such point.
        """
        slopes = self._slopes(self.parametric.point(name))
        return Sensitivity(slopes[:, :3], slopes[:, 3:6], slopes[:, 6:])

    def efforts(self) -> Array:
        """Of the efforts of the drives: (n, drives, np)."""
        return self._slopes(self.parametric.efforts)

    def _slopes(self, quantity: Quantity) -> Array:
        _, slopes = quantity(self._states, self._derivatives, self.values)
        return self._in_rows(slopes)

    def _in_rows(self, slopes: Array) -> Array:
        found = np.full((len(self.motion), *slopes.shape[1:]), np.nan)
        found[self._regular] = slopes
        return found
