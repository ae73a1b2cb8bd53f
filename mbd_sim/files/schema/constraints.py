"""The constraints of a mechanism file, in addition to the joints, and the contacts between shapes of its parts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from mbd_sim.base.errors import InputError
from mbd_sim.files.schema.fields import (
    AnyNumber,
    Direction,
    ExpressionField,
    LengthOfTime,
    PositiveLength,
    PositiveVelocity,
    QuantityField,
    Restitution,
    Spec,
    list_or_word,
)
from mbd_sim.mechanism.elements.contacts import CAM_ANGLE
from mbd_sim.mechanism.values.expression import TimeExpression

Coordinate = Annotated[str, StringConstraints(min_length=1)]
SurfaceExpression = Annotated[TimeExpression, ExpressionField("", ("x", "y", "z", "t"))]
FrictionCoefficient = Annotated[float, QuantityField("", at_least=0)]
Z: tuple[float, float, float] = (0.0, 0.0, 1.0)


class BoundedSpec(Spec):
    """A constraint that may be one-sided: with a `bound`, a quantity is at least or at most what the constraint says.

    Where it reaches that, its parts rebound with the coefficient of `restitution`.
    """

    bound: Literal["at_least", "at_most"] | None = None
    restitution: Restitution | None = None

    @model_validator(mode="after")
    def _one_sided(self) -> BoundedSpec:
        given = [key for key in ("restitution", "friction", "static_friction") if getattr(self, key, None) is not None]
        if given and self.bound is None:
            raise InputError(f"{given[0]} has no effect without a bound", "Add 'bound: at_least' or 'bound: at_most'.")
        return self


class FrictionalSpec(BoundedSpec):
    """A contact that may have Coulomb friction: `friction` μ in motion and `static_friction` μ_s ≥ μ at rest."""

    friction: FrictionCoefficient | None = None
    static_friction: FrictionCoefficient | None = None

    @model_validator(mode="after")
    def _ordered(self) -> FrictionalSpec:
        require_ordered_friction(self.friction, self.static_friction)
        return self


def require_ordered_friction(friction: float | None, static: float | None) -> None:
    """Refuse static friction without or below sliding friction."""
    if static is not None and friction is None:
        raise InputError("static_friction needs friction", "Add 'friction', the coefficient in motion.")
    if static is not None and friction is not None and static < friction:
        raise InputError(
            f"static_friction {static:g} is less than friction {friction:g}",
            "Static friction is at least as large as sliding friction.",
        )


class DistanceSpec(BoundedSpec):
    """A massless rod: two points keep the distance `length`, which may be an expression of time.

    With `bound: at_most` it is a rope, with `bound: at_least` a strut.
    """

    type: Literal["distance"]
    between: tuple[str, str]
    length: LengthOfTime


class OnPlaneSpec(FrictionalSpec):
    """A point stays on the plane through `plane`, whose part carries the `normal`.

    With `bound: at_least` it stays on the side of the normal, with `bound: at_most` on the other.
    """

    type: Literal["on_plane"]
    point: str
    plane: str = "ground"
    normal: Direction = Z


class OnLineSpec(Spec):
    """A point stays on the line through `line`, whose part carries the `direction`."""

    type: Literal["on_line"]
    point: str
    line: str = "ground"
    direction: Direction


class OnSurfaceSpec(FrictionalSpec):
    """A point stays where an expression of its x, y and z (and t) in the frame of `frame` is 0; two make a curve.

    With `bound: at_least` it stays where the expression of a surface is not negative, with `bound: at_most` where it
    is not positive.
    """

    type: Literal["on_surface", "on_curve"]
    point: str
    frame: str = "ground"
    equation: SurfaceExpression | None = None
    equations: tuple[SurfaceExpression, SurfaceExpression] | None = None

    @model_validator(mode="after")
    def _count(self) -> OnSurfaceSpec:
        key, other = ("equation", "equations") if self.type == "on_surface" else ("equations", "equation")
        if getattr(self, key) is None or getattr(self, other) is not None:
            count = "one: equation" if key == "equation" else "two: equations"
            raise InputError(f"needs '{key}'", f"A {self.type.removeprefix('on_')} has {count}.")
        if self.bound is not None and self.type == "on_curve":
            raise InputError("a curve has no sides", "Remove 'bound', or use on_surface.")
        return self


class PlaySpec(Spec):
    """A coupling that may have play: its sum moves freely in a range of the size `backlash`.

    At both ends of the range it rebounds with the coefficient of `restitution`.
    """

    backlash: Annotated[float, QuantityField(None, above=0)] | None = None
    restitution: Restitution | None = None

    @model_validator(mode="after")
    def _play(self) -> PlaySpec:
        if self.restitution is not None and self.backlash is None:
            raise InputError("restitution has no effect without backlash", "Add 'backlash'.")
        return self


class GearSpec(PlaySpec):
    """Two gear wheels in mesh: the second rotates by -r₁/r₂ times the first, or by r₁/r₂ if one has internal teeth.

    `backlash` is the play along the pitch circles.
    """

    type: Literal["gear"]
    joints: tuple[Coordinate, Coordinate]
    radii: tuple[PositiveLength, PositiveLength]
    internal: bool = False


class RackSpec(PlaySpec):
    """A rack on a pinion, or a cable on a drum: a displacement is `radius` times the angle of another joint."""

    type: Literal["rack"]
    pinion: Coordinate
    rack: Coordinate
    radius: PositiveLength
    reverse: bool = Field(False, description="the rack moves backward when the pinion rotates forward")


class CouplingSpec(Spec):
    """A relation between joint coordinates: the sum of `terms` (factors by coordinate) equals `value`.

    The value may be an expression of coordinates, for cams and curves. With a `bound` the sum is at least or at most
    the value. Friction then acts along the rate of the sum of `slip`.
    """

    type: Literal["coupling"]
    terms: dict[Coordinate, AnyNumber] = Field(min_length=1)
    value: Annotated[TimeExpression, ExpressionField(None, state=True, speeds=False)] = TimeExpression("0", {})
    backlash: Annotated[float, QuantityField(None, above=0)] | None = None
    bound: Literal["at_least", "at_most"] | None = None
    restitution: Restitution | None = None
    friction: FrictionCoefficient | None = None
    static_friction: FrictionCoefficient | None = None
    slip: dict[Coordinate, AnyNumber] | None = None
    follower: Coordinate | None = Field(
        None, description="which of two coordinates mimics the other one in URDF and SDF; the motion is the same"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> CouplingSpec:
        if self.bound is not None and self.backlash is not None:
            raise InputError("has both bound and backlash", "Give one of them.")
        if self.restitution is not None and self.bound is None and self.backlash is None:
            raise InputError("restitution has no effect without backlash", "Add 'backlash' or 'bound'.")
        if self.value.state and (self.bound is not None or self.backlash is not None):
            what = "a bound" if self.bound is not None else "backlash"
            raise InputError(f"has {what} and a value that depends on coordinates", "Give one of them.")
        if (self.friction is None) != (self.slip is None):
            missing = "friction" if self.friction is None else "slip"
            raise InputError("friction and slip belong together", f"Add '{missing}'.")
        if self.friction is not None and self.bound is None:
            raise InputError("friction has no effect without a bound", "Add 'bound'.")
        if self.follower is not None and (len(self.terms) != 2 or self.follower not in self.terms):
            raise InputError("follower must be one of two coordinates of 'terms'", "Name one of the two, or remove it.")
        require_ordered_friction(self.friction, self.static_friction)
        return self


class RollingSpec(Spec):
    """A wheel with an `axis`, or a ball without one, rolls on a plane without slipping; `wheel` is its center.

    With `friction` or `restitution` it is a contact: it slips where friction does not suffice, and may lift off.
    """

    type: Literal["rolling"]
    wheel: str
    axis: Direction | None = None
    radius: PositiveLength
    plane: str = "ground"
    normal: Direction = Z
    restitution: Restitution | None = None
    friction: FrictionCoefficient | None = None
    static_friction: FrictionCoefficient | None = None

    @model_validator(mode="after")
    def _ordered(self) -> RollingSpec:
        require_ordered_friction(self.friction, self.static_friction)
        return self


class KnifeEdgeSpec(Spec):
    """A blade at a point does not move sideways to its `direction` (in its part), in a plane with this `normal`."""

    type: Literal["knife_edge"]
    at: str
    direction: Direction
    plane: str = "ground"
    normal: Direction = Z


class CableSpec(BoundedSpec):
    """A taut massless cable from point to point over small frictionless pulleys; its total length is prescribed.

    With `bound: at_most` it can become slack.
    """

    type: Literal["cable"]
    through: list[str] = Field(min_length=2)
    length: LengthOfTime


class ClutchSpec(Spec):
    """A clutch between two joint coordinates, or a brake on one, for the sum of `terms` (factors by coordinate).

    A `one_way` clutch keeps the rate of the sum from becoming negative. A friction clutch transmits up to its
    `capacity`, an expression of time in N or N*m, and `static` times as much while it does not slip.
    """

    type: Literal["clutch"]
    terms: dict[Coordinate, AnyNumber] = Field(min_length=1)
    one_way: bool = False
    capacity: Annotated[TimeExpression, ExpressionField(None)] | None = None
    static: Annotated[float, QuantityField("", at_least=1)] = 1.0

    @model_validator(mode="after")
    def _one_kind(self) -> ClutchSpec:
        if self.one_way == (self.capacity is not None):
            given = "both one_way and a capacity" if self.one_way else "neither one_way nor a capacity"
            raise InputError(f"has {given}", "Write 'one_way: true', or the 'capacity' of a friction clutch.")
        if self.one_way and "static" in self.model_fields_set:
            raise InputError("a one-way clutch has no static friction", "Remove 'static'.")
        return self


AnyConstraintSpec = Annotated[
    DistanceSpec
    | OnPlaneSpec
    | OnLineSpec
    | OnSurfaceSpec
    | GearSpec
    | RackSpec
    | CouplingSpec
    | RollingSpec
    | KnifeEdgeSpec
    | CableSpec
    | ClutchSpec,
    Field(discriminator="type"),
]


CamProfile = Annotated[TimeExpression, ExpressionField("m", (CAM_ANGLE,))]
ContactStiffness = Annotated[float, QuantityField(None, above=0)]
ContactExponent = Annotated[float, QuantityField("", at_least=1)]
ContactDamping = Annotated[float, QuantityField("s/m", at_least=0)]
_PARTNERS = "'between' two parts, 'among' several, 'parts' on a 'plane' or on a 'cam', or a 'plane' on a 'cam'"
ALL = "all"
PartsOrAll = Annotated[
    Annotated[list[str], Field(min_length=1), Tag("list")] | Annotated[Literal["all"], Tag("word")],
    Discriminator(list_or_word),
]


class ContactSpec(Spec):
    """Shapes that cannot penetrate each other: `between` two parts, `among` several, or of `parts` on a plane or cam.

    A part stands for its shapes; `among: all` are the pairs of all parts that are not neighbors, welded together or
    connected by a joint. `part.name` is one of them by its name, or a point. `parts: all` are all parts with
    shapes but those `without`, and those that are welded to ground or to the plane. The plane through `plane` has the
    `normal` of that point's part, away from the material; the second of two parts encloses the first if it is `inside`.
    A cam turns with the part of `cam`; its `profile` is the radius in the x-y plane of this point, an expression of
    `angle`. A contact is rigid, with Newton's `restitution`, or with a `stiffness` k compliant: k δⁿ (1 + c δ').
    """

    between: tuple[str, str] | None = None
    among: PartsOrAll | None = Field(None, description="parts, each with every other; or all, but for neighbors")
    parts: PartsOrAll | None = Field(None, description="parts, shapes and points, or all")
    without: list[str] | None = Field(None, description="parts that 'all' leaves out")
    active: bool = Field(True, description="false: it is only listed, until --floor or an overlay sets it to true")
    plane: str | None = None
    normal: Direction = (0.0, 0.0, 1.0)
    cam: str | None = None
    profile: CamProfile | None = None
    inside: bool = Field(False, description="the first of two parts is inside the second, in its holes if it has any")
    restitution: Restitution | None = None
    friction: FrictionCoefficient | None = None
    static_friction: FrictionCoefficient | None = None
    stiffness: ContactStiffness | None = Field(None, description="k of a compliant contact in N/m^exponent")
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
        if isinstance(self.among, list) and len(self.among) < 2:
            raise InputError("among needs several parts", "Name two of them, or more.")
        if self.without is not None and ALL not in (self.parts, self.among):
            raise InputError(
                "without has no effect on a list", "Write 'parts: all' or 'among: all', or shorten the list."
            )
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
