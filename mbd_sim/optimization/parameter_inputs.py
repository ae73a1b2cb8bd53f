"""Numbers of the equations as CasADi expressions of parameters of the file.

The formulas are those of `mbd_sim.symbolic.number_formulas`, so that derivatives with respect to a length or a mass are
exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import casadi as ca
import numpy as np

from mbd_sim.dynamics.symbolic_parameters import Path, SymbolicParameters, equation_data
from mbd_sim.errors import MechanismError, Problem
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import GROUND, Mechanism
from mbd_sim.mechanism_file.override import values_of, with_values
from mbd_sim.symbolic.exact_numbers import Exact
from mbd_sim.symbolic.number_formulas import Formula, Samples, formulas
from mbd_sim.symbolic.parameter_samples import number_samples
from mbd_sim.symbolic.symbolic_values import with_forces_alone

ONE = Formula(((Exact(Fraction(1)), ()),))


@dataclass(frozen=True, eq=False)
class ParameterInputs:
    """The `keys` of parameters, their `values` (n,) in SI units, and the numbers of the equations that depend on them.

    `numbers` are symbols of the equations. Each is the quotient of two `formulas` in the parameters. `points` has the
    formulas of the position (3,) of each point, by part and name, in the part's frame.
    """

    keys: tuple[str, ...]
    values: Array
    numbers: SymbolicParameters
    formulas: tuple[tuple[Formula, Formula], ...]
    points: Mapping[tuple[str, str], tuple[Formula, ...]]

    def numbers_at(self, parameters: ca.SX) -> ca.SX:
        """The numbers of the equations for parameters (n,)."""
        quotients = (
            casadi_expression(above, parameters) / casadi_expression(below, parameters)
            for above, below in self.formulas
        )
        return ca.vertcat(ca.SX(0, 1), *quotients)

    def point_at(self, part: str, point: str, parameters: ca.SX) -> ca.SX:
        """The position (3,) of a point in its part's frame."""
        return ca.vertcat(*(casadi_expression(formula, parameters) for formula in self.points[part, point]))


def parameter_inputs(
    mechanism: Mechanism, keys: Sequence[str], reduced: Callable[[Mechanism], Mechanism] = with_forces_alone
) -> ParameterInputs:
    """The numbers of a mechanism as formulas of some parameters.

    :param keys: of its file, as for live values.
    :param reduced: gives the mechanism whose equations are wanted, such as one without forces.
    :raises MechanismError: a key does not exist, or more than numbers depends on its value, or numbers without a short
        formula.
    """
    whole, mechanism, start = mechanism, reduced(mechanism), values_of(mechanism, keys)
    data = equation_data(mechanism)
    samples = number_samples(lambda changes: reduced(with_values(whole, changes)), start, _numbers)
    problems = [_problem(mechanism, key, f"cannot be an input: {reason}") for key, reason in samples.built_in.items()]
    if problems:
        raise MechanismError(problems)
    base, unused = _numbers(mechanism), [key for key in keys if key not in samples.keys]
    if unused:
        raise MechanismError([_problem(mechanism, key, "the equations do not depend on it") for key in unused])
    found = _formulas(samples.samples, base) if keys else [_constant(value) for value in base]
    named = dict(zip([*data.paths, *_further_paths(mechanism)], found, strict=True))
    columns: dict[tuple[Formula, Formula], int] = {}
    indices, column_of = [], []
    for index, path in enumerate(data.paths):
        quotient = _quotient(mechanism, keys, named, path)
        if any(formula.parameters for formula in quotient):
            indices.append(index)
            column_of.append(columns.setdefault(quotient, len(columns)))
    values = np.zeros(len(columns))
    values[column_of] = base[indices]
    numbers = SymbolicParameters(data, np.array(indices, dtype=np.intp), np.array(column_of, dtype=np.intp), values)
    points = {
        key: tuple(_quotient(mechanism, keys, named, ("points", *key, axis))[0] for axis in range(3))
        for key in _points(mechanism)
    }
    return ParameterInputs(tuple(keys), samples.base, numbers, tuple(columns), points)


def _formulas(samples: Samples, base: Array) -> list[Formula | int]:
    """The formula of each number, see `formulas`; those that depend on no parameter are constants."""
    table = np.vstack([samples.joint[1], *(numbers for _, numbers in samples.slices)])
    constant = np.all(table == base, axis=0).tolist()
    found = formulas(samples, np.ones(len(base)))
    return [_constant(value) if fixed else formula for formula, fixed, value in zip(found, constant, base, strict=True)]


def casadi_expression(formula: Formula, parameters: ca.SX) -> ca.SX:
    """The value of a formula as an expression of the parameters (n,)."""
    total = ca.SX(1, 1)
    for coefficient, term in formula.terms:
        product = ca.SX(float(coefficient))
        for factor in term:
            x = parameters[factor.parameter]
            base = x if factor.kind == "power" else ca.sin(x) if factor.kind == "sin" else ca.cos(x)
            exponent = factor.exponent
            product *= ca.sqrt(base) ** exponent.numerator if exponent.denominator == 2 else base ** int(exponent)
        total += product
    return formula.root * ca.sqrt(total) if formula.root else total


def _quotient(
    mechanism: Mechanism, keys: Sequence[str], named: Mapping[Path, Formula | int], path: Path
) -> tuple[Formula, Formula]:
    """The formulas whose quotient a number is: for the center of mass of a composite part, first moment and mass.

    :raises MechanismError: there are none.
    """
    formula = named[path]
    if isinstance(formula, Formula):
        return formula, ONE
    if path[:2] == (0, "parts") and path[3] == "center":
        above, below = named["moments", path[2], path[4]], named[0, "parts", path[2], "mass"]
        if isinstance(above, Formula) and isinstance(below, Formula):
            return above, below
    what = ".".join(map(str, path[1:]))
    raise MechanismError([_problem(mechanism, keys[0], f"{what} depends on the inputs by no short formula")])


def _numbers(mechanism: Mechanism) -> Array:
    moments = [part.mass * part.center for part in mechanism.parts.values()]
    found = np.concatenate([equation_data(mechanism).free, *moments, *_points(mechanism).values()])
    return np.where(np.isinf(found), 0.0, found)  # limits that there are not, whatever the parameters


def _further_paths(mechanism: Mechanism) -> list[Path]:
    """The paths of the numbers that follow those of the equations."""
    moments: list[Path] = [("moments", part, axis) for part in mechanism.parts for axis in range(3)]
    return moments + [("points", *key, axis) for key in _points(mechanism) for axis in range(3)]


def _points(mechanism: Mechanism) -> dict[tuple[str, str], Array]:
    """The positions of all points."""
    found = {(GROUND, name): pose.position for name, pose in mechanism.ground_points.items()}
    for part in mechanism.parts.values():
        found |= {(part.name, name): pose.position for name, pose in part.points.items()}
    return found


def _constant(value: float) -> Formula:
    return Formula(((Exact(Fraction(float(value))), ()),))


def _problem(mechanism: Mechanism, key: str, message: str) -> Problem:
    return Problem(message, "Leave it out, or give its value in the file.", key=key, file=mechanism.source.file)
