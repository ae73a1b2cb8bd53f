"""Constraints as plain records: they restrict the motion in addition to the joints, on both sides or on one.

A constraint with a contact `law` is one-sided: `bound` says whether the constrained quantity is at least or at most
what the record says, and the gap is the distance to that. Contacts, stops, ropes, plays and clutches are one-sided
too. A gap g(q, t) that cannot become negative has a multiplier λ ≥ 0 with g λ = 0. It may have friction in the
directions across it, and a coefficient of restitution.

Directions (3,) are unit vectors in the frame of the part that carries them; SI units throughout.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, assert_never

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.elements.parts import Attachment
from mbd_sim.mechanism.values.expression import TimeExpression

Bound = Literal["at_least", "at_most"]


@dataclass(frozen=True)
class ContactLaw:
    """What happens at a closed gap: Newton's `restitution` e, and Coulomb friction with μ and μ_s in its plane.

    0 ≤ e ≤ 1, and 0 ≤ `friction` μ ≤ `static_friction` μ_s; without friction both are 0.
    """

    restitution: float = 0.0
    friction: float = 0.0
    static_friction: float = 0.0


@dataclass(frozen=True)
class Play:
    """The play of a coupling: its sum may be between -`half` and `half` about its value, in m or rad."""

    half: float
    restitution: float


def two_sided(constraints: Iterable[Constraint]) -> list[Constraint]:
    """Those that act on both sides, always."""
    return [constraint for constraint in constraints if not is_one_sided(constraint)]


def is_one_sided(constraint: Constraint) -> bool:
    """Whether a constraint acts on one side only."""
    return any(getattr(constraint, key, None) is not None for key in ("law", "play", "capacity"))


@record
class Distance:
    """Two points at the distance `length` in m, a function of time."""

    name: str
    first: Attachment
    second: Attachment
    length: TimeExpression
    kind: str = "distance"
    bound: Bound | None = None
    law: ContactLaw | None = None


@record
class Flat:
    """A point on the planes through `base` with these `normals` (k, 3): one normal makes a plane, two a line."""

    name: str
    point: Attachment
    base: Attachment
    normals: Array
    kind: str
    bound: Bound | None = None
    law: ContactLaw | None = None


@record
class Surface:
    """A point at which all `equations` are 0: expressions of its coordinates x, y, z in m and of the time t in s.

    The coordinates are measured from `base` along the columns of `axes` (3, 3). One equation makes a surface, two make
    a curve.
    """

    name: str
    point: Attachment
    base: Attachment
    axes: Array
    equations: tuple[TimeExpression, ...]
    kind: str
    bound: Bound | None = None
    law: ContactLaw | None = None


@record
class Coupling:
    """The relation Σ factor · coordinate = `value` between joint coordinates by name, or up to a `play`.

    The value is an expression of time, and of coordinates if there is neither a play nor a law. Of two coordinates one
    may be the `follower` of the other; that changes no motion, only how exports write the relation.

    With a contact `law` the sum is at least or at most the value, by `bound`, and friction acts along the rate of
    Σ `slip` factor · coordinate.
    """

    name: str
    factors: Mapping[str, float]
    value: TimeExpression
    kind: str
    play: Play | None = None
    bound: Bound | None = None
    law: ContactLaw | None = None
    slip: Mapping[str, float] = field(default_factory=dict)
    follower: str | None = None


@record
class Rolling:
    """A disc with this `axis`, or a ball if it is None, that rolls without slip on the plane through `plane`.

    With a contact `law` it slips where friction does not suffice, and can lift off.
    """

    name: str
    center: Attachment
    axis: Array | None
    radius: float
    plane: Attachment
    normal: Array
    kind: str = "rolling"
    law: ContactLaw | None = None


@record
class KnifeEdge:
    """A point whose velocity in the plane with this `normal` has the given `direction` (a skate or a wheel edge)."""

    name: str
    point: Attachment
    direction: Array
    plane: Attachment
    normal: Array
    kind: str = "knife_edge"


@record
class Cable:
    """A taut cable that runs straight from point to point; its total `length` in m is a function of time."""

    name: str
    points: tuple[Attachment, ...]
    length: TimeExpression
    kind: str = "cable"
    bound: Bound | None = None
    law: ContactLaw | None = None


@record
class Clutch:
    """A clutch or brake for the relative speed Σ factor · speed of joint coordinates by name.

    A one-way clutch has a `law`, and does not let that speed become negative. A friction clutch transmits up to its
    `capacity`, a force or moment as a function of time, and `static` times as much while it sticks.
    """

    name: str
    factors: Mapping[str, float]
    capacity: TimeExpression | None = None
    static: float = 1.0
    law: ContactLaw | None = None
    kind: str = "clutch"


Constraint = Distance | Flat | Surface | Coupling | Rolling | KnifeEdge | Cable | Clutch


def expressions_of(constraint: Constraint) -> tuple[TimeExpression, ...]:
    """The expressions of time in a constraint."""
    match constraint:
        case Distance(length=length) | Cable(length=length):
            return (length,)
        case Coupling(value=value):
            return (value,)
        case Surface(equations=equations):
            return equations
        case Clutch(capacity=capacity):
            return () if capacity is None else (capacity,)
        case Flat() | Rolling() | KnifeEdge():
            return ()
        case _:
            assert_never(constraint)
