"""The expressions in the forces of a mechanism, and the joints on whose motion they depend."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.force_elements import AppliedEffort, AppliedForce, Spring
from mbd_sim.mechanism.laws import Expressed, Varying
from mbd_sim.mechanism.records import Joint, Mechanism
from mbd_sim.mechanism.source import Location


class ForceExpression(NamedTuple):
    """An expression of a force, its location in the file, and the joint or spring of whose elongation it may be."""

    location: Location
    expression: TimeExpression
    stretched: Joint | Spring | None = None


def expressions_of_forces(mechanism: Mechanism) -> Iterator[ForceExpression]:
    """The expressions of the forces of a mechanism."""
    return force_expressions(mechanism.joints.values(), mechanism.springs, mechanism.applied, mechanism.efforts)


def force_expressions(
    joints: Iterable[Joint],
    springs: Iterable[Spring],
    applied: Iterable[AppliedForce],
    efforts: Iterable[AppliedEffort],
) -> Iterator[ForceExpression]:
    """The expressions of springs in joints, springs between points, forces and couples, and efforts."""
    for joint in joints:
        if isinstance(joint.spring, Expressed | Varying):
            yield ForceExpression(("joints", joint.name, "spring", "force"), joint.spring.force, joint)
    for spring in springs:
        if isinstance(spring.law, Expressed | Varying):
            yield ForceExpression(("forces", spring.name, "force"), spring.law.force, spring)
    for element in applied:
        for index, expression in enumerate(element.vector):
            yield ForceExpression(("forces", element.name, "vector", index), expression)
    for effort in efforts:
        yield ForceExpression(("forces", effort.name, "effort"), effort.effort)
