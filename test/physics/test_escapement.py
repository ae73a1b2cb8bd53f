"""Graham's escapement against a computation of its own, from event to event."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
    """Its two edges as complex numbers from the pivot; a tooth slides from `locking` to `leaving`. `side` is 1 at the entry."""

    def __init__(self, side):
        self.side, middle = side, 1.25 * math.pi if side > 0 else -0.25 * math.pi
        self.radius, end = (OUTER, INNER) if side > 0 else (INNER, OUTER)
        self.locking = cmath.rect(self.radius, middle - side * EARLY)
        self.leaving = cmath.rect(end, middle + side * LATE)
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


def pendulum(phi, rate):
    return (-BOB * G * L * math.sin(phi) - C * rate) / INERTIA


def locked(time, y):
    """y = (phi, direction of the tooth, their rates); the wheel turns clockwise."""
    return [y[2], 0.0, pendulum(y[0], y[2]), 0.0]


def free(time, y):
    return [y[2], y[3], pendulum(y[0], y[2]), -M / J]


def pushing(pallet, time, y):
    gradient, second = gap(pallet, y[0], y[1], 1), gap(pallet, y[0], y[1], 2)
    unloaded = np.array([pendulum(y[0], y[2]), -M / J])
    compliance = np.array([1.0 / INERTIA, 1.0 / J])
    rates = np.array([y[2], y[3]])
    force = -(gradient @ unloaded + rates @ second @ rates) / (gradient**2 @ compliance)
    return [y[2], y[3], *(unloaded + compliance * gradient * force)]


def until(motion, time, y, event, direction):
    event.terminal, event.direction = True, direction
    found = solve_ivp(motion, (time, time + 2.0), y, events=event, **PRECISE)
    assert found.t_events[0].size == 1
    return found.t_events[0][0], found.y_events[0][0]


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
        gradient, compliance = gap(pallet, y[0], y[1], 1), np.array([1.0 / INERTIA, 1.0 / J])
        y[2:] -= compliance * gradient * (gradient @ y[2:]) / (gradient**2 @ compliance)

        def beyond(time, y):
            arm = (cmath.rect(R, y[1]) - PIVOT) * cmath.rect(1.0, -y[0])
            return (pallet.along.conjugate() * (arm - pallet.leaving)).real

        time, y = until(lambda t, y: pushing(pallet, t, y), time, y, beyond, 1)
        fallen = y[1] - (y[1] - other.rests()) % PITCH
        time, y = until(free, time, y, lambda t, y: y[1] - fallen, -1)
        self.time, self.pallet, self.y = time, other, np.array([y[0], other.rests(), y[2], 0.0])
        self.beats.append(time)


def fallen_on_entry(phi):
    """The state at which the first tooth falls on the entry pallet, with the pendulum released at an angle."""
    time = math.sqrt(2.0 * 0.005 * math.pi * J / M)
    swing = solve_ivp(lambda t, y: [y[1], pendulum(*y)], (0.0, time), [phi, 0.0], **PRECISE).y[:, -1]
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
