"""Hydraulic and pneumatic cylinders as plain records. SI units throughout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal


@dataclass(frozen=True)
class Oil:
    """A liquid with the `bulk_modulus` β in Pa, and a valve with the flow K √Δp in m³/s when it is fully open.

    `valve` is K in m³/(s·√Pa), and `leakage` in m³/(s·Pa) is the flow past the piston per pressure difference.
    """

    bulk_modulus: float
    valve: float
    leakage: float = 0.0


@dataclass(frozen=True)
class Gas:
    """An ideal gas whose changes of state have the polytropic `exponent` n; 1 is isothermal.

    `valve` and `leakage` in m³/(s·Pa) are the sonic conductances C by ISO 6358 of the fully open valve and of the gap
    at the piston, `critical_ratio` is b, the ratio of pressures up to which the flow is choked.
    """

    exponent: float
    valve: float
    critical_ratio: float
    leakage: float = 0.0


@dataclass(frozen=True)
class Cylinder:
    """A piston between two chambers, and a valve that connects one of them to the supply and the other to the tank.

    Chamber A, the first of each pair, extends the cylinder and has the opening of the valve as its sign: see
    `mbd_sim.dynamics.cylinders`. `areas` of the piston are in m², `dead_volumes` at the ends of the stroke in m³. The
    piston moves from the position `retracted` of the port over the `stroke`, in m.

    Pressures in Pa are absolute with a gas, and relative to the ambient pressure with oil. `pressures` are those at the
    start, and that of the `tank` also acts on the outside of the piston with a gas. Below a pressure difference of
    `transition` in Pa the flow becomes laminar.
    """

    fluid: Oil | Gas
    areas: tuple[float, float]
    dead_volumes: tuple[float, float]
    retracted: float
    stroke: float
    supply: float
    tank: float
    transition: float
    pressures: tuple[float, float]
    control: ClassVar[Literal["opening"]] = "opening"
    has_states: ClassVar[bool] = True
