"""Graham's escapement against a computation of its own, from event to event, and against the theory of its energy."""

from __future__ import annotations

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


def polar(radius, angle):
    return radius * complex(math.cos(angle), math.sin(angle))


class Pallet:
    """The locking edge and the let-off edge of a pallet as complex numbers from the pivot; `side` is 1 for the entry."""

    def __init__(self, side):
        self.side = side
        middle = 1.25 * math.pi if side > 0 else -0.25 * math.pi
        locking, leaving = (OUTER, INNER) if side > 0 else (INNER, OUTER)
        self.locking, self.leaving = polar(locking, middle - side * EARLY), polar(leaving, middle + side * LATE)
        self.radius = locking
        self.along = (self.leaving - self.locking) / abs(self.leaving - self.locking)
        self.normal = self.along * 1j  # from the face to the tooth: the pallet is on its right
        self.normal *= math.copysign(1.0, (self.normal.conjugate() * polar(1.0, middle + side * math.pi / 2)).real)

    def rests(self):
        """The direction of a tooth that rests on the locking face, from the axis of the wheel."""
        height = (3.0 - (self.radius / R) ** 2) / (2.0 * math.sqrt(2.0))
        return math.pi - math.asin(height) if self.side > 0 else math.asin(height)


ENTRY, EXIT = Pallet(1), Pallet(-1)
PIVOT = complex(0.0, math.sqrt(2.0) * R)


def gap(pallet, phi, tooth, order=0):
    """The distance of a tooth in a direction from the impulse face, and its derivatives by (phi, direction)."""
    tip = R * complex(math.cos(tooth), math.sin(tooth))
    arm, turn = tip - PIVOT, complex(math.cos(phi), math.sin(phi))
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
    return found.t_events[0][0], found.y_events[0][0], found


class Oracle:
    """The motion from a state with a tooth on the entry pallet; `beats` are the times at which teeth fall on pallets."""

    def __init__(self, phi, rate=0.0, time=0.0, pallet=ENTRY):
        self.time, self.pallet = time, pallet
        self.y = np.array([phi, pallet.rests(), rate, 0.0])
        self.beats, self.amplitudes, self.impulse_work = [], [], 0.0

    def beat(self):
        """Up to the next tooth's fall on the other pallet, with an impulse on the way."""
        pallet, other = self.pallet, EXIT if self.pallet is ENTRY else ENTRY
        rest = math.atan2(*(R * complex(math.cos(self.y[1]), math.sin(self.y[1])) - PIVOT).__reduce__()[1][::-1])
        edge = math.atan2(pallet.locking.imag, pallet.locking.real)

        def edge_passes(time, y):
            return math.remainder(edge + y[0] - rest, 2.0 * math.pi)

        time, y, turned = until(locked, self.time, self.y, edge_passes, -pallet.side)
        self.amplitudes.append(float(np.max(np.abs(turned.y[0]))))
        time, y, _ = until(free, time, y, lambda t, y: gap(pallet, y[0], y[1]) if t > time + 1e-9 else 1.0, -1)
        gradient, compliance = gap(pallet, y[0], y[1], 1), np.array([1.0 / INERTIA, 1.0 / J])
        y[2:] -= compliance * gradient * (gradient @ y[2:]) / (gradient**2 @ compliance)

        def leaves(time, y):
            arm = (R * complex(math.cos(y[1]), math.sin(y[1])) - PIVOT) * complex(math.cos(y[0]), -math.sin(y[0]))
            return (pallet.along.conjugate() * (arm - pallet.leaving)).real

        time, y, _ = until(lambda t, y: pushing(pallet, t, y), time, y, leaves, 1)
        ahead = other.rests()
        passed = math.remainder(y[1] - ahead, PITCH) % PITCH  # how far the next tooth is from the other pallet
        fall = y[1] - passed
        time, y, _ = until(free, time, y, lambda t, y: y[1] - fall, -1)
        self.time, self.pallet = time, other
        self.y = np.array([y[0], ahead, y[2], 0.0])
        self.beats.append(time)


def test_the_motion_is_that_of_a_computation_from_event_to_event():
    simulation = Simulation.from_file("graham_escapement")
    start = solve_ivp(free, (0.0, 1.0), [math.radians(3.0), 0.795 * 0.0 + ENTRY.rests() + math.radians(0.9) - math.radians(0.0), 0.0, 0.0],
                      events=(lambda t, y: 1.0,), **{**PRECISE, "t_eval": [0.0]})  # fmt: skip
    assert start.success
    fall = math.radians(144.0) - 0.795 * math.pi
    time = math.sqrt(2.0 * fall * J / M)
    swing = solve_ivp(lambda t, y: [y[1], pendulum(*y)], (0.0, time), [math.radians(3.0), 0.0], **PRECISE).y[:, -1]
    oracle = Oracle(swing[0], swing[1], time)
    for _ in range(3):
        oracle.beat()
    simulation.step(1600)
    impacts = [event.time for event in simulation.contact_events if event.change.value == "impact"]
    assert impacts[0] == pytest.approx(time, abs=1e-11)
    assert impacts[2::2] == pytest.approx(oracle.beats, abs=1e-9)
