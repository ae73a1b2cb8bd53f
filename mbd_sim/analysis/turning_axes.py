"""The axes of small rotations of spherical and free joints while these turn.

The speeds of such a joint have the angular velocity ω in the axes of its second part, and displacements ν a small
rotation δ in these axes. They turn with the part, so that δ' = δω - ω × δ. A part that spins about a fixed axis without
external moments has constant derivatives in these axes. A wheel that rolls straight on has them in the axes before the
joint instead, in which δ and δω have the components φ = R δ and R δω:

    φ' = R δω,    (R δω)' = R (δω' + ω × δω).

Eigenvalues say how small motions go on only in axes in which the derivatives stay constant.
"""

from __future__ import annotations

import numpy as np

from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.evaluation import evaluated
from mbd_sim.geometry.pose import Array

AHEAD = 1e-5  # s times 1/s: how far derivatives are compared, relative to the time of a radian
CONSTANT = 1e-7  # relative change of derivatives in the time of a radian that is round-off
STEADIER = 0.5  # the change of derivatives in the other axes, relative to that in the part's


def turning_of_parts(equations: Equations, u: Array) -> Array:
    """[ω]× of each spherical and free joint in its place (nv, nv), with zeros elsewhere."""
    found = np.zeros((len(u), len(u)))
    for name, joint in equations.mechanism.joints.items():
        if joint.kind.quaternion is not None and not joint.drive:
            span = slice(equations.layout.u[name].stop - 3, equations.layout.u[name].stop)
            x, y, z = u[span].tolist()
            found[span, span] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    return found


def steadier_before_joints(equations: Equations, t: float, y: Array, inputs: Array, turning: Array) -> bool:
    """Whether the derivatives change less in the axes before the joints than in those that turn with the parts.

    :param turning: see `turning_of_parts`.
    """
    columns, nv = equations.derivative_layout, len(turning)
    rates = evaluated(equations.rates, t, y, inputs).ravel()
    step = AHEAD / float(np.max(np.abs(turning)))

    def derivatives(after: float) -> Array:
        return evaluated(equations.derivatives, t + after, y + after * rates, inputs).T

    change, here = (derivatives(step) - derivatives(-step)) / (2.0 * step), derivatives(0.0)
    of_columns = np.zeros((columns.size, columns.size))
    of_columns[columns.displacements, columns.displacements] = turning
    of_columns[columns.speeds, columns.speeds] = turning
    otherwise = change - here @ of_columns
    otherwise[:nv] += turning @ here[:nv]
    state = slice(0, columns.states.stop)
    own, other, size = (float(np.linalg.norm(matrix[:, state])) for matrix in (change, otherwise, here))
    return own > CONSTANT * float(np.max(np.abs(turning))) * size and other < STEADIER * own
