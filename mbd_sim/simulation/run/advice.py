"""Why a run diverges: its step is too large for the accuracy or the method, or an expression has no finite value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, assert_never

import numpy as np

from mbd_sim.base.errors import DivergedError, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.contents import one_sided_names
from mbd_sim.mechanism.elements.forces import (
    AppliedEffort,
    AppliedForce,
    AppliedPotential,
    Bushing,
    Damper,
    ForceElement,
    Spring,
)
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.model.state_records import Energies

if TYPE_CHECKING:
    from mbd_sim.simulation.run.undefined_expressions import UndefinedExpression

TOLERATED = 1e-5  # estimated error of a step relative to s + |q| and s + |u|; shipped mechanisms stay below 1e-6
OPEN_ACCOUNT = 1e-4  # residual relative to the largest energy or work
UNPRESSED = 0.05  # of a force that presses a contact, which may lack in time stepping
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
    from mbd_sim.simulation.model.method_choice import fastest_mode

    method = model.method.one_step
    meaningless = not estimate < 1.0  # then the state says nothing about the mechanism
    mode = fastest_mode(model.equations, *((0.0, model.start) if meaningless else (time, y)), inputs)
    fastest, name = mode.rate, next(iter(model.mechanism.coordinate_names[mode.speed :]), "")
    stiff = step * fastest > method.stability_limit
    better = step * (TARGET / estimate) ** (1.0 / (method.order + 1)) if math.isfinite(estimate) else 0.1 * step
    if stiff:
        better = min(better, MARGIN * method.stability_limit / fastest)
    proposals = []
    may_be_stiff = not method.for_stiff and _may_become_stiff(model)
    if one_sided_names(model.mechanism):  # which no method for stiff mechanisms treats
        proposals += [f"less damping and stiffness, or more inertia, at {name}"] if stiff else []
    elif stiff or (not math.isfinite(estimate) and may_be_stiff):
        proposals.append("method rosenbrock")
    elif method.order < 8 and method.explicit:
        proposals.append("method tsitouras8")
    if not proposals or better * USELESS >= step:
        proposals.insert(0, f"step {round_down(better):g}")
    size = f"is estimated at {estimate:.1g}" if math.isfinite(estimate) else "is unbounded"
    rates = f", which has rates of {fastest:.1g}/s at {name}" if stiff else ""
    return (
        f"a step of {step:g} s is too large for {model.mechanism.name}{rates}: the error of a step {size}. "
        f"Try {' or '.join(proposals)}."
    )


def advice_on_pressing(model: Model, time: float, y: Array, inputs: Array, step: float) -> str | None:
    """A sentence on dampers that make contacts press too little in time stepping, or None if they do so by little.

    A step h is free first, in which a damper d of a mass m takes from a force what it would take if no contact held
    the mass: the contact bears (1 - exp(-x))/x of the force, with x = h d/m.
    """
    if not model.method.time_stepping:
        return None
    from mbd_sim.simulation.model.method_choice import fastest_decay

    mode = fastest_decay(model.equations, time, y, inputs)
    part = mode.rate * step
    if part <= 2.0 * UNPRESSED:
        return None
    names = list(model.mechanism.coordinate_names)
    at = f" at {names[mode.speed]}" if names else ""
    borne = (1.0 - math.exp(-part)) / part
    return (
        f"a step of {step:g} s is too large for {model.mechanism.name} with {model.method.name}: dampers{at} act at a "
        f"rate of {mode.rate:.1g}/s, so that a contact which holds it bears {borne:.2g} of the force that presses it. "
        f"Try step {round_down(2.0 * UNPRESSED / mode.rate):g} or a method with events."
    )


def open_share(model: Model, energies: Energies, start_energy: float, step: float) -> float:
    """The residual of the energy account relative to its largest term; 0 where it is not known.

    What was exchanged counts, and the potential energies that may have been: at a turning point nothing else is left.

    :param step: the step size in s.
    """
    changes = energies.total - start_energy, energies.work_applied, energies.work_drives, energies.dissipated
    from mbd_sim.mechanism.natural_units import energy_size

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
    model: Model,
    time: float,
    n: int,
    step: float,
    advice: str | None,
    undefined: UndefinedExpression | None,
    closed: Sequence[str] = (),
    moving: Sequence[str] = (),
) -> DivergedError:
    """The error for a state that becomes infinite within n steps of size `step` from `time` on, both in s.

    :param closed: the contacts that are closed at this time, and the drives that are `moving`.
    :param undefined: an expression without a finite value there, see `undefined_expression`.
    """
    head = f"{model.mechanism.name}: the state became infinite between t = {time:g} s and {time + n * step:g} s"
    if undefined is not None:
        also = f" Another possible cause: {advice}" if advice and undefined.error_estimate > TOLERATED else ""
        return DivergedError(f"{head}. {undefined.problem}{also}")
    remedy = advice or f"Use a smaller step than {step:g} s."
    causes = "efforts, stiffnesses, initial values and drives"
    if model.row_names:
        causes += ", and that the loops can follow the motion"
    if closed:
        by = f"the {'drive' if len(moving) == 1 else 'drives'} of {', '.join(moving)}" if moving else "drives"
        press = "presses" if len(moving) == 1 else "press"
        causes += f", and whether these closed contacts leave room for what {by} {press} on them: {', '.join(closed)}"
    return DivergedError(head, f"{remedy[0].upper()}{remedy[1:]} Otherwise check the {causes}.")


def fastest_rate(model: Model, time: float, y: Array, inputs: Array) -> float:
    """The largest |eigenvalue| of ∂f/∂(q, u) in 1/s; 0 if it cannot be found."""
    from mbd_sim.simulation.model.method_choice import fastest_mode

    return fastest_mode(model.equations, time, y, inputs).rate


def round_down(value: float) -> float:
    """The largest number of the form 1, 2 or 5 times a power of ten that does not exceed a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(lead for lead in (5.0, 2.0, 1.0) if lead * power <= value * (1.0 + 1e-9)) * power
