"""The expressions of a mechanism that have no finite value near a state: the cause of many steps that fail.

A module of its own, as it needs CasADi: it is imported after a step has failed, and never by the start of a node.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.base.errors import Problem
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.linear_algebra import norm
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.mechanism.contents import ForceExpression, expressions_of_forces
from mbd_sim.mechanism.elements.constraints import Surface, expressions_of
from mbd_sim.mechanism.elements.forces import Spring
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint
from mbd_sim.mechanism.mass_properties import DIFFERENCE, state_numbers
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TIME, TimeExpression
from mbd_sim.mechanism.values.laws import ELONGATION, ELONGATION_RATE
from mbd_sim.mechanism.values.source import Location
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.model import Model

STEPS_AHEAD = (0.0, 0.25, 0.5, 1.0, 2.0)  # of the failing step, to which the motion is extrapolated
LARGEST_VALUE = 1e6  # of a variable; beyond it the motion has diverged, whatever an expression gives there


@dataclass(frozen=True, slots=True)
class UsedExpression:
    """An expression, its location in the file, and the values of its variables at a state.

    Of its `derivatives` in these variables, none or two enter the equations of motion.
    """

    location: Location
    expression: TimeExpression
    variables: Mapping[str, float]
    derivatives: int


@dataclass(frozen=True, slots=True)
class UndefinedExpression:
    """The problem with an expression, and the largest estimated error of the steps before the one that fails."""

    problem: Problem
    error_estimate: float


def undefined_expression(
    model: Model, mechanism: Mechanism, memory: KernelMemory, n: int
) -> UndefinedExpression | None:
    """The first expression without a finite value near the step that fails, if there is one.

    :param mechanism: that of the model, with the present live values.
    :param memory: the state, inputs and time from which the n steps fail; it is not changed.
    """
    if not any(_expressions(model, mechanism, 0.0, model.start, memory.inputs)):
        return None
    last, estimate = _last_finite(model, memory, n)
    time, step, moving = last.steps * last.step_size, last.step_size, slice(model.layout.nq + model.layout.nv)
    rates = np.array(model.equations.rates.call([time, last.y, last.inputs])[0]).ravel()[moving]
    with np.errstate(all="ignore"):  # the state may be close to infinity
        for steps in STEPS_AHEAD:
            ahead = last.y.copy()
            ahead[moving] += steps * step * np.where(np.isfinite(rates), rates, 0.0)
            for used in _expressions(model, mechanism, time + steps * step, ahead, last.inputs):
                if all(abs(value) < LARGEST_VALUE for value in used.variables.values()) and not _is_finite(used):
                    return UndefinedExpression(_problem(mechanism, used), estimate)
    return None


def _last_finite(model: Model, memory: KernelMemory, n: int) -> tuple[KernelMemory, float]:
    """The last state from which one of n steps fails, and the largest estimated error of the steps before it."""
    last, size, estimate = KernelMemory(model, memory.step_size), n, 0.0
    last.restore(memory.y, memory.inputs, memory.steps)
    while size > 1:
        size //= 2
        while last.advance(size):
            estimate = last.error_estimate
        last.restore(last.y, last.inputs, last.steps, estimate)  # without the estimate of the step that fails
    return last, estimate


def _expressions(model: Model, mechanism: Mechanism, time: float, y: Array, inputs: Array) -> Iterator[UsedExpression]:
    """The expressions of a mechanism at a state."""
    now = {TIME: time}
    for name, joint in mechanism.joints.items():
        if isinstance(joint.drive, CommandedDrive):
            continue
        for index, expression in enumerate(joint.drive):
            location: Location = ("joints", name, "drive") + ((index,) if len(joint.drive) > 1 else ())
            yield UsedExpression(location, expression, now, 2)
    poses = {GROUND: Pose(np.zeros(3), np.eye(3)), **model.poses(time, y, inputs)}
    for force in expressions_of_forces(mechanism):
        variables = _elongation(model, force, time, y, inputs)
        variables |= state_numbers(mechanism, force.expression, time, y)
        yield UsedExpression(force.location, force.expression, variables or now, 0)
    for constraint in mechanism.constraints:
        variables = {**now, **_local(poses, constraint)} if isinstance(constraint, Surface) else now
        expressions = expressions_of(constraint)
        for index, expression in enumerate(expressions):
            if expression.state:
                variables = state_numbers(mechanism, expression, time, y)
            location = ("constraints", constraint.name, *_key(mechanism, constraint.name, index))
            yield UsedExpression(location, expression, variables, 2)


def _elongation(model: Model, force: ForceExpression, time: float, y: Array, inputs: Array) -> dict[str, float]:
    """The elongation of the spring to which an expression belongs, and its rate; empty if it belongs to none."""
    match force.stretched:
        case None:
            return {}
        case Joint() as joint:
            q, u = model.layout.q[joint.name].start, model.layout.u[joint.name].start
            x, rate = float(y[q] - joint.rest[0]), float(y[model.layout.nq + u])
        case Spring() as spring:
            rates = np.array(model.equations.rates.call([time, y, inputs])[0]).ravel()
            moved = y + np.where(np.arange(len(y)) < model.layout.nq, rates, 0.0) * DIFFERENCE
            lengths = [_length(model, spring, time + dt, at, inputs) for dt, at in ((0.0, y), (DIFFERENCE, moved))]
            x, rate = lengths[0] - spring.length, (lengths[1] - lengths[0]) / DIFFERENCE
    own = {ELONGATION: x, ELONGATION_RATE: rate}
    return {name: value for name, value in own.items() if name in force.expression.variables}


def _length(model: Model, spring: Spring, time: float, y: Array, inputs: Array) -> float:
    poses = {GROUND: Pose(np.zeros(3), np.eye(3)), **model.poses(time, y, inputs)}
    return norm(_position(poses, spring.second) - _position(poses, spring.first))


def _key(mechanism: Mechanism, constraint: str, index: int) -> Location:
    """The key of an expression in an entry of the file; some types of constraints have expressions without one."""
    entry = mechanism.source.data["constraints"][constraint]
    found = next((key for key in ("equation", "equations", "length", "value") if key in entry), None)
    return () if found is None else (found, index) if found == "equations" else (found,)


def _position(poses: Mapping[str, Pose], attachment: Attachment) -> Array:
    pose = poses[attachment.part]
    return pose.position + pose.rotation @ attachment.point


def _local(poses: Mapping[str, Pose], surface: Surface) -> dict[str, float]:
    """The coordinates of a point on a surface or curve, by the names that its equations use."""
    line = _position(poses, surface.point) - _position(poses, surface.base)
    return dict(zip("xyz", ((poses[surface.base.part].rotation @ surface.axes).T @ line).tolist(), strict=True))


def _is_finite(used: UsedExpression) -> bool:
    """Whether an expression and its derivatives are finite."""
    variables = ca.SX.sym("v", len(used.variables))
    names = dict(zip(used.variables, ca.vertsplit(variables), strict=True))
    outputs = [function_of(used.expression, names)]
    for _ in range(used.derivatives):
        outputs.append(ca.jacobian(outputs[-1], variables))
    values = ca.Function("at", [variables], [ca.vertcat(*map(ca.vec, outputs))])(list(used.variables.values()))
    return bool(np.all(np.isfinite(np.array(values))))


def _problem(mechanism: Mechanism, used: UsedExpression) -> Problem:
    units = {TIME: " s"}
    at = ", ".join(f"{name} = {value:.8g}{units.get(name, '')}" for name, value in used.variables.items())
    what = "value or derivative" if used.derivatives else "value"
    remedy = "Change the expression so that it is finite over the whole motion, or end the run earlier."
    return mechanism.source.problem(used.location, f"the expression has no finite {what} near {at}", remedy)
