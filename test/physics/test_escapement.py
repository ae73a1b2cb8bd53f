"""Graham's escapement and the anchor escapement against computations of their own, from event to event."""

from __future__ import annotations

import cmath
import math
from functools import partial

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk

from mbd_sim import Simulation

R, TEETH, LIFT, LOCK, DROP = 0.025, 30, math.radians(2.0), math.radians(0.5), math.radians(1.0)
L, BOB, C, M, J, G = 0.25, 0.5, 1e-3, 2e-4, 6e-7, 9.81
INERTIA = BOB * L * L + 1e-4
THICKNESS = R * (math.pi / TEETH - DROP)
OUTER, INNER = R + 0.5 * THICKNESS, R - 0.5 * THICKNESS
EARLY, LATE = 0.5 * (LIFT - LOCK), 0.5 * (LIFT + LOCK)
PITCH = 2.0 * math.pi / TEETH
PRECISE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


class Pallet:
    """Two edges of it as complex numbers from the pivot; a tooth slides from `locking` to `leaving`. `side` is 1 at the entry.

    :param before: the angle from its edge to the middle of the pallet, and `after` that to the other one, in rad.
    :param longer: by which the face begins beyond the thickness, in m.
    """

    def __init__(self, side, before=EARLY, after=LATE, longer=0.0):
        self.side, middle = side, 1.25 * math.pi if side > 0 else -0.25 * math.pi
        begin, end = (OUTER + longer, INNER) if side > 0 else (INNER - longer, OUTER)
        self.radius = begin
        self.locking = cmath.rect(begin, middle - side * before)
        self.leaving = cmath.rect(end, middle + side * after)
        self.along = (self.leaving - self.locking) / abs(self.leaving - self.locking)
        self.normal = -1j * self.along  # toward the tooth

    def direction(self, radius):
        """The direction from the axis of the wheel in which its tips are at this distance from the pivot."""
        height = (3.0 - (radius / R) ** 2) / (2.0 * math.sqrt(2.0))
        return math.pi - math.asin(height) if self.side > 0 else math.asin(height)

    def rests(self):
        """That of a tooth on the locking face."""
        return self.direction(self.radius)


ENTRY, EXIT = Pallet(1), Pallet(-1)
SLIPS, MOST, WEAK = math.radians(2.0), math.radians(4.0), 5e-4  # of the anchor escapement; the damping of its pendulum
RECOIL = THICKNESS * (MOST - SLIPS) / (2.0 * SLIPS)
ANCHOR = {side: Pallet(side, MOST, SLIPS, RECOIL) for side in (1, -1)}
PIVOT = complex(0.0, math.sqrt(2.0) * R)


def gap(pallet, phi, tooth, order=0):
    """The distance of a tooth in a direction from the impulse face, and its derivatives by (phi, direction)."""
    tip, turn = cmath.rect(R, tooth), cmath.rect(1.0, phi)
    arm = tip - PIVOT
    normal = pallet.normal * turn
    value = (normal.conjugate() * arm).real - (pallet.normal.conjugate() * pallet.locking).real
    if order == 0:
        return value
    by_phi, by_tooth = ((1j * normal).conjugate() * arm).real, (normal.conjugate() * 1j * tip).real
    if order == 1:
        return np.array([by_phi, by_tooth])
    mixed = ((1j * normal).conjugate() * 1j * tip).real
    return np.array([[-(normal.conjugate() * arm).real, mixed], [mixed, -(normal.conjugate() * tip).real]])


def pendulum(phi, rate, damping):
    return (-BOB * G * L * math.sin(phi) - damping * rate) / INERTIA


def locked(time, y):
    """y = (phi, direction of the tooth, their rates); the wheel turns clockwise."""
    return [y[2], 0.0, pendulum(y[0], y[2], C), 0.0]


def free(time, y, damping=C):
    return [y[2], y[3], pendulum(y[0], y[2], damping), -M / J]


def pushing(pallet, time, y, damping=C):
    gradient, second = gap(pallet, y[0], y[1], 1), gap(pallet, y[0], y[1], 2)
    unloaded = np.array([pendulum(y[0], y[2], damping), -M / J])
    compliance = np.array([1.0 / INERTIA, 1.0 / J])
    rates = np.array([y[2], y[3]])
    force = -(gradient @ unloaded + rates @ second @ rates) / (gradient**2 @ compliance)
    return [y[2], y[3], *(unloaded + compliance * gradient * force)]


def until(motion, time, y, event, direction):
    event.terminal, event.direction = True, direction
    found = solve_ivp(motion, (time, time + 2.0), y, events=event, **PRECISE)
    assert found.t_events[0].size == 1
    return found.t_events[0][0], found.y_events[0][0]


def struck(pallet, y):
    """The state after a plastic impact of a tooth on the face."""
    gradient, compliance = gap(pallet, y[0], y[1], 1), np.array([1.0 / INERTIA, 1.0 / J])
    return np.array([*y[:2], *(y[2:] - compliance * gradient * (gradient @ y[2:]) / (gradient**2 @ compliance))])


def beyond(pallet, time, y):
    """How far a tooth has slid beyond the end of the face, in m."""
    arm = (cmath.rect(R, y[1]) - PIVOT) * cmath.rect(1.0, -y[0])
    return (pallet.along.conjugate() * (arm - pallet.leaving)).real


class Oracle:
    """The motion from a state with a tooth on a pallet; `beats` are the times at which teeth fall on the other one."""

    def __init__(self, time, phi, rate, pallet=ENTRY):
        self.time, self.pallet, self.y = time, pallet, np.array([phi, pallet.rests(), rate, 0.0])
        self.beats = []

    def beat(self):
        """Up to the next fall, with an impulse on the way."""
        pallet, other = self.pallet, EXIT if self.pallet is ENTRY else ENTRY
        edge = cmath.phase(pallet.locking) - cmath.phase(cmath.rect(R, self.y[1]) - PIVOT)
        time, y = until(
            locked, self.time, self.y, lambda t, y: math.remainder(edge + y[0], 2.0 * math.pi), -pallet.side
        )
        released = time
        time, y = until(free, time, y, lambda t, y: gap(pallet, y[0], y[1]) if t > released + 1e-7 else 1.0, -1)
        time, y = until(partial(pushing, pallet), time, struck(pallet, y), partial(beyond, pallet), 1)
        fallen = y[1] - (y[1] - other.rests()) % PITCH
        time, y = until(free, time, y, lambda t, y: y[1] - fallen, -1)
        self.time, self.pallet, self.y = time, other, np.array([y[0], other.rests(), y[2], 0.0])
        self.beats.append(time)


def fallen_on_entry(phi):
    """The state at which the first tooth falls on the entry pallet, with the pendulum released at an angle."""
    time = math.sqrt(2.0 * 0.005 * math.pi * J / M)
    swing = solve_ivp(lambda t, y: [y[1], pendulum(*y, C)], (0.0, time), [phi, 0.0], **PRECISE).y[:, -1]
    return time, swing[0], swing[1]


def test_the_motion_is_that_of_a_computation_from_event_to_event():
    simulation, oracle = Simulation.from_file("graham_escapement"), Oracle(*fallen_on_entry(math.radians(3.0)))
    for _ in range(3):
        oracle.beat()
    simulation.step(1500)
    impacts = [event.time for event in simulation.contact_events if event.change.value == "impact"]
    assert impacts[0] == pytest.approx(fallen_on_entry(math.radians(3.0))[0], abs=1e-11)
    assert impacts[2::2] == pytest.approx(oracle.beats, abs=1e-10)
    rest = solve_ivp(locked, (oracle.time, 1.5), oracle.y, **PRECISE).y[:, -1]
    assert simulation.q[0] == pytest.approx(rest[0], abs=1e-10)
    assert simulation.u[0] == pytest.approx(rest[2], abs=1e-10)
    assert simulation.energies.residual == pytest.approx(0.0, abs=1e-15)


def anchored(beats, phi):
    """The times at which teeth fall on the pallets of the anchor escapement, and the last state; released at an angle."""
    direction = ANCHOR[1].direction(INNER + THICKNESS * (SLIPS + phi) / (2.0 * SLIPS)) + 0.005 * math.pi
    motion, time, y, times = partial(free, damping=WEAK), 0.0, np.array([phi, direction, 0.0, 0.0]), []
    for beat in range(beats):
        pallet, other = ANCHOR[(-1) ** beat], ANCHOR[-((-1) ** beat)]
        time, y = until(motion, time, y, lambda t, y, pallet=pallet: gap(pallet, y[0], y[1]), -1)
        times.append(time)
        if beat < beats - 1:
            time, y = until(partial(pushing, pallet, damping=WEAK), time, struck(pallet, y), partial(beyond, pallet), 1)
            y[1] -= PITCH * round((y[1] - other.direction(R)) / PITCH - 0.5)  # that tooth which falls next
    return times, time, struck(pallet, y), pallet


def couple(pallet, phi):
    """That of a tooth on the face about the pivot of the anchor, without inertia of the wheel."""
    middle = pallet.direction(R)
    by_phi, by_tooth = gap(pallet, phi, brentq(partial(gap, pallet, phi), middle - 0.3, middle + 0.3), 1)
    return M * by_phi / by_tooth


def test_recoil_is_that_of_a_computation_from_event_to_event_and_shortens_the_period():
    simulation, a = Simulation.from_file("anchor_escapement"), math.radians(3.4)
    times, time, y, pallet = anchored(4, a)
    simulation.step(1450)
    impacts = [event.time for event in simulation.contact_events if event.change.value == "impact"]
    assert impacts == pytest.approx(times, abs=1e-10)
    end = solve_ivp(partial(pushing, pallet, damping=WEAK), (time, 1.45), y, **PRECISE).y[:, -1]
    assert end[3] > 0.0 > end[2]  # the wheel turns back
    assert simulation.q[0] == pytest.approx(end[0], abs=1e-10)
    assert simulation.u == pytest.approx([end[2], -end[3]], abs=1e-9)
    # Airy's theory of disturbed pendulums, to first order; the couple acts on from the angle at which the other tooth slips off.
    rate, begin = math.sqrt(BOB * G * L / INERTIA), -math.acos(SLIPS / a)

    def disturbance(angle, pallet):
        return couple(pallet, pallet.side * a * math.cos(angle)) * pallet.side * math.cos(angle)

    disturbed = sum(quad(disturbance, begin, begin + math.pi, args=(each,))[0] for each in ANCHOR.values())
    free_period = 4.0 / rate * ellipk(math.sin(0.5 * a) ** 2)
    assert impacts[3] - impacts[1] - free_period == pytest.approx(disturbed / (INERTIA * rate**3 * a), rel=0.01)
