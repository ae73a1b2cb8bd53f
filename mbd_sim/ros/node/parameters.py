"""A node's parameters: declared with their meaning and range, validated, and updated while the node runs.

Others see them in what the node prints for `--help`, and as launch arguments: from the declarations, so that a launch
file cannot omit one.

The service `set_parameters` is such that a node accepts its own dump from `ros2 param load`, which reads each value of
its file a second time as YAML. A small number such as 1e-05 then arrives as a string, because the numbers of YAML 1.1
have a point, and a string such as 2024 as a number.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import textwrap
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python

from mbd_sim.base.errors import nearest, quoted
from mbd_sim.mechanism.values.names import split_names

RCLPY_PREFIXES = ("qos_overrides.",)  # of parameters that rclpy itself declares later
ALL, WILDCARD = "all", "*"  # the former is what is dumped: `ros2 param load` cannot read the latter
SIMILARITY = 0.7  # of an unknown name to a known one from which it counts as misspelled


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter: its default, meaning and range, and whether it may be set while the node runs."""

    name: str
    default: Any
    description: str
    low: float | None = None
    high: float | None = None
    live: bool = False
    takes_all: bool = False  # names separated by commas, or "all", which may be written as *


def _descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=spec.description, read_only=not spec.live)
    if not spec.live:
        descriptor.additional_constraints = "read-only: set it when starting the node"
    low, high = spec.low, spec.high
    if low is not None and high is not None:
        if isinstance(spec.default, int):
            descriptor.type = ParameterType.PARAMETER_INTEGER
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=0)]
        else:
            # An integer is accepted for a floating-point parameter: `-p publish_rate:=50`.
            descriptor.dynamic_typing = True
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    return descriptor


class NodeParameters:
    """A node's parameters as plain values, and the live values of its mechanism."""

    def __init__(self, node: Node, specs: Sequence[ParameterSpec], on_change: Callable[[str, Any], None]) -> None:
        """Declare all parameters; `on_change(name, value)` is called for changes while the node runs.

        :raises ValueError: a value given at the start has the wrong type or is out of range.
        """
        self._node, self._on_change = node, on_change
        self._specs = {spec.name: spec for spec in specs}
        self._values: dict[str, Any] = {}
        self._live_keys: dict[str, list[str]] = {}
        self._fixed: dict[str, str] = {}
        self._check: Callable[[Mapping[str, Any]], str] = lambda values: ""
        self._current_live: Callable[[], Mapping[str, float]] = dict
        self._set_live: Callable[[Mapping[str, float]], str] = lambda changes: ""
        self._is_following = False
        for spec in specs:
            given = node._parameter_overrides.get(spec.name)
            if given is not None and (problem := _problem(spec, given.value)):  # rclpy's own message names no range
                raise ValueError(problem)
            if spec.takes_all and given is not None and given.value == WILDCARD:
                node._parameter_overrides[spec.name] = Parameter(spec.name, value=ALL)
            value = node.declare_parameter(spec.name, spec.default, _descriptor(spec)).value
            self._values[spec.name] = type(spec.default)(value)

    def __getitem__(self, name: str) -> Any:
        return self._values[name]

    @property
    def values(self) -> dict[str, Any]:
        """All parameters except the mechanism's live values."""
        return dict(self._values)

    def names_in(self, name: str) -> list[str]:
        """The entries of a parameter that holds names separated by commas; `*` for all."""
        entries = split_names(self._values[name])
        takes_all = self._specs[name].takes_all
        return [WILDCARD if takes_all and entry == ALL else entry for entry in entries]

    def is_default(self, name: str) -> bool:
        """Whether a parameter has its default, given or not."""
        return bool(self._values[name] == self._specs[name].default)

    def add_live(
        self, current: Callable[[], Mapping[str, float]], set_live: Callable[[Mapping[str, float]], str]
    ) -> dict[str, float]:
        """Declare the mechanism's live values; returns those given at the start, if any differs from the file's.

        Keys with an index form one parameter: `gravity` is an array of three.

        :param current: returns the live values.
        :param set_live: changes some of them and returns the problem, or "" on success.
        :raises ValueError: a value given at the start does not fit.
        """
        self._current_live, self._set_live = current, set_live
        live = current()
        for key in live:
            self._live_keys.setdefault(re.sub(r"\[\d+\]$", "", key), []).append(key)
        given: dict[str, float] = {}
        for name, keys in self._live_keys.items():
            default = live[keys[0]] if keys == [name] else [live[key] for key in keys]
            descriptor = ParameterDescriptor(
                description="a value of the mechanism file, in SI units; can be set at any time", dynamic_typing=True
            )
            value = self._node.declare_parameter(name, default, descriptor).value
            changes, problem = self._live_changes(name, value)
            if problem:
                raise ValueError(problem)
            if name in self._node._parameter_overrides:
                given |= changes
        return given if any(new != live[key] for key, new in given.items()) else {}

    def change_live(self, changes: Mapping[str, float]) -> str:
        """Change live values as the service does, and let the parameters show them; returns the problem, or ""."""
        problem = self._set_live(changes)
        self._follow_live(())
        return problem

    def check(self, problem: Callable[[Mapping[str, Any]], str]) -> None:
        """Refuse changes from now on that leave all parameters with a problem; it returns "" if there is none."""
        self._check = problem

    def fix(self, name: str, reason: str) -> None:
        """Refuse changes of a parameter from now on, for a reason that names the remedy."""
        self._fixed[name] = reason

    def finish(self) -> list[str]:
        """Accept changes from now on; returns the parameters given at the start that the node does not have.

        :raises ValueError: such a parameter looks like a misspelled one.
        """
        self._follow_live(())  # those that follow the ones given at the start
        self._node.add_on_set_parameters_callback(self._set)
        self._node.add_post_set_parameters_callback(self._follow_live)
        return _unknown(self._node, [*self._specs, *self._live_keys, "use_sim_time", "start_type_description_service"])

    def _follow_live(self, _: Sequence[Parameter]) -> None:
        """Let the parameters of live values show the present ones: a change may change others by their formulas."""
        if self._is_following:
            return
        live, shown = self._current_live(), []
        for name, keys in self._live_keys.items():
            values = [live[key] for key in keys]
            if self._live_changes(name, self._node.get_parameter(name).value)[0] != dict(
                zip(keys, values, strict=True)
            ):
                shown.append(Parameter(name, value=values[0] if keys == [name] else values))
        if shown:
            self._is_following = True
            try:
                self._node.set_parameters(shown)
            finally:
                self._is_following = False

    def _set(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        if self._is_following:
            return SetParametersResult(successful=True)
        changes: dict[str, Any] = {}
        live: dict[str, float] = {}
        for parameter in parameters:
            if (reason := self._fixed.get(parameter.name)) and not self._is_current(parameter):
                return SetParametersResult(successful=False, reason=reason)
            if (spec := self._specs.get(parameter.name)) is not None:
                problem = _problem(spec, parameter.value)
                if not problem:
                    changes[parameter.name] = type(spec.default)(parameter.value)
            elif parameter.name in self._live_keys:
                found, problem = self._live_changes(parameter.name, parameter.value)
                live |= found
            elif not parameter.name:  # rclpy accepts it
                problem = "a parameter has no name."
            else:
                continue
            if problem:
                return SetParametersResult(successful=False, reason=problem)
        if changes and (problem := self._check(self._values | changes)):
            return SetParametersResult(successful=False, reason=problem)
        if live and (problem := self._set_live(live)):
            return SetParametersResult(successful=False, reason=problem)
        self._values |= changes
        for name, value in changes.items():
            self._on_change(name, value)
        return SetParametersResult(successful=True)

    def _is_current(self, parameter: Parameter) -> bool:
        return bool(parameter.value == self._node.get_parameter(parameter.name).value)

    def _live_changes(self, name: str, value: Any) -> tuple[dict[str, float], str]:
        """The live values that a parameter's value sets, and the problem with it, or ""."""
        keys = self._live_keys[name]
        values = [value] if keys == [name] else list(value) if isinstance(value, Sequence | array) else []
        if len(values) != len(keys) or not all(_is_finite(number) for number in values):
            expected = "a number" if keys == [name] else f"{len(keys)} numbers"
            return {}, f"parameter '{name}' must be {expected}, not {_shown(value)}."
        return dict(zip(keys, map(float, values), strict=True)), ""


def _shown(value: Any) -> str:
    return quoted(list(value) if isinstance(value, array) else value, 100)


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _unknown(node: Node, known: Sequence[str]) -> list[str]:
    """Parameters given at the start that the node does not have: rclpy ignores them silently.

    :raises ValueError: one of them looks like a misspelled name.
    """
    unknown = [name for name in node._parameter_overrides if name not in known and not name.startswith(RCLPY_PREFIXES)]
    for name in unknown:
        if difflib.get_close_matches(name, known, n=1, cutoff=SIMILARITY):
            raise ValueError(f"there is no parameter '{name}'. {nearest(name, known)}")
    return unknown


def _problem(spec: ParameterSpec, value: Any) -> str:
    """Why a value is not accepted, or ""."""
    expected = type(spec.default)
    fits = isinstance(value, expected) and not (expected is int and isinstance(value, bool))
    if expected is float:
        fits = _is_finite(value)
    if not fits:
        return f"parameter '{spec.name}' must be of type {expected.__name__}, not {_shown(value)} ({spec.description})."
    low, high = spec.low, spec.high
    if low is not None and high is not None and not low <= value <= high:
        return f"parameter '{spec.name}' must lie between {low:g} and {high:g}, not {value!r}."
    return ""


NUMBERS = (Parameter.Type.INTEGER, Parameter.Type.DOUBLE, Parameter.Type.INTEGER_ARRAY, Parameter.Type.DOUBLE_ARRAY)

Service = Callable[[Any, Any], Any]  # (request, response) -> response


def set_one_at_a_time(node: Node, callback: Service, reason_of: Callable[[Exception], str]) -> Service:
    """`set_parameters` that answers each parameter separately, also if rclpy cannot read it.

    A value that is in effect already is accepted, even of a read-only parameter.

    :param callback: rclpy's own service.
    :param reason_of: describes an exception in the answer.
    """

    def set_parameter(parameter: ParameterMessage) -> SetParametersResult:
        if node.has_parameter(parameter.name):
            current = node.get_parameter(parameter.name)
            if _is_current(parameter.value, current):
                return SetParametersResult(successful=True)
            if node.describe_parameter(parameter.name).read_only:
                reason = f"parameter '{parameter.name}' is read-only: set it when starting the node"
                return SetParametersResult(successful=False, reason=reason)
            parameter = ParameterMessage(name=parameter.name, value=_as_number(parameter.value, current))
        else:
            return SetParametersResult(successful=False, reason=_undeclared(node, parameter.name))
        single = callback(SetParameters.Request(parameters=[parameter]), SetParameters.Response())
        return single.results[0]

    def set_parameters(request: Any, response: Any) -> Any:
        for parameter in request.parameters:
            try:
                response.results.append(set_parameter(parameter))
            except Exception as error:
                reason = f"parameter '{parameter.name}': {reason_of(error)}"
                response.results.append(SetParametersResult(successful=False, reason=reason))
        return response

    return set_parameters


def _undeclared(node: Node, name: str) -> str:
    """Why a parameter that the node does not have cannot be set."""
    known = [other for other in node._parameters if not other.startswith(RCLPY_PREFIXES)]
    hint = ""
    if "." in name and "live" in known:
        hint = (
            " Numbers of the mechanism file are parameters if 'live' names them at the start and they can change in a "
            "run: a joint with a drive, for example, has no damping, and the sizes of boxes that touch are built in."
        )
    return f"there is no parameter '{name}'. {nearest(name, known)}{hint}"


def _is_current(value: ParameterValue, current: Parameter) -> bool:
    """Whether a value is the present one, or what `ros2 param load` makes of it."""
    present = current.get_parameter_value()
    if value == present:
        return True
    try:
        return bool(value == get_parameter_value(str(parameter_value_to_python(present))))
    except (yaml.YAMLError, ValueError, RecursionError):
        return False


def _as_number(value: ParameterValue, current: Parameter) -> ParameterValue:
    """The number, or the numbers, that a string stands for where the parameter holds numbers; else the value."""
    if value.type != ParameterType.PARAMETER_STRING or current.type_ not in NUMBERS:
        return value
    try:
        read = json.loads(value.string_value)
    except (ValueError, RecursionError):
        return value
    numbers = read if isinstance(read, list) else [read]
    if not numbers or any(isinstance(number, bool) or not isinstance(number, int | float) for number in numbers):
        return value
    found = [float(number) for number in numbers]
    return Parameter(current.name, value=found if isinstance(read, list) else found[0]).get_parameter_value()


WIDTH, INDENT = 110, 28

Rows = Sequence[tuple[str, str]]  # (name, meaning)


def program_help(
    name: str, description: str, example: str, parameters: Sequence[ParameterSpec], sections: Mapping[str, Rows]
) -> str:
    """The whole text.

    :param example: a parameter for the usage line, such as `mechanism:=double_rod`.
    :param sections: further tables by their heading.
    """
    blocks = [
        f"usage: ros2 run mbd_sim {name} [--ros-args -p {example} ...]",
        textwrap.fill(description, WIDTH),
        _table("parameters, each after -p (*: can be changed while the node runs)", _parameter_rows(parameters)),
        *(_table(heading, rows) for heading, rows in sections.items() if rows),
    ]
    return "\n\n".join(blocks)


def _parameter_rows(parameters: Sequence[ParameterSpec]) -> Rows:
    return [(f"{spec.name}{' *' if spec.live else ''}", _meaning(spec)) for spec in parameters]


def _meaning(spec: ParameterSpec) -> str:
    limits = f"; {spec.low:g} to {spec.high:g}" if spec.low is not None and spec.high is not None else ""
    return f"{spec.description} (default: {written(spec.default)}{limits})"


def written(value: Any) -> str:
    """A parameter's value as on the command line."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, str) else str(value)


def _table(heading: str, rows: Rows) -> str:
    lines = [f"{heading}:"]
    for name, meaning in rows:
        first = f"  {name}".ljust(INDENT)
        wrapped = textwrap.wrap(meaning, WIDTH - INDENT, break_on_hyphens=False) or [""]
        if len(first) > INDENT:
            lines.append(first)
            first = " " * INDENT
        lines += [first + wrapped[0], *(" " * INDENT + line for line in wrapped[1:])]
    return "\n".join(lines)


def as_yaml(value: Any) -> str:
    """A parameter's value as a launch argument."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def argument_rows(specs: Sequence[ParameterSpec]) -> list[tuple[str, str, str, type]]:
    """The name, default, description and type of the launch argument of each parameter."""
    return [(spec.name, as_yaml(spec.default), spec.description, type(spec.default)) for spec in specs]
