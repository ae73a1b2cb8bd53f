"""The flywheel that keeps the speed of a machine within a stated irregularity.

A drive exerts the mean effort, and the flywheel stores the difference. The coefficient of speed fluctuation is
δ = (ω_max - ω_min) / ω with the mean speed ω, and the energy changes by ΔE = J ω² δ between the two (Uicker, Pennock &
Shigley, ch. 16; Norton, *Design of Machinery*, ch. 11). The loads are those at constant speed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.studies.sizing.cycle import LoadCycle

ROUND_OFF = 1e-11  # of a mean effort, relative to the largest one


@record
class Flywheel:
    """A flywheel: its `inertia` in kg·m² and what it follows from.

    `total` is the inertia that is needed at the shaft, `present` the mean one of the mechanism, zero where it is
    unknown. `mean_effort` in N·m is that of a drive with a flywheel, `swing` in J the energy that it stores at most.
    """

    irregularity: float
    speed: float
    mean_effort: float
    swing: float
    total: float
    present: float

    @property
    def inertia(self) -> float:
        """Of the flywheel itself."""
        return max(self.total - self.present, 0.0)

    def disc(self, radius: float, density: float = 7850.0) -> tuple[float, float]:
        """The mass in kg and the thickness in m of a solid disc with this inertia."""
        mass = 2.0 * self.inertia / radius**2
        return mass, mass / (density * math.pi * radius**2)


def flywheel(load: LoadCycle, irregularity: float) -> Flywheel:
    """The flywheel for a shaft that turns in one direction.

    :param irregularity: the coefficient of speed fluctuation, such as 0.02.
    :raises InputError: it is not possible, or the load does not turn in one direction.
    """
    if not 0.0 < irregularity < 1.0:
        raise InputError(
            f"an irregularity of {irregularity:g} is not possible", "Give one between 0 and 1, such as 0.02."
        )
    samples = load.samples
    turned = samples.integral(load.speed)
    if np.any(load.speed * np.sign(turned) <= 0.0) or not load.rotation:
        raise InputError(
            f"'{load.name}' does not turn in one direction, as a flywheel does", "Choose a shaft that does."
        )
    speed = turned / load.duration
    mean = samples.integral(load.power) / turned
    mean = mean if abs(mean) > ROUND_OFF * load.peak else 0.0
    low, high = samples.extremes_of_integral(mean * load.speed - load.power)
    present = load.mean_inertia
    return Flywheel(
        irregularity,
        speed,
        mean,
        high - low,
        (high - low) / (irregularity * speed**2),
        0.0 if math.isnan(present) else present,
    )


def load_beside(load: LoadCycle, wheel: Flywheel) -> LoadCycle:
    """The load of a drive that exerts the mean effort all the time: with the inertia of the flywheel."""
    return replace(load.with_effort(np.full(len(load), wheel.mean_effort)), inertia=load.inertia + wheel.inertia)


def with_flywheel(load: LoadCycle, wheel: Flywheel) -> Array:
    """The speed (n,) of the shaft under the mean effort, with the energy that the flywheel has stored."""
    samples = load.samples
    stored = samples.cumulative(wheel.mean_effort * load.speed - load.power)
    low, high = samples.extremes_of_integral(wheel.mean_effort * load.speed - load.power)
    inertia = wheel.inertia + wheel.present
    middle = (0.5 * wheel.irregularity * wheel.speed) ** 2 + wheel.speed**2  # mean of the squares of both extremes
    return np.asarray(np.sign(wheel.speed) * np.sqrt(middle + 2.0 * (stored - 0.5 * (low + high)) / inertia))
