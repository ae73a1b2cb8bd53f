"""Why a run diverges: its step is too large for the accuracy or the method, or an expression has no finite value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import assert_never

import casadi as ca
import numpy as np

from mbd_sim.base.errors import DivergedError, Problem, listed
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.mechanism.contents import ForceExpression, expressions_of_forces
from mbd_sim.mechanism.elements.constraints import Surface, expressions_of
from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import GROUND, Attachment, Joint
from mbd_sim.mechanism.mass_properties import DIFFERENCE, state_numbers
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TIME, TimeExpression
from mbd_sim.mechanism.values.laws import ELONGATION, ELONGATION_RATE
from mbd_sim.mechanism.values.source import Location
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.method_choice import fastest_mode
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Energies

TOLERATED = 1e-5  # estimated error of a step relative to s + |q| and s + |u|; shipped mechanisms stay below 1e-6
OPEN_ACCOUNT = 1e-4  # residual relative to the largest energy or work
TARGET = 1e-7  # error of a step at which the proposed step size aims
MARGIN = 0.5  # the proposed step as a fraction of the largest stable one
USELESS = 100.0  # a step smaller by more than this factor is not proposed if another method is


def advice_on_step(model: Model, time: float, y: Array, inputs: Array, step: float, estimate: float) -> str | None:
    """A sentence that names a better step or method, or None if the estimated error of a step is small enough.

    :param step: the step size in s.
    :param estimate: the estimated error of a step, see `Simulation.error_estimate`.
    """
    if estimate <= TOLERATED:
        return None
    method = model.method.one_step
    meaningless = not estimate < 1.0  # then the state says nothing about the mechanism
    fastest = fastest_rate(model, 0.0, model.start, inputs) if meaningless else fastest_rate(model, time, y, inputs)
    stiff = step * fastest > method.stability_limit
    better = step * (TARGET / estimate) ** (1.0 / (method.order + 1)) if math.isfinite(estimate) else 0.1 * step
    if stiff:
        better = min(better, MARGIN * method.stability_limit / fastest)
    proposals = []
    may_be_stiff = not method.for_stiff and _may_become_stiff(model)
    if stiff or (not math.isfinite(estimate) and may_be_stiff):
        proposals.append("method rosenbrock")
    elif method.order < 8 and method.explicit:
        proposals.append("method tsitouras8")
    if not proposals or better * USELESS >= step:
        proposals.insert(0, f"step {round_down(better):g}")
    size = f"is estimated at {estimate:.1g}" if math.isfinite(estimate) else "is unbounded"
    rates = f", which has rates of {fastest:.1g}/s" if stiff else ""
    return (
        f"a step of {step:g} s is too large for {model.mechanism.name}{rates}: the error of a step {size}. "
        f"Try {' or '.join(proposals)}."
    )


def open_share(model: Model, energies: Energies, start_energy: float, step: float) -> float:
    """The residual of the energy account relative to its largest term; 0 where it is not known.

    What was exchanged counts, and the potential energies that may have been: at a turning point nothing else is left.

    :param step: the step size in s.
    """
    changes = energies.total - start_energy, energies.work_applied, energies.work_drives, energies.dissipated
    from mbd_sim.dynamics.layouts.state_scales import energy_size

    potentials = start_energy, energies.potential, energy_size(model.mechanism, step)
    largest = max(energies.kinetic, *map(abs, changes), *map(abs, potentials))
    return abs(energies.residual) / largest if largest > 0.0 else 0.0


def advice_on_energy(model: Model, energies: Energies, start_energy: float, step: float) -> str | None:
    """A sentence on an energy account that does not close, with what may be the cause; None if it closes.

    Estimates of errors overlook what happens within single steps, such as a force that jumps; the account does not.
    """
    share = open_share(model, energies, start_energy, step)
    if not share > OPEN_ACCOUNT:
        return None
    mechanism, causes = model.mechanism, list[str]()
    if turning := [f"'{each.name}'" for each in mechanism.bushings if np.any(each.stiffness[3:, 3:])]:
        causes.append(f"the couple of {listed(turning)} reverses where a bushing turns past half a turn")
    if springs := [f"'{each.name}'" for each in mechanism.springs if each.needs_line]:
        causes.append(f"the force of {listed(springs)} reverses where its length passes zero")
    cause = f": {'; '.join(causes)}" if causes else ", such as one that jumps"
    return (
        f"the energy account of {mechanism.name} is open by {share:.1g} of the largest "
        f"energy or work. A force may change abruptly within steps of {step:g} s{cause}. Try step "
        f"{round_down(0.1 * step):g}, or keep the motion away from there."
    )


def _may_become_stiff(model: Model) -> bool:
    """Whether there are springs, dampers, friction or stops, or live values, which may be theirs."""
    mechanism = model.mechanism
    by_elements = any(map(_may_be_stiff, mechanism.force_elements))
    return by_elements or bool(model.input_layout.value_count) or any(
        np.any(joint.stiffness) or np.any(joint.damping) or joint.spring or joint.damper or joint.friction
        or any(limits is not None and limits.stiffness for limits in joint.limits)
        for joint in mechanism.all_joints.values()
    )  # fmt: skip


def _may_be_stiff(element: ForceElement) -> bool:
    """Whether the force of an element depends on the motion."""
    match element:
        case Spring() | Damper() | Bushing() | AppliedEffort() | AppliedPotential():
            return True
        case AppliedForce(vector=vector):
            return any(expression.state for expression in vector)
        case _:
            assert_never(element)


def divergence(
    model: Model, time: float, n: int, step: float, advice: str | None, undefined: UndefinedExpression | None
) -> DivergedError:
    """The error for a state that becomes infinite within n steps of size `step` from `time` on, both in s.

    :param undefined: an expression without a finite value there, see `undefined_expression`.
    """
    head = f"{model.mechanism.name}: the state became infinite between t = {time:g} s and {time + n * step:g} s."
    if undefined is not None:
        also = f" Another possible cause: {advice}" if advice and undefined.error_estimate > TOLERATED else ""
        return DivergedError(f"{head} {undefined.problem}{also}")
    remedy = advice or f"Use a smaller step than {step:g} s."
    causes = "efforts, stiffnesses, initial values and drives"
    if model.row_names:
        causes += ", and that the loops can follow the motion"
    return DivergedError(f"{head} {remedy[0].upper()}{remedy[1:]} Otherwise check the {causes}.")


def fastest_rate(model: Model, time: float, y: Array, inputs: Array) -> float:
    """The largest |eigenvalue| of ∂f/∂(q, u) in 1/s; 0 if it cannot be found."""
    return fastest_mode(model.equations, time, y, inputs).rate


def round_down(value: float) -> float:
    """The largest number of the form 1, 2 or 5 times a power of ten that does not exceed a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(lead for lead in (5.0, 2.0, 1.0) if lead * power <= value * (1.0 + 1e-9)) * power


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
    last.load(memory.y, memory.inputs, memory.steps)
    while size > 1:
        size //= 2
        while last.advance(size):
            estimate = last.error_estimate
        last.load(last.y, last.inputs, last.steps, estimate)  # without the estimate of the step that fails
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
    return float(np.linalg.norm(_position(poses, spring.second) - _position(poses, spring.first)))


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
