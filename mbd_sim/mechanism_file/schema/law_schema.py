"""Force laws in a mechanism file: against an elongation or a speed, along a length or about an axis."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.laws import ELONGATION, ELONGATION_RATE
from mbd_sim.mechanism_file.expression_field import ExpressionField
from mbd_sim.mechanism_file.quantity import (
    Angle,
    Length,
    LinearDamping,
    PositiveAngularVelocity,
    PositiveLength,
    PositiveVelocity,
    Quantity,
    TorsionDamping,
)
from mbd_sim.mechanism_file.schema.base_schema import Spec

ForceValue = Annotated[float, Quantity("N")]
TorqueValue = Annotated[float, Quantity("N*m")]
FrictionForce = Annotated[float, Quantity("N", at_least=0)]
FrictionTorque = Annotated[float, Quantity("N*m", at_least=0)]
Coefficient = Annotated[float, Quantity("", at_least=0)]


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
