"""The members of an ensemble: how they are advanced, why one diverged, and whether one can start again by itself.

With one-sided elements each goes through its own events, as a single simulation does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import CommandError, DivergedError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.ensemble_kernel import (
    Advance,
    Done,
    MemberGroups,
    advance_lanes,
    advance_one_by_one,
    compile_members,
)
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.contact.compiled_contacts import advance_members
from mbd_sim.simulation.contact.stepper import OneSidedStepper
from mbd_sim.simulation.ensemble.variants import Variants
from mbd_sim.simulation.kernel.memory import KernelMemory, one_sided_stepper
from mbd_sim.simulation.model.builder import partial_system
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.penetrations import require_outside
from mbd_sim.simulation.run.advice import advice_on_step, divergence
from mbd_sim.simulation.run.run_point import MemberFailure
from mbd_sim.simulation.run.undefined_expressions import undefined_expression


def member_steppers(model: Model, variants: Variants, count: int) -> tuple[OneSidedStepper, ...]:
    """The stepper of each of `count` members, or none at all where everything is two-sided."""
    if model.one_sided is None:
        return ()
    return tuple(one_sided_stepper(model, variants.mechanism_of(member)) for member in range(count))


def find_modes_of_members(
    model: Model, steppers: Sequence[OneSidedStepper], members: NDArray[np.intp], states: Array, inputs: Array
) -> None:
    """Find the modes of some members at time zero, in place, with impacts where contacts approach.

    :param steppers: of all members.
    :param states: (k, n), and `inputs` (k, m), of these members.
    :raises CommandError: a member is inside an obstacle.
    :raises DivergedError: contacts without a solution, or with more points than slots; both errors name the member.
    """
    for member, y, row in zip(members.tolist() if steppers else (), states, inputs, strict=False):
        steppers[member].events.clear()
        try:
            require_outside(model, 0.0, y, row)
            steppers[member].find_modes(0.0, y, row)
        except (CommandError, DivergedError) as error:
            raise type(error)(f"member {member}: {error}") from error


def advance_through_events(steppers: Sequence[OneSidedStepper], inputs_size: int) -> Advance:
    """Advance each member, in a group by itself; one whose contacts have no solution is no longer alive.

    Those that are observed, or have changing features or a step that compiled code leaves to others, are advanced by
    their steppers.
    """
    contacts = np.array([stepper.packed for stepper in steppers])

    def advance(arrays: Mapping[str, Array], first: int, h: float, steps: int, groups: range, done: Done) -> None:
        rows = {name: array[:, :, 0] for name, array in arrays.items()}
        compiled = [member for member in groups if steppers[member].is_compiled]
        left = advance_members(contacts, rows, np.array(compiled, dtype=np.int64), first, h, steps)
        for member in sorted({*groups} - {*compiled} | {*left}):
            y, inputs, estimate, alive = (rows[name][member] for name in ("y", "inputs", "estimates", "alive"))
            if alive[0]:
                own, history = inputs[:inputs_size], inputs[inputs_size:]
                try:
                    alive[0] = float(steppers[member].advance(y, own, history, np.array([first]), h, steps, estimate))
                except DivergedError:
                    alive[0] = 0.0
        done.append(groups)

    return advance


ENOUGH = 2_000_000  # instructions of all members together from which on threads save time


def member_groups(model: Model, count: int, steppers: Sequence[OneSidedStepper]) -> MemberGroups:
    """The arrays of `count` members, and what advances them."""
    sizes = {"y": len(model.start), "inputs": len(model.inputs) + model.history_size, "estimates": 1, "alive": 1}
    if steppers:
        advance = advance_through_events(steppers, len(model.inputs))
        return MemberGroups(count, 1, sizes, advance, ENOUGH // model.kernel.instructions)
    if model.method.uses_series:  # each member needs its own expansions
        return MemberGroups(count, 1, sizes, advance_one_by_one(model.kernel))
    equations = model.equations
    partial = partial_system(equations, model.method)
    kernel = compile_members(
        equations.rates,
        equations.project,
        model.method,
        equations.core,
        partial,
        model.between_steps,
        scales=equations.scales,
    )
    return MemberGroups(count, kernel.lanes, sizes, advance_lanes(kernel), ENOUGH // model.kernel.instructions)


def divergence_of_member(
    model: Model, mechanism: Mechanism, failure: MemberFailure, y: Array, step_size: float, error_estimate: float
) -> DivergedError:
    """The error that a `Simulation` with the values of this member raises.

    :param mechanism: with the values of this member.
    :param y: (n,) the state before the call that failed.
    :param step_size: in s.
    :param error_estimate: of the member, see `Ensemble.error_estimates`.
    """
    memory = KernelMemory(model, step_size, mechanism)
    memory.restore(y, failure.inputs, failure.steps)
    try:
        memory.advance(failure.count)
    except DivergedError as error:
        return error
    undefined = undefined_expression(model, mechanism, memory, failure.count)
    time = failure.steps * step_size
    advice = advice_on_step(model, time, y, failure.inputs, step_size, error_estimate)
    return divergence(model, time, failure.count, step_size, advice, undefined)


def time_dependence(model: Model) -> str | None:
    """Why the same state moves in another way at another time; None if it does not, but for `sampling_steps`."""
    functions = [model.equations.rates, model.equations.project]
    if model.between_steps is not None:
        functions += [sampler.function for sampler in model.between_steps.samplers]
    if any(function is not None and function.jac_sparsity(0, 0).nnz() for function in functions):
        return "a drive, a force or a constraint of the mechanism depends on the time"
    return None


def sampling_steps(model: Model) -> int:
    """The number of steps after which all sampled servos act again as at time zero; 1 without such."""
    between = model.between_steps
    return 1 if between is None else math.lcm(*(sampler.every for sampler in between.samplers))
