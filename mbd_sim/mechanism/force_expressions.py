"""The expressions in the forces of a mechanism, and the joints on whose motion they depend."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import assert_never

from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Expressed, Varying
from mbd_sim.mechanism.values.source import Location


@dataclass(frozen=True, slots=True)
class ForceExpression:
    """An expression of a force, its location in the file, and the joint or spring of whose elongation it may be."""

    location: Location
    expression: TimeExpression
    stretched: Joint | Spring | None = None


def expressions_of_forces(mechanism: Mechanism) -> Iterator[ForceExpression]:
    """The expressions of the forces of a mechanism."""
    return force_expressions(mechanism.joints.values(), mechanism.force_elements)


def force_expressions(joints: Iterable[Joint], elements: Iterable[ForceElement]) -> Iterator[ForceExpression]:
    """The expressions of springs in joints, and of force elements."""
    for joint in joints:
        if isinstance(joint.spring, Expressed | Varying):
            yield ForceExpression(("joints", joint.name, "spring", "force"), joint.spring.force, joint)
    for element in elements:
        match element:
            case Spring(name=name, law=Expressed(force=force) | Varying(force=force)):
                yield ForceExpression(("forces", name, "force"), force, element)
            case AppliedForce(name=name, vector=vector):
                for index, expression in enumerate(vector):
                    yield ForceExpression(("forces", name, "vector", index), expression)
            case AppliedEffort(name=name, effort=effort):
                yield ForceExpression(("forces", name, "effort"), effort)
            case AppliedPotential(name=name, energy=energy):
                yield ForceExpression(("forces", name, "energy"), energy)
            case Spring() | Damper() | Bushing():
                pass
            case _:
                assert_never(element)
