"""Refuses contacts of cylinders whose gap cannot be computed: those that tilt against each other, or slide past an end.

The distance of cylinders is known as long as their axes are parallel, and beside each other. The motion of joints
without regard to loops decides whether they stay so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mbd_sim.base.errors import MechanismError, Problem
from mbd_sim.base.linear_algebra import norm, product
from mbd_sim.dynamics.layouts.vectors import trial_states
from mbd_sim.mechanism.elements.contacts import Ball, Barrel, Cam, Contact, PlanarBody, Solid
from mbd_sim.mechanism.parallel_axes import (
    PARALLEL,
    Poses,
    are_thin_barrels,
    axes_and_offset,
    with_ground,
)
from mbd_sim.simulation.model.model import Model


def require_computable_pairs(model: Model) -> None:
    """Refuse contacts of cylinders that cannot be computed.

    :raises MechanismError: the contacts are named, with what to do.
    """
    pairs = [contact for contact in model.mechanism.contacts if _is_limited(contact)]
    if not pairs:
        return
    trials = _trial_poses(model)
    if problems := [problem for contact in pairs for problem in _problems(model, contact, trials)]:
        raise MechanismError(problems)


def endless_remarks(model: Model) -> Iterator[str]:
    """A sentence on each contact with a cam along whose axis the other body moves: the cam has no ends there."""
    cams = [contact for contact in model.mechanism.contacts if isinstance(contact.second, Cam)]
    trials = _trial_poses(model) if cams else []
    for contact in cams:
        along = [axes_and_offset(contact, poses)[2] for poses in trials]
        if np.ptp(along) > PARALLEL * max(map(abs, along)):
            yield (
                f"the cam of {contact.name!r} is endless along its axis, along which {contact.names[0]!r} moves: they "
                "touch beside the cam as well. Hold them beside each other by joints."
            )


def _is_limited(contact: Contact) -> bool:
    first, second = contact.first, contact.second
    if isinstance(first, PlanarBody) or isinstance(second, PlanarBody):
        return True
    if isinstance(first, Barrel):
        return isinstance(second, Barrel | Cam)
    return isinstance(first, Ball) and first.radius == 0.0 and isinstance(second, Barrel)


def _trial_poses(model: Model) -> list[Poses]:
    states = trial_states(model.mechanism, model.layout, model.start)
    return [with_ground(dict(model.poses(time, y, model.inputs))) for time, y in states]


def _planar_problems(model: Model, contact: Contact, trials: Sequence[Poses]) -> Iterator[Problem]:
    """Those of outlines: the plane must not tilt in the frame of the other body, and outlines face the same side."""
    bodies = contact.first, contact.second
    frames = [[poses[body.at.part].rotation for body in bodies] for poses in trials]
    outlines = [(frame, body) for frame, body in zip(zip(*frames, strict=True), bodies, strict=True)
                if isinstance(body, PlanarBody)]  # fmt: skip
    start = product(outlines[0][0][0], outlines[0][1].axes[:, 2])
    axes = [[product(frame, body.axes[:, 2] if isinstance(body, PlanarBody) else product(first.T, start))
             for frame, first, body in zip(both, frames[0], bodies, strict=True)] for both in frames]  # fmt: skip
    names, where = f"'{contact.names[0]}' and '{contact.names[1]}'", ("contacts", contact.name)
    problem = model.mechanism.source.problem
    tilt = max(norm(np.cross(both[0], both[1])) for both in axes)
    is_ball = any(isinstance(body, Solid) and len(body.vertices) == 1 for body in bodies)
    if tilt > PARALLEL and not is_ball:
        yield problem(
            where,
            f"the planes of {names} are or become tilted against each other, so that they are not one planar pair",
            "Let joints hold them parallel, and check 'plane', 'rotate' and the axis of a roller.",
        )
    elif len(outlines) == 2 and product(axes[0][0], axes[0][1]) < 0.0:
        yield problem(
            where,
            f"one of {names} is seen from behind: the axes of their planes are opposite",
            "Turn one of the parts, or its outline, so that both are drawn in axes of the same hand.",
        )


def _problems(model: Model, contact: Contact, trials: Sequence[Poses]) -> Iterator[Problem]:
    first, second = contact.first, contact.second
    if isinstance(first, PlanarBody) or isinstance(second, PlanarBody):
        yield from _planar_problems(model, contact, trials)
        return
    placed = [axes_and_offset(contact, poses) for poses in trials]
    tilts = [norm(np.cross(one, other)) for one, other, _ in placed]
    along = np.array([offset for _, _, offset in placed])
    radius = getattr(second, "radius", 0.0)
    names = f"'{contact.names[0]}' and '{contact.names[1]}'"
    where, problem = ("contacts", contact.name), model.mechanism.source.problem
    if contact.slots and (max(tilts) > PARALLEL or np.ptp(along) > PARALLEL * radius):
        if are_thin_barrels(contact):
            yield problem(
                where,
                f"{names} have no thickness, so that they would pass through each other",
                "Give a cylinder in place of a disc or a ring, or let joints hold their axes parallel.",
            )
        return
    if isinstance(first, Barrel) and max(tilts) > PARALLEL:
        yield problem(
            where,
            f"the axes of {names} are or become crossed, so that their distance cannot be computed",
            "Let joints hold the axes parallel, or give one of the parts a sphere, or several.",
        )
    elif isinstance(second, Barrel) and np.ptp(along) > PARALLEL * radius:
        yield problem(
            where,
            f"{names} move along the axis, so that one can pass an end of the other, which cannot be computed",
            "Hold them beside each other by joints, give the first a sphere with a radius, or the second a length.",
        )
    elif isinstance(second, Barrel):
        reach = 0.5 * (second.length + (first.length if isinstance(first, Barrel) else 0.0))
        if (apart := abs(float(along[0])) - reach) > PARALLEL * radius:
            yield problem(
                where,
                f"{names} never touch: they are {apart:.4g} m apart along the axis",
                "Move their shapes into one plane, lengthen a cylinder, or remove the contact.",
            )
