"""The springs of a mechanism whose potential has a part that is added in Python: see `DistantPotential`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism
from mbd_sim.dynamics.math.laws import distant_potential

if TYPE_CHECKING:
    from mbd_sim.dynamics.math.distant_potentials import DistantPotential


@dataclass(frozen=True, eq=False)
class DistantSprings:
    """`elongations(t, y)` (n,) in m or rad, of the springs with these potentials (n,)."""

    elongations: ca.Function
    potentials: tuple[DistantPotential, ...]

    def __len__(self) -> int:
        return len(self.potentials)

    def potential(self, elongations: Array) -> float:
        """What they add to V, in J."""
        return sum(
            potential(elongation) for potential, elongation in zip(self.potentials, elongations.tolist(), strict=True)
        )


def distant_springs(traced: TracedMechanism, lengths: ca.SX, inputs: Sequence[ca.SX]) -> DistantSprings | None:
    """Those of all joints and springs; None if there are none.

    :param lengths: (springs and dampers,) the distances between the ends in m.
    :param inputs: of the function `elongations`.
    """
    found = list(_found(traced, lengths))
    if not found:
        return None
    elongations, potentials = zip(*found, strict=True)
    return DistantSprings(ca.Function("elongations", list(inputs), [ca.densify(ca.vertcat(*elongations))]), potentials)


def _found(traced: TracedMechanism, lengths: ca.SX) -> Iterator[tuple[ca.SX, DistantPotential]]:
    for link in traced.links:
        joint = link.joint
        for offset in range(link.u.stop - link.u.start):
            if joint.spring is not None and (potential := distant_potential(joint.spring)) is not None:
                yield traced.state.q[link.q.start + offset] - joint.rest[offset], potential
    for index, spring in enumerate(traced.mechanism.springs):
        if (potential := distant_potential(spring.law)) is not None:
            yield lengths[index] - spring.length, potential
