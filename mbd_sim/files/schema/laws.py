"""The laws of a mechanism file: force laws, the ranges of coordinates, and tables.

A force depends on an elongation or a speed, along a length or about an axis. The ends of the range of a joint's
coordinate can be elastic or rigid stops. Expressions read tables by name.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from mbd_sim.base.errors import InputError, counted
from mbd_sim.files.schema.fields import (
    Angle,
    AnyNumber,
    ExpressionField,
    Length,
    LinearDamping,
    LinearStiffness,
    PositiveAngularVelocity,
    PositiveLength,
    PositiveVelocity,
    QuantityField,
    Restitution,
    Spec,
    TorsionDamping,
    TorsionStiffness,
)
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import ELONGATION, ELONGATION_RATE
from mbd_sim.mechanism.values.tables import BicubicSurface, Curve, Table

ForceValue = Annotated[float, QuantityField("N")]
TorqueValue = Annotated[float, QuantityField("N*m")]
FrictionForce = Annotated[float, QuantityField("N", at_least=0)]
FrictionTorque = Annotated[float, QuantityField("N*m", at_least=0)]
Coefficient = Annotated[float, QuantityField("", at_least=0)]


def _finite_at_rest(expression: TimeExpression) -> TimeExpression:
    if expression.variables - {ELONGATION}:
        return expression  # without a potential; it is evaluated at the start of the motion
    try:
        expression.value({ELONGATION: 0.0})
    except InputError as error:
        message = f"has no finite value at {ELONGATION} = 0, where its potential is zero"
        raise InputError(message, "Write a force that is finite there.") from error
    return expression


def _growing(rows: list[tuple[float, float]]) -> list[tuple[float, float]]:
    if len(rows) < 2:
        raise InputError("needs at least two rows", "Add one, as [elongation, force].")
    for (before, _), (after, _) in pairwise(rows):
        if after <= before:
            raise InputError(f"{after:g} comes after {before:g}", "Sort the rows by increasing elongation.")
    return rows


_Checks = AfterValidator(_finite_at_rest)
_ELONGATION = (ELONGATION, ELONGATION_RATE)
ForceOfElongation = Annotated[TimeExpression, ExpressionField("N", _ELONGATION, state=True), _Checks]
TorqueOfAngle = Annotated[TimeExpression, ExpressionField("N*m", _ELONGATION, state=True), _Checks]
ForceTable = Annotated[list[tuple[Length, ForceValue]], AfterValidator(_growing)]
TorqueTable = Annotated[list[tuple[Angle, TorqueValue]], AfterValidator(_growing)]


def require_one(record: Spec, *keys: str) -> None:
    """Refuse a record unless it gives exactly one of these keys."""
    given = [key for key in keys if key in record.model_fields_set]
    if len(given) != 1:
        message = f"gives {' and '.join(given)}" if given else f"gives none of {', '.join(keys)}"
        raise InputError(message, f"Give {'only ' if given else ''}one of {', '.join(keys)}.")


class ForceCurveSpec(Spec):
    """A nonlinear spring: its `force` as an expression of the elongation x in m, or a `table` of force against x."""

    force: ForceOfElongation | None = None
    table: ForceTable | None = None

    @model_validator(mode="after")
    def _one(self) -> ForceCurveSpec:
        require_one(self, "force", "table")
        return self


class TorqueCurveSpec(Spec):
    """A nonlinear torsion spring: the torque as an expression of the angle x in rad, or a `table` of both."""

    force: TorqueOfAngle | None = None
    table: TorqueTable | None = None

    @model_validator(mode="after")
    def _one(self) -> TorqueCurveSpec:
        require_one(self, "force", "table")
        return self


class LinearPowerSpec(Spec):
    """A damper with the force C |v|ᵖ against the speed v."""

    coefficient: Coefficient = Field(description="C in N/(m/s)^p, a plain number")
    exponent: Coefficient = 1.0
    regularization: PositiveVelocity | None = None


class TorsionPowerSpec(Spec):
    """A damper with the torque C |ω|ᵖ against the angular speed ω."""

    coefficient: Coefficient = Field(description="C in N*m/(rad/s)^p, a plain number")
    exponent: Coefficient = 1.0
    regularization: PositiveAngularVelocity | None = None


class FrictionSpec(Spec):
    """What friction along lengths and about axes has in common."""

    sticking: bool = Field(False, description="friction that sticks up to its static limit without creeping")

    @model_validator(mode="after")
    def _consistent(self) -> FrictionSpec:
        require_one(self, "coulomb", "coefficient")
        if getattr(self, "coefficient") is not None:  # noqa: B009
            self._require_loaded()
            return self
        if getattr(self, "static_coefficient") is not None:  # noqa: B009
            raise InputError("static_coefficient needs coefficient", "Give 'static' with 'coulomb'.")
        coulomb, static, speed = (getattr(self, key) for key in ("coulomb", "static", "stribeck_velocity"))
        if self.sticking and "regularization" in self.model_fields_set:
            raise InputError("has sticking and regularization", "Friction that sticks is not smooth: remove one.")
        if static is not None and static < coulomb:
            raise InputError(
                f"static {static:g} is less than coulomb {coulomb:g}",
                "Static friction is at least as large as sliding friction.",
            )
        if (static is None) != (speed is None) and not (self.sticking and speed is None):
            missing = "static" if static is None else "stribeck_velocity"
            raise InputError("static and stribeck_velocity belong together", f"Add '{missing}'.")
        return self

    def _require_loaded(self) -> None:
        """The checks of friction that depends on the load."""
        given = [key for key in ("static", "stribeck_velocity", "regularization") if key in self.model_fields_set]
        if given:
            message = f"has coefficient and {given[0]}"
            raise InputError(message, "Friction with a coefficient sticks: give 'static_coefficient' if you need it.")
        sliding, static = (getattr(self, key) for key in ("coefficient", "static_coefficient"))
        if static is not None and static < sliding:
            raise InputError(
                f"static_coefficient {static:g} is less than coefficient {sliding:g}",
                "Static friction is at least as large as sliding friction.",
            )


class LinearFrictionSpec(FrictionSpec):
    """Dry friction in a slider: smooth at rest, or `sticking`.

    `coulomb` is its size whatever the load; with a `coefficient` it is that times the force across the guide.
    """

    coulomb: FrictionForce | None = None
    static: FrictionForce | None = None
    coefficient: Coefficient | None = Field(
        None, description="friction per force across the guide; it sticks without creeping"
    )
    static_coefficient: Coefficient | None = None
    stribeck_velocity: PositiveVelocity | None = None
    viscous: LinearDamping = 0.0
    regularization: PositiveVelocity = Field(1e-2, description="speed below which friction falls to zero")


class TorsionFrictionSpec(FrictionSpec):
    """Dry friction in a hinge: smooth at rest, or `sticking`.

    `coulomb` is its size whatever the load; with a `coefficient` it is that times the force in the bearing, times the
    bearing's `radius`.
    """

    coulomb: FrictionTorque | None = None
    static: FrictionTorque | None = None
    coefficient: Coefficient | None = Field(
        None, description="friction per force in the bearing; it sticks without creeping"
    )
    static_coefficient: Coefficient | None = None
    radius: PositiveLength | None = Field(None, description="radius of the bearing, for friction with a coefficient")
    stribeck_velocity: PositiveAngularVelocity | None = None
    viscous: TorsionDamping = 0.0
    regularization: PositiveAngularVelocity = Field(1e-2, description="speed below which friction falls to zero")

    @model_validator(mode="after")
    def _bearing(self) -> TorsionFrictionSpec:
        if (self.coefficient is None) != (self.radius is None):
            missing = "coefficient" if self.coefficient is None else "radius"
            raise InputError("coefficient and radius belong together", f"Add '{missing}'.")
        return self


class LimitsSpec(Spec):
    """What both kinds of limits have in common: all but the units of their numbers."""

    lower: float
    upper: float
    stiffness: float | None = None
    damping: float = 0.0
    restitution: Restitution | None = None

    @model_validator(mode="after")
    def _ordered(self) -> LimitsSpec:
        if self.lower >= self.upper:
            remedy = "Swap them." if self.lower > self.upper else "Give a larger upper limit, or a 'fixed' joint."
            raise InputError(f"lower {self.lower:g} is not below upper {self.upper:g}", remedy)
        if self.damping and not self.stiffness:
            raise InputError("damping of stops has no effect without stiffness", "Add 'stiffness'.")
        if self.restitution is not None and self.stiffness is not None:
            raise InputError(
                "has stiffness and restitution", "Elastic stops have 'stiffness', rigid ones 'restitution': remove one."
            )
        return self


class AngleLimitsSpec(LimitsSpec):
    """The range of an angle. With `stiffness` and `damping` its ends are elastic stops.

    With a coefficient of `restitution` they are rigid stops.
    """

    lower: Angle
    upper: Angle
    stiffness: TorsionStiffness | None = None
    damping: Annotated[float, QuantityField("s/rad", at_least=0)] = 0.0


class LengthLimitsSpec(LimitsSpec):
    """The range of a displacement. With `stiffness` and `damping` its ends are elastic stops.

    With a coefficient of `restitution` they are rigid stops.
    """

    lower: Length
    upper: Length
    stiffness: LinearStiffness | None = None
    damping: Annotated[float, QuantityField("s/m", at_least=0)] = 0.0


MAX_POINTS, MAX_NODES = 1000, 2500  # of one and of two variables: the kernel compares with each of them
CLOSED = 1e-9  # relative difference of lengths and values that count as equal


class TableSpec(Spec):
    """A function through given points: `points` of one variable x, or `values` at the grid points of `x` and `y`.

    With a `period` it repeats itself. Values may have units; they are in SI units then.
    """

    points: list[tuple[AnyNumber, AnyNumber]] | None = Field(None, description="[x, value] in order of increasing x")
    period: Annotated[float, QuantityField(None, above=0)] | None = Field(
        None, description="of a table of one variable"
    )
    x: list[AnyNumber] | None = None
    y: list[AnyNumber] | None = None
    values: list[list[AnyNumber]] | None = Field(None, description="a row for each x, with a value for each y")

    @model_validator(mode="after")
    def _one_form(self) -> TableSpec:
        grid = [key for key in ("x", "y", "values") if getattr(self, key) is not None]
        if (self.points is not None) == bool(grid) or (grid and len(grid) < 3):
            raise InputError("gives neither a curve nor a surface", "Give points, or x, y and values.")
        if self.points is not None:
            _require_increasing("points", [x for x, _ in self.points], MAX_POINTS)
            if self.period is not None:
                self._require_one_period([x for x, _ in self.points], self.period)
            return self
        if self.period is not None:
            raise InputError("a table of two variables has no period", "Remove it, and use mod(x, period).")
        assert self.x is not None and self.y is not None and self.values is not None
        _require_increasing("x", self.x, MAX_NODES)
        _require_increasing("y", self.y, MAX_NODES)
        if len(self.x) * len(self.y) > MAX_NODES:
            raise InputError(f"has {len(self.x) * len(self.y)} values", f"Give at most {MAX_NODES}.")
        if len(self.values) != len(self.x) or any(len(row) != len(self.y) for row in self.values):
            message = f"values is not {counted(len(self.x), 'row')} of {counted(len(self.y), 'number')}"
            raise InputError(message, "Give a row for each x, with a value for each y.")
        return self

    def _require_one_period(self, x: list[float], period: float) -> None:
        assert self.points is not None
        extent, (first, last) = x[-1] - x[0], (self.points[0][1], self.points[-1][1])
        if extent > period * (1.0 + CLOSED):
            raise InputError(f"the points extend over {extent:g}, more than the period {period:g}", "Remove some.")
        size = max(abs(value) for _, value in self.points)
        if extent >= period * (1.0 - CLOSED) and abs(last - first) > CLOSED * size:
            message = f"begins with {first:g} and ends with {last:g}, a period later"
            raise InputError(message, "Give the same value at both ends, or remove the last point.")

    @property
    def table(self) -> Table:
        """The function."""
        if self.points is None:
            assert self.x is not None and self.y is not None and self.values is not None
            return BicubicSurface(tuple(self.x), tuple(self.y), tuple(map(tuple, self.values)))
        points = list(self.points)
        if self.period is not None:  # the end of the period is exact, and has the value of its beginning
            if points[-1][0] - points[0][0] >= self.period * (1.0 - CLOSED):
                points.pop()
            points.append((points[0][0] + self.period, points[0][1]))
        x, values = zip(*points, strict=True)
        return Curve(x, values, self.period)


def _require_increasing(key: str, x: list[float], most: int) -> None:
    if not 2 <= len(x) <= most:
        raise InputError(f"{key} has {len(x)} entries", f"Give between 2 and {most}.")
    for before, after in pairwise(x):
        if after <= before:
            raise InputError(f"in {key}, {after:g} comes after {before:g}", "Sort them by increasing x.")
