"""Numbers of the equations as CasADi expressions of parameters of the file.

The formulas are those of `mbd_sim.studies.algebra.formulas`, so that derivatives with respect to a length or a
mass are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import MechanismError, Problem
from mbd_sim.base.geometry.batch import of_all
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.parameters import Path, SymbolicParameters, equation_data, equation_data_of_variants
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.files.checks.override import location_of, values_of
from mbd_sim.files.text.parameters import dependencies_first, resolve_functions
from mbd_sim.files.text.units import split_unit, unit_factor
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression, names_in
from mbd_sim.studies.algebra.formulas import Formula, ParameterSamples, formulas
from mbd_sim.studies.algebra.polynomial import Exact
from mbd_sim.studies.algebra.samples import number_samples, sampled, with_forces_alone

ONE = Formula(((Exact(Fraction(1)), ()),))
SAME = 1e-12  # relative difference of a value by its formula and that of the file


@dataclass(frozen=True, eq=False)
class ParameterInputs:
    """The `keys` of parameters, their `values` (n,) in SI units, and the numbers of the equations that depend on them.

    `numbers` are symbols of the equations. Each is the quotient of two `formulas` in the parameters. `points` has the
    formulas of the position (3,) of each point, by part and name, in the part's frame.

    The formulas are those in `variables`: the parameters, or these and others of the file that follow from them.

    `starts` has those of the numbers at the start, by the paths of `start_numbers`; of a number without a short
    formula, the indices of the parameters on which it depends. It is empty if they were not asked for.
    """

    keys: tuple[str, ...]
    values: Array
    numbers: SymbolicParameters
    formulas: tuple[tuple[Formula, Formula], ...]
    points: Mapping[tuple[str, str], tuple[Formula, ...]]
    starts: Mapping[Path, Formula | tuple[int, ...]] = field(default_factory=dict)
    variables: Callable[[ca.SX], ca.SX] = lambda parameters: parameters

    def numbers_at(self, parameters: ca.SX) -> ca.SX:
        """The numbers of the equations for parameters (n,)."""
        variables = self.variables(parameters)
        quotients = (
            casadi_expression(above, variables) / casadi_expression(below, variables) for above, below in self.formulas
        )
        return ca.vertcat(ca.SX(0, 1), *quotients)

    def point_at(self, part: str, point: str, parameters: ca.SX) -> ca.SX:
        """The position (3,) of a point in its part's frame."""
        variables = self.variables(parameters)
        return ca.vertcat(*(casadi_expression(formula, variables) for formula in self.points[part, point]))


def parameter_inputs(
    mechanism: Mechanism,
    keys: str | Sequence[str],
    reduced: Callable[[Mechanism], Mechanism] = with_forces_alone,
    *,
    starts: bool = False,
) -> ParameterInputs:
    """The numbers of a mechanism as formulas of some parameters.

    :param keys: of its file, as for live values; a single one may be given by itself.
    :param reduced: gives the mechanism whose equations are wanted, such as one without forces.
    :param starts: whether the numbers at the start are wanted as well; then only they may depend on a parameter.
    :raises MechanismError: a key does not exist or is given twice, or more than numbers depends on its value, or
        numbers without a short formula.
    """
    keys = (keys,) if isinstance(keys, str) else tuple(keys)
    try:
        return _inputs(mechanism, keys, reduced, starts=starts)
    except _NoFormulaError:
        derived = [] if starts else _derived_parameters(mechanism, keys)
        if not derived:
            raise
    # Numbers may have short formulas in parameters that the file computes, whatever the formulas of these.
    values = _derived_values(mechanism, keys, derived)
    found = _inputs(mechanism, (*keys, *derived), reduced, starts=False)
    return replace(found, keys=keys, values=found.values[: len(keys)], variables=values)


class _NoFormulaError(MechanismError):
    """A number depends on the parameters by no short formula."""


def _inputs(
    mechanism: Mechanism, keys: tuple[str, ...], reduced: Callable[[Mechanism], Mechanism], *, starts: bool
) -> ParameterInputs:
    whole, mechanism, start = mechanism, reduced(mechanism), values_of(mechanism, keys)
    _require_each_once(mechanism, keys)
    data = equation_data(mechanism)

    def numbers_of(one: Mechanism) -> Array:
        found = _numbers(one)
        return np.concatenate([found, list(start_numbers(one).values())]) if starts else found

    samples = number_samples(
        lambda changes: reduced(sampled(whole, changes)),
        start,
        numbers_of,
        None if starts else _numbers_of_variants,
    )
    problems = [_problem(mechanism, key, f"cannot be an input: {reason}") for key, reason in samples.built_in.items()]
    if problems:
        raise MechanismError(problems)
    start_paths = list(start_numbers(mechanism)) if starts else []
    base, unused = numbers_of(mechanism), [key for key in keys if key not in samples.keys]
    if unused:
        raise MechanismError([_problem(mechanism, key, "the equations do not depend on it") for key in unused])
    found = _formulas(samples.samples, base) if keys else [_constant(value) for value in base]
    paths = [*data.paths, *_further_paths(mechanism)]
    named = dict(zip(paths, found[: len(paths)], strict=True))
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
    at_start = {
        path: formula if isinstance(formula, Formula) else _parameters_of(samples.samples, index)
        for index, (path, formula) in enumerate(zip(start_paths, found[len(paths) :], strict=True), len(paths))
    }
    return ParameterInputs(tuple(keys), samples.base, numbers, tuple(columns), points, at_start)


def start_numbers(mechanism: Mechanism) -> dict[Path, float]:
    """The numbers at the start, before loops are closed, in SI units.

    These are positions and velocities of joints, positions of drives that follow commands, and of actuators the
    commands before the first one and the states of their machines, such as pressures.
    """
    found: dict[Path, float] = {}
    for name, joint in mechanism.joints.items():
        for what in ("position", "velocity"):
            found |= {(what, name, index): float(value) for index, value in enumerate(getattr(joint, what))}
    found |= {("drive", name): float(drive.start) for name, drive in commanded_drives(mechanism).items()}
    for actuator in mechanism.actuators:
        found |= {("command", actuator.name, channel): float(value) for channel, value in actuator.start.items()}
        states = actuator.motor.start_states
        found |= {("state", actuator.name, state): float(value) for state, value in states.items()}
    return found


def _parameters_of(samples: ParameterSamples, number: int) -> tuple[int, ...]:
    """The indices of the parameters on which a number depends."""
    return tuple(index for index, (_, values) in enumerate(samples.slices) if np.ptp(values[:, number]) > 0.0)


def _formulas(samples: ParameterSamples, base: Array) -> list[Formula | int]:
    """The formula of each number, see `formulas`; those that depend on no parameter are constants."""
    table = np.vstack([samples.joint[1], *(numbers for _, numbers in samples.slices)])
    constant = np.all(table == base, axis=0).tolist()
    found = formulas(samples, np.ones(len(base)), decimals=True)
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
    raise _NoFormulaError([_problem(mechanism, keys[0], f"{what} depends on the inputs by no short formula")])


def _numbers(mechanism: Mechanism) -> Array:
    moments = [part.mass * part.center for part in mechanism.parts.values()]
    found = np.concatenate([equation_data(mechanism).free, *moments, *_points(mechanism).values()])
    return np.where(np.isinf(found), 0.0, found)  # limits that there are not, whatever the parameters


def _numbers_of_variants(mechanism: Mechanism, valid: NDArray[np.bool_]) -> Array:
    """The numbers (k, n) of the k variants of a mechanism whose numbers are batches."""
    moments = [part.mass * part.center for part in mechanism.parts.values()]
    free = [data.free for data in equation_data_of_variants(mechanism, valid)]
    found = np.hstack([free, *(of_all(value, len(valid)) for value in (*moments, *_points(mechanism).values()))])
    return np.where(np.isinf(found), 0.0, found)


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


def _require_each_once(mechanism: Mechanism, keys: Sequence[str]) -> None:
    """:raises MechanismError: two keys, such as `l` and `parameters.l`, are those of one value."""
    locations = [location_of(mechanism, key) for key in keys]
    twice = [key for index, key in enumerate(keys) if locations[index] in locations[:index]]
    file, message = mechanism.source.file, "is given twice as a parameter"
    if twice:
        raise MechanismError([Problem(message, "Leave one out.", key=key, file=file) for key in twice])


def _problem(mechanism: Mechanism, key: str, message: str) -> Problem:
    return Problem(message, "Leave it out, or give its value in the file.", key=key, file=mechanism.source.file)


def _derived_parameters(mechanism: Mechanism, keys: Sequence[str]) -> list[str]:
    """The other parameters whose formulas in the file depend on those at `keys`, each after those that it uses."""
    reached, found = set(_names_in_texts(mechanism, keys)), list[str]()
    formulas = _texts(mechanism)
    uses = {name: names_in(text, formulas) for name, (text, _) in formulas.items()}
    for name in dependencies_first(uses):
        if name not in reached and uses[name] & reached:
            reached.add(name)
            found.append(name)
    return found


def _derived_values(mechanism: Mechanism, keys: Sequence[str], derived: Sequence[str]) -> ca.Function:
    """The values of parameters (n,) at `keys` and of the `derived` ones (k,) as a function (n + k,) of the former.

    :raises MechanismError: a formula does not give the value that the file has.
    """
    parameters, formulas = ca.SX.sym("parameters", len(keys)), _texts(mechanism)
    names = {name: ca.SX(float(value)) for name, value in mechanism.parameters.items()}
    given = dict(zip(_names_in_texts(mechanism, keys), range(len(keys)), strict=True))
    names |= {name: parameters[index] for name, index in given.items()}
    for name in derived:
        text, unit = formulas[name]
        names[name] = function_of(TimeExpression(text, {}), names) * (unit_factor(unit, None) if unit else 1.0)
    found = ca.Function("derived", [parameters], [ca.vertcat(parameters, *(names[name] for name in derived))])
    start = [mechanism.parameters.get(name, 0.0) for name in given]
    expected = np.array([*start, *(mechanism.parameters[name] for name in derived)])
    differs = np.abs(found(ca.DM(start)).full().ravel() - expected) > SAME * np.abs(expected)
    if np.any(differs):
        name = [*given, *derived][int(np.argmax(differs))]
        message = f"the value of '{name}' does not follow from its formula in the same way for all parameters"
        raise MechanismError([Problem(message, "Write it as an expression.", key=name, file=mechanism.source.file)])
    return found


def _names_in_texts(mechanism: Mechanism, keys: Sequence[str]) -> list[str]:
    """The names of the keys that are parameters, and the other keys, which no formula uses."""
    locations = [(key, location_of(mechanism, key)) for key in keys]
    return [str(at[1]) if at[0] == "parameters" and len(at) == 2 else key for key, at in locations]


def _texts(mechanism: Mechanism) -> dict[str, tuple[str, str]]:
    """The expression and the unit of each parameter that is written as one; of the others, an empty number."""
    functions, written = resolve_functions(mechanism.source), mechanism.source.data.get("parameters") or {}
    parts = {name: split_unit(value) if isinstance(value, str) else ("0", "") for name, value in written.items()}
    return {name: (functions.expanded(text), unit) for name, (text, unit) in parts.items()}
