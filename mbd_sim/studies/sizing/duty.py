"""A motor with a gear in a cycle of a load: what it must do, and whether it can.

The rotor turns with ω = n v, with the ratio n of the gear and the speed v of the load. Its torque is
τ = J n a + (F / n) η^(-s) + c sign(ω) + d ω, with its own inertia and that of the gear J, the acceleration a and the
effort F of the load, the efficiency η of the gear, s = 1 where the load is driven and -1 where it drives, and the
friction c, d of the rotor. So a gear behaves as that of an actuator in a simulation. The current is τ / k, the voltage
R i + L i' + k ω. The winding warms up by T' = (R(T) i² R_th - (T - T_ambient)) / t_th, a model of the first order with
the resistance of copper; iron losses are left out. In a cycle that repeats itself, T is that of the periodic state.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.short_repr import record
from mbd_sim.studies.sizing.catalog import AMBIENT, DIRECT, WARM, GearType, MotorType
from mbd_sim.studies.sizing.cycle import LoadCycle
from mbd_sim.studies.sizing.samples import SampleTimes

SPARE = 1e-9  # by which a limit may be exceeded: round-off

MOST_GROWTH = 500.0  # exponent of a temperature that grows in a cycle, beyond which it is infinite


@record
class MotorDuty:
    """What a motor does in a cycle, by time (n,).

    `speed` in rad/s and `torque` in N·m are those of the rotor; `driving` is the part of the torque that goes through
    the gear. `temperature` (n,) in °C is nan where it is not known, and infinite where the motor does not settle.
    """

    motor: MotorType
    gear: GearType
    load: LoadCycle
    ambient: float
    speed: Array
    torque: Array
    current: Array
    voltage: Array
    temperature: Array

    @property
    def samples(self) -> SampleTimes:
        """The times of the cycle."""
        return self.load.samples

    @property
    def peak_torque(self) -> float:
        """In N·m."""
        return float(np.max(np.abs(self.torque)))

    @cached_property
    def rms_torque(self) -> float:
        """In N·m."""
        return self.samples.rms(self.torque)

    @property
    def top_speed(self) -> float:
        """In rad/s."""
        return float(np.max(np.abs(self.speed)))

    @cached_property
    def mean_speed(self) -> float:
        """The mean of the magnitude in rad/s: with the RMS torque, the point that continuous curves are made for."""
        samples = self.samples
        return (samples.positive_part(self.speed) + samples.positive_part(-self.speed)) / samples.duration

    @property
    def inertia_ratio(self) -> float:
        """The mean inertia of the load, seen by the rotor, over that of the rotor and the gear."""
        own = self.motor.rotor_inertia + self.gear.inertia
        return self.load.mean_inertia / self.gear.ratio**2 / own if own else math.inf

    @property
    def power(self) -> Array:
        """The electric power (n,) in W; that of the rotor where currents are not known."""
        return self.voltage * self.current if self.motor.is_electric else self.torque * self.speed

    @cached_property
    def drawn(self) -> float:
        """The energy in J that the motor takes in a cycle."""
        return self.samples.positive_part(self.power)

    @cached_property
    def returned(self) -> float:
        """The energy in J that flows back into its supply in a cycle, not negative."""
        return self.samples.positive_part(-self.power)

    @cached_property
    def copper_loss(self) -> float:
        """In J in a cycle, with the resistance that was used for the voltage."""
        return self.samples.integral(_resistance(self.motor, self.temperature) * self.current**2)

    @property
    def peak_current(self) -> float:
        """In A."""
        return float(np.max(np.abs(self.current)))

    @cached_property
    def rms_current(self) -> float:
        """In A."""
        return self.samples.rms(self.current)

    @property
    def peak_voltage(self) -> float:
        """In V."""
        return float(np.max(np.abs(self.voltage)))

    @property
    def hottest(self) -> float:
        """In °C."""
        return float(np.max(self.temperature))

    @cached_property
    def uses(self) -> dict[str, float]:
        """How much of each limit is used: 1 is all of it; infinite where the motor can do nothing at such a speed."""
        motor, gear = self.motor, self.gear
        braking = self.torque * self.speed < 0.0
        peak = motor.peak(np.where(braking & (np.abs(self.speed) <= motor.max_speed), 0.0, self.speed))
        continuous = float(motor.continuous(np.array([self.mean_speed]))[0])
        found = {
            "peak torque": float(np.max(_shares(np.abs(self.torque), peak))),
            "RMS torque": float(_shares(np.array([self.rms_torque]), np.array([continuous]))[0]),
            "speed": self.top_speed / motor.max_speed,
        }
        if math.isfinite(motor.voltage) and motor.is_electric:
            found["voltage"] = self.peak_voltage / motor.voltage
        if math.isfinite(motor.max_temperature) and not math.isnan(self.hottest):
            found["temperature"] = (self.hottest - self.ambient) / (motor.max_temperature - self.ambient)
        if math.isfinite(gear.max_effort):
            found["gear"] = self.load.peak / gear.max_effort
        return found

    @property
    def most_used(self) -> tuple[str, float]:
        """The limit that is used most."""
        name = max(self.uses, key=lambda one: self.uses[one])
        return name, self.uses[name]

    @property
    def suffices(self) -> bool:
        """Whether no limit is exceeded."""
        return self.most_used[1] <= 1.0 + SPARE


def motor_duty(load: LoadCycle, motor: MotorType, gear: GearType = DIRECT, ambient: float = AMBIENT) -> MotorDuty:
    """What a motor with a gear does in a cycle of a load.

    :param ambient: temperature of the surroundings in °C.
    """
    if motor.coulomb or gear.efficiency != 1.0:
        load = load.split
    speed = gear.ratio * load.speed
    torque = rotor_torque(load, motor, gear)
    current = torque / motor.torque_constant
    temperature = _temperatures(load.samples, motor, current, ambient)
    resistance = _resistance(motor, temperature)
    voltage = resistance * current + motor.torque_constant * speed
    if motor.inductance:
        voltage = voltage + motor.inductance * load.samples.derivative(current)
    return MotorDuty(motor, gear, load, ambient, speed, torque, current, voltage, temperature)


def effort_at_gear(load: LoadCycle, efficiency: float) -> Array:
    """The effort (n,) of a load with the losses of its gear, which help to brake; of a `split` one if there are any."""
    if efficiency == 1.0:
        return load.effort
    signs = load.samples.signs
    return np.asarray(load.effort * efficiency ** -(signs(load.effort) * signs(load.speed)))


def rotor_torque(load: LoadCycle, motor: MotorType, gear: GearType) -> Array:
    """The torque (n,) of the rotor in N·m."""
    speed, inertia = gear.ratio * load.speed, motor.rotor_inertia + gear.inertia
    friction = motor.coulomb * load.samples.signs(speed) + motor.viscous * speed
    driven = effort_at_gear(load, gear.efficiency) / gear.ratio
    return np.asarray(inertia * gear.ratio * load.acceleration + driven + friction)


def _shares(values: Array, limits: Array) -> Array:
    """values / limits; 0 where both are zero."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > 0.0, values / limits, 0.0)


def _resistance(motor: MotorType, temperature: Array) -> Array:
    """(n,) in Ω; that at 25 °C where the temperature is not known or not finite."""
    known = np.where(np.isfinite(temperature), temperature, WARM)
    return np.asarray(motor.resistance * (1.0 + motor.resistance_slope * (known - WARM)))


def _temperatures(samples: SampleTimes, motor: MotorType, current: Array, ambient: float) -> Array:
    """The temperature (n,) of the winding: exactly, for the mean of the square of the current in each interval."""
    if math.isnan(motor.thermal_resistance) or not motor.is_electric:
        return np.full(len(samples.times), np.nan)
    steps, squares = np.diff(samples.times), np.diff(samples.cumulative(current**2))
    mean = np.divide(squares, steps, out=np.zeros(len(steps)), where=steps > 0.0)
    heat = mean * motor.resistance * motor.thermal_resistance  # K at 25 °C, if it went on for ever
    if math.isnan(motor.thermal_time):  # the mean alone is known
        whole = samples.integral(current**2) / samples.duration * motor.resistance * motor.thermal_resistance
        return np.full(len(samples.times), _settled(whole, motor, ambient))
    # With x = T - T_ambient: x' = (heat (1 + slope (T_ambient - 25)) - (1 - heat slope) x) / t_th
    stiffness = 1.0 - heat * motor.resistance_slope
    drive = heat * (1.0 + motor.resistance_slope * (ambient - WARM))
    rate = stiffness * steps / motor.thermal_time
    if float(np.sum(np.maximum(-rate, 0.0))) > MOST_GROWTH:
        return np.full(len(samples.times), math.inf)
    factor = np.exp(-rate)
    small = np.abs(rate) < 1e-12
    gained = np.where(small, steps / motor.thermal_time, -np.expm1(-rate) / np.where(small, 1.0, stiffness))
    offsets = drive * gained
    start, found = 0.0, np.zeros(len(samples.times))
    if samples.cyclic:
        whole, end = 1.0, 0.0
        for a, b in zip(factor.tolist(), offsets.tolist(), strict=True):
            whole, end = a * whole, a * end + b
        if whole >= 1.0:
            return np.full(len(samples.times), math.inf)  # it becomes hotter in each cycle
        start = end / (1.0 - whole)
    found[0] = start
    for row, (a, b) in enumerate(zip(factor.tolist(), offsets.tolist(), strict=True)):
        found[row + 1] = a * found[row] + b
    return ambient + found


def _settled(heat: float, motor: MotorType, ambient: float) -> float:
    """The temperature in °C after a long time."""
    left = 1.0 - heat * motor.resistance_slope
    return ambient + heat * (1.0 + motor.resistance_slope * (ambient - WARM)) / left if left > 0.0 else math.inf
