"""Impacts: the speeds after several contacts have closed at one instant (Moreau 1988; Glocker 2001).

v_N⁺ + e v_N⁻ ≥ 0, Λ_N ≥ 0, one of them zero; impulses of friction up to μ Λ_N against the slip after the impact. Joints
and other two-sided constraints take up impulses as well. Newton's law with friction, or with different coefficients of
restitution, can demand a gain of energy; the coefficients of that impact are then reduced by a common factor, the
largest that gains none. A mechanism that wedges can have no impulses at all with which it would rebound; nothing then
rebounds. Without restitution there always are some (Anitescu & Potra 1997).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.simulation.contact.candidates import RESTING
from mbd_sim.simulation.contact.compiled.instant.impact import JAMMED, SMALL
from mbd_sim.simulation.contact.complementarity import block, independent, least_solution, product
from mbd_sim.simulation.contact.one_sided_model import Mask, OneSidedModel, OneSidedReadings, OneSidedTerms
from mbd_sim.simulation.contact.problem import ContactProblem, FrictionLimit, NoSolutionError, contact_forces

GAIN = 1e-13  # of the kinetic energy that is exchanged, up to which a gain is round-off
HALVINGS = 50
SHORT = 1e-8  # of the natural time, step of time stepping
ELASTIC_REST = 1e-9  # of the natural speed, the approach speed below which even an elastic contact closes


@dataclass(frozen=True, eq=False)
class Impact:
    """The `impulses` (rows,) of an impact in N·s, the change of u (nv,), and the `loss` of energy in J.

    `factor` is 1, or what the coefficients of restitution were reduced by.
    """

    impulses: Array
    u_change: Array
    loss: float
    factor: float


def impact(
    model: OneSidedModel,
    time: float,
    y: Array,
    inputs: Array,
    readings: OneSidedReadings,
    touching: Mask,
    returning: Mask,
    rest_speed: float,
    elastic: bool = True,
) -> Impact:
    """The impact of all touching contacts.

    :param returning: gaps (gaps,) that open so slowly that they close again before they differ from zero.
    :param rest_speed: approach speed in m/s below which a contact does not rebound.
    :param elastic: False: nothing rebounds.
    :raises NoSolutionError: no impulses are admissible.
    """
    terms = model.terms(time, y, inputs)
    e = model.restitution(inputs)
    rest = rest_speed * model.speeds / model.units.speed
    slow, rates = np.where(e == 1.0, ELASTIC_REST * model.speeds[: len(e)], rest[: len(e)]), readings.rates[: len(e)]
    gaps = [int(index) for index in np.flatnonzero(touching)]
    frictions = [
        (rows, gap, terms.sizes[index, 0])
        for index, (rows, gap) in enumerate(model.frictions)
        if gap is not None and touching[gap] and terms.sizes[index, 0] > 0.0
    ]
    resting = [gap for gap in gaps if abs(rates[gap]) <= slow[gap] or returning[gap]]
    if np.all(rates[gaps] >= -slow[gaps]) and resting:
        own = [row for rows, gap, _ in frictions if gap in resting for row in rows]
        if (found := _slow_at_rest(model, readings, terms.matrix, resting, own, rest)) is not None:
            return Impact(found[0], model.response(time, y, inputs, found[0]), max(found[1], 0.0), 1.0)
    chosen = [*gaps, *(row for rows, _, _ in frictions for row in rows)]
    place = {row: position for position, row in enumerate(chosen)}
    limits = [FrictionLimit(tuple(place[row] for row in rows), place[gap], size) for rows, gap, size in frictions]
    matrix, before = block(terms.matrix, chosen), readings.rates[chosen]
    approach = np.minimum(before[: len(gaps)], 0.0)
    e = np.where(-approach < slow[gaps], 0.0, e[gaps]) * (1.0 if elastic else 0.0)

    def with_factor(factor: float) -> tuple[Array, float]:
        free = before.copy()
        free[: len(gaps)] += factor * e * approach
        impulses = contact_forces(ContactProblem(matrix, free, range(len(gaps)), limits, model.compliance[chosen]))
        after = before.copy()
        for column, impulse in enumerate(impulses.tolist()):
            after += matrix[:, column] * impulse
        return impulses, -0.5 * added((impulses * (before + after)).tolist())

    try:
        given, loss, factor = *with_factor(1.0), 1.0
    except NoSolutionError:
        given, loss, factor = *with_factor(0.0), 0.0
    exchanged = 0.5 * added(abs(given * before).tolist())
    if factor and loss < -GAIN * exchanged:
        factor = largest_factor(lambda trial: with_factor(trial)[1], loss, GAIN * exchanged)
        given, loss = with_factor(factor)
    impulses = np.zeros(model.layout.rows)
    impulses[chosen] = given
    return Impact(impulses, model.response(time, y, inputs, impulses), max(loss, 0.0), factor)


def return_at_once(
    model: OneSidedModel, readings: OneSidedReadings, terms: OneSidedTerms, inputs: Array, touching: Mask, least: float
) -> Mask:
    """The gaps (gaps,) that an impact has opened, and that are pressed back before they differ from zero.

    :param readings: after the impact, with the modes found.
    :param least: a gap in its unit that is zero, to round-off.
    """
    gaps = len(touching)
    rates = readings.rates[:gaps]
    pressing = np.flatnonzero(readings.forces).tolist()
    accelerations = terms.free[:gaps] + product(terms.matrix[:gaps, pressing], readings.forces[pressing])
    is_open = touching & (model.modes(inputs)[model.layout.closed] == 0.0) & ~model.clutches
    slowest, highest = RESTING * model.speeds[:gaps], -2.0 * accelerations * least * model.gap_units
    return np.asarray(is_open & (rates > slowest) & (rates**2 <= highest), dtype=bool)


def is_jammed(model: OneSidedModel, impulses: Array, rates: Array, rows: Sequence[int]) -> bool:
    """Whether impulses (n,) of some rows, or forces, are so large that they only divide by round-off.

    :param rates: (n,) which they change; of velocities if they are impulses, of accelerations if they are forces.
    """
    own = list(rows)
    fastest = float(np.max(np.abs(rates) / model.speeds[own], initial=0.0))
    return bool(np.any(np.abs(impulses) > JAMMED * fastest * model.loads[own] / model.units.rate))


def tangential_impact(model: OneSidedModel, time: float, y: Array, inputs: Array, touching: Mask) -> Impact | None:
    """The impulses where touching contacts that do not approach have no forces; None if there are none.

    A body may slide with so much friction that no finite force keeps it from penetrating. Friction then presses it onto
    the surface until its slip has ended or reversed, at once (Génot & Brogliato 1999). The impulses are those of time
    stepping as its step tends to zero, which always converge to a motion (Stewart 1998): impulses of a regular state
    vanish with the step, these do not.
    """
    terms, readings = model.terms(time, y, inputs), model.readings(time, y, inputs)
    resting = touching & (readings.rates[: len(touching)] <= RESTING * model.speeds[: len(touching)])
    gaps = [int(gap) for gap in np.flatnonzero(resting)]
    frictions = [(rows, gap, terms.sizes[index, 0]) for index, (rows, gap) in enumerate(model.frictions) if gap in gaps]
    chosen = [*gaps, *(row for rows, _, _ in frictions for row in rows)]
    place = {row: position for position, row in enumerate(chosen)}
    limits = [FrictionLimit(tuple(place[row] for row in rows), place[gap], size) for rows, gap, size in frictions]
    matrix, before = block(terms.matrix, chosen), readings.rates[chosen]

    def within(step: float) -> Array:
        free = before + step * terms.free[chosen]
        return contact_forces(ContactProblem(matrix, free, range(len(gaps)), limits, model.compliance[chosen]))

    step = SHORT / model.units.rate
    try:
        given = 2.0 * within(0.5 * step) - within(step)  # they are linear in the step
    except NoSolutionError:
        return None
    change = product(matrix, given)
    if np.all(np.abs(change) <= RESTING * model.speeds[chosen]):
        return None
    impulses = np.zeros(model.layout.rows)
    impulses[chosen] = given
    loss = -0.5 * added((given * (2.0 * before + change)).tolist())
    return Impact(impulses, model.response(time, y, inputs, impulses), max(loss, 0.0), 1.0)


def largest_factor(loss: Callable[[float], float], last: float, enough: float) -> float:
    """The largest factor in 0…1 with a loss that is not negative, by a bracketing root finder.

    :param last: the loss with the factor 1, negative.
    :param enough: the loss that is not distinguished from 0.
    """
    low, f_low, high, f_high, side = 0.0, loss(0.0), 1.0, last, 0
    for count in range(HALVINGS):
        middle = (low * f_high - high * f_low) / (f_high - f_low) if f_low > 0.0 else 0.0
        if count % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        found = loss(middle)
        if found >= 0.0:
            f_high *= 0.5 if side > 0 else 1.0
            low, f_low, side = middle, found, 1
            if found <= enough:
                break
        else:
            f_low *= 0.5 if side < 0 else 1.0
            high, f_high, side = middle, found, -1
    return low


def _slow_at_rest(
    model: OneSidedModel, readings: OneSidedReadings, matrix: Array, gaps: list[int], friction: list[int], rest: Array
) -> tuple[Array, float] | None:
    """As `_resting`, of these gaps with the slow rows of their friction, or the independent ones of them, or none."""
    slip = [row for row in friction if abs(readings.rates[row]) <= rest[row]]
    apart = frozenset(independent(matrix, [*gaps, *slip]))
    chosen = ([*gaps, *slip], [*gaps, *(row for row in slip if row in apart)], gaps)
    tried = (_resting(model, readings, matrix, rows, rest) for rows in chosen)
    return next((found for found in tried if found is not None), None)


def _resting(
    model: OneSidedModel, readings: OneSidedReadings, matrix: Array, rows: list[int], rest: Array
) -> tuple[Array, float] | None:
    """The impulses (all rows,) that bring these rows to rest with the least loss of energy, and this; None without any.

    A block that rocks on its edges rebounds without restitution, from one edge to the other; so infinitely many impacts
    end. Rows that nearly depend on each other, as of a bar that turns through the upright between a floor and a
    ceiling, would not come to rest, or only if far faster motions were stopped.

    :param rest: the slow rates (all rows,).
    """
    impulses, own, rates = np.zeros(model.layout.rows), block(matrix, rows), readings.rates[rows]
    found = least_solution(own, -rates, model.compliance[rows])
    loss = 0.5 * added((found * -rates).tolist())
    fastest = np.maximum(np.abs(readings.rates), rest)
    slow = 0.5 * added(fastest[row] ** 2 / matrix[row, row] for row in rows if matrix[row, row] > 0.0)
    after = np.abs(rates + product(own, found))
    if loss > SMALL * slow or np.any(after > RESTING * model.speeds[rows]):
        return None
    impulses[rows] = found
    return impulses, loss
