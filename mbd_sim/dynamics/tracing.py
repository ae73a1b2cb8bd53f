"""The symbols of a mechanism's state and inputs, and the motion of its parts as expressions of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.energy import audit_states, kinetic_energy
from mbd_sim.dynamics.input_layout import InputLayout
from mbd_sim.dynamics.kinematics import (
    LinkMotion,
    SymbolicPose,
    coordinate_rates,
    link_motions,
    part_poses,
)
from mbd_sim.dynamics.links import CoordinateLayout, Link, coordinate_layout
from mbd_sim.dynamics.symbolic_parameters import (
    SymbolicParameters,
    equation_data,
    varying_parameters,
    with_symbols,
)
from mbd_sim.mechanism.records import Mechanism


@dataclass(frozen=True, eq=False)
class StateSymbols:
    """The symbols t, q (nq,) and u (nv,) of which everything is a function, and q' (nq,) = N(q) u."""

    t: ca.SX
    q: ca.SX
    u: ca.SX
    q_rates: ca.SX

    def rate(self, expression: ca.SX) -> ca.SX:
        """The time derivative of an expression of t and q; for one of u as well, its part without u'."""
        return ca.jtimes(expression, self.q, self.q_rates) + ca.jtimes(expression, self.t, ca.SX(1))


@dataclass(frozen=True, eq=False)
class TracedMechanism:
    """A mechanism whose motion is traced as a function of symbols.

    `numeric` is the mechanism in numbers; `mechanism` and `links` hold symbols in place of its `parameters`. The
    integrated state `y` is q (nq,), u (nv,) and the energies `audit` in J, see `audit_states`. `inputs` are described
    in `input_layout`; the `efforts` (nv,) are their first part. `motions` and `poses` are those of the links.
    """

    numeric: Mechanism
    mechanism: Mechanism
    links: Sequence[Link]
    layout: CoordinateLayout
    parameters: SymbolicParameters
    input_layout: InputLayout
    state: StateSymbols
    y: ca.SX
    audit: ca.SX
    inputs: ca.SX
    efforts: ca.SX
    motions: Sequence[LinkMotion]
    poses: Sequence[SymbolicPose]
    kinetic_energy: ca.SX


def trace(
    mechanism: Mechanism, loaded: Sequence[str] = (), parameters: SymbolicParameters | None = None
) -> TracedMechanism:
    """Introduce the symbols and trace poses, velocities and the kinetic energy.

    :param loaded: parts on which external wrenches act.
    :param parameters: the numbers of the mechanism that are inputs; none by default.
    """
    parameters = parameters or varying_parameters(equation_data(mechanism), ())
    symbolic, links = with_symbols(mechanism, parameters)
    layout = coordinate_layout(mechanism)
    nq, nv = layout.nq, layout.nv
    input_layout = InputLayout(nv, tuple(loaded), len(parameters.base))
    t, efforts = ca.SX.sym("t"), ca.SX.sym("e", nv)
    wrenches = ca.SX.sym("w", input_layout.values.start - nv)
    y = ca.SX.sym("y", nq + nv + len(audit_states(mechanism)))
    q, u, audit = ca.vertsplit(y, [0, nq, nq + nv, y.shape[0]])
    motions = link_motions(links, t, q, u)
    return TracedMechanism(
        numeric=mechanism,
        mechanism=symbolic,
        links=links,
        layout=layout,
        parameters=parameters,
        input_layout=input_layout,
        state=StateSymbols(t, q, u, coordinate_rates(links, motions, nq)),
        y=y,
        audit=audit,
        inputs=ca.vertcat(efforts, wrenches, parameters.symbols),
        efforts=efforts,
        motions=motions,
        poses=part_poses(links, t, q),
        kinetic_energy=kinetic_energy(links, motions),
    )
