"""The service `set_parameters`, so that a node accepts its own dump from `ros2 param load`.

`ros2 param load` reads each value of its file a second time as YAML. A small number such as 1e-05 then arrives as a
string, because the numbers of YAML 1.1 have a point, and a string such as 2024 as a number.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import yaml
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value, parameter_value_to_python

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
