"""All configurations of a mechanism at given drives: its assembly modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem

BATCH = 100  # starts
LEAST, MOST = 200, 4000  # starts
ENOUGH = 6  # times that each mode is found, after which the search ends
ITERATIONS = 25  # of Newton's method, from each start
REACH = 2.0  # sizes of the mechanism, up to which displacements are drawn
SAME = 1e-6  # difference of two configurations that are one, in natural units


@record
class AssemblyModes:
    """The configurations q (k, nq) that were found, in order of their coordinates.

    Joints that the file drives have coordinates as well, those of `mechanism`. `found` (k,) is how many of the `starts`
    of Newton's method ended in each. A mode that is found only once shows that there may be more: the probability that
    another start finds a new one is about `chance_of_another` (Good 1953).
    """

    mechanism: Mechanism
    drives: Mapping[str, float]
    q: Array
    found: Sequence[int]
    starts: int

    def __len__(self) -> int:
        return len(self.q)

    @property
    def chance_of_another(self) -> float:
        """The number of modes found only once, divided by the number of starts."""
        return sum(count == 1 for count in self.found) / self.starts


@interruptible()
def assembly_modes(mechanism: Mechanism, drives: Mapping[str, float]) -> AssemblyModes:
    """Search for all configurations at given coordinates, by Newton's method from many starts, the same in every run.

    The search ends when each mode has been found several times. It can miss modes from which hardly any start leads.

    :param drives: as many coordinates as there are degrees of freedom, in rad or m.
    :raises InputError: a coordinate does not exist, their number is wrong, or there is no configuration at them.
    :raises MechanismError: see `KinematicSystem`.
    """
    system = KinematicSystem(mechanism, list(drives))
    return modes_at(system, np.array(list(drives.values()), dtype=float))


def modes_at(system: KinematicSystem, drives: Array) -> AssemblyModes:
    """The assembly modes of a system.

    :raises InputError: there is no configuration at these drives.
    """
    random, modes, found, starts = np.random.default_rng(0), list[Array](), list[int](), 0
    while starts < MOST and (starts < LEAST or min(found, default=0) < ENOUGH):
        for _ in range(BATCH):
            q = system.closed_at(_start(system, random), drives, ITERATIONS)
            if q is None:
                continue
            q = _principal(system, q)
            same = next((index for index, other in enumerate(modes) if _is_same(system, q, other)), None)
            if same is None:
                modes.append(q)
                found.append(1)
            else:
                found[same] += 1
        starts += BATCH
        if not modes and starts >= LEAST:
            break
    named = dict(zip(system.drives, drives.tolist(), strict=True))
    if not modes:
        text = ", ".join(f"{name} = {value:.6g}" for name, value in named.items())
        raise InputError(
            f"{system.mechanism.name} cannot be assembled at {text}: none of {starts} starts closes its loops",
            "Choose other coordinates or lengths.",
        )
    order = sorted(range(len(modes)), key=lambda index: np.round(modes[index], 6).tolist())
    q, counts = np.array([modes[index] for index in order]), [found[index] for index in order]
    return AssemblyModes(system.mechanism, named, q, counts, starts)


def _start(system: KinematicSystem, random: np.random.Generator) -> Array:
    """Coordinates anywhere: angles in a turn, displacements within the reach, any orientation."""
    q = system.start.copy()
    for name, joint in system.mechanism.joints.items():
        span, kind = system.layout.q[name], joint.kind
        count = kind.nv if kind.quaternion is None else kind.quaternion
        widths = [np.pi if one.rotation else REACH * system.constraints.size for one in kind.coordinates[:count]]
        q[span.start : span.start + count] = random.uniform(-1.0, 1.0, count) * widths
        if kind.quaternion is not None:
            quaternion = random.normal(size=4)
            q[span.start + count : span.stop] = quaternion / np.linalg.norm(quaternion)
    return q


def _principal(system: KinematicSystem, q: Array) -> Array:
    """A configuration with angles in (-pi, pi], except those of the drives, and w >= 0 in quaternions."""
    result, angles = q.copy(), system.angles.copy()
    angles[system.q_driven] = False
    result[angles] = np.pi - np.mod(np.pi - q[angles], 2.0 * np.pi)
    for name, joint in system.mechanism.joints.items():
        if (offset := joint.kind.quaternion) is not None:
            first = system.layout.q[name].start + offset
            if result[first] < 0.0:
                result[first : first + 4] *= -1.0
    return result


def _is_same(system: KinematicSystem, one: Array, other: Array) -> bool:
    difference = one - other
    difference[system.angles] = np.mod(difference[system.angles] + np.pi, 2.0 * np.pi) - np.pi
    return bool(np.max(np.abs(difference) / system.constraints.coordinate_scales) <= SAME)
