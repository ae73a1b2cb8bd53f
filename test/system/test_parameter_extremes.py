"""Parameters of a node at the ends of their ranges and of double precision: the run goes on, or a reset restores it."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

from mbd_sim.ros.node.parameters import ParameterSpec
from mbd_sim.ros.node.sim_parameters import PARAMETERS
from test.system.nodes import Listener, nanoseconds, running

LEAST, LARGE = 5e-324, sys.float_info.max
NUMBERS = [one for one in PARAMETERS if one.live and isinstance(one.default, float | int) and one.low is not None]


def ends(spec: ParameterSpec) -> tuple[float, float]:
    assert spec.low is not None and spec.high is not None
    return spec.low, spec.high


def is_inside(spec: ParameterSpec, value: float) -> bool:
    low, high = ends(spec)
    return low <= value <= high


def extremes(spec: ParameterSpec) -> list[float | int]:
    """Values at the ends of a range, next to them, and outside it."""
    low, high = ends(spec)
    if isinstance(spec.default, int):
        return [int(low), int(high), int(low) - 1, int(high) + 1, 2**63 - 1, -(2**63)]
    inner = [low, math.nextafter(low, high), high]
    return [*inner, LEAST, 1e-9, -0.0, -LEAST, math.nextafter(high, math.inf), LARGE]


def set_value(listener: Listener, name: str, value: float | int) -> Any:
    """The answer to a request with exactly this number."""
    kind = ParameterType.PARAMETER_INTEGER if isinstance(value, int) else ParameterType.PARAMETER_DOUBLE
    field = "integer_value" if isinstance(value, int) else "double_value"
    message = Parameter(name=name, value=ParameterValue(type=kind, **{field: value}))
    return listener.call(SetParameters, "set_parameters", parameters=[message]).results[0]


def goes_on(listener: Listener, what: str) -> None:
    """Wait until later states arrive."""
    stamp = nanoseconds(listener.states[-1].header.stamp)
    listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) > stamp + 20_000_000, what)


def test_no_value_of_a_parameter_of_the_node_ends_the_run(tmp_path: Path) -> None:
    assert len(NUMBERS) > 8
    with running(tmp_path, record=True, record_dir=str(tmp_path)) as (process, listener):
        listener.until(lambda: listener.states, "joint states")
        for spec in NUMBERS:
            for value in extremes(spec):
                accepted = set_value(listener, spec.name, value).successful
                assert accepted == is_inside(spec, value), (spec.name, value)
                assert not accepted or listener.reset().success, (spec.name, value)
            assert set_value(listener, spec.name, spec.default).successful
            goes_on(listener, f"states after the extremes of {spec.name}")
        assert not [text for text in listener.events if "failed" in text]
        assert process.end() == 0
        assert "Traceback" not in process.text
