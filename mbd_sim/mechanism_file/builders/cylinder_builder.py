"""Builds the hydraulic and pneumatic cylinders of a mechanism from their records in the file."""

from __future__ import annotations

import math

from mbd_sim.mechanism.actuators import Port
from mbd_sim.mechanism.cylinders import Cylinder, Gas, Oil
from mbd_sim.mechanism.source import Location
from mbd_sim.mechanism_file.builders.build_context import BuildContext
from mbd_sim.mechanism_file.schema.actuator_schema import (
    HydraulicCylinderSpec,
    PneumaticCylinderSpec,
)

TRANSITION = {"hydraulic_cylinder": 1e5, "pneumatic_cylinder": 1e3}  # Pa


def build_cylinder(
    location: Location, spec: HydraulicCylinderSpec | PneumaticCylinderSpec, port: Port, context: BuildContext
) -> Cylinder:
    """The cylinder of an actuator; a problem is reported to `context`."""
    if port.rotation:
        context.report(location, "a cylinder moves along a line, but acts on an angle", "Give 'between' two points.")
    if isinstance(spec, HydraulicCylinderSpec):
        fluid: Oil | Gas = Oil(spec.bulk_modulus, spec.rated_flow / math.sqrt(spec.rated_drop), spec.leakage)
        tank = spec.tank
    else:
        fluid, tank = Gas(spec.exponent, spec.conductance, spec.critical_ratio, spec.leakage), spec.exhaust
    return Cylinder(
        fluid=fluid,
        areas=spec.areas,
        dead_volumes=spec.dead_volumes,
        retracted=spec.retracted or 0.0,
        stroke=spec.stroke,
        supply=spec.supply,
        tank=tank,
        transition=TRANSITION[spec.type] if spec.transition is None else spec.transition,
        pressures=spec.pressures or (tank, tank),
    )
