"""Slip along two directions that counts as zero although it is not: it ends where friction slides in another direction.

The motion follows the direction of slip, however slow that is, but the modes were found as if there were none. Forces
would then be those of another direction, so that a contact may pull and its modes are wrong at once.
"""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import added
from mbd_sim.dynamics.contact.one_sided_equations import SLOW
from mbd_sim.simulation.contact.compiled.instant.modes import ALONG, STOPPED
from mbd_sim.simulation.contact.complementarity import block, least_solution
from mbd_sim.simulation.contact.impact import Impact
from mbd_sim.simulation.contact.one_sided_model import OneSidedModel, OneSidedReadings


def slips_to_end(model: OneSidedModel, readings: OneSidedReadings, modes: Array) -> list[int] | None:
    """The rows of slip that counts as zero, if some friction slides in a direction other than that of its slip."""
    sliding, closed, slow, turns = frozenset(model.sliding(modes)), modes[model.layout.closed], list[int](), False
    first = model.layout.direction.start - model.layout.gaps
    for index, (rows, gap) in enumerate(model.frictions):
        if len(rows) < 2 or gap is None or not closed[gap]:
            continue
        along, across = readings.rates[list(rows)].tolist()
        speed = math.hypot(along, across)
        if SLOW * model.units.speed < speed <= STOPPED * model.speeds[rows[0]]:
            slow += rows
            x, y = modes[[first + row for row in rows]].tolist()
            turns = turns or (index in sliding and abs(x * across - y * along) > ALONG * speed)
    return slow if turns else None


def end_slips(model: OneSidedModel, time: float, y: Array, inputs: Array, slow: list[int]) -> Impact:
    """The impulses that end slips, and the least of them of contacts and friction that do not move by these."""
    readings, matrix = model.readings(time, y, inputs), model.terms(time, y, inputs).matrix
    active = np.flatnonzero(model.modes(inputs)[model.layout.active]).tolist()
    rows = [*slow, *(row for row in active if row not in slow)]
    rates = np.zeros(len(rows))
    rates[: len(slow)] = readings.rates[slow]
    impulses = np.zeros(model.layout.rows)
    impulses[rows] = least_solution(block(matrix, rows), -rates, model.compliance[rows])
    loss = -0.5 * added((impulses[slow] * readings.rates[slow]).tolist())
    return Impact(impulses, model.response(time, y, inputs, impulses), max(loss, 0.0), 1.0)
