"""Joint coordinates and speeds by name, and the values of expressions of them, as forces and couplings use them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca

from mbd_sim.dynamics.kinematics.drives import driven_motion
from mbd_sim.dynamics.kinematics.links import Link
from mbd_sim.dynamics.math.expressions import function_of
from mbd_sim.mechanism.values.expression import TIME, TimeExpression
from mbd_sim.mechanism.values.laws import ELONGATION, ELONGATION_RATE


class FunctionOfCoordinates(NamedTuple):
    """The `value` of an expression, and its partial derivatives in time and in each of its coordinates by name."""

    value: ca.SX
    time_slope: ca.SX
    slopes: Mapping[str, ca.SX]


def function_of_coordinates(
    expression: TimeExpression, coordinates: Mapping[str, ca.SX], t: ca.SX
) -> FunctionOfCoordinates:
    """An expression of time and coordinates, with these values."""
    names = sorted({name.coordinate for name in expression.state})
    symbols, time = ca.SX.sym("s", len(names)), ca.SX.sym("time")
    given = {name.written: symbols[names.index(name.coordinate)] for name in expression.state}
    value = function_of(expression, {**given, TIME: time})
    found = [value, ca.jacobian(value, time), *(ca.jacobian(value, symbols[i]) for i in range(len(names)))]
    actual = [ca.vertcat(ca.SX(0, 1), *(coordinates[name] for name in names)), t]
    value, time_slope, *slopes = ca.substitute(found, [symbols, time], actual)
    return FunctionOfCoordinates(value, ca.sparsify(time_slope), dict(zip(names, slopes, strict=True)))


class StateVariables:
    """The time `t`, and the `positions` and `speeds` of all joints of the tree by name, also of driven ones.

    `rows` are the indices in u of the coordinates that are not driven. Angular velocities have no positions.
    """

    def __init__(self, links: Sequence[Link], t: ca.SX, q: ca.SX, u: ca.SX) -> None:
        self.t, self.positions, self.speeds = t, dict[str, ca.SX](), dict[str, ca.SX]()
        self.rows: dict[str, int] = {}
        for link in links:
            joint, positions, speeds = link.joint, q[link.q], u[link.u]
            if joint.drive:
                positions, speeds, _ = driven_motion(link, t, q)
            elif joint.kind.quaternion is not None:  # which has no coordinates of its rotation
                positions = positions[: joint.kind.quaternion]
            for index, name in enumerate(joint.motion_names):
                self.speeds[name] = speeds[index]
                if index < positions.shape[0]:
                    self.positions[name] = positions[index]
            self.rows |= dict(zip(joint.coordinate_names, range(link.u.start, link.u.stop), strict=True))

    def names(self, expression: TimeExpression) -> dict[str, ca.SX]:
        """The values of the names of an expression: those of the state, and the time unless a parameter hides it."""
        found = {} if TIME in expression.names else {TIME: self.t}
        for name in expression.state:
            found[name.written] = (self.speeds if name.speed else self.positions)[name.coordinate]
        return found

    def value(self, expression: TimeExpression, variables: Mapping[str, ca.SX] | None = None) -> ca.SX:
        """The value of an expression, with these values of its own variables."""
        return function_of(expression, {**self.names(expression), **(variables or {})})

    def stretched(self, expression: TimeExpression, x: ca.SX, rate: ca.SX) -> ca.SX:
        """The force of a spring against its elongation x in m or rad, which changes at this rate in m/s or rad/s."""
        return self.value(expression, {ELONGATION: x, ELONGATION_RATE: rate})

    def vector(self, expressions: Sequence[TimeExpression]) -> ca.SX:
        """The values (n,) of expressions."""
        return ca.vertcat(*map(self.value, expressions))
