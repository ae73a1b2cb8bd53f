"""Parameters of a node at the ends of their ranges and of double precision: the run goes on, or a reset restores it."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters

from mbd_sim.ros.node.parameters import ParameterSpec
from mbd_sim.ros.node.sim_parameters import PARAMETERS
from test.system.nodes import Listener, nanoseconds, running

LEAST, SMALL, LARGE = 5e-324, sys.float_info.min, sys.float_info.max
NUMBERS = [one for one in PARAMETERS if one.live and isinstance(one.default, float | int) and one.low is not None]


def extremes(spec: ParameterSpec) -> list[float | int]:
    """Values at the ends of a range, next to them, and outside it."""
    low, high = spec.low, spec.high
    assert low is not None and high is not None
    if isinstance(spec.default, int):
        return [int(low), int(high), int(low) - 1, int(high) + 1, 2**63 - 1, -(2**63)]
    inner = [low, math.nextafter(low, high), math.nextafter(high, low), high]
    return [*inner, LEAST, SMALL, 1e-300, 1e-15, 1e-9, -0.0, -LEAST, math.nextafter(high, math.inf), LARGE, -LARGE]


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
                inside = spec.low <= value <= spec.high  # type: ignore[operator]
                assert set_value(listener, spec.name, value).successful == inside, (spec.name, value)
                assert listener.reset().success, (spec.name, value)
            assert set_value(listener, spec.name, spec.default).successful
            goes_on(listener, f"states after the extremes of {spec.name}")
        assert not [text for text in listener.events if "failed" in text]
        assert process.end() == 0
        assert "Traceback" not in process.text


@pytest.mark.parametrize("value", [0.0, LEAST, -LARGE])
def test_no_live_value_of_the_mechanism_ends_the_run_for_good(tmp_path: Path, value: float) -> None:
    with running(tmp_path, mechanism="moving_support_pendulum", live="all") as (process, listener):
        listener.until(lambda: listener.states, "joint states")
        declared = listener.call(ListParameters, "list_parameters").result.names
        found = {name: listener.parameter(name) for name in declared}
        own = {spec.name for spec in PARAMETERS}
        names = [name for name, value in found.items() if isinstance(value, float) and name not in own]
        assert len(names) > 2
        for name in names:
            accepted = set_value(listener, name, value).successful
            listener.reset()
            if accepted:
                assert set_value(listener, name, found[name]).successful
        assert listener.reset().success
        listener.pause(False)
        goes_on(listener, "states after the reset")
        assert not [text for text in listener.events if "failed" in text]
        assert process.end() == 0
        assert "Traceback" not in process.text
