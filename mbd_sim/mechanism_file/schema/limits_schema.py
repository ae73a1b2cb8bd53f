"""The ranges of the coordinates of joints, whose ends can be elastic or rigid stops."""

from __future__ import annotations

from typing import Annotated

from pydantic import model_validator

from mbd_sim.errors import InputError
from mbd_sim.mechanism_file.quantity import Angle, Length, LinearStiffness, Quantity, Restitution, TorsionStiffness
from mbd_sim.mechanism_file.schema.base_schema import Spec


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
    damping: Annotated[float, Quantity("s/rad", at_least=0)] = 0.0


class LengthLimitsSpec(LimitsSpec):
    """The range of a displacement. With `stiffness` and `damping` its ends are elastic stops.

    With a coefficient of `restitution` they are rigid stops.
    """

    lower: Length
    upper: Length
    stiffness: LinearStiffness | None = None
    damping: Annotated[float, Quantity("s/m", at_least=0)] = 0.0
