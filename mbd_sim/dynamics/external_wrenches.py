"""The wrenches on parts as symbols among the inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.input_layout import InputLayout


@dataclass(frozen=True, eq=False)
class ExternalWrench:
    """A wrench on a part, in the order in which the inputs hold it.

    `force` (3,) in N and `couple` (3,) in N·m are expressed in ground's axes, `own_force` (3,) and `own_couple` (3,)
    in the part's axes, with which they rotate. Both forces act at the `point` (3,) in m in the part's frame.
    """

    force: ca.SX
    couple: ca.SX
    own_force: ca.SX
    own_couple: ca.SX
    point: ca.SX


def external_wrenches(layout: InputLayout, inputs: ca.SX) -> Mapping[str, ExternalWrench]:
    """The symbols of the wrench on each loaded part."""
    return {part: ExternalWrench(*ca.vertsplit(inputs[span], 3)) for part, span in layout.wrenches.items()}
