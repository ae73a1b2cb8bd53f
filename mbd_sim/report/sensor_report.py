"""A sensor in the report of `mbd_sim check`."""

from __future__ import annotations

import math
from typing import Any

from mbd_sim.mechanism.sensors import (
    EXACT,
    AnySensor,
    CoordinateSensor,
    Encoder,
    ErrorModel,
    ForceTorque,
    MotorCurrent,
)


def sensor_report(sensor: AnySensor, step: float) -> dict[str, Any]:
    """Type, place, timing, and the errors of each quantity that has any, in SI units.

    :param step: in s.
    """
    pairs = list(zip(sensor.quantities, sensor.errors, strict=True))
    resolution = {"resolution": sensor.resolution} if isinstance(sensor, Encoder) else {}
    return {
        "name": sensor.name,
        "type": sensor.kind,
        "at": _place(sensor),
        "rate": 1.0 / step if sensor.sampling.rate is None else sensor.sampling.rate,
        "delay": sensor.sampling.delay,
        "drop_out": sensor.sampling.drop_out,
        "units": {quantity.name: quantity.unit for quantity in sensor.quantities},
        "errors": {
            quantity.name: {**_given(errors), **resolution}
            for quantity, errors in pairs
            if errors != EXACT or resolution
        },
    }


def _place(sensor: AnySensor) -> str:
    if isinstance(sensor, CoordinateSensor):
        return sensor.coordinate
    if isinstance(sensor, ForceTorque):
        return sensor.joint
    if isinstance(sensor, MotorCurrent):
        return sensor.actuator
    position = ", ".join(f"{value:.6g}" for value in sensor.at.pose.position + 0.0)
    return sensor.at.part if sensor.at.is_of_part else f"{sensor.at.part} [{position}]"


def _given(errors: ErrorModel) -> dict[str, float]:
    return {key: value for key, value in vars(errors).items() if value and math.isfinite(value)}
