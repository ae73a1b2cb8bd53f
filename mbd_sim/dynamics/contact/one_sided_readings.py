"""What is read from a state with contacts: gaps, rates, forces, and the guards that are negative where a mode ends."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from mbd_sim.dynamics.contact.one_sided_equations import RELEASED, SLIDING, FrictionElement, OneSidedEquations
from mbd_sim.dynamics.contact.one_sided_rows import JointLoad

TURNED = 0.5  # cosine of the angle by which a direction of sliding turns before it is stored again
UNMOVED = 5e-10  # of the natural speed, up to which a closed gap that depends on others does not move: above `RESTING`
PARTED = 1e-11  # of the natural speed, up to which contacts that share their forces do not move: below `RESTING`
RELOADED = 1e-8  # of the weight: the force at which a closed gap is loaded again, above the round-off of shared forces
# Of the natural speed, up to which friction at rest along one or two directions does not slip: above `RESTING` and
# `STOPPED`
UNSLIPPED = 1e-9, 2e-8


def gap_values(one_sided: OneSidedEquations, positions: ca.SX | None = None) -> ca.SX:
    """The gaps (gaps,), or other `positions`; for clutches their speeds."""
    equations, found = one_sided.equations, []
    for index, gap in enumerate(one_sided.gaps):
        clutch = equations.velocity[index]
        found.append(clutch if gap.clutch else (equations.position if positions is None else positions)[index])
    return ca.vertcat(ca.SX(0, 1), *found)


def one_sided_readings(
    one_sided: OneSidedEquations, loads: Sequence[JointLoad], mobility: ca.SX, weight: float, solution: ca.SX
) -> ca.SX:
    """The gaps, the rates and forces of all rows, the guards, and the rates at which friction can turn slips.

    :param mobility: the diagonal (rows,) of A without friction.
    :param weight: in N, by which guards of forces are divided; those of moments by this times the natural length.
    :param solution: (rows,) of the active rows; of others what `mbd_sim.compiler.steps.active_rows.emit_solved`
        watches.
    """
    forces, gaps = one_sided.forces(solution), gap_values(one_sided)
    weights = [weight * one_sided.units.length / length for length in one_sided.lengths]
    guards = [
        _gap_guard(one_sided, index, gaps[index], forces[index] / weights[index], solution[index] / weights[index])
        for index in range(one_sided.layout.gaps)
    ]
    sizes = iter([load.size(forces) for load in loads])
    for element in one_sided.frictions:
        load = ca.SX(1) if element.gap is None else forces[element.gap]
        load = load if element.joint is None else next(sizes)
        guards.append(_friction_guard(one_sided, element, forces, load, weights[element.rows[0]]))
    guards += [
        ca.if_else(load.factor, load.sign * (load.unloaded + load.by_force @ forces) / weight, 1.0)
        for load in loads
        if load.components == 1
    ]
    spatial = [element for element in one_sided.frictions if len(element.rows) == 2]
    turning = [_turning(one_sided, element, forces, mobility) for element in spatial]
    return ca.vertcat(gaps, one_sided.equations.velocity, forces, *guards, *turning)


def _turning(one_sided: OneSidedEquations, element: FrictionElement, forces: ca.SX, mobility: ca.SX) -> ca.SX:
    """The rate in 1/s at which friction along two directions can turn its slip velocity."""
    assert element.gap is not None
    slip = one_sided.equations.velocity[list(element.rows), :]
    speed = ca.sqrt(ca.dot(slip, slip))
    stored = one_sided.stored_direction(element)
    slides = (ca.dot(stored, stored) > 0.0) * (speed > one_sided.slow)
    size = element.sliding(slip) * ca.fabs(forces[element.gap]) * ca.sum1(mobility[list(element.rows)])
    return ca.if_else(slides, size / ca.fmax(speed, one_sided.slow), 0.0)


def _gap_guard(one_sided: OneSidedEquations, index: int, gap: ca.SX, force: ca.SX, unloaded: ca.SX) -> ca.SX:
    """Open: the gap, but for slots. Closed: the force, and if it depends on other closed gaps that it does not move.

    A gap that others hold without a force must not get one: it is `unloaded` by so much.
    """
    speed = ca.fabs(one_sided.equations.velocity[index]) / one_sided.speeds[index]
    held, number = 1.0 - speed / UNMOVED, one_sided.numbers[one_sided.layout.active][index]
    is_open = gap / one_sided.gap_units[index] if one_sided.gaps[index].numbers is None else 1.0
    bears = ca.if_else(number < 0.0, ca.fmin(force, 1.0 - speed / PARTED), force)
    closed = ca.if_else(number, bears, ca.fmin(held, unloaded + RELOADED))
    return ca.if_else(one_sided.closed[index], closed, is_open)


def _friction_guard(
    one_sided: OneSidedEquations, element: FrictionElement, forces: ca.SX, load: ca.SX, weight: float
) -> ca.SX:
    """Sliding: the speed along the stored direction. Sticking: what friction could bear more than it does.

    Friction that depends on other friction at rest does not move either. A clutch that is released is watched until it
    has a capacity, or slips. Along two directions the stored direction is renewed where sliding has turned by 60
    degrees.
    """
    rows = list(element.rows)
    stored = one_sided.stored_direction(element)
    own = forces[rows]
    size = ca.fabs(own[0]) if len(rows) == 1 else ca.sqrt(ca.dot(own, own))
    reserve = (element.static * load - size) / weight
    sticks = ca.sum1(one_sided.active[rows]) > 0.0
    slides = ca.dot(stored, stored) > SLIDING
    slip = one_sided.equations.velocity[rows, :] / one_sided.speeds[rows[0]]
    speed = ca.dot(stored, slip)
    if len(rows) == 2:
        speed -= TURNED * ca.sqrt(ca.dot(slip, slip))
    slips = ca.sqrt(ca.dot(slip, slip))
    held, numbers = 1.0 - slips / UNSLIPPED[len(rows) - 1], one_sided.numbers[one_sided.layout.active][rows]
    reserve = ca.if_else(ca.fmin(numbers[0], numbers[-1]) < 0.0, ca.fmin(reserve, 1.0 - slips / PARTED), reserve)
    if len(rows) == 2:  # one of them may depend on others
        reserve = ca.if_else((ca.sum1(one_sided.active[rows]) < 2.0) * (held < 0.0), held, reserve)
    if element.joint is not None:
        held = ca.if_else(element.static > 0.0, held, 1.0)
        return ca.if_else(slides, speed, ca.if_else(sticks, reserve, held))
    if element.gap is not None:
        held = ca.if_else(one_sided.closed[element.gap] * (element.static > 0.0), held, 1.0)
    elif not element.static.is_constant():
        held = ca.if_else((stored[0] == RELEASED) * (element.static > 0.0), -element.static / weight, held)
    return ca.if_else(sticks, reserve, ca.if_else(slides, speed, held))
