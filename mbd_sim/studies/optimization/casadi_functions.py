"""The equations of a mechanism as CasADi functions with named inputs and outputs, for optimal control.

All functions consist of scalar operations (SX), so that they can be called with numbers, and with SX or MX symbols. The
steps of trajectories are those of the simulation with the same explicit method: their derivatives are those of the
computed trajectory, not of the exact one (differentiation of the discretized equations).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from functools import cached_property
from operator import index

import casadi as ca
import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.equations import Equations, derive
from mbd_sim.dynamics.layouts.actuators import require_continuous
from mbd_sim.integrators.explicit import EXPLICIT, Tableau
from mbd_sim.mechanism.contents import channel_names, require_two_sided
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.mechanism.values.names import readings, reference
from mbd_sim.studies.algebra.samples import with_forces_alone
from mbd_sim.studies.optimization.parameter_inputs import ParameterInputs, parameter_inputs

REFUSED = "cannot be given as CasADi functions"
SMOOTH = "Remove them, or use smooth ones: stops and contacts with a 'stiffness', friction without 'sticking'."


@record
class CasadiFunctions:
    """Functions of the time `t` in s, the state `x` (nx,), the efforts `e` (ne,) and the parameters `p` (np,).

    The inputs and outputs of each function are named so; SI units. x = (q, u), followed by `actuator_states` such as
    currents. e are the efforts of the `coordinates`, followed by the `commands` of actuators. `parameters` are the keys
    of p, in order, and `values` (np,) their values in the file; `start` (nx,) is the start state, and `efforts` (ne,)
    are those before the first command. `equations` are the traced equations, with numbers among their inputs.
    """

    mechanism: Mechanism
    parameters: tuple[str, ...]
    values: Array
    start: Array
    efforts: Array
    equations: Equations = field(repr=False)
    _inputs: ParameterInputs = field(repr=False)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the generalized speeds and efforts (nv,)."""
        return self.mechanism.coordinate_names

    @property
    def commands(self) -> tuple[str, ...]:
        """The commands of actuators and drives in e, such as `drive.voltage`, in SI units."""
        return channel_names(self.mechanism.commanded)

    @property
    def points(self) -> tuple[str, ...]:
        """The names of all points, such as `rod.tip`."""
        return tuple(reference(*key) for key in self._inputs.points)

    @property
    def actuator_states(self) -> tuple[str, ...]:
        """The states of actuators in x, such as `drive.current`, in SI units."""
        return self.equations.actuator_layout.core_names(self.mechanism.actuators)

    @cached_property
    def f(self) -> ca.Function:
        """(t, x, e, p) -> `x_dot` (nx,): q', u', and the rates of the states of actuators."""
        return self._function("f", {"x_dot": self._rates}, with_efforts=True)

    @cached_property
    def M(self) -> ca.Function:  # noqa: N802
        """(t, x, p) -> `M` (nv, nv), the mass matrix."""
        return self._function("M", {"M": self._mass})

    @cached_property
    def bias(self) -> ca.Function:
        """(t, x, p) -> `bias` (nv,), with M u' + bias = e + Gᵀ λ: inertial terms less all forces but e.

        With actuators, it includes their efforts without commands.
        """
        at_zero = [self._t, self._x, ca.SX.zeros(self._e.shape[0], 1), self._p]
        rates = self.f.call(at_zero)[0][self._speeds]
        multipliers = self.multipliers.call(at_zero)[0]
        return self._function("bias", {"bias": self._gradient.T @ multipliers - self._mass @ rates})

    @cached_property
    def energies(self) -> ca.Function:
        """(t, x, p) -> `T`, `V` in J; V without springs that are given by expressions."""
        both = self._call(self.equations.energies)
        return self._function("energies", {"T": both[0], "V": both[1]})

    @cached_property
    def constraints(self) -> ca.Function:
        """(t, x, p) -> `Phi` (m,), zero for nonholonomic rows, and `Phi_dot` (m,): the rate of Phi, or G u + b."""
        both = self._call(self.equations.violation)
        return self._function("constraints", {"Phi": both[:, 0], "Phi_dot": both[:, 1]})

    @cached_property
    def G(self) -> ca.Function:  # noqa: N802
        """(t, x, p) -> `G` (m, nv), the constraint matrix of all rows."""
        return self._function("G", {"G": self._gradient})

    @cached_property
    def multipliers(self) -> ca.Function:
        """(t, x, e, p) -> `lambda` (m,)."""
        return self._function("multipliers", {"lambda": self._call(self.equations.multipliers)}, with_efforts=True)

    @cached_property
    def margin(self) -> ca.Function | None:
        """(t, x, e, p) -> `margin`, negative where constraints are nearly singular; None where they never are."""
        if self.equations.rates.n_out() < 2:
            return None
        return self._function("margin", {"margin": self._call(self.equations.rates, 1)}, with_efforts=True)

    @cached_property
    def project(self) -> ca.Function:
        """(t, x, p) -> `x_projected` (nx,): with unit quaternions, and on the constraints as after each step."""
        project = self.equations.project
        after = self._x if project is None else self._call(project)[: len(self.start)]
        return self._function("project", {"x_projected": after})

    @cached_property
    def numbers(self) -> ca.Function:
        """(p) -> `numbers` (k,), those of the equations that depend on the parameters."""
        return ca.Function("numbers", [self._p], [ca.densify(self._inputs.numbers_at(self._p))], ["p"], ["numbers"])

    def point(self, name: str) -> ca.Function:
        """(t, x, p) -> `position` (3,) and `velocity` (3,) of a point such as "rod.tip", in ground's axes.

        :raises InputError: there is no such point.
        """
        place = next((key for key in self._inputs.points if key in readings(name)), None)
        if place is None:
            raise InputError(f"there is no point '{name}'", nearest(name, self.points))
        part, point = place
        position = self._inputs.point_at(part, point, self._p)
        if part != GROUND:
            pose = self._call(self.equations.poses)[12 * self.equations.part_names.index(part) :][:12]
            position = pose[:3] + ca.reshape(pose[3:], 3, 3) @ position
        rate = ca.jtimes(position, self._x, self._rates) + ca.jtimes(position, self._t, ca.SX(1))
        return self._function("point", {"position": position, "velocity": rate})

    @cached_property
    def _t(self) -> ca.SX:
        return ca.SX.sym("t")

    @cached_property
    def _x(self) -> ca.SX:
        return ca.SX.sym("x", len(self.start))

    @cached_property
    def _e(self) -> ca.SX:
        return ca.SX.sym("e", len(self.efforts))

    @cached_property
    def _p(self) -> ca.SX:
        return ca.SX.sym("p", len(self.values))

    @cached_property
    def _rates(self) -> ca.SX:
        return self._call(self.equations.rates)[: len(self.start)]

    @cached_property
    def _gradient(self) -> ca.SX:
        return ca.jacobian(self._call(self.equations.violation)[:, 1], self._x[self._speeds])

    @cached_property
    def _mass(self) -> ca.SX:
        kinetic = self._call(self.equations.energies)[0]
        return ca.hessian(kinetic, self._x)[0][self._speeds, self._speeds]

    @property
    def _speeds(self) -> slice:
        layout = self.equations.layout
        return slice(layout.nq, layout.nq + layout.nv)

    def _call(self, function: ca.Function, output: int = 0) -> ca.SX:
        """An output of a function of (t, y) or (t, y, inputs)."""
        equations = self.equations
        y = ca.vertcat(self._x, ca.SX.zeros(equations.start_state.size - len(self.start), 1))
        inputs = ca.SX(ca.DM(equations.inputs_without_commands))
        acting = [*range(equations.layout.nv), *range(equations.inputs.commands.start, equations.inputs.commands.stop)]
        if acting:
            inputs[acting] = self._e
        if equations.inputs.value_count:
            inputs[equations.inputs.values] = self._inputs.numbers_at(self._p)
        return function.call([self._t, y, inputs][: function.n_in()])[output]

    def _function(self, name: str, outputs: dict[str, ca.SX], *, with_efforts: bool = False) -> ca.Function:
        inputs = {"t": self._t, "x": self._x, **({"e": self._e} if with_efforts else {}), "p": self._p}
        return ca.Function(
            name,
            list(inputs.values()),
            [ca.densify(output) for output in outputs.values()],
            list(inputs),
            list(outputs),
            {"cse": True},
        )


@interruptible()
def casadi_functions(mechanism: Mechanism, parameters: Sequence[str] = ()) -> CasadiFunctions:
    """The equations of a mechanism as CasADi functions.

    :param parameters: keys of numbers of its file that are the inputs p, as for live values: `l`, `parts.rod.mass`. A
        single key may be given by itself.
    :raises MechanismError: it has one-sided elements, or actuators that change only between steps; or a key does not
        exist, cannot be an input, or is given twice.
    """
    require_two_sided(require_mechanism(mechanism), REFUSED, SMOOTH)
    mechanism = with_forces_alone(mechanism)
    inputs = parameter_inputs(mechanism, parameters)
    equations = derive(mechanism, parameters=inputs.numbers)
    require_continuous(mechanism, equations.actuator_layout, REFUSED)
    start = equations.start_state[: equations.core.stop]
    at_start = equations.inputs_without_commands
    efforts = np.concatenate([at_start[equations.inputs.efforts], at_start[equations.inputs.commands]])
    return CasadiFunctions(mechanism, inputs.keys, inputs.values, start, efforts, equations, inputs)


DEFAULT = "tsitouras8"


@interruptible()
def one_step(functions: CasadiFunctions, step: float, method: str = DEFAULT) -> ca.Function:
    """(t, x, e, p) -> `x_next` (nx,), the state `step` s later under constant efforts.

    With constraints and unit quaternions the state is projected onto them, as in the simulation.

    :param method: an explicit method, see `integrator.method` in mechanism files.
    :raises InputError: there is no such method.
    """
    if method not in EXPLICIT:
        raise InputError(f"there is no explicit method '{method}'", nearest(method, EXPLICIT))
    t, x = ca.SX.sym("t"), ca.SX.sym("x", len(functions.start))
    e, p = ca.SX.sym("e", len(functions.efforts)), ca.SX.sym("p", len(functions.values))
    after = _runge_kutta(functions.f, EXPLICIT[method], t, x, e, p, step)
    after = functions.project.call([t + step, after, p])[0]
    return ca.Function("one_step", [t, x, e, p], [after], ["t", "x", "e", "p"], ["x_next"], {"cse": True})


@interruptible()
def trajectory(functions: CasadiFunctions, steps: int, step: float, method: str = DEFAULT) -> ca.Function:
    """(t0, x0, e, p) -> `x` (nx, steps + 1), the states from x0 at the time t0 on, `step` s apart.

    `e` (ne, steps) are the efforts, constant during each step. `function.factory("name", function.name_in(),
    ["jac:x:p"])` differentiates it.

    :param method: see `one_step`.
    :raises InputError: there is no such method, or no step.
    :raises TypeError: `steps` is not an integer.
    """
    if (steps := index(steps)) < 1 or not step > 0.0:
        raise InputError(
            f"{steps} steps of {step} s are not a trajectory", "Give at least one step, of a positive size."
        )
    next_state = one_step(functions, step, method)
    x0, e = ca.MX.sym("x0", len(functions.start)), ca.MX.sym("e", len(functions.efforts), steps)
    t0, p = ca.MX.sym("t0"), ca.MX.sym("p", len(functions.values))
    times = t0 + ca.DM([step * number for number in range(steps)]).T
    states = _state_first(next_state).mapaccum(steps)(x0, times, e, ca.repmat(p, 1, steps))
    return ca.Function("trajectory", [t0, x0, e, p], [ca.horzcat(x0, states)], ["t0", "x0", "e", "p"], ["x"])


def _state_first(function: ca.Function) -> ca.Function:
    """A copy of a function with its state as the first input, as `mapaccum` needs it."""
    t, x, e, p = function.sx_in()
    return ca.Function("state_first", [x, t, e, p], function.call([t, x, e, p]))


def _runge_kutta(f: ca.Function, method: Tableau, t: ca.SX, x: ca.SX, e: ca.SX, p: ca.SX, step: float) -> ca.SX:
    rates: list[ca.SX] = []
    for row, c in zip(method.a, method.c, strict=True):
        place = x + step * sum((a * k for a, k in zip(row, rates, strict=False) if a), ca.SX.zeros(x.shape[0], 1))
        rates.append(f.call([t + c * step, place, e, p])[0])
    return x + step * sum((b * k for b, k in zip(method.b, rates, strict=True) if b), ca.SX.zeros(x.shape[0], 1))
