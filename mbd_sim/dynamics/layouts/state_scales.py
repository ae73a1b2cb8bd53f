"""What the errors of a state are compared with besides its components: numbers with the units of the mechanism.

An angle is compared with 1 rad, a length with the size of the mechanism, a speed with these in a thousand steps, and an
energy with that of the mass at such a speed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, assert_never

from mbd_sim.dynamics.layouts.actuators import ActuatorLayout
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout
from mbd_sim.mechanism.elements.joint_types import STATES
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units, rounded

if TYPE_CHECKING:
    from mbd_sim.mechanism.elements.actuators import Actuator


def state_scales(
    mechanism: Mechanism, layout: CoordinateLayout, actuators: ActuatorLayout, step: float, core: int, size: int
) -> tuple[float, ...]:
    """The scales (size,) of the components of y.

    :param step: in s.
    :param core: the number of components before the energies.
    """
    units = natural_units(mechanism, step)
    length, rate = units.length, units.rate
    q, u = list[float](), list[float]()
    for joint in mechanism.joints.values():
        lengths = [1.0 if coordinate.rotation else length for coordinate in joint.kind.coordinates]
        if joint.drive:
            continue
        u += [value * rate for value in lengths]
        plain = joint.kind.nv if joint.kind.quaternion is None else joint.kind.quaternion
        q += lengths[:plain] + [1.0] * (joint.kind.nq - plain)
    for name in layout.drives:
        own = 1.0 if mechanism.joints[name].kind.coordinates[0].rotation else length
        q += [own * rate**power for power in range(STATES)]
    energy = units.mass * length**2 * rate**2
    result = [*q, *u, *[1.0] * (core - len(q) - len(u)), *[energy] * (size - core)]
    for actuator, slots in zip(mechanism.actuators, actuators.slots, strict=True):
        for name, index in slots.states.items():
            if index < core:
                result[index] = _of_actuator(actuator, name)
    return tuple(result)


def _of_actuator(actuator: Actuator, state: str) -> float:
    """The scale of a state with a rate: of the integral of a servo, or of a state of its machine."""
    from mbd_sim.mechanism.elements.actuators import DcMotor, EffortMotor, FluidCylinder

    if state == "integral":
        return rounded(actuator.output_limit)
    match actuator.motor:
        case FluidCylinder(supply=supply):
            return rounded(supply)
        case DcMotor():  # a current is compared with 1 A
            return 1.0
        case EffortMotor():
            raise AssertionError(f"an effort motor has no state '{state}'")
        case _:
            assert_never(actuator.motor)
