"""The force of a hydraulic or pneumatic cylinder, the rates of its pressures, and the power of its fluid.

The valve's opening y is between -1 and 1. With y > 0 it connects chamber A to the supply and B to the tank, otherwise
the other way round (Merritt, sec. 5-1; Jelali & Kroll, sec. 4.3). With the flow Q into a chamber of the volume V:

- oil: V p' = β (Q - V'), with Q = |y| K s(Δp) in m³/s at the density in the chamber (Merritt, eqs. 3-24 and 6-3).
- gas: V p' = n (G - p V'), with G = R T ṁ = |y| C p₀ p₁ ψ in W, p₀ = 100 kPa and the higher pressure p₁. ψ is 1 as long
  as the ratio of pressures is at most b, and then the quarter of an ellipse (ISO 6358-1).

The root s(Δp) = Δp / (Δp² + δ²)^¼ has a finite slope at zero. In ψ = √(d (2 - d)), with d = (1 - p₂/p₁)/(1 - b), it
stands for √d.

The energy of the fluid is counted as the work that it can do until it has expanded slowly to the ambient pressure, by
the same law of its density. Oil with the density ρ₀ exp(p/β) stores V β (exp(p/β) - 1 - p/β) in a chamber, and carries
β (1 - exp(-p/β)) per volume at ambient density. Gas stores V (p φ - (p - pₐ)), and carries φ per unit of R T ṁ, with
φ = n/(n - 1) (1 - (pₐ/p)^((n-1)/n)), or ln(p/pₐ) if n = 1.

Integrating the throttling loss as such would take a logarithm or an exponential for each chamber. By parts it takes
none: of both fluids, what enters a chamber behind its orifices is the change of E + V (p - pₐ), less ∫ V p' dt, with
the stored energy E. What the fluid carries to the orifices, less that, is lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import assert_never

import casadi as ca

from mbd_sim.dynamics.math.spatial import between, is_absent, is_symbolic
from mbd_sim.mechanism.elements.actuators import FluidCylinder, Gas, Oil

REFERENCE_PRESSURE = 1e5  # Pa, to which sonic conductances refer


@dataclass(frozen=True, eq=False)
class CylinderOutput:
    """What a cylinder does at a moment; pairs are of the chambers A and B.

    `effort` in N pushes outwards. `flows` through the valve into the chambers are in m³/s for oil, and R T ṁ in W for a
    gas; `pressure_rates` in Pa/s. `fluid_power` in W enters through the supply, less what leaves to the tank; of it,
    `throttling_loss` is lost in the valve and at the piston. `compression` is the sum of V p' of the chambers, in W.
    """

    effort: ca.SX
    pressures: Sequence[ca.SX]
    flows: Sequence[ca.SX]
    pressure_rates: Sequence[ca.SX]
    fluid_power: ca.SX
    throttling_loss: ca.SX
    compression: ca.SX


def cylinder_output(
    cylinder: FluidCylinder, command: ca.SX, pressures: Sequence[ca.SX], position: ca.SX, speed: ca.SX
) -> CylinderOutput:
    """A cylinder at the position and the speed of its port in m and m/s.

    :param command: the opening of the valve, which is limited to -1 and 1.
    :param pressures: in the two chambers, in Pa.
    """
    opening = between(command, -1.0, 1.0)
    extends, size = opening > 0.0, ca.fabs(opening)
    sources = [ca.if_else(extends, first, second) for first, second in _ends(cylinder)]
    flows = [size * _flow(cylinder, cylinder.fluid.valve, *pair) for pair in zip(sources, pressures, strict=True)]
    leak = ca.SX(1, 1)
    if not is_absent(cylinder.fluid.leakage):
        leak = _leak(cylinder, *pressures)
    volumes, sweeps = _volumes(cylinder, position), (cylinder.areas[0] * speed, -cylinder.areas[1] * speed)
    compressions = [
        _compression(cylinder.fluid, pressure, flow, sweep)
        for pressure, flow, sweep in zip(pressures, (flows[0] - leak, flows[1] + leak), sweeps, strict=True)
    ]
    rates = [compression / volume for compression, volume in zip(compressions, volumes, strict=True)]
    power, loss = _powers(cylinder, extends, pressures, flows, leak)
    ambient = ambient_pressure(cylinder)
    effort = (pressures[0] - ambient) * cylinder.areas[0] - (pressures[1] - ambient) * cylinder.areas[1]
    return CylinderOutput(effort, pressures, flows, rates, power, loss, sum(compressions, ca.SX(1, 1)))


def fastest_rate(cylinder: FluidCylinder, position: float) -> float:
    """The rate in 1/s at which a pressure reaches that behind the fully open valve, at the position of the port in m.

    It is that of small pressure drops in the smaller chamber.
    """
    volume = min(float(volume) for volume in _volumes(cylinder, ca.SX(position)))
    match cylinder.fluid:
        case Oil(bulk_modulus=beta, valve=valve):
            return beta * valve / math.sqrt(cylinder.transition) / volume
        case Gas(exponent=n, valve=valve, critical_ratio=ratio):
            slope = math.sqrt(2.0 / (1.0 - ratio) * cylinder.supply / cylinder.transition)
            return n * valve * REFERENCE_PRESSURE * slope / volume
        case _:
            assert_never(cylinder.fluid)


def ambient_pressure(cylinder: FluidCylinder) -> float:
    """The pressure on the outside of the piston, in Pa."""
    return cylinder.tank if isinstance(cylinder.fluid, Gas) else 0.0


def _ends(cylinder: FluidCylinder) -> tuple[tuple[float, float], tuple[float, float]]:
    """The pressure that the valve connects each chamber to while it extends the cylinder, and while it retracts it."""
    return (cylinder.supply, cylinder.tank), (cylinder.tank, cylinder.supply)


def _volumes(cylinder: FluidCylinder, position: ca.SX) -> tuple[ca.SX, ca.SX]:
    travel = position - cylinder.retracted
    first, second = cylinder.dead_volumes
    return first + cylinder.areas[0] * travel, second + cylinder.areas[1] * (cylinder.stroke - travel)


def _root(drop: ca.SX, transition: float) -> ca.SX:
    """The square root of a pressure drop in √Pa, with its sign and a finite slope at zero."""
    return drop / ca.sqrt(ca.sqrt(drop**2 + transition**2))


def _flow(cylinder: FluidCylinder, valve: float, source: ca.SX, pressure: ca.SX) -> ca.SX:
    """The flow through an orifice from a source into a chamber."""
    match cylinder.fluid:
        case Oil():
            return valve * _root(source - pressure, cylinder.transition)
        case Gas(critical_ratio=ratio):
            upstream = ca.fmax(source, pressure)
            choked = upstream * (1.0 - ratio)  # the pressure drop from which on the flow is choked
            drop = between(source - pressure, -choked, choked)
            # ψ = s(Δp) √((2 - d)/choked) with d = |Δp|/choked, as one quotient
            square = (2.0 * choked - ca.fabs(drop)) / (choked**2 * ca.sqrt(drop**2 + cylinder.transition**2))
            return (valve * REFERENCE_PRESSURE) * upstream * drop * ca.sqrt(square)
        case _:
            assert_never(cylinder.fluid)


def _leak(cylinder: FluidCylinder, first: ca.SX, second: ca.SX) -> ca.SX:
    """The flow past the piston from chamber A to chamber B."""
    if isinstance(cylinder.fluid, Oil):
        return cylinder.fluid.leakage * (first - second)
    return _flow(cylinder, cylinder.fluid.leakage, first, second)


def _compression(fluid: Oil | Gas, pressure: ca.SX, flow: ca.SX, sweep: ca.SX) -> ca.SX:
    """V p' of a chamber in W; `flow` enters it, and its volume grows by `sweep` in m³/s."""
    match fluid:
        case Oil():
            return fluid.bulk_modulus * (flow - sweep)
        case Gas():
            return fluid.exponent * (flow - pressure * sweep)
        case _:
            assert_never(fluid)


def _powers(
    cylinder: FluidCylinder, extends: ca.SX, pressures: Sequence[ca.SX], flows: Sequence[ca.SX], leak: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """The power of the fluid that enters, and that which is lost in the valve and at the piston, in W.

    A flow from a pressure p to a lower one loses the difference of what it carries. At the density in the chamber, oil
    carries β (exp(p/β) - exp((p - p₁)/β)) per volume if it comes from the pressure p₁.
    """
    fluid, power, loss = cylinder.fluid, ca.SX(1, 1), ca.SX(1, 1)
    carried: list[ca.SX] = []
    for pressure, ends, flow in zip(pressures, _ends(cylinder), flows, strict=True):
        match fluid:
            case Oil(bulk_modulus=beta):
                density = _exponential(pressure * (1.0 / beta))
                first, second = (ca.exp(ca.SX(-end / beta)) for end in ends)
                kept = density * ca.if_else(extends, first, second)
                power += flow * (beta * (density - kept))
                loss += flow * (beta * (1.0 - kept))
                carried.append(beta * density)
            case Gas():
                own = _available(cylinder, pressure)
                first, second = (_available(cylinder, ca.SX(end)) for end in ends)
                source = ca.if_else(extends, first, second)
                power += flow * source
                loss += flow * (source - own)
                carried.append(own)
            case _:
                assert_never(fluid)
    if not is_absent(fluid.leakage):
        loss += leak * (carried[0] - carried[1])
    return power, loss


def _exponential(x: ca.SX) -> ca.SX:
    """exp(x) to round-off for |x| < 0.2 and to 1e-12 for |x| < 1, without a slow call of the C library."""
    quarter = 0.25 * x
    value = ca.SX(1.0)
    for divisor in range(9, 0, -1):
        value = 1.0 + quarter * value * (1.0 / divisor)
    return (value**2) ** 2


def _available(cylinder: FluidCylinder, pressure: ca.SX) -> ca.SX:
    """The work φ that a gas can do per unit of R T m."""
    assert isinstance(cylinder.fluid, Gas)
    n, logarithm = cylinder.fluid.exponent, ca.log(pressure * (1.0 / cylinder.tank))
    if not is_symbolic(n) and n == 1.0:
        return logarithm
    return n / (n - 1.0) * (1.0 - _exponential((1.0 - n) / n * logarithm))


def displaced_energy(cylinder: FluidCylinder, pressures: Sequence[ca.SX], position: ca.SX) -> ca.SX:
    """The sum of V (p - pₐ) of both chambers, in J."""
    ambient, volumes = ambient_pressure(cylinder), _volumes(cylinder, position)
    terms = (volume * (pressure - ambient) for volume, pressure in zip(volumes, pressures, strict=True))
    return sum(terms, ca.SX(1, 1))


def stored_energy(cylinder: FluidCylinder, pressures: Sequence[ca.SX], position: ca.SX) -> ca.SX:
    """The energy of the fluid in both chambers, in J."""
    total = ca.SX(1, 1)
    for volume, pressure in zip(_volumes(cylinder, position), pressures, strict=True):
        match cylinder.fluid:
            case Oil(bulk_modulus=beta):
                strain = pressure / beta
                total += volume * beta * (ca.exp(strain) - 1.0 - strain)
            case Gas():
                total += volume * (pressure * _available(cylinder, pressure) - (pressure - cylinder.tank))
            case _:
                assert_never(cylinder.fluid)
    return total
