"""The energies and equations of a mechanism as SymPy matrices, for work beyond printing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.symbolic.equations import SymbolicEquations, symbolic_equations


@dataclass(frozen=True, eq=False)
class SympyModel:
    """M u' + h = Q + Gᵀ λ, with q' = N(q) u, in SymPy; SI units.

    - `t`, `q` (nq, 1), `u` (nv, 1), `u_rates` (nv, 1), `efforts` (nv, 1), `multipliers` (m, 1): symbols. Their names
      are those of the joints after `q_`, `u_`, `du_`, `e_`; u is q' except for spherical and free joints, see
      `equations.coordinates`.
    - `parameters`: the value of each symbol that is a number in SI units.
    - `T`, `V`: kinetic and potential energy in J; `D`: Rayleigh's dissipation function in W; None if too long.
    - `M` (nv, nv), `h` (nv, 1), `Q` (nv, 1): mass matrix, inertial terms, and all forces but those of constraints.
      Efforts of actuators are symbols, whose laws are in `equations.actuators`.
    - `Phi` (m, 1): positions of the constraints, which stay zero; of a nonholonomic row NaN.
    - `G` (m, nv), `b` (m, 1): the rates G u + b of the constraints. The rows of one-sided elements come last.
    - `sensors`: by the name of each sensor that has a formula, the matrix of each quantity, see `SymbolicSensor`.
    """

    equations: SymbolicEquations
    t: Any
    q: Any
    u: Any
    u_rates: Any
    efforts: Any
    multipliers: Any
    parameters: Mapping[Any, float]
    T: Any
    V: Any
    D: Any
    M: Any
    h: Any
    Q: Any
    Phi: Any
    G: Any
    b: Any
    sensors: Mapping[str, Mapping[str, Any]]

    __repr__ = short_repr

    @property
    def L(self) -> Any:  # noqa: N802
        """The Lagrangian T - V in J."""
        return self.T - self.V

    @property
    def residual(self) -> Any:
        """M u' + h - Q - Gᵀ λ (nv, 1), zero along a motion."""
        return self.M * self.u_rates + self.h - self.Q - self.G.T * self.multipliers


def sympy(mechanism: Mechanism, parameters: Sequence[str] | None = None) -> SympyModel:
    """The energies, equations and constraints of a small mechanism as SymPy expressions.

    >>> model = sympy(load_mechanism("rod_pendulum"))
    >>> model.M
    Matrix([[l**2*m/3]])

    :param parameters: keys of the numbers of its file that become symbols, as for live values, and with them the
        gravity; () for none. By default all parameters of the file.
    :raises MissingPackageError: SymPy is not installed.
    :raises MechanismError: there is no such key.
    :raises MbdSimError: the equations are too long to be read, or cannot be written as formulas.
    """
    equations = symbolic_equations(mechanism, parameters)
    import sympy as sp

    rows, energies, nv = equations.rows, equations.energies, len(equations.u)
    return SympyModel(
        equations=equations,
        t=equations.time,
        q=_column(equations.q),
        u=_column(equations.u),
        u_rates=_column(equations.u_rates),
        efforts=_column(equations.efforts),
        multipliers=_column(equations.multipliers),
        parameters={one.symbol: one.value for one in equations.parameters},
        T=None if energies is None else energies.kinetic,
        V=None if energies is None else energies.potential,
        D=None if energies is None else energies.dissipation,
        M=sp.Matrix(nv, nv, [entry for row in equations.mass for entry in row]),
        h=_column(equations.inertial),
        Q=_column(equations.forces),
        Phi=_column([sp.nan if row.position is None else row.position for row in rows]),
        G=sp.Matrix(len(rows), nv, [entry for row in rows for entry in row.gradient]),
        b=_column([row.drift for row in rows]),
        sensors={one.sensor.name: one.values for one in equations.sensors if not one.reason},
    )


def _column(entries: Sequence[Any]) -> Any:
    import sympy as sp

    return sp.Matrix(len(entries), 1, list(entries))
