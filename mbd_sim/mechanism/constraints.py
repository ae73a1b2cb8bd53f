"""Constraints as plain records: what restricts a mechanism besides the joints of its tree.

Directions (3,) are unit vectors in the frame of the part that carries them; SI units throughout.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.records import Attachment


@dataclass(frozen=True, eq=False)
class Distance:
    """Two points a `length` apart, in m, a function of time."""

    name: str
    first: Attachment
    second: Attachment
    length: TimeExpression
    kind: str = "distance"


@dataclass(frozen=True, eq=False)
class Flat:
    """A point that has no displacement from `base` along `normals` (k, 3): one for a plane, two for a line."""

    name: str
    point: Attachment
    base: Attachment
    normals: Array
    kind: str


@dataclass(frozen=True, eq=False)
class Surface:
    """A point where `equations` of its x, y and z in m along `axes` (3, 3) from `base`, and of t in s, are 0."""

    name: str
    point: Attachment
    base: Attachment
    axes: Array
    equations: tuple[TimeExpression, ...]
    kind: str


@dataclass(frozen=True, eq=False)
class Coupling:
    """Σ factor · coordinate = `value`, over coordinates of joints by name."""

    name: str
    factors: Mapping[str, float]
    value: TimeExpression
    kind: str


@dataclass(frozen=True, eq=False)
class Rolling:
    """A disc about `axis`, or a ball where there is none, that rolls on the plane through `plane`."""

    name: str
    center: Attachment
    axis: Array | None
    radius: float
    plane: Attachment
    normal: Array
    kind: str = "rolling"


@dataclass(frozen=True, eq=False)
class KnifeEdge:
    """A point that moves along `direction` only, as seen in the plane with this `normal`."""

    name: str
    point: Attachment
    direction: Array
    plane: Attachment
    normal: Array
    kind: str = "knife_edge"


@dataclass(frozen=True, eq=False)
class Cable:
    """Points between which a cable of constant or prescribed `length` in m runs straight."""

    name: str
    points: tuple[Attachment, ...]
    length: TimeExpression
    kind: str = "cable"


Constraint = Distance | Flat | Surface | Coupling | Rolling | KnifeEdge | Cable


def expressions_of(constraint: Constraint) -> tuple[TimeExpression, ...]:
    """The expressions of time in a constraint."""
    match constraint:
        case Distance(length=length) | Cable(length=length):
            return (length,)
        case Coupling(value=value):
            return (value,)
        case Surface(equations=equations):
            return equations
        case Flat() | Rolling() | KnifeEdge():
            return ()
        case _:
            assert_never(constraint)
