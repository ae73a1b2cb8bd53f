"""Joint coordinates and speeds, by the names that the expressions of forces use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from mbd_sim.dynamics.links import Link
from mbd_sim.dynamics.time_functions import function_of, time_functions
from mbd_sim.mechanism.expression import TIME, TimeExpression
from mbd_sim.mechanism.laws import ELONGATION, ELONGATION_RATE


class StateVariables:
    """The time t, and the coordinates and speeds of all joints of the tree, also of driven ones.

    `rows` are the indices in u of the coordinates that are not driven, by name.
    """

    def __init__(self, links: Sequence[Link], t: ca.SX, q: ca.SX, u: ca.SX) -> None:
        self._t, self._positions, self._speeds = t, dict[str, ca.SX](), dict[str, ca.SX]()
        self.rows: dict[str, int] = {}
        for link in links:
            joint, positions, speeds = link.joint, q[link.q], u[link.u]
            if joint.drive:
                positions, speeds, _ = time_functions(joint.drive, t)
            elif joint.kind.quaternion is not None:  # which has no coordinates of its rotation
                positions = positions[: joint.kind.quaternion]
            for index, name in enumerate(joint.motion_names):
                self._speeds[name] = speeds[index]
                if index < positions.shape[0]:
                    self._positions[name] = positions[index]
            self.rows |= dict(zip(joint.coordinate_names, range(link.u.start, link.u.stop), strict=True))

    def names(self, expression: TimeExpression) -> dict[str, ca.SX]:
        """The values of the names of an expression: those of the state, and the time unless a parameter hides it."""
        found = {} if TIME in expression.names else {TIME: self._t}
        for name in expression.state:
            found[name.written] = (self._speeds if name.speed else self._positions)[name.coordinate]
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
