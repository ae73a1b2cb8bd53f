"""Why the state of a member of an ensemble would have become infinite."""

from __future__ import annotations

from mbd_sim.errors import DivergedError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.contact_events import EventError
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.snapshot import MemberFailure
from mbd_sim.simulation.step_advice import advice_on_step, divergence
from mbd_sim.simulation.undefined_expressions import undefined_expression


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
    memory.load(y, failure.inputs, failure.steps)
    try:
        memory.advance(failure.count)
    except EventError as error:
        return error
    undefined = undefined_expression(model, mechanism, memory, failure.count)
    time = failure.steps * step_size
    advice = advice_on_step(model, time, y, failure.inputs, step_size, error_estimate)
    return divergence(model, time, failure.count, step_size, advice, undefined)
