"""The parameters of `sim_node`: declared with what they mean, their range, and whether they may change live."""

from __future__ import annotations

import difflib
import math
import re
from array import array
from collections.abc import Callable, Mapping, Sequence
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

from mbd_sim.errors import nearest

FOREIGN = ("qos_overrides.",)  # parameters that rclpy declares later, by itself
ALIKE = 0.7  # how alike an unknown name and one of ours must be to count as misspelled


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
    Declared("step_on_command", False, "while paused, each command comes with step_count steps", live=True),
    Declared("reset_rewinds_clock", False, "whether ~/reset sets /clock back to zero", live=True),
    Declared("record", True, "record the run from the start; ~/record starts and stops"),
    Declared("record_dir", "recordings", "folder of the recordings, from where the node was started"),
    Declared("record_format", "mcap", "mcap: one file; rosbag2: a folder with metadata.yaml"),
    Declared(
        "record_split_size", 0.0, "MB after which a recording goes on in another file; 0: never",
        0.0, 1e9, live=True,
    ),
    Declared(
        "record_split_duration", 0.0, "simulated s after which a recording goes on in another file; 0: never",
        0.0, 1e9, live=True,
    ),
    Declared("wrenches", "*", "what takes wrenches: part, part.point, separated by commas; *: all; empty: none"),
    Declared(
        "live", "gravity[*], parameters.*, forces.*, joints.*.stiffness, joints.*.damping",
        "values of the mechanism's file that are parameters of this node; empty: none",
    ),
    Declared("rerun", "", "show the run in Rerun: spawn, serve, connect, connect:URL, or a file.rrd; empty: no"),
    Declared("rerun_rate", 60.0, "updates of the Rerun scene per simulated second", 1.0, 10_000.0),
    Declared("rerun_traces", "", "what leaves a trace: part, part.point, separated by commas; empty: ends of chains"),
    Declared("rerun_trace_time", 1.0, "how long a trace stays, in simulated s", 0.01, 1e6),
    Declared("marker_rate", 30.0, "markers per simulated second, where somebody listens; 0: none", 0.0, 1000.0),
    Declared("joint_reactions", False, "publish the force and moment that go through each joint"),
    Declared("constraint_violation", False, "publish how far loops and constraints are off"),
    Declared("part_poses", "", "parts whose poses are published, separated by commas, or *; empty: none"),
    Declared("tf", False, "publish the poses of all parts on /tf; not beside robot_state_publisher. Needs tf2_msgs"),
    Declared("frame_prefix", "", "put before the names of frames, for several instances: name/"),
    Declared("real_time_priority", 20, "of the stepping thread (SCHED_FIFO), where permitted; 0: ordinary", 0, 90),
)  # fmt: skip


def _descriptor(declared: Declared) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=declared.description, read_only=not declared.live)
    if not declared.live:
        descriptor.additional_constraints = "needed to build the node: give it at the start"
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
    """The node's parameters as plain values, and the live values of its mechanism."""

    def __init__(
        self, node: Node, on_change: Callable[[str, Any], None], known: Sequence[Declared] = PARAMETERS
    ) -> None:
        """Declare all; `on_change(name, value)` hears of changes while the node runs.

        :raises ValueError: a value given at start is of the wrong type or out of range.
        """
        self._node, self._on_change = node, on_change
        self._known = {declared.name: declared for declared in known}
        self._values: dict[str, Any] = {}
        self._live: dict[str, list[str]] = {}
        self._set_live: Callable[[Mapping[str, float]], str] = lambda changes: ""
        for declared in known:
            value = node.declare_parameter(declared.name, declared.default, _descriptor(declared)).value
            if problem := _problem(declared, value):
                raise ValueError(problem)
            self._values[declared.name] = type(declared.default)(value)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    @property
    def values(self) -> dict[str, Any]:
        """All but the mechanism's live values."""
        return dict(self._values)

    def listed(self, name: str) -> list[str]:
        """The entries of a parameter that holds names separated by commas."""
        return [entry.strip() for entry in self._values[name].split(",") if entry.strip()]

    def add_live(self, live: Mapping[str, float], set_live: Callable[[Mapping[str, float]], str]) -> dict[str, float]:
        """Declare the mechanism's live values; `set_live` changes some and returns what went wrong, or "".

        Those that differ from the file's, as given at the start, are returned. Keys with an index are one parameter:
        `gravity` is an array of three.

        :raises ValueError: a value given at start does not fit, or the name of one is misspelled.
        """
        self._set_live = set_live
        for key in live:
            self._live.setdefault(re.sub(r"\[\d+\]$", "", key), []).append(key)
        given: dict[str, float] = {}
        for name, keys in self._live.items():
            default = live[keys[0]] if keys == [name] else [live[key] for key in keys]
            descriptor = ParameterDescriptor(
                description="of the mechanism's file, in SI units; may change at any time", dynamic_typing=True
            )
            value = self._node.declare_parameter(name, default, descriptor).value
            changes, problem = self._live_changes(name, value)
            if problem:
                raise ValueError(problem)
            given |= {key: new for key, new in changes.items() if new != live[key]}
        return given

    def finish(self) -> list[str]:
        """Begin to hear of changes; returns parameters given at the start that mean nothing here.

        :raises ValueError: one looks like a misspelled name.
        """
        self._node.add_on_set_parameters_callback(self._set)
        return _unknown(self._node, [*self._known, *self._live, "use_sim_time", "start_type_description_service"])

    def _set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        changes: dict[str, Any] = {}
        live: dict[str, float] = {}
        for parameter in parameters:
            if (declared := self._known.get(parameter.name)) is not None:
                problem = _problem(declared, parameter.value)
                if not problem:
                    changes[parameter.name] = type(declared.default)(parameter.value)
            elif parameter.name in self._live:
                found, problem = self._live_changes(parameter.name, parameter.value)
                live |= found
            else:
                continue
            if problem:
                return SetParametersResult(successful=False, reason=problem)
        if live and (problem := self._set_live(live)):
            return SetParametersResult(successful=False, reason=problem)
        for name, value in changes.items():
            self._values[name] = value
            self._on_change(name, value)
        return SetParametersResult(successful=True)

    def _live_changes(self, name: str, value: Any) -> tuple[dict[str, float], str]:
        """The live values that a parameter's value means, or why it cannot be taken."""
        keys = self._live[name]
        values = [value] if keys == [name] else list(value) if isinstance(value, Sequence | array) else []
        if len(values) != len(keys) or not all(_finite(number) for number in values):
            wanted = "a number" if keys == [name] else f"{len(keys)} numbers"
            return {}, f"parameter '{name}' must be {wanted}, not {value!r}"
        return dict(zip(keys, map(float, values), strict=True)), ""


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _unknown(node: Node, known: Sequence[str]) -> list[str]:
    """Parameters given at the start that are none of the node's: rclpy passes over them in silence.

    :raises ValueError: one looks like a misspelled name.
    """
    unknown = [name for name in node._parameter_overrides if name not in known and not name.startswith(FOREIGN)]
    for name in unknown:
        if difflib.get_close_matches(name, known, n=1, cutoff=ALIKE):
            raise ValueError(f"there is no parameter '{name}'. {nearest(name, known)}")
    return unknown


def _problem(declared: Declared, value: Any) -> str:
    """Why a value cannot be taken, or ""."""
    wanted = type(declared.default)
    fits = isinstance(value, wanted) and not (wanted is int and isinstance(value, bool))
    if wanted is float:
        fits = _finite(value)
    if not fits:
        return f"parameter '{declared.name}' must be of type {wanted.__name__}, not {value!r}: {declared.description}"
    low, high = declared.low, declared.high
    if low is not None and high is not None and not low <= value <= high:
        return f"parameter '{declared.name}' must lie between {low:g} and {high:g}, not {value!r}"
    return ""
