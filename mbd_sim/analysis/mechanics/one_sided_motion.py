"""The smooth motion between two events of contacts: which rows act, the accelerations, and their derivatives.

While closed contacts stay closed, sticking ones stick and sliding ones slide in their directions, the contact forces λ
solve F(λ; t, q, u, inputs) = 0, so that dλ = -F_λ⁻¹ dF: accelerations are differentiated exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.contact.one_sided_equations import SLIDING, FrictionElement
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.one_sided_functions import OneSidedFunctions

BARELY = 1e-9  # gaps, speeds and forces in natural units that count as zero
ITERATIONS, CONVERGED, SETTLED = 60, 1e-14, 1e-13
DEPENDENT = 1e-12  # singular value, relative to the largest, that is one of round-off
BLOCKED = 1e-11  # of the mobility, below which an acceleration by efforts is round-off


@dataclass(frozen=True, eq=False)
class OneSidedDerivatives:
    """The motion in a state, in the modes among its inputs.

    `u_rates` (nv,) are u'. (u', s'), with the states s of actuators, has the derivatives `by_state` with respect to
    (q, u, s) and `by_inputs` with respect to efforts and commands. The largest derivative of u' with respect to an
    effort, with given contact forces, is `mobility`; `n` (nq, nv) with q' = N u.
    `gradient` (m, nv) are the rows of closed and of sticking contacts, of which `holonomic` (m,) are closed gaps;
    `slopes` (m, nq) are the derivatives of their rates by q.
    """

    u_rates: Array
    by_state: Array
    by_inputs: Array
    mobility: float
    n: Array
    gradient: Array
    holonomic: Array
    slopes: Array


class OneSidedMotion:
    """The motion of a mechanism with one-sided elements in given modes."""

    def __init__(self, equations: Equations) -> None:
        assert equations.one_sided is not None
        self._equations, self._functions = equations, equations.one_sided
        self._system, self._derivatives = _functions(equations, self._functions)

    def at(self, t: float, q: Array, u: Array, s: Array, inputs: Array) -> OneSidedDerivatives:
        """The derivatives at a state.

        :param s: the states of actuators on which rates depend.
        :param inputs: (size,) with the modes of the contacts.
        :raises MbdSimError: the motion is not smooth there; the element and the reason are named.
        """
        found, readings = self._evaluated(t, q, u, s, inputs)
        self._require_smooth(t, inputs, readings)
        return found

    def efforts(
        self, t: float, q: Array, u: Array, u_rates: Array, inputs: Array, actuated: list[int]
    ) -> tuple[Array, Array]:
        """The efforts (nv,) of least norm with accelerations as near to `u_rates` (nv,) as possible, and those (nv,).

        They are found by Newton's method, and add to the efforts among the inputs.

        :param actuated: the indices of the coordinates that can have efforts.
        :raises ValueError: a contact would have to pull, or to hold more than its friction.
        """
        given, efforts = inputs.copy(), np.zeros(len(u))
        base = inputs[self._equations.inputs.efforts]
        states = np.zeros(self._equations.core.stop - len(q) - len(u))
        found, readings = self._evaluated(t, q, u, states, given)
        for _ in range(ITERATIONS):
            slopes, least = found.by_inputs[: len(u), actuated], BLOCKED * found.mobility
            slopes = np.where(np.abs(slopes) > least, slopes, 0.0)
            needed = u_rates - found.u_rates + slopes @ efforts[actuated]
            new = _least_squares(slopes, needed, least)
            change = new - efforts[actuated]
            efforts[actuated] = new
            given[self._equations.inputs.efforts] = base + efforts
            found, readings = self._evaluated(t, q, u, states, given)
            if np.max(np.abs(change), initial=0.0) <= SETTLED * np.max(np.abs(new), initial=1e-300):
                break
        self._require_admissible(inputs, readings)
        return efforts, found.u_rates

    def _evaluated(self, t: float, q: Array, u: Array, s: Array, inputs: Array) -> tuple[OneSidedDerivatives, Array]:
        """The derivatives, and the readings of `OneSidedFunctions`."""
        nq, nv, size = len(q), len(u), len(q) + len(u) + len(s)
        forces = self._forces(t, q, u, s, inputs)
        found = [np.array(value, dtype=float) for value in self._derivatives(t, q, u, s, inputs, forces)]
        u_rates, n, by_all, residual_by_all, by_forces, residual_by_forces, velocity_by_all, readings = found
        mobility = float(np.max(np.abs(by_all[:nv, size : size + nv]), initial=0.0))
        by_all = by_all - by_forces @ self._solved(residual_by_forces, residual_by_all, inputs)
        rows, holonomic = self._rows(inputs)
        derivatives = OneSidedDerivatives(
            u_rates=u_rates.ravel(),
            by_state=by_all[:, :size],
            by_inputs=by_all[:, size:],
            mobility=mobility,
            n=n,
            gradient=velocity_by_all[rows, nq : nq + nv],
            holonomic=np.array(holonomic, dtype=bool),
            slopes=velocity_by_all[rows, :nq],
        )
        return derivatives, readings.ravel()

    def _forces(self, t: float, q: Array, u: Array, s: Array, inputs: Array) -> Array:
        """The forces λ (rows,) that are solved for, by Newton's method: the loads of joints are not linear in them."""
        forces = np.zeros(self._functions.equations.layout.rows)
        for _ in range(ITERATIONS):
            residual, slope = (np.array(value, dtype=float) for value in self._system(t, q, u, s, inputs, forces))
            try:
                change = self._solved(slope, residual.ravel(), inputs)
            except np.linalg.LinAlgError:
                raise self._error(t, "no forces of its contacts are determined") from None
            forces = forces - change
            if np.max(np.abs(change), initial=0.0) <= CONVERGED * (
                self._functions.equations.units.force + np.max(np.abs(forces), initial=0.0)
            ):
                return forces
        raise self._error(t, "friction and the loads on which it depends do not balance")

    def _solved(self, slope: Array, right: Array, inputs: Array) -> Array:
        """The solution for the forces; where rows share theirs, that with the least sum of squares.

        :raises np.linalg.LinAlgError: there is none.
        """
        active = inputs[self._equations.inputs.one_sided][self._functions.equations.layout.active]
        if not np.any(active < 0.0):
            return np.asarray(np.linalg.solve(slope, right))
        scale = 1.0 / np.sqrt(np.where(active, np.abs(active), 1.0))
        solution = np.linalg.lstsq(slope * scale, right, rcond=DEPENDENT)[0]
        return np.asarray(scale.reshape(-1, *[1] * (right.ndim - 1)) * solution)

    def _rows(self, inputs: Array) -> tuple[list[int], list[bool]]:
        """The rows of closed gaps and of sticking friction, and which of them are holonomic."""
        one_sided, modes = self._functions.equations, inputs[self._equations.inputs.one_sided]
        layout = one_sided.layout
        closed, active = modes[layout.closed], modes[layout.active]
        rows = [index for index in range(layout.gaps) if closed[index]]
        holonomic = [not one_sided.gaps[index].clutch for index in rows]
        for element, slides in zip(one_sided.frictions, self._slides(inputs), strict=True):
            if not slides and any(active[row] for row in element.rows):
                rows += element.rows
                holonomic += [False] * len(element.rows)
        return rows, holonomic

    def _slides(self, inputs: Array) -> list[bool]:
        """Which friction elements slide."""
        one_sided, modes = self._functions.equations, inputs[self._equations.inputs.one_sided]
        layout, found = one_sided.layout, []
        directions = modes[layout.direction]
        for element in one_sided.frictions:
            size = sum(float(directions[row - layout.gaps]) ** 2 for row in element.rows)
            found.append(size > SLIDING)
        return found

    def _require_smooth(self, t: float, inputs: Array, readings: Array) -> None:
        """Refuse a state at which a contact is about to change; `readings` are those of `OneSidedFunctions`."""
        one_sided = self._functions.equations
        layout, rows = one_sided.layout, one_sided.equations.rows
        closed = inputs[self._equations.inputs.one_sided][layout.closed]
        rates = readings[layout.gaps : layout.gaps + layout.rows] / np.array(one_sided.speeds)
        guards = readings[layout.gaps + 2 * layout.rows :]
        for gap in range(layout.gaps):
            if guards[gap] > BARELY or not (closed[gap] or rates[gap] <= BARELY):
                continue
            raise self._error(t, f"'{rows[gap].name}' touches without a force")
        elements = zip(one_sided.frictions, guards[layout.gaps :], self._slides(inputs), strict=False)
        for element, guard, slides in elements:
            if guard <= BARELY:
                what = "slides at zero speed" if slides else "carries as much friction as it can at rest"
                raise self._error(t, f"'{rows[element.rows[0]].name}' {what}")
        first = layout.gaps + len(one_sided.frictions)
        single_loads = self._functions.load_components.count(1)
        if np.any(guards[first : first + single_loads] <= BARELY):
            raise self._error(t, "a joint whose friction depends on its load carries none")

    def _require_admissible(self, inputs: Array, readings: Array) -> None:
        one_sided = self._functions.equations
        layout, rows = one_sided.layout, one_sided.equations.rows
        guards = readings[layout.gaps + 2 * layout.rows :]
        closed = inputs[self._equations.inputs.one_sided][layout.closed]
        for gap in range(layout.gaps):
            if closed[gap] and not guards[gap] >= -BARELY:
                raise InputError(
                    f"these accelerations require '{rows[gap].name}' to pull, which it cannot", "Request others."
                )
        for element, guard, slides in zip(
            one_sided.frictions, guards[layout.gaps :], self._slides(inputs), strict=False
        ):
            if not slides and not guard >= -BARELY:
                raise InputError(
                    f"these accelerations require '{rows[element.rows[0]].name}' to hold more than its friction can",
                    "Request others.",
                )

    def _error(self, t: float, why: str) -> MbdSimError:
        return MbdSimError(
            f"the motion has no derivatives at {t:.6g} s, because {why}: it changes in one way to one side of this "
            "state and in another way to the other",
            "Choose a state in which contacts carry a force or are open, and friction is below its limit.",
        )


def _functions(equations: Equations, functions: OneSidedFunctions) -> tuple[ca.Function, ca.Function]:
    """(t, q, u, s, inputs, λ) -> F and ∂F/∂λ; and u', N, and the derivatives of (u', s'), F and of the rows' rates."""
    nq, nv, core = equations.layout.nq, equations.layout.nv, equations.core
    t, q, u, inputs = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("u", nv), ca.SX.sym("i", equations.inputs.size)
    forces = ca.SX.sym("forces", functions.equations.layout.rows)
    s = ca.SX.sym("s", core.stop - nq - nv)
    y = ca.vertcat(q, u, s, ca.SX.zeros(equations.start_state.size - core.stop))
    slots = functions.slots.values(t, y, inputs)
    memory, left, factor, right, *further = functions.rates.system.call([t, y, inputs, slots])
    n = forces.shape[0]
    active = inputs[equations.inputs.one_sided][functions.equations.layout.active]
    residual = functions.rates.product(left, factor, forces) - right
    position = 0
    for size, element in zip(functions.load_components, _loaded(functions), strict=True):
        factor = further[0][position]
        unloaded = further[0][position + 1 + size : position + 1 + 2 * size]
        slopes = ca.reshape(further[0][position + 1 + 2 * size : position + 1 + (2 + n) * size], size, n)
        across = unloaded + slopes @ forces
        row, length = element.rows[0], ca.sqrt(ca.dot(across, across))
        residual[row] = ca.if_else(factor, forces[row] + factor * length, residual[row])
        position += 1 + (2 + n) * size
    residual = ca.if_else(active != 0.0, residual, forces)
    rates = functions.rates.result.call([memory, forces, slots])[0]
    readings = functions.read(t, y, inputs, forces)
    velocity = readings[functions.equations.layout.gaps : functions.equations.layout.gaps + n]
    given = [t, q, u, s, inputs, forces]
    outputs = [rates[nq : nq + nv], ca.jacobian(rates[:nq], u)]
    for values in (rates[core], residual):
        by_inputs = ca.jacobian(values, inputs)[:, equations.inputs.acting]
        outputs.append(ca.horzcat(ca.jacobian(values, ca.vertcat(q, u, s)), by_inputs))
    outputs += [ca.jacobian(rates[core], forces), ca.jacobian(residual, forces)]
    outputs += [ca.jacobian(velocity, ca.vertcat(q, u)), readings]
    system = ca.Function("contact_forces", given, [ca.densify(residual), ca.densify(ca.jacobian(residual, forces))])
    return system, ca.Function("contact_derivatives", given, [ca.densify(output) for output in outputs])


def _loaded(functions: OneSidedFunctions) -> list[FrictionElement]:
    return [element for element in functions.equations.frictions if element.joint is not None]


def _least_squares(matrix: Array, right: Array, least: float) -> Array:
    """The smallest solution (n,), where singular values of up to `least` count as zero."""
    left, values, axes = np.linalg.svd(matrix, full_matrices=False)
    kept = values > least
    return np.asarray(axes[kept].T @ (left[:, kept].T @ right / values[kept]))
