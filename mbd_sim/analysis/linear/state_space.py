"""Linear systems x' = A x + B i, o = C x + D i with chosen inputs and outputs, found by exact differentiation.

The linear-quadratic regulator gives the gains that stabilize such a system of a mechanism.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from mbd_sim.analysis.linear.inputs import LinearInput, driven_inputs, possible_inputs
from mbd_sim.analysis.linear.outputs import LinearizationPoint, LinearOutput, possible_outputs
from mbd_sim.analysis.linear.small_motion import SmallMotion, small_motion
from mbd_sim.analysis.mechanics.load_sharing import LoadSharing
from mbd_sim.base.errors import CommandError, InputError, listed, nearest, shortened
from mbd_sim.base.geometry.arrays import finite_matrix
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.base.short_repr import LONGEST
from mbd_sim.dynamics.equations import Equations, derivative_function
from mbd_sim.dynamics.layouts.vectors import UNDRIVEN
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.mechanism.mechanism import Mechanism

Named = TypeVar("Named")


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = `a` x + `b` i and o = `c` x + `d` i for small changes of the states, inputs and outputs, by their names.

    The units are SI units. States are those of `Linearization`, then, for each drive among the inputs, the changes of
    its position and velocity, or, for a command of a drive, the states of its filter.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]

    def response(self, frequencies: Sequence[float] | Array) -> Array:
        """The frequency response C (2πi f - A)⁻¹ B + D (n, outputs, inputs) at frequencies f (n,) in Hz.

        It is not finite at a frequency that is an eigenvalue.
        """
        s = 2j * np.pi * np.asarray(frequencies, dtype=float)
        shifted = s[:, None, None] * np.eye(len(self.a)) - self.a
        try:
            return np.asarray(
                self.c @ np.linalg.solve(shifted, np.broadcast_to(self.b, (len(s), *self.b.shape))) + self.d
            )
        except np.linalg.LinAlgError:
            return np.array([self._response_at(one) for one in shifted])

    def __repr__(self) -> str:
        names = (listed(list(one), 3) or "none" for one in (self.states, self.inputs, self.outputs))
        return shortened("<StateSpace: states {}; inputs {}; outputs {}>".format(*names), LONGEST)

    def _response_at(self, shifted: Array) -> Array:
        try:
            return np.asarray(self.c @ np.linalg.solve(shifted, self.b) + self.d)
        except np.linalg.LinAlgError:
            return np.full(self.d.shape, np.nan + 0j)

    def scipy(self) -> Any:
        """The system as a `scipy.signal.StateSpace`.

        :raises MissingPackageError: scipy is not installed.
        """
        require_packages("scipy", purpose="A system of scipy.signal")
        from scipy import signal

        return signal.StateSpace(self.a, self.b, self.c, self.d)

    def control(self) -> Any:
        """The system as a `control.StateSpace` of python-control; in the names of its signals, dots are `_`.

        :raises MissingPackageError: python-control is not installed.
        """
        require_packages("control", purpose="A system of python-control")
        import control

        kinds = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        names = {kind: [name.replace(".", "_") for name in given] for kind, given in kinds.items()}
        return control.ss(self.a, self.b, self.c, self.d, **names)


def state_space(
    equations: Equations,
    mechanism: Mechanism,
    t: float,
    y: Array,
    given: Array,
    inputs: Iterable[str] | None = None,
    outputs: Iterable[str] | None = None,
) -> StateSpace:
    """The linear system about a state y that satisfies the constraints: see `Simulation.state_space`.

    :param mechanism: that of the equations, or a variant with the live values among the inputs.
    :param given: all inputs of the equations.
    """
    plain = possible_inputs(mechanism, equations.disturbed(()).inputs)
    default = [name for name in plain if name.startswith(("efforts.", "commands."))]
    names = [one.name for one in _chosen(default if inputs is None else inputs, plain, "input")]
    full = equations.disturbed(tuple(dict.fromkeys(plain[name].part for name in names if plain[name].part)))
    possible, values = possible_inputs(mechanism, full.inputs), _with_disturbances(equations, full, mechanism, t, given)
    chosen = [possible[name] for name in names]
    _require_drives(full, chosen, values)
    small = small_motion(full, t, y, values)
    driven = driven_inputs(full, small, chosen, t, y, values)
    t_, y_, i_ = (ca.SX.sym(name, full.rates.size_in(place)) for place, name in enumerate("tyi"))
    state = LinearizationPoint((t_, y_, i_), (t, y, values))
    positions = [f"joints.{name}.position" for name in mechanism.coordinate_names]
    wanted = _chosen(positions if outputs is None else outputs, possible_outputs(full, mechanism, state), "output")
    by_x, by_given = small.along(_output_derivatives(full, mechanism, wanted, state))
    own, extra = len(small.a), len(driven.rates)
    return StateSpace(
        a=np.block([[small.a, small.b @ driven.states], [np.zeros((extra, own)), driven.rates @ driven.states]]),
        b=np.vstack([small.b @ driven.inputs, driven.rates @ driven.inputs]),
        c=np.hstack([by_x, by_given @ driven.states]),
        d=by_given @ driven.inputs,
        states=(*_state_names(full, mechanism, small), *driven.names),
        inputs=tuple(names),
        outputs=tuple(one.name for one in wanted),
        input_units=tuple(one.unit for one in chosen),
        output_units=tuple(one.unit for one in wanted),
    )


def _chosen(names: Iterable[str], possible: Mapping[str, Named], what: str) -> list[Named]:
    """Those with these names, or with names that begin with one of these and a dot.

    :raises CommandError: there are none.
    """
    found: dict[str, Named] = {}
    for name in [names] if isinstance(names, str) else names:
        own = [name] if name in possible else [other for other in possible if other.startswith(f"{name}.")]
        if not own:
            raise CommandError(f"there is no {what} '{name}'", nearest(name, possible))
        found |= {other: possible[other] for other in own}
    return list(found.values())


def _with_disturbances(equations: Equations, full: Equations, mechanism: Mechanism, t: float, given: Array) -> Array:
    """The inputs of the equations `full` from those of others, with zero disturbances at time t."""
    centers = [mechanism.parts[part].center for part in full.inputs.loaded]
    values = full.inputs.without_commands(centers, np.zeros(full.inputs.value_count))
    for part, span in equations.inputs.wrenches.items():
        values[full.inputs.wrenches[part]] = given[span]
    for name in ("efforts", "commands", "one_sided"):
        values[getattr(full.inputs, name)] = given[getattr(equations.inputs, name)]
    values[full.inputs.values.start : full.inputs.disturbances.start] = given[equations.inputs.values]
    values[full.inputs.disturbances.stop - UNDRIVEN] = t
    return values


def _require_drives(full: Equations, chosen: Sequence[LinearInput], values: Array) -> None:
    """Refuse drives as inputs where their effect on contacts is not known, and two inputs that move one drive.

    :raises CommandError: the inputs are named.
    """
    moving = [one for one in chosen if one.drive is not None or one.filtered]
    if moving and full.has_contact(values):
        names = listed([one.name for one in moving])
        raise CommandError(
            f"{names}: drives cannot be inputs while contacts are closed or stick", "Choose a state without contact."
        )
    for joint in dict.fromkeys(one.filtered for one in moving if one.filtered):
        if any(one.name == f"drives.{joint}" for one in moving):
            raise CommandError(f"drives.{joint}: commands of this drive are inputs as well", "Choose one or the other.")


def _output_derivatives(
    full: Equations, mechanism: Mechanism, wanted: Sequence[LinearOutput], state: LinearizationPoint
) -> Array:
    """The derivatives (outputs, variables), with the loads of redundant joints shared.

    :raises CommandError: an output depends on the forces of contacts, or redundant joints share its load.
    """
    values = ca.vertcat(ca.SX(0, 1), *(one.value() for one in wanted))
    _require_no_contact_forces(full, wanted, values, state)
    found = _evaluated(full, values, state)
    sharing = LoadSharing(mechanism, full)
    loads = [(row, one.reaction_row) for row, one in enumerate(wanted) if one.reaction_row is not None]
    if not loads or not sharing.indeterminacy:
        return found
    if any(load < 0 for _, load in loads):
        names = listed([wanted[row].name for row, load in loads if load < 0])
        raise CommandError(f"{names}: redundant joints share this load", "Choose the force and moment of the joint.")
    reactions = _evaluated(full, ca.vec(state.called(full.reactions)), state)
    multipliers = _evaluated(full, state.called(full.multipliers), state)
    shared = sharing.shared_changes(*state.values, reactions, multipliers)
    for row, load in loads:
        assert load is not None
        found[row] = shared[load]
    return found


def _evaluated(full: Equations, values: ca.SX, state: LinearizationPoint) -> Array:
    return evaluated(derivative_function(full, "outputs", state.symbols, values), *state.values).T


def _require_no_contact_forces(
    full: Equations, wanted: Sequence[LinearOutput], values: ca.SX, state: LinearizationPoint
) -> None:
    if not full.has_contact(state.values[2]):
        return
    depends = ca.jacobian(values, state.symbols[2][full.inputs.one_sided]).sparsity()
    rows = set(depends.get_triplet()[0])
    if names := [one.name for row, one in enumerate(wanted) if row in rows]:
        raise CommandError(
            f"{listed(names)}: outputs that depend on the forces of closed contacts are not linearized",
            "Choose positions, velocities, or a state without contact.",
        )


def _state_names(full: Equations, mechanism: Mechanism, small: SmallMotion) -> list[str]:
    """Names for p, w and s: those of coordinates where nothing constrains them."""
    names = mechanism.coordinate_names
    directions = small.displacements.shape[1], small.speeds.shape[1]
    if small.directions is None:
        own = [f"joints.{name}.{what}" for what in ("position", "velocity") for name in names]
    else:
        counted = zip(("displacement", "speed"), directions, strict=True)
        own = [f"{what}_{number + 1}" for what, count in counted for number in range(count)]
    return [*own, *(f"actuators.{name}" for name in full.actuator_layout.core_names(mechanism.actuators))]


ROUNDING = 1e-12  # relative error of the costs that is accepted


def lqr(a: Array, b: Array, state_cost: Array, effort_cost: Array) -> Array:
    """The gain K (m, n) of e = -K x that minimizes ∫ xᵀ Q x + eᵀ R e dt for x' = A x + B e.

    The Riccati equation is solved with the stable eigenvectors of its Hamiltonian matrix (Potter 1966; Åström & Murray,
    sec. 7.5). The states may differ greatly in scale, but A must not have nearly equal modes.

    :param a: A (n, n).
    :param b: B (n, m).
    :param state_cost: Q (n, n), symmetric and positive semidefinite.
    :param effort_cost: R (m, m), symmetric and positive definite.
    :raises ValueError: a matrix has another shape, a cost is not symmetric or not positive; or an unstable mode is not
        controllable through B, or a mode that does not decay has no cost in Q.
    """
    a = np.asarray(a, dtype=float)
    n = len(a) if a.ndim else 0
    a, b = finite_matrix(a, (n, n), "a"), _columns(b, n)
    state_cost = _cost(state_cost, n, "state_cost")
    effort_cost = _cost(effort_cost, b.shape[1], "effort_cost", positive=True)
    weighted = np.linalg.solve(effort_cost, b.T)
    hamiltonian = np.block([[a, -b @ weighted], [-state_cost, -a.T]])
    values, vectors = np.linalg.eig(hamiltonian)
    stable = vectors[:, values.real < -1e-9 * np.max(np.abs(values), initial=0.0)]
    if stable.shape[1] != n or np.linalg.matrix_rank(stable[:n]) < n:
        raise InputError(
            "no regulator stabilizes this system: these efforts cannot control an unstable mode, or a mode that does "
            "not decay has no cost",
            "Actuate another joint, or give every coordinate a cost.",
        )
    solution = np.real(stable[n:] @ np.linalg.inv(stable[:n]))
    return np.asarray(weighted @ solution)


def _columns(given: Array, size: int) -> Array:
    """A matrix (size, m) with a column for each effort."""
    b = np.asarray(given, dtype=float)
    if b.ndim != 2:
        raise InputError(
            f"b must be a matrix ({size}, m) with a column for each of m efforts, not an array of shape {b.shape}",
            "Give the column of a single effort as b[:, :1], or as [[0], [1]].",
        )
    return finite_matrix(b, (size, b.shape[1]), "b")


def _cost(given: Array, size: int, name: str, *, positive: bool = False) -> Array:
    """A symmetric matrix (size, size) that is positive semidefinite, or with `positive` definite."""
    cost = finite_matrix(given, (size, size), name)
    largest = float(np.max(np.abs(cost), initial=0.0))
    if not np.allclose(cost, cost.T, rtol=0.0, atol=ROUNDING * largest):
        raise ValueError(f"{name} must be symmetric.")
    least = float(np.min(np.linalg.eigvalsh(cost), initial=np.inf))
    if positive and not least > 0.0:
        raise ValueError(f"{name} must be positive definite; its least eigenvalue is {least:.6g}.")
    if least < -ROUNDING * largest:
        raise ValueError(f"{name} must be positive semidefinite; its least eigenvalue is {least:.6g}.")
    return cost
