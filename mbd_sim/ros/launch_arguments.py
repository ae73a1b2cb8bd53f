"""Launch arguments from the declarations of a node's parameters: no parameter can be forgotten in a launch file.

The launch files of this package use it, and those of other packages may; it needs no DDS.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mbd_sim.ros.node_parameters import ParameterSpec


def written(value: Any) -> str:
    """A parameter's value as a launch argument."""
    return str(value).lower() if isinstance(value, bool) else str(value)


def argument_rows(specs: Sequence[ParameterSpec]) -> list[tuple[str, str, str, type]]:
    """The name, default, description and type of the launch argument of each parameter."""
    return [(spec.name, written(spec.default), spec.description, type(spec.default)) for spec in specs]
