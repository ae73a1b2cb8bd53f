"""The configurations of a mechanism without its dynamics, so that no part needs a mass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from mbd_sim.analysis.mechanics.free_drives import with_free_drives
from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.arrays import finite_vector
from mbd_sim.base.geometry.pose import Array, Pose, unpack_poses
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import short_repr
from mbd_sim.dynamics.constraints.assembly import close_loops
from mbd_sim.dynamics.constraints.start import assemble
from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.dynamics.layouts.coordinate_names import named_positions, names_of_q
from mbd_sim.dynamics.math.expressions import require_smooth
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.mechanism.spanning_tree import split_reference


class Kinematics:
    """The poses of the parts and the positions of their points as functions of the coordinates.

    It needs neither masses nor inertias, and compiles nothing. `start` holds the coordinates q (nq,) at t = 0, in the
    order of `Simulation.q`, with all loops closed.

    >>> import numpy as np
    >>> from mbd_sim import Kinematics, load_mechanism
    >>> arm = Kinematics(load_mechanism("six_axis_arm"))
    >>> arm.poses(np.zeros(6))["tool"].position.shape
    (3,)
    """

    __repr__ = short_repr

    @interruptible()
    def __init__(self, mechanism: Mechanism) -> None:
        """Trace the positions and close the loops.

        :raises MechanismError: the loops cannot be closed, or nothing can move.
        """
        require_smooth(require_mechanism(mechanism))
        traced = trace(mechanism)
        assembly = assemble(traced)
        self.mechanism, self.layout, self.traced = mechanism, traced.layout, traced
        self.rows, self.constraints = tuple(assembly.equations.rows), assembly.functions
        self.assembled = assembly.start
        self.start = assembly.start.q
        self.part_names = traced.part_names
        inputs = [traced.state.t, traced.state.q, traced.parameters.symbols]
        self._poses = ca.Function("poses", inputs, [traced.flat_poses[: 12 * len(self.part_names)]])
        self._values = traced.parameters.base

    def poses(self, q: Sequence[float] | Array | None = None, time: float = 0.0) -> Mapping[str, Pose]:
        """The pose of each part in ground's frame.

        :param q: (nq,) the coordinates, by default those at the start.
        :param time: in s, on which drives depend.
        :raises ValueError: the number of coordinates is wrong.
        """
        rows = np.array(self._poses(time, self.checked(q), self._values)).reshape(-1, 12)
        positions, rotations = unpack_poses(rows)
        return {
            name: Pose(position.copy(), rotation.copy())
            for name, position, rotation in zip(self.part_names, positions, rotations, strict=True)
        }

    def point(self, name: str, q: Sequence[float] | Array | None = None, time: float = 0.0) -> Array:
        """The position (3,) in m, in ground's frame, of a point `part.point`, or of the origin of a part.

        :raises ValueError: there is no such part or point, or the number of coordinates is wrong.
        """
        known = {GROUND: self.mechanism.ground_points, **{p.name: p.points for p in self.mechanism.parts.values()}}
        try:
            part, point = split_reference(name, known)
        except InputError as error:
            valid = [text for owner, points in known.items() for text in (owner, *(f"{owner}.{p}" for p in points))]
            raise InputError(f"there is no point '{name}'", nearest(name, valid)) from error
        local = known[part][point].position if point else np.zeros(3)
        if part == GROUND:
            return np.array(local)
        pose = self.poses(q, time)[part]
        return np.asarray(pose.position + pose.rotation @ local)

    def positions(self, q: Sequence[float] | Array | None = None) -> Mapping[str, float]:
        """The position in rad or m of each coordinate and of each drive that follows commands, by its name.

        A free joint has x, y, z and its rotation vector; those of drives by expressions of time are not among them.

        :param q: (nq,) the coordinates, by default those at the start.
        :raises ValueError: the number of coordinates is wrong.
        """
        return named_positions(self.mechanism, self.layout, self.checked(q))

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """What each of the coordinates q (nq,) is: see `names_of_q`."""
        return names_of_q(self.mechanism, self.layout)

    @cached_property
    def with_free_drives(self) -> Kinematics:
        """The same with the joints of drives that follow commands as coordinates; itself if there are none."""
        return Kinematics(with_free_drives(self.mechanism)) if self.layout.drives else self

    def closed(self, q: Sequence[float] | Array, time: float = 0.0) -> Array:
        """The coordinates (nq,) near q that close the loops at a time.

        :raises ValueError: there are none, or the number of coordinates is wrong.
        """
        closing = close_loops(self.constraints, time, self.checked(q), np.ones(self.layout.nv, dtype=bool))
        if not closing.closed:
            raise InputError(
                f"no position near these coordinates closes the loops: a gap of {np.max(np.abs(closing.gaps)):.3g} "
                "remains",
                "Give coordinates closer to a closed configuration.",
            )
        return closing.q

    def checked(self, q: Sequence[float] | Array | None) -> Array:
        """The coordinates (nq,) as an array, by default those at the start.

        :raises ValueError: wrong length, or one is not finite.
        """
        return self.start if q is None else finite_vector(q, len(self.start), "q", lambda: self.coordinate_names)
