"""Builds the force elements of a mechanism from their records in the file."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import TypeVar, assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.builders.context import BuildContext, ForceElements, attachment
from mbd_sim.files.builders.joints import LARGEST_ELONGATION, build_curve, build_power_law
from mbd_sim.files.schema import forces as schema
from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.elements.parts import GROUND, Attachment
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import ElasticLaw, GreenStrain, Linear, Varying
from mbd_sim.mechanism.values.source import Location

Element = TypeVar("Element")


def build_force_elements(specs: Mapping[str, schema.AnyForceSpec], context: BuildContext) -> ForceElements:
    """The force elements of a file; invalid ones are left out and reported to `context`."""
    built = [element for name, spec in specs.items() if (element := _build(name, spec, context))]

    def of(kind: type[Element]) -> tuple[Element, ...]:
        return tuple(element for element in built if isinstance(element, kind))

    return ForceElements(
        springs=of(Spring),
        dampers=of(Damper),
        applied=of(AppliedForce),
        efforts=of(AppliedEffort),
        potentials=of(AppliedPotential),
        bushings=of(Bushing),
    )


def _build(name: str, spec: schema.AnyForceSpec, context: BuildContext) -> ForceElement | None:
    match spec:
        case schema.SpringSpec():
            ends = _ends(name, spec.between, context)
            return _spring(name, spec, ends, context) if ends else None
        case schema.ElasticBarSpec():
            ends = _ends(name, spec.between, context)
            law = GreenStrain(spec.stiffness, spec.length) if spec.strain == "green" else Linear(spec.stiffness)
            return Spring(name, *ends, law, spec.length, spec.damping) if ends else None
        case schema.DamperSpec():
            ends = _ends(name, spec.between, context)
            return Damper(name, *ends, build_power_law(spec), spec.along == "line") if ends else None
        case schema.PointForceSpec(at=at, vector=vector, axes=axes):
            return _applied(name, ("at", at), vector, axes, context)
        case schema.CoupleSpec(on=on, vector=vector, axes=axes):
            return _applied(name, ("on", on), vector, axes, context)
        case schema.PotentialSpec(energy=energy):
            return AppliedPotential(name, energy)
        case schema.EffortSpec():
            known = context.coordinate(("forces", name, "coordinate"), spec.coordinate)
            return AppliedEffort(name, spec.coordinate, spec.effort) if known else None
        case schema.LineForceSpec():
            ends = _ends(name, spec.between, context)
            curve = build_curve(spec.force, None, -spec.length, LARGEST_ELONGATION * max(1.0, spec.length))
            return Spring(name, *ends, curve, spec.length, 0.0) if ends else None
        case schema.BushingSpec():
            return _bushing(name, spec, context)
        case _:
            assert_never(spec)


def _ends(name: str, between: tuple[str, str], context: BuildContext) -> tuple[Attachment, Attachment] | None:
    ends = context.attachments(("forces", name, "between"), between)
    return (ends[0], ends[1]) if ends else None


def _spring(name: str, spec: schema.SpringSpec, ends: tuple[Attachment, Attachment], context: BuildContext) -> Spring:
    law: ElasticLaw | Varying = Linear(spec.stiffness)
    if spec.force is not None or spec.table is not None:
        law = build_curve(spec.force, spec.table, -spec.length, LARGEST_ELONGATION * max(1.0, spec.length))
    location: Location = ("forces", name)
    if law == Linear(0.0) and not spec.damping:
        remedy = "Add 'stiffness', 'force', 'table' or 'damping'."
        context.report(location, "has neither stiffness nor damping", remedy)
    if spec.mass and GROUND not in (ends[0].part, ends[1].part):
        message = "a spring with mass must have one end on ground"
        remedy = "Remove its mass, and weld a particle of half the mass to the part at each end."
        context.report((*location, "mass"), message, remedy)
    return Spring(name, *ends, law, spec.length, spec.damping, spec.mass)


def _bushing(name: str, spec: schema.BushingSpec, context: BuildContext) -> Bushing | None:
    location: Location = ("forces", name, "between")
    frames = [context.frame((*location, index), reference) for index, reference in enumerate(spec.between)]
    ends = context.on_different_parts(location, frames)
    if not ends or frames[0] is None or frames[1] is None:
        return None
    axes = frames[0][1].rotation, frames[1][1].rotation
    for key, time in (("stiffness_matrix", ""), ("damping_matrix", "*s")):
        for row, column in product(range(6), repeat=2):
            unit = f"N{'' if row < 3 else '*m'}{time}/{'m' if column < 3 else 'rad'}"
            context.has_unit(("forces", name, key, row, column), unit)
    stiffness = _matrix(spec.stiffness_matrix, spec.stiffness, spec.rotational_stiffness)
    damping = _matrix(spec.damping_matrix, spec.damping, spec.rotational_damping)
    return Bushing(name, ends[0], ends[1], *axes, stiffness, damping)


def _matrix(given: object, linear: object, rotational: object) -> Array:
    """A matrix (6, 6) from its rows, or from three numbers, or one, for the displacements and for the rotations."""
    if given is not None:
        return np.array(given, dtype=float)
    return np.diag(
        np.concatenate([np.broadcast_to(np.array(part, dtype=float), (3,)) for part in (linear, rotational)])
    )


def _applied(
    name: str,
    point: tuple[str, str],
    vector: tuple[TimeExpression, TimeExpression, TimeExpression],
    axes: str,
    context: BuildContext,
) -> AppliedForce | None:
    """A force, or a couple where the key of `point` is `on`; `point` is the key and the reference."""
    location: Location = ("forces", name)
    key, reference = point
    at = context.frame((*location, key), reference)
    in_part_axes = axes == "part"  # a keyword, even if a part has this name
    frame = at if in_part_axes else context.frame((*location, "axes"), axes)
    if at is None or frame is None:
        return None
    if at[0] == GROUND:
        context.report((*location, key), "acts on ground, which does not move", "Name a part.")
        return None
    axes_part, pose = frame
    rotation = np.eye(3) if in_part_axes else pose.rotation
    return AppliedForce(name, attachment(at), vector, key == "on", axes_part, rotation)
