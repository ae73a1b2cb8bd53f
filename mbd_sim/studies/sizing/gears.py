"""The ratio of a gear with which a motor needs the least RMS torque.

The torque of the rotor is a n + b / n + f, with a = J a_load + d v, the effort b of the load with the losses of the
gear, and coulomb friction f. Without f, its mean square is <a²> n² + 2 <a b> + <b²> / n², least at
n² = sqrt(<b²> / <a²>): for a pure inertia J_L, n² = J_L / J, at which the inertias match (Pasch & Seering 1984). With
f, its derivative by n is a polynomial of fourth degree.
"""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.studies.sizing.catalog import MotorType
from mbd_sim.studies.sizing.cycle import LoadCycle
from mbd_sim.studies.sizing.duty import effort_at_gear


def best_ratio(load: LoadCycle, motor: MotorType, *, efficiency: float = 1.0, inertia: float = 0.0) -> float:
    """The ratio of least RMS torque at which the motor is fast enough: in rad/s for 1 rad/s or 1 m/s of the load.

    :param inertia: of the gear, at the rotor, in kg·m².
    :raises InputError: the load does not move.
    """
    if not load.top_speed:
        raise InputError(f"'{load.name}' does not move, so that no ratio is best", "Give the ratio.")
    fastest = motor.max_speed / load.top_speed
    if motor.coulomb or efficiency != 1.0:
        load = load.split
    samples = load.samples
    a = (motor.rotor_inertia + inertia) * load.acceleration + motor.viscous * load.speed
    b = effort_at_gear(load, efficiency)
    f = motor.coulomb * samples.signs(load.speed)
    squares = samples.mean(a * a), samples.mean(b * b)
    if not motor.coulomb:
        return min(math.sqrt(math.sqrt(squares[1] / squares[0])), fastest) if squares[0] else fastest
    found = np.roots([squares[0], samples.mean(f * a), 0.0, -samples.mean(f * b), -squares[1]])
    real = [float(root.real) for root in found if abs(root.imag) <= 1e-9 * abs(root) and root.real > 0.0]
    known = [min(root, fastest) for root in real] or [fastest]
    return min(known, key=lambda n: samples.mean((a * n + b / n + f) ** 2))
