"""One-sided elements as plain records: contacts, stops, ropes, plays and clutches, and which elements have them.

A gap g(q, t) that cannot become negative has a multiplier λ ≥ 0 with g λ = 0. It may have friction in the directions
across it, and a coefficient of restitution.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from mbd_sim.errors import MechanismError, Problem, listed

if TYPE_CHECKING:
    from mbd_sim.mechanism.constraints import Constraint
    from mbd_sim.mechanism.records import Mechanism

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


def require_two_sided(mechanism: Mechanism, what: str, remedy: str = "") -> None:
    """Refuse what is possible only without one-sided elements.

    :param what: that it is not possible, such as "cannot be linearized".
    :raises MechanismError: the elements are named.
    """
    if names := one_sided_names(mechanism):
        message = f"{mechanism.name} {what}, because it has one-sided elements: {listed(names)}"
        raise MechanismError([Problem(message, remedy or "Remove them, or make them two-sided.")])


def has_one_sided(mechanism: Mechanism) -> bool:
    """Whether a mechanism has gaps, sticking friction or clutches: then its motion has events."""
    return bool(one_sided_names(mechanism))


def one_sided_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The one-sided elements as keys of the file, such as `joints.elbow.limits`: joints, constraints, contacts."""
    found = []
    for name, joint in mechanism.all_joints.items():
        if any(limits is not None and limits.restitution is not None for limits in joint.limits):
            found.append(f"joints.{name}.limits")
        if joint.friction is not None and joint.friction.sticks:
            found.append(f"joints.{name}.friction")
    found += [f"constraints.{constraint.name}" for constraint in mechanism.constraints if is_one_sided(constraint)]
    found += dict.fromkeys(f"contacts.{contact.name}" for contact in mechanism.contacts if contact.rigid)
    return tuple(found)


def two_sided(constraints: Iterable[Constraint]) -> list[Constraint]:
    """Those that act on both sides, always."""
    return [constraint for constraint in constraints if not is_one_sided(constraint)]


def is_one_sided(constraint: Constraint) -> bool:
    """Whether a constraint acts on one side only."""
    return any(getattr(constraint, key, None) is not None for key in ("law", "play", "capacity"))
