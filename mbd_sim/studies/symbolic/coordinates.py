"""The symbols of coordinates, speeds and efforts with their LaTeX, and the energies as simplified SymPy expressions."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import casadi as ca
import sympy as sp

from mbd_sim.dynamics.lagrange import LagrangeEquations
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS, JointType
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.algebra.names import escaped, greek_name
from mbd_sim.studies.algebra.polynomial import Algebra


@dataclass(frozen=True, eq=False)
class Coordinate:
    """The symbols of a joint: its coordinates, its speeds, their rates, and its efforts, in order."""

    joint: str
    type: JointType
    q: tuple[Any, ...]
    u: tuple[Any, ...]
    u_rates: tuple[Any, ...]
    efforts: tuple[Any, ...]


def symbolic_coordinate(mechanism: Mechanism, name: str, names: dict[Any, str]) -> Coordinate:
    """The symbols of a joint; `names` gets their LaTeX."""
    joint = mechanism.joints[name]
    labels = joint.coordinate_names
    if not labels:
        return Coordinate(name, joint.type, (), (), (), ())
    quaternion = joint.kind.quaternion

    def symbols(letter: str, written: str, subscripts: list[str]) -> tuple[Any, ...]:
        made = tuple(sp.Symbol(f"{letter}_{subscript}", real=True) for subscript in subscripts)
        for symbol, subscript in zip(made, subscripts, strict=True):
            names[symbol] = f"{written}_{{\\mathrm{{{escaped(subscript)}}}}}"
        return made

    def greek(letter: str, accent: str = "") -> tuple[Any, ...]:
        assert own_letter is not None
        symbol = sp.Symbol(f"{letter}_{name}", real=True)
        stem, subscript = own_letter
        names[symbol] = (rf"{accent}{{{stem}}}" if accent else stem) + (f"_{{{subscript}}}" if subscript else "")
        return (symbol,)

    own = [label.replace(".", ",") for label in labels]
    own_letter = greek_name(name) if labels == (name,) else None
    if own_letter is not None:
        effort = symbols("e", r"\tau", own)
        return Coordinate(name, joint.type, greek("q"), greek("u", r"\dot"), greek("du", r"\ddot"), effort)
    if quaternion is None:
        q, u = symbols("q", "q", own), symbols("u", r"\dot{q}", own)
        return Coordinate(name, joint.type, q, u, symbols("du", r"\ddot{q}", own), symbols("e", r"\tau", own))
    subscripts = [f"{name},{axis}" for axis in "xyz"]
    turned = symbols("p", "p", [f"{name},{axis}" for axis in "wxyz"])
    omega, omega_rate = symbols("w", r"\omega", subscripts), symbols("dw", r"\dot{\omega}", subscripts)
    moments = symbols("m", r"\tau", subscripts)
    if quaternion == 0:
        return Coordinate(name, joint.type, turned, omega, omega_rate, moments)
    q, v, v_rate = symbols("q", "q", subscripts), symbols("v", "v", subscripts), symbols("dv", r"\dot{v}", subscripts)
    forces = symbols("f", "F", subscripts)
    return Coordinate(name, joint.type, q + turned, v + omega, v_rate + omega_rate, forces + moments)


def define_unit_quaternion(algebra: Algebra, coordinate: Coordinate) -> None:
    """Define w² = 1 - x² - y² - z² in the algebra, for the quaternion of a joint."""
    start = JOINT_KINDS[coordinate.type].quaternion
    if start is None or not coordinate.q:
        return
    w, *vector = (algebra.generator(symbol) for symbol in coordinate.q[start:])
    algebra.define_square(w, {(): Fraction(1)} | {((number, 2),): Fraction(-1) for number in vector})


@dataclass(frozen=True, eq=False)
class SymbolicEnergies:
    """The `kinetic` and the `potential` energy in J, and Rayleigh's `dissipation` function in W.

    Springs whose force is an expression have no part in the potential: they are among the forces.
    """

    kinetic: Any
    potential: Any
    dissipation: Any

    @property
    def lagrangian(self) -> Any:
        """L = T - V."""
        return self.kinetic - self.potential


def energy_function(lagrange: LagrangeEquations) -> ca.Function:
    """(t, q, u), and parameters if there are any, -> T, V and D."""
    given = lagrange.energies.sx_in()
    *kinetic, potential = lagrange.energies.call(given)
    dissipation = lagrange.dissipation.call(given)[0]
    outputs = [ca.sparsify(one) for one in (sum(kinetic, ca.SX(1, 1)), potential, dissipation)]
    return ca.Function("energies", given, outputs)
