"""Contacts between shapes of parts in a mechanism file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.base import Direction, Spec
from mbd_sim.files.schema.constraints import FrictionCoefficient, require_ordered_friction
from mbd_sim.files.schema.fields import ExpressionField, PositiveVelocity, Quantity, Restitution
from mbd_sim.mechanism.elements.contacts import CAM_ANGLE
from mbd_sim.mechanism.values.expression import TimeExpression

CamProfile = Annotated[TimeExpression, ExpressionField("m", (CAM_ANGLE,))]
PositiveStiffness = Annotated[float, Quantity(None, above=0)]
ContactExponent = Annotated[float, Quantity("", at_least=1)]
ContactDamping = Annotated[float, Quantity("s/m", at_least=0)]
_PARTNERS = "'between' two parts, 'among' several, 'parts' on a 'plane' or on a 'cam', or a 'plane' on a 'cam'"


class ContactSpec(Spec):
    """Shapes that cannot penetrate each other: `between` two parts, `among` several, or of `parts` on a plane or cam.

    A part stands for its shapes; `part.name` is one of them by its name, or a point. The plane through `plane` has the
    `normal` of that point's part, away from the material; the second of two parts encloses the first if it is `inside`.
    A cam turns with the part of `cam`; its `profile` is the radius in the x-y plane of this point, an expression of
    `angle`. A contact is rigid, with Newton's `restitution`, or with a `stiffness` k compliant: k δⁿ (1 + c δ').
    """

    between: tuple[str, str] | None = None
    among: list[str] | None = Field(None, min_length=2)
    parts: list[str] | None = Field(None, min_length=1)
    plane: str | None = None
    normal: Direction = (0.0, 0.0, 1.0)
    cam: str | None = None
    profile: CamProfile | None = None
    inside: bool = Field(False, description="the first of two parts is inside the second, in its holes if it has any")
    restitution: Restitution | None = None
    friction: FrictionCoefficient | None = None
    static_friction: FrictionCoefficient | None = None
    stiffness: PositiveStiffness | None = Field(None, description="k of a compliant contact in N/m^exponent")
    exponent: ContactExponent = Field(1.5, description="n: 1.5 for spheres (Hertz), 1 for a linear spring")
    damping: ContactDamping = Field(0.0, description="c of a compliant contact in s/m")
    regularization: PositiveVelocity = Field(1e-2, description="slip below which compliant friction falls to zero")

    @model_validator(mode="after")
    def _partners(self) -> ContactSpec:
        names = [key for key in ("between", "among", "parts", "plane", "cam") if getattr(self, key) is not None]
        if names not in (["between"], ["among"], ["parts", "plane"], ["parts", "cam"], ["plane", "cam"]):
            raise InputError(f"has {' and '.join(names) or 'nothing to be in contact'}", f"Give {_PARTNERS}.")
        if (self.cam is None) != (self.profile is None):
            raise InputError("cam and profile belong together", "Give both or neither.")
        if "normal" in self.model_fields_set and self.plane is None:
            raise InputError("normal has no effect without a plane", "Add 'plane', or remove 'normal'.")
        if self.inside and self.between is None:
            raise InputError("inside needs two parts", "Give 'between', with the enclosing part last.")
        return self

    @model_validator(mode="after")
    def _law(self) -> ContactSpec:
        require_ordered_friction(self.friction, self.static_friction)
        given = self.model_fields_set
        compliant = self.stiffness is not None
        wrong = ("restitution", "static_friction") if compliant else ("exponent", "damping", "regularization")
        if found := [key for key in wrong if key in given and getattr(self, key) is not None]:
            if compliant:
                remedy = f"Restitution follows from 'damping', and sticking needs a rigid contact: remove '{found[0]}'."
                raise InputError(f"has stiffness and {found[0]}", remedy)
            raise InputError(
                f"{found[0]} has no effect in a rigid contact", f"Add 'stiffness', or remove '{found[0]}'."
            )
        return self
