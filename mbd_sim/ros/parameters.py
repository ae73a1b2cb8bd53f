"""The parameters of `sim_node`: declared with what they mean, their range, and whether they may change live."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter


@dataclass(frozen=True)
class Declared:
    """A parameter: its default, its meaning, its range, and whether it may be set while the node runs."""

    name: str
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    live: bool = False


PARAMETERS = (
    Declared("mechanism", "double_rod", "a mechanism file (.yaml), a robot's .urdf, or the name of one that ships"),
    Declared("method", "", "integration method; empty: that of the mechanism's file"),
    Declared("step", 0.0, "integration step in s; 0: that of the mechanism's file", 0.0, 1.0),
    Declared("publish_rate", 100.0, "joint_states and energies per simulated second", 0.0, 100_000.0, live=True),
    Declared("clock_rate", 200.0, "/clock messages per simulated second; 0: none", 0.0, 100_000.0, live=True),
    Declared("real_time_factor", 1.0, "1: real time; 0: as fast as possible", 0.0, 1000.0, live=True),
    Declared("start_paused", False, "wait for ~/pause or ~/step before the first step"),
    Declared(
        "command_timeout", 0.5, "simulated s without a command after which efforts go to zero; 0: never",
        0.0, 1e6, live=True,
    ),
    Declared("step_count", 1, "steps that one call of ~/step takes", 1, 1_000_000, live=True),
    Declared("reset_rewinds_clock", False, "whether ~/reset sets /clock back to zero", live=True),
    Declared("record", True, "record the run to an MCAP file"),
    Declared("record_dir", "recordings", "folder of the recordings, from where the node was started"),
    Declared("rerun", "", "show the run in Rerun: spawn, serve, connect, connect:URL, or a file.rrd; empty: no"),
    Declared("rerun_rate", 60.0, "updates of the Rerun scene per simulated second", 1.0, 10_000.0),
)  # fmt: skip


def _descriptor(declared: Declared) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=declared.description, read_only=not declared.live)
    low, high = declared.low, declared.high
    if low is not None and high is not None:
        if isinstance(declared.default, int):
            descriptor.type = ParameterType.PARAMETER_INTEGER
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=0)]
        else:
            # A whole number written for a real one (`-p publish_rate:=50`) is taken as such.
            descriptor.dynamic_typing = True
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    return descriptor


class Parameters:
    """The node's parameters as plain values; `on_change(name, value)` hears of live changes."""

    def __init__(self, node: Node, on_change: Callable[[str, Any], None]) -> None:
        """Declare all.

        :raises ValueError: a value given at start is of the wrong type or out of range.
        """
        self._known = {declared.name: declared for declared in PARAMETERS}
        self._values: dict[str, Any] = {}
        self._on_change = on_change
        for declared in PARAMETERS:
            value = node.declare_parameter(declared.name, declared.default, _descriptor(declared)).value
            if problem := _problem(declared, value):
                raise ValueError(problem)
            self._values[declared.name] = type(declared.default)(value)
        node.add_on_set_parameters_callback(self._set)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    def _set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        changes = {}
        for parameter in parameters:
            declared = self._known.get(parameter.name)
            if declared is None:
                continue
            if problem := _problem(declared, parameter.value):
                return SetParametersResult(successful=False, reason=problem)
            changes[parameter.name] = type(declared.default)(parameter.value)
        for name, value in changes.items():
            self._values[name] = value
            self._on_change(name, value)
        return SetParametersResult(successful=True)


def _problem(declared: Declared, value: Any) -> str:
    """Why a value cannot be taken, or ""."""
    wanted = type(declared.default)
    fits = isinstance(value, wanted) and not (wanted is int and isinstance(value, bool))
    if wanted is float:
        fits = isinstance(value, int | float) and not isinstance(value, bool)
    if not fits:
        return f"parameter '{declared.name}' must be of type {wanted.__name__}, not {value!r}: {declared.description}"
    low, high = declared.low, declared.high
    if low is not None and high is not None and not low <= value <= high:
        return f"parameter '{declared.name}' must lie between {low:g} and {high:g}, not {value!r}"
    return ""
