"""Functions of the state that are traced when they are first read: accelerations, motions of parts, measurements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.dynamics.accelerations import ConstrainedMotion
from mbd_sim.dynamics.constraint_equations import ConstraintEquations
from mbd_sim.dynamics.dynamics_terms import DynamicsTerm, term_function
from mbd_sim.dynamics.frame_functions import FrameQuantity, center_function, frame_function, momentum_function
from mbd_sim.dynamics.frame_motion import coordinate_accelerations, part_motions
from mbd_sim.dynamics.tracing import TracedMechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.actuator_functions import ActuatorFunctions


@dataclass(frozen=True, eq=False)
class Measurements:
    """Functions of (t, y, inputs) in SI units; the inputs contain the contact forces, if there are contacts."""

    traced: TracedMechanism
    motion: ConstrainedMotion
    constraints: ConstraintEquations
    trace_reactions: Callable[[], ca.SX]

    @cached_property
    def accelerations(self) -> ca.Function:
        """u' (nv,), then the accelerations of the driven coordinates, in declared order."""
        return self._function("accelerations", coordinate_accelerations(self.traced, self.motion.u_rates))

    @cached_property
    def part_motions(self) -> ca.Function:
        """(12, parts) in ground's axes: the velocity of each origin, ω, the acceleration of the origin, and ω'."""
        return self._function("part_motions", part_motions(self.traced, self.motion.links))

    def frame(self, part: str | None, quantity: FrameQuantity) -> ca.Function:
        """(t, y, inputs, point) -> a quantity of a point of a part, see `frame_function`; None: the center of mass."""
        if part is None:
            return center_function(self.traced, quantity)
        return frame_function(self.traced, part, quantity)

    def term(self, term: DynamicsTerm) -> ca.Function:
        """(t, y, inputs, u') -> a term of the equations of motion, see `term_function`."""
        return term_function(self.traced, self.constraints, term)

    @property
    def momentum(self) -> ca.Function:
        """(6,): the linear momentum, and the angular one about ground's origin."""
        return momentum_function(self.traced)

    def sensors(self, actuators: ActuatorFunctions | None) -> dict[str, ca.Function]:
        """The exact values of each sensor by name, see `exact_values`, with the functions of the actuators."""
        from mbd_sim.dynamics.actuator_functions import MOTOR_READINGS
        from mbd_sim.dynamics.sensor_expressions import exact_values
        from mbd_sim.mechanism.sensors import ForceTorque

        sensors = self.traced.mechanism.sensors
        with_load = any(isinstance(sensor, ForceTorque) for sensor in sensors)
        reactions = self.trace_reactions() if with_load else ca.SX(6, 0)
        links, currents = self.motion.links, ca.SX(0, 1)
        if actuators is not None:
            (readings,) = actuators.readings.call([self.traced.state.t, self.traced.y, self.traced.inputs])
            currents = readings[MOTOR_READINGS.index("current"), :].T
        return {
            sensor.name: self._function(
                f"sensor_{number}", exact_values(self.traced, links, reactions, currents, sensor)
            )
            for number, sensor in enumerate(sensors)
        }

    def _function(self, name: str, output: ca.SX) -> ca.Function:
        inputs = [self.traced.state.t, self.traced.y, self.traced.inputs]
        return ca.Function(name, inputs, [ca.densify(output)], {"cse": True})
