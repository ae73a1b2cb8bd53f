"""Places in the vectors of the equations: joints in q and u, the energies of the audit in y, and all inputs.

The inputs are efforts, wrenches on parts, commands, parameters, and the modes of one-sided elements.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mbd_sim.base.geometry.arrays import require_finite, vector
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.linear_algebra import norm
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.mechanism.contents import commanded_drives, has_one_sided
from mbd_sim.mechanism.elements.joint_types import STATES
from mbd_sim.mechanism.mechanism import Mechanism

TRIALS, SEED = 6, 1  # of states that are tried


@record
class CoordinateLayout:
    """The slices of each joint's coordinates in q (nq,) and speeds in u (nv,), in declared order.

    The states of commanded `drives`, by the names of their joints, are the last coordinates in q.
    """

    q: dict[str, slice]
    u: dict[str, slice]
    nq: int
    nv: int
    drives: dict[str, slice]


def coordinate_layout(mechanism: Mechanism) -> CoordinateLayout:
    """Assign slices of q and u to the joints of the tree; driven joints get empty ones."""
    q: dict[str, slice] = {}
    u: dict[str, slice] = {}
    nq = nv = 0
    for joint in mechanism.joints.values():
        joint_nq, joint_nv = (0, 0) if joint.drive else (joint.kind.nq, joint.kind.nv)
        q[joint.name], u[joint.name] = slice(nq, nq + joint_nq), slice(nv, nv + joint_nv)
        nq, nv = nq + joint_nq, nv + joint_nv
    drives = {name: slice(nq + STATES * i, nq + STATES * (i + 1)) for i, name in enumerate(commanded_drives(mechanism))}
    return CoordinateLayout(q, u, nq + STATES * len(drives), nv, drives)


def trial_states(mechanism: Mechanism, layout: CoordinateLayout, start: Array) -> Iterator[tuple[float, Array]]:
    """Times and states (n,), which begin with the coordinates: the start, and with all of these changed at random."""
    yield 0.0, start
    chance = np.random.default_rng(SEED)
    for _ in range(TRIALS):
        y = start.copy()
        y[: layout.nq] += chance.normal(size=layout.nq)
        for joint in mechanism.joints.values():
            if joint.kind.quaternion is not None and not joint.drive:
                first = layout.q[joint.name].start + joint.kind.quaternion
                y[first : first + 4] /= norm(y[first : first + 4])
        yield float(chance.uniform()), y


AUDIT_STATES = ("work_applied", "work_drives", "dissipated")  # J, at the end of the integrated state y in this order
LOSS_STATES = ("impact_loss", "friction_loss")  # J, parts of the dissipated energy, before them if there are contacts


def audit_states(mechanism: Mechanism) -> tuple[str, ...]:
    """The energies in J that are integrated with the state: its last components, in their order."""
    return (*LOSS_STATES, *AUDIT_STATES) if has_one_sided(mechanism) else AUDIT_STATES


WRENCH_SIZE = 15  # the numbers of an `ExternalWrench`
UNDRIVEN = 4  # disturbances besides those of drives: their time, and the acceleration of ground


@dataclass(frozen=True)
class InputLayout:
    """The slices of the inputs: the efforts (nv,), `WRENCH_SIZE` numbers for each loaded part, then the values.

    Mechanisms with actuators have their commands before the values. Those with one-sided elements also have the
    `one_sided` numbers, see `OneSidedLayout`. The last of the values are the `disturbances`, if there are any, see
    `mbd_sim.dynamics.kinematics.drives`.
    """

    nv: int
    loaded: tuple[str, ...] = ()
    value_count: int = 0
    one_sided_count: int = 0
    command_count: int = 0
    disturbance_count: int = 0

    __repr__ = short_repr

    @property
    def efforts(self) -> slice:
        """The efforts."""
        return slice(0, self.nv)

    @cached_property
    def wrenches(self) -> Mapping[str, slice]:
        """The wrench on each loaded part."""
        starts = range(self.nv, self.nv + WRENCH_SIZE * len(self.loaded), WRENCH_SIZE)
        return {part: slice(start, start + WRENCH_SIZE) for part, start in zip(self.loaded, starts, strict=True)}

    @property
    def commands(self) -> slice:
        """The commands of the actuators, see `ActuatorLayout`."""
        return slice(self._first_value - self.command_count, self._first_value)

    @property
    def acting(self) -> list[int]:
        """The indices of efforts, commands, the force and the couple on each loaded part, and disturbances."""
        spans = [self.efforts, self.commands, *self.forces.values(), self.disturbances]
        return [index for span in spans for index in range(span.start, span.stop)]

    @property
    def forces(self) -> Mapping[str, slice]:
        """The force and the couple in ground's axes on each loaded part."""
        return {part: slice(span.start, span.start + 6) for part, span in self.wrenches.items()}

    @property
    def disturbances(self) -> slice:
        """The disturbances, among the values."""
        return slice(self.values.stop - self.disturbance_count, self.values.stop)

    @property
    def drive_disturbances(self) -> list[tuple[int, int, int]]:
        """The indices of the changes of position, velocity and acceleration of each coordinate driven by time."""
        if not self.disturbance_count:
            return []
        count, first = (self.disturbance_count - UNDRIVEN) // 3, self.disturbances.start
        return [(first + number, first + count + number, first + 2 * count + number) for number in range(count)]

    @property
    def values(self) -> slice:
        """The values of the symbolic parameters."""
        return slice(self._first_value, self._first_value + self.value_count)

    @property
    def one_sided(self) -> slice:
        """The modes of the one-sided elements, and their multipliers."""
        return slice(self._first_value + self.value_count, self.size)

    @property
    def size(self) -> int:
        """The number of inputs."""
        return self._first_value + self.value_count + self.one_sided_count

    @property
    def _first_value(self) -> int:
        return self.nv + WRENCH_SIZE * len(self.loaded) + self.command_count

    def checked(self, inputs: Sequence[float] | Array) -> Array:
        """A copy of all inputs.

        :raises ValueError: wrong length, or one is not finite. Values may be infinite, as the tracking time of a servo
            without an integral is.
        """
        found = vector(inputs, self.size, "inputs").copy()
        finite = found.copy()
        finite[self.values][np.isinf(found[self.values])] = 0.0
        require_finite(finite, "inputs")
        return found

    def without_commands(self, centers: Sequence[Array], values: Array) -> Array:
        """The inputs (size,) with zero efforts, wrenches and commands.

        :param centers: (3,) center of mass of each loaded part in m, the point at which its wrench acts.
        :param values: (value_count,) values of the symbolic parameters.
        """
        inputs = np.zeros(self.size)
        for span, center in zip(self.wrenches.values(), centers, strict=True):
            inputs[span.stop - 3 : span.stop] = center
        inputs[self.values] = values
        return inputs
