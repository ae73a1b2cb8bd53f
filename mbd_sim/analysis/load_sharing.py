"""How redundant joints and constraints share the load: with the least complementary energy (Menabrea's theorem)."""

from __future__ import annotations

from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mbd_sim.dynamics.equations import Equations
from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism

ROUND_OFF = 1e-12  # of the shared loads, relative to the largest load
DETERMINED = 1e-9  # influence of multipliers on drives that is round-off, relative to that of one multiplier


class LoadSharing:
    """Multipliers and reactions of a mechanism, unique also where equilibrium alone does not determine them.

    Of all loads in equilibrium with the motion, those are taken that minimize

        Σ c (|F|² + |M|²/L²) over the joints + Σ λ² over the constraints,

    with the reaction F, M of a joint, the moment about its point on the second part, its relative `compliance` c, and
    the `length` L. These are the reactions of joints that are elastic with compliances in these ratios, and otherwise
    rigid. They do not depend on which joint of a loop is cut, nor on the frames of the parts. The forces of drives
    stay those that the multipliers of the equations of motion give.

    `indeterminacy` is the number of independent self-stresses: loads without any effect on the motion.
    """

    def __init__(self, mechanism: Mechanism, equations: Equations) -> None:
        self._mechanism, self._equations = mechanism, equations
        self.indeterminacy = len(equations.rows) - equations.start.rank

    def multipliers(self, t: float, y: Array, inputs: Array) -> Array:
        """λ (m,) of all rows."""
        multipliers, added = self._given_multipliers(t, y, inputs), self._added(t, y, inputs)
        return multipliers if added is None else multipliers + added[0]

    def reactions(self, t: float, y: Array, inputs: Array) -> Array:
        """The force and the moment (joints, 6) across each joint, see `joint_reactions`."""
        reactions, added = self._given_reactions(t, y, inputs), self._added(t, y, inputs)
        return reactions if added is None else reactions + added[1]

    def _given_multipliers(self, t: float, y: Array, inputs: Array) -> Array:
        return np.array(self._equations.multipliers(t, y, inputs), dtype=float).ravel()

    def _given_reactions(self, t: float, y: Array, inputs: Array) -> Array:
        return np.array(self._equations.reactions(t, y, inputs), dtype=float).T

    def _added(self, t: float, y: Array, inputs: Array) -> tuple[Array, Array] | None:
        """The self-stress that minimizes the sum: multipliers (m,) and reactions (joints, 6).

        None if it is zero or round-off, as in a plane linkage under loads in its plane: exact zeros stay zero.
        """
        if not self.indeterminacy:
            return None
        of_reactions, stresses = self._indeterminate(t, y, inputs)
        loads, multipliers = self._given_reactions(t, y, inputs).ravel(), self._given_multipliers(t, y, inputs)
        components, is_round_off = self._components(of_reactions, stresses, loads, multipliers)
        if is_round_off:
            return None
        added = stresses @ components
        return added, (of_reactions @ added).reshape(-1, 6)

    def shared_changes(self, t: float, y: Array, inputs: Array, reactions: Array, multipliers: Array) -> Array:
        """Changes (6 joints, n) of the reactions, from those that the equations of motion give.

        :param reactions: (6 joints, n) of the equations, joint by joint.
        :param multipliers: (m, n) of the equations.
        :raises MbdSimError: redundant joints share the load in this state, so that the changes depend on their place.
        """
        if self._added(t, y, inputs) is not None:
            raise MbdSimError(
                f"the reactions of '{self._mechanism.name}' are not linearized, because redundant joints share the "
                "load in this state. Leave out redundant constraints, or choose other outputs."
            )
        of_reactions, stresses = self._indeterminate(t, y, inputs)
        components = self._components(of_reactions, stresses, reactions, multipliers)[0]
        return np.asarray(reactions + of_reactions @ stresses @ components)

    def _indeterminate(self, t: float, y: Array, inputs: Array) -> tuple[Array, Array]:
        """The reactions (6 joints, m) by unit multipliers, and the `_self_stresses` (m, k)."""
        of_reactions, of_drives, gradient = (np.array(part) for part in self._equations.load_paths(t, y, inputs))
        return of_reactions, self._self_stresses(gradient, of_drives)

    def _components(
        self, of_reactions: Array, stresses: Array, reactions: Array, multipliers: Array
    ) -> tuple[Array, bool]:
        """The self-stress (k, …) that minimizes the sum for given loads, and whether it is zero or round-off."""
        weights, own = self._weights, self._own_rows
        effects, loads = weights[:, None] * (of_reactions @ stresses), (weights * reactions.T).T
        if len(own):
            effects, loads = np.vstack([effects, stresses[own]]), np.concatenate([loads, multipliers[own]])
        components: Array = np.linalg.lstsq(effects, -loads, rcond=None)[0].astype(float)
        size = ROUND_OFF * np.max(np.abs(loads), initial=0.0)
        return components, bool(np.max(np.abs(effects @ components), initial=0.0) <= size)

    def _self_stresses(self, gradient: Array, of_drives: Array) -> Array:
        """An orthonormal basis (m, k) of the multipliers that change neither the motion nor the forces of drives.

        Its dimension is that of almost all configurations, so that it changes smoothly through singular ones.

        :param gradient: G (m, nv).
        :param of_drives: (n, m) the forces of drives for unit multipliers.
        """
        basis = np.linalg.svd(gradient)[0][:, len(gradient) - self.indeterminacy :]
        if not of_drives.size:
            return basis
        _, sizes, directions = np.linalg.svd(of_drives @ basis)
        rank = int(np.sum(sizes > DETERMINED * np.max(np.abs(of_drives))))
        return np.asarray(basis @ directions[rank:].T)

    @cached_property
    def _own_rows(self) -> NDArray[np.intp]:
        """The rows of constraints other than joints."""
        return np.array(
            [n for n, row in enumerate(self._equations.rows) if row.owner[0] == "constraints"], dtype=np.intp
        )

    @cached_property
    def _weights(self) -> Array:
        """The roots (6 joints,) of the factors of each squared component."""
        joints = [*self._mechanism.joints.values(), *self._mechanism.closing.values()]
        in_moments = np.array([1.0] * 3 + [self.length**-2] * 3)
        return np.asarray(np.sqrt(np.concatenate([joint.compliance * in_moments for joint in joints])))

    @cached_property
    def length(self) -> float:
        """The largest distance in m of two joints, or of a joint and the center of mass, on one part other than ground.

        1 m if there is none.
        """
        places: dict[str, list[Array]] = {name: [part.center] for name, part in self._mechanism.parts.items()}
        for joint in self._mechanism.all_joints.values():
            for part, frame in ((joint.parent, joint.parent_pose), (joint.child, joint.child_pose)):
                places.setdefault(part, []).append(frame.position)
        pairs = [pair for name in self._mechanism.parts for pair in combinations(places[name], 2)]
        return max((float(np.linalg.norm(one - other)) for one, other in pairs), default=0.0) or 1.0
