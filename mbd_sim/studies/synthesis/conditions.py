"""Conditions that a design keeps besides its goal, such as `stroke(ram) = 100mm`.

A condition compares the largest or the least value of a coordinate or of a component of a point, or their difference,
over the positions of the drive with a number. A largest value between two positions is that of the parabola through
three of them. The search for the least root mean square keeps conditions by an augmented Lagrangian (Powell 1969,
Rockafellar 1973), that for the least peak by linear programs with an exact penalty.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Literal, cast, get_args

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.files.text.units import parse_value
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.kinematic_analysis.system import coordinate_index, is_rotation

Measure = Literal["stroke", "max", "min"]
Relation = Literal["=", "<=", ">="]
AXES = "xyz"
MET = 1e-6  # violation relative to the size of the value, up to which a condition counts as met
PARABOLA = 1e-12  # curvature relative to the values, below which there is no largest value between positions
_TEXT = re.compile(r"\s*(\w+)\s*\(\s*([^()]+?)\s*\)\s*(<=|>=|==|=)\s*(.+?)\s*")


@record
class Condition:
    """The `measure` of a `quantity` is at most, at least or exactly a `value` in `unit`, rad or m.

    The quantity is a coordinate, or a component of a point, such as `coupler.tracer.x`.
    """

    measure: Measure
    quantity: str
    relation: Relation
    value: float
    unit: Literal["rad", "m"]

    @property
    def text(self) -> str:
        """What is measured."""
        return f"{self.measure}({self.quantity})"

    @property
    def size(self) -> float:
        """What violations are relative to."""
        return abs(self.value) or 1.0

    def excess(self, measured: float) -> float:
        """By how much it is exceeded, relative to its size: negative while an inequality holds."""
        return (self.value - measured if self.relation == ">=" else measured - self.value) / self.size

    def violation(self, measured: float) -> float:
        """How far it is from being met, relative to its size."""
        excess = self.excess(measured)
        return abs(excess) if self.relation == "=" else max(excess, 0.0)


@record
class KeptCondition:
    """A condition with what it measures at the start (nan where that cannot be assembled) and in the design."""

    condition: Condition
    start: float
    end: float

    @property
    def is_met(self) -> bool:
        """Whether the design keeps it."""
        return self.condition.violation(self.end) <= MET


def conditions_of(texts: Sequence[str], mechanism: Mechanism) -> tuple[Condition, ...]:
    """The conditions of texts such as `stroke(ram) = 100mm` or `min(knee) >= 10deg`.

    :raises InputError: one cannot be read, or names no coordinate and no component of a point.
    """
    return tuple(_condition(text, mechanism) for text in texts)


def _condition(text: str, mechanism: Mechanism) -> Condition:
    found = _TEXT.fullmatch(text)
    if found is None or found[1] not in get_args(Measure):
        raise InputError(
            f"'{text}' is not a condition",
            "Write stroke(NAME), max(NAME) or min(NAME), then =, <= or >=, and a value: 'stroke(ram) = 100mm'.",
        )
    name = found[2]
    if axis_of(name, mechanism) is None:
        coordinate_index(mechanism, name)
    unit: Literal["rad", "m"] = "rad" if axis_of(name, mechanism) is None and is_rotation(mechanism, name) else "m"
    try:
        value = parse_value(found[4], mechanism.parameters, unit)
    except InputError as error:
        raise InputError(f"'{text}': {error.message}", error.remedy) from error
    measure = cast("Measure", found[1])
    relation = cast("Relation", "=" if found[3].startswith("=") else found[3])
    if measure == "stroke" and (value < 0.0 or (value == 0.0 and relation == "=")):
        raise InputError(f"'{text}': a stroke is positive", "Give another value.")
    return Condition(measure, name, relation, value, unit)


def axis_of(name: str, mechanism: Mechanism) -> tuple[str, int] | None:
    """The point and the axis of `part.point.x`; None for a coordinate."""
    point, _, axis = name.rpartition(".")
    part, _, own = point.partition(".")
    if axis in {*AXES} and part in mechanism.parts and own in mechanism.parts[part].points:
        return point, AXES.index(axis)
    return None


def measured(condition: Condition, values: Array, slopes: Array) -> tuple[float, Array]:
    """What a condition measures of values (n,) at the positions of the drive, with its derivatives (k,).

    :param slopes: the derivatives (n, k) of the values.
    """
    if condition.measure == "stroke":
        high, low = (_largest(sign * values, sign * slopes) for sign in (1.0, -1.0))
        return high[0] + low[0], high[1] + low[1]
    sign = 1.0 if condition.measure == "max" else -1.0
    value, slope = _largest(sign * values, sign * slopes)
    return sign * value, sign * slope


def _largest(values: Array, slopes: Array) -> tuple[float, Array]:
    """The largest value and its derivatives; inside, that of the parabola through the largest one and its neighbors."""
    at = int(np.argmax(values))
    if 0 < at < len(values) - 1:
        before, here, after = values[at - 1 : at + 2]
        bend, rise = before - 2.0 * here + after, after - before
        if bend < -PARABOLA * max(abs(here), 1e-300):
            of_bend, of_rise = slopes[at - 1] - 2.0 * slopes[at] + slopes[at + 1], slopes[at + 1] - slopes[at - 1]
            share = rise / bend
            slope = slopes[at] - share * of_rise / 4.0 + share**2 * of_bend / 8.0
            return float(here - rise * share / 8.0), slope
    return float(values[at]), slopes[at]


def excesses(conditions: Sequence[Condition], values: Array, slopes: Array) -> tuple[Array, Array]:
    """How far measured values (m,) exceed the conditions, and the derivatives (m, k) of that."""
    signs = np.array([(-1.0 if one.relation == ">=" else 1.0) / one.size for one in conditions])
    found = np.array([one.excess(value) for one, value in zip(conditions, values.tolist(), strict=True)])
    return found, signs[:, None] * slopes


Excess = Callable[[Array], tuple[Array, Array]]  # of unknowns (k,): excesses (m,) and their derivatives (m, k)
