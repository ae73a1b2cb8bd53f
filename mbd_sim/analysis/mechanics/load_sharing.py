"""How redundant joints and constraints share the load: with the least complementary energy (Menabrea's theorem)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import least_solution, norm, null_space, product
from mbd_sim.base.short_repr import short_repr
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.kernel_functions import Loads
from mbd_sim.mechanism.mechanism import Mechanism

LOAD_ROUND_OFF = 1e-12  # of the shared loads, relative to the largest load
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

    __repr__ = short_repr

    def __init__(
        self, mechanism: Mechanism, equations: Equations, read: Callable[[float, Array, Array], Array] | None = None
    ) -> None:
        """`read` evaluates the function of `Equations.load_paths`, which by default CasADi does."""
        self._mechanism, self._equations = mechanism, equations
        self._read = read
        self.indeterminacy = len(equations.rows) - equations.start.rank

    def multipliers(self, t: float, y: Array, inputs: Array) -> Array:
        """λ (m,) of all rows."""
        if not self.can_share:
            return np.array(self._equations.multipliers(t, y, inputs), dtype=float).ravel()
        loads = self._loads(t, y, inputs)
        added = self._added(loads)
        return loads.multipliers if added is None else loads.multipliers + added[0]

    def reactions(self, t: float, y: Array, inputs: Array) -> Array:
        """The force and the moment (joints, 6) across each joint, see `joint_reactions`."""
        if not self.can_share:
            return np.array(self._equations.reactions(t, y, inputs), dtype=float).T
        return self.shared_reactions(self._values(t, y, inputs))

    def shared_reactions(self, values: Array) -> Array:
        """`reactions` from the output (size,) of the function of `Equations.load_paths`."""
        loads = self._equations.load_paths.loads(values)
        reactions, added = loads.reactions.reshape(-1, 6), self._added(loads)
        return reactions if added is None else reactions + added[1].reshape(-1, 6)

    @cached_property
    def can_share(self) -> bool:
        """Whether redundant joints share load in any state.

        They do not if all self-stresses are in idle rows that carry nothing, as in a plane linkage under loads in its
        plane: see `LoadPaths`. Then the reactions are those that the equations of motion give.
        """
        if not self.indeterminacy:
            return False
        paths = self._equations.load_paths
        return self._fixed_stresses is None or not paths.idle_unloaded

    def undetermined_forces(self, t: float, y: Array, inputs: Array) -> list[str]:
        """The names of the joints whose force equilibrium alone does not determine in this state."""
        if not self.can_share:
            return []
        loads = self._loads(t, y, inputs)
        stresses = self._self_stresses(loads)
        effects = np.abs(product(loads.of_reactions, stresses)).reshape(-1, 6, stresses.shape[1])
        forces = effects[:, :3].max(axis=(1, 2), initial=0.0)
        names = [*self._mechanism.joints, *self._mechanism.closing]
        return [
            name for name, force in zip(names, forces, strict=True) if force > LOAD_ROUND_OFF * effects.max(initial=0.0)
        ]

    def _values(self, t: float, y: Array, inputs: Array) -> Array:
        return (self._read or self._equations.load_paths.values)(t, y, inputs)

    def _loads(self, t: float, y: Array, inputs: Array) -> Loads:
        return self._equations.load_paths.loads(self._values(t, y, inputs))

    def _added(self, loads: Loads) -> tuple[Array, Array] | None:
        """The self-stress that minimizes the sum: multipliers (m,) and reactions (6 joints,).

        None if it is zero or round-off: exact zeros stay zero.
        """
        stresses = self._self_stresses(loads)
        components, is_round_off = self._components(loads.of_reactions, stresses, loads.reactions, loads.multipliers)
        if is_round_off:
            return None
        added = product(stresses, components)
        return added, product(loads.of_reactions, added)

    def shared_changes(self, t: float, y: Array, inputs: Array, reactions: Array, multipliers: Array) -> Array:
        """Changes (6 joints, n) of the reactions, from those that the equations of motion give.

        :param reactions: (6 joints, n) of the equations, joint by joint.
        :param multipliers: (m, n) of the equations.
        :raises MbdSimError: redundant joints share the load in this state, so that the changes depend on their place.
        """
        loads = self._loads(t, y, inputs)
        if self._added(loads) is not None:
            raise InputError(
                f"the reactions of '{self._mechanism.name}' are not linearized, because redundant joints share the "
                "load in this state",
                "Leave out redundant constraints, or choose other outputs.",
            )
        of_reactions, stresses = loads.of_reactions, self._self_stresses(loads)
        components = self._components(of_reactions, stresses, reactions, multipliers)[0]
        return np.asarray(reactions + product(product(of_reactions, stresses), components))

    def _components(
        self, of_reactions: Array, stresses: Array, reactions: Array, multipliers: Array
    ) -> tuple[Array, bool]:
        """The self-stress (k, …) that minimizes the sum for given loads, and whether it is zero or round-off."""
        weights, own = self._weights, self._own_rows
        effects, loads = weights[:, None] * (product(of_reactions, stresses)), (weights * reactions.T).T
        if len(own):
            effects, loads = np.vstack([effects, stresses[own]]), np.concatenate([loads, multipliers[own]])
        components = least_solution(effects, -loads)
        return components, bool(np.abs(product(effects, components)).max() <= LOAD_ROUND_OFF * np.abs(loads).max())

    def _self_stresses(self, loads: Loads) -> Array:
        """An orthonormal basis (m, k) of the multipliers that change neither the motion nor the forces of drives.

        Its dimension is that of almost all configurations, so that it changes smoothly through singular ones.
        """
        basis, of_drives = self._fixed_stresses, loads.of_drives
        if basis is None:
            basis = null_space(loads.gradient.T, 0.0, len(loads.gradient) - self.indeterminacy)
        if not of_drives.size:
            return basis
        by_stresses = product(of_drives, basis)
        if not by_stresses.any():
            return basis
        directions = null_space(by_stresses, DETERMINED * float(np.max(np.abs(of_drives))))
        return np.asarray(product(basis, directions))

    @cached_property
    def _fixed_stresses(self) -> Array | None:
        """The basis (m, k) of the multipliers without effect on the motion, if these are the multipliers of idle rows.

        None if other rows depend on each other.
        """
        idle = self._equations.load_paths.idle
        return np.eye(len(self._equations.rows))[:, idle] if len(idle) == self.indeterminacy else None

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
        return max((norm(one - other) for one, other in pairs), default=0.0) or 1.0
