"""The parameters of a node as others see them: in what it prints for `--help`, and as launch arguments.

The help has usage, parameters with their defaults, topics and services. Launch arguments come from the declarations of
the parameters, so that no parameter can be forgotten in a launch file. The launch files of this package use them, and
those of other packages may; this needs no DDS.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from mbd_sim.ros.node.parameters import ParameterSpec

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
