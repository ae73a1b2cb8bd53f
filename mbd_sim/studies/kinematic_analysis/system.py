"""The constraints of a mechanism whose drives are prescribed: positions, velocities and accelerations at given drives.

The analysis needs no dynamics: it prescribes coordinates within their ranges, and the mechanism is taken without its
drives.

The coordinates are those of the spanning tree. With the selection S of the driven ones, positions satisfy Φ(q) = 0 and
S q = c, velocities G u = 0 and S u = c', accelerations G u' + γ = 0 and S u' = c'' (Nikravesh, ch. 3). Redundant rows
are kept, and the systems solved by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import InputError, MbdSimError, MechanismError, Problem, counted, listed, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.dynamics.constraints.assembly import CLOSED
from mbd_sim.dynamics.constraints.functions import scaled
from mbd_sim.dynamics.constraints.start import assemble, rheonomic
from mbd_sim.dynamics.kinematics.parameters import SymbolicParameters
from mbd_sim.dynamics.kinematics.tracing import trace
from mbd_sim.dynamics.math.expressions import evaluated, require_smooth
from mbd_sim.dynamics.math.rank import fast_least_solution
from mbd_sim.files.checks.bare_angles import bare_argument_remark
from mbd_sim.files.checks.override import number_at
from mbd_sim.files.text.units import parse_value, split_unit
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.mechanism.values.names import split_assignment

EXAMPLE = "Write for example crank=0:360deg, or crank=0:360deg:73 for 73 positions."


@dataclass(frozen=True)
class DriveRange:
    """A coordinate that moves from `start` to `stop`, in rad or m; with `start` = `stop` it is held there."""

    name: str
    start: float
    stop: float


def drive_range(text: str, mechanism: Mechanism) -> tuple[DriveRange, int | None]:
    """Read `NAME=START:STOP`, `NAME=START:STOP:COUNT` or `NAME=VALUE`, and the number of positions if it is given.

    A unit after the last value is that of the first one too, unless this has its own.

    :raises InputError: the text cannot be read, or there is no such coordinate.
    """
    name, rest = split_assignment(text)
    words = [word.strip() for word in rest.split(":")]
    if not all(words) or len(words) > 3:
        raise InputError(f"'{text}' gives no range of a drive", EXAMPLE)
    unit, count = _unit_of(mechanism, name), None
    if len(words) == 3:
        if not words[2].isdigit() or int(words[2]) < 2:
            raise InputError(f"{text}: the number of positions cannot be '{words[2]}'", EXAMPLE)
        count = int(words.pop())
    try:
        if len(words) == 2 and not split_unit(words[0])[1] and (last := split_unit(words[1])[1]):
            words[0] = f"${{{words[0]}}} {last}"
        values = [parse_value(_plain(word), mechanism.parameters, unit) for word in words]
    except InputError as error:
        raise InputError(f"{text}: {error.message}", error.remedy or EXAMPLE) from error
    return DriveRange(name, values[0], values[-1]), count


def bare_range_remark(text: str, mechanism: Mechanism) -> str:
    """A sentence if the text of a range has an angle beyond a full turn without a unit, or ""."""
    name, rest = split_assignment(text)
    values = [_plain(word.strip()) for word in rest.split(":")[:2]]
    if any(split_unit(value)[1] for value in values if isinstance(value, str)) or not is_rotation(mechanism, name):
        return ""
    return bare_argument_remark(text, values)


def drive_speed(text: str, mechanism: Mechanism, drives: Sequence[DriveRange]) -> float:
    """The speed of the first drive that moves, such as `60rpm`, in rad/s or m/s.

    :raises InputError: it is not one.
    """
    moving = next((one.name for one in drives if one.start != one.stop), drives[0].name)
    unit = "rad/s" if is_rotation(mechanism, moving) else "m/s"
    try:
        speed = parse_value(_plain(text), mechanism.parameters, unit)
    except InputError as error:
        raise InputError(f"the speed {text}: {error.message}", error.remedy) from error
    if speed < 0.0:
        raise InputError(f"the speed {text} is negative", "Exchange the ends of the range instead.")
    return speed


def parameter_value(text: str, mechanism: Mechanism) -> tuple[str, float]:
    """The key and the number in SI units of `KEY=VALUE`.

    :raises InputError: the text cannot be read, or its unit does not fit.
    :raises MechanismError: there is no such key.
    """
    key, value = split_assignment(text)
    if not key or not value:
        raise InputError(f"'{text}' gives no value", "Write for example l=0.1mm.")
    return key, parameter_number(text, key, value, mechanism)


def parameter_number(text: str, key: str, value: str, mechanism: Mechanism) -> float:
    """The number in SI units of a `value` for a key of the file, which is part of an argument `text`.

    :raises InputError: it is none, or has a unit that does not fit.
    :raises MechanismError: there is no such key.
    """
    try:
        return number_at(mechanism, key, _plain(value), mechanism.parameters)
    except InputError as error:
        raise InputError(f"{text}: '{value}': {error.message}", error.remedy) from error


def position_count(given: Sequence[tuple[DriveRange, int | None]], default: int) -> int:
    """The number of positions of drives that move together.

    :raises InputError: the ranges contain different numbers.
    """
    counts = {count for _, count in given if count is not None}
    if len(counts) > 1:
        raise InputError("the drives move together, but have different numbers of positions", "Give one number.")
    return counts.pop() if counts else default


def undriven(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """The mechanism at rest, with a coordinate in place of each drive that is among the `names`, where it is at t = 0.

    :raises InputError: there is no such coordinate, or it is named twice, or its motion cannot be prescribed.
    :raises MechanismError: something else depends on time.
    """
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{listed(twice)} is driven twice", "Give one range.")
    for name in names:
        _unit_of(mechanism, name)
    joints = {
        key: _at_rest(_without_drive(joint) if joint.drive and set(joint.motion_names) & {*names} else joint)
        for key, joint in mechanism.joints.items()
    }
    changed = replace(mechanism, joints=joints)
    if rheonomic(changed):
        what = listed(list(changed.driven_names)) or "its constraints"
        message = f"{mechanism.name} also moves as a function of time: {what}"
        raise MechanismError([Problem(message, "Give a range for these drives too, or a constant in the file.")])
    return changed


def joint_of(mechanism: Mechanism, name: str) -> Joint | None:
    """The joint of the spanning tree to which a coordinate belongs."""
    return next((joint for joint in mechanism.joints.values() if name in joint.motion_names), None)


def is_rotation(mechanism: Mechanism, name: str) -> bool:
    """Whether a coordinate is an angle."""
    joint = joint_of(mechanism, name)
    return joint is not None and joint.kind.coordinates[joint.motion_names.index(name)].rotation


def drivable(mechanism: Mechanism) -> tuple[str, ...]:
    """The coordinates whose motion can be prescribed: all but the rotations of spherical and free joints."""
    return tuple(name for joint in mechanism.joints.values() for name in joint.motion_names if _is_scalar(joint, name))


def coordinate_columns(mechanism: Mechanism) -> tuple[int, ...]:
    """The index in q of each coordinate (nv,) of a mechanism without drives; -1 for rotations in space."""
    found, first = list[int](), 0
    for joint in mechanism.joints.values():
        kind = joint.kind
        plain = kind.nv if kind.quaternion is None else kind.quaternion
        found += [first + index if index < plain else -1 for index in range(kind.nv)]
        first += kind.nq
    return tuple(found)


def coordinate_index(mechanism: Mechanism, name: str) -> int:
    """The index in u of a coordinate of a mechanism without drives.

    :raises InputError: there is none of this name.
    """
    if name not in mechanism.coordinate_names:
        remedy = nearest(name, mechanism.coordinate_names)
        if name in mechanism.closing:
            remedy = f"It closes a loop: write 'cut: true' at another joint of the loop. {remedy}"
        raise InputError(f"there is no coordinate '{name}'", remedy)
    return mechanism.coordinate_names.index(name)


def _is_scalar(joint: Joint, name: str) -> bool:
    kind = joint.kind
    return kind.quaternion is None or not kind.coordinates[joint.motion_names.index(name)].rotation


def _unit_of(mechanism: Mechanism, name: str) -> str:
    known = drivable(mechanism)
    if name in known:
        return "rad" if is_rotation(mechanism, name) else "m"
    if name in mechanism.closing:
        message = f"'{name}' closes a loop, and so has no coordinate that can be driven"
        raise InputError(message, f"Write 'cut: true' at another joint of its loop, or drive one of {listed(known)}.")
    if joint_of(mechanism, name) is not None:
        raise InputError(f"'{name}' is a component of a rotation, which cannot be driven alone", nearest("", known))
    raise InputError(f"there is no coordinate '{name}'", nearest(name, known) or "Nothing in this mechanism moves.")


def _without_drive(joint: Joint) -> Joint:
    if isinstance(joint.drive, CommandedDrive):
        position = [joint.drive.start]
    else:
        position = [expression.at(0.0) for expression in joint.drive]
    count = len(position)
    return replace(
        joint,
        drive=(),
        position=np.array(position),
        velocity=np.zeros(count),
        fixed_in_assembly=(True,) * count,
    )


def _at_rest(joint: Joint) -> Joint:
    count = joint.kind.nv
    return joint if joint.drive else replace(joint, velocity=np.zeros(count), fixed_speeds=(False,) * count)


def _plain(word: str) -> float | str:
    try:
        value = float(word)
    except ValueError:
        return word
    return value if math.isfinite(value) else word


ITERATIONS = 50
LONGEST = 0.5  # step of Newton's method, rad, or in lengths the size of the mechanism
SETTLED = 1e-9  # step of Newton's method after which the error, about its square, is round-off
SINGULAR = 1e-7  # singular value, relative to the largest, at which velocities are not determined


class KinematicSystem:
    """A mechanism with the driven coordinates `drives`, all others following from them.

    `start` (nq,) is the configuration of the file. `scale` (nv,) is 1 for angles and the size of the mechanism in m for
    displacements. `angles` (nq,) marks the coordinates that are angles. `values` are those of the symbolic parameters.
    `bias_function` of (t, q, u, values) is γ (m,).
    """

    @interruptible()
    def __init__(
        self, mechanism: Mechanism, drives: Sequence[str], parameters: SymbolicParameters | None = None
    ) -> None:
        """Trace the constraints and close the loops.

        :raises InputError: a drive does not exist, or their number is not that of the degrees of freedom.
        :raises MechanismError: the loops cannot be closed, or constraints depend on time or on velocities.
        """
        mechanism = undriven(require_mechanism(mechanism), drives)
        require_smooth(mechanism)
        self.traced = trace(mechanism, (), parameters)
        self.assembly = assemble(self.traced)
        self.mechanism, self.layout, self.drives = mechanism, self.traced.layout, tuple(drives)
        self.constraints = self.assembly.functions
        if not np.all(self.constraints.holonomic):
            rows = zip(self.assembly.equations.rows, self.constraints.holonomic, strict=True)
            names = dict.fromkeys(str(row.owner[1]) for row, holonomic in rows if not holonomic)
            message = f"positions do not follow from drives, because of constraints on velocities: {listed([*names])}"
            raise MechanismError([Problem(message, "Simulate the motion instead.", file=mechanism.source.file)])
        self.start = self.assembly.start.q
        self.values = self.traced.parameters.base
        self.u_driven = np.array([mechanism.coordinate_names.index(name) for name in drives], dtype=np.intp)
        self.q_driven = np.array(coordinate_columns(mechanism), dtype=np.intp)[self.u_driven]
        self.dependent = np.setdiff1d(np.arange(self.layout.nv), self.u_driven)
        self.scale = self.constraints.scales
        self.angles = self._plain_angles()
        self._require_determined()
        state = self.traced.state
        symbols = [state.t, state.q, state.u, self.traced.parameters.symbols]
        self.bias_function = ca.Function("bias", symbols, [ca.densify(self.assembly.equations.bias)])

    @property
    def degrees_of_freedom(self) -> int:
        """The number of independent speeds."""
        return self.layout.nv - self.assembly.start.rank

    def with_values(self, values: Array) -> KinematicSystem:
        """A copy with other values of the symbolic parameters."""
        other = copy(self)
        other.values, other.constraints = values, self.constraints.with_values(values)
        return other

    def bias(self, q: Array, u: Array) -> Array:
        """γ (m,)."""
        return evaluated(self.bias_function, 0.0, q, u, self.values).ravel()

    def displaced(self, q: Array, step: Array) -> Array:
        """The coordinates after a small step (nv,) along the speeds."""
        return self.constraints.displaced(q, step)

    def closed_at(self, q: Array, drives: Array, iterations: int = ITERATIONS) -> Array | None:
        """The coordinates near q that satisfy the constraints at the drives (n,), to round-off.

        None if Newton's method does not find them within this number of iterations.
        """
        q = q.copy()
        q[self.q_driven] = drives
        step = np.zeros(self.layout.nv)
        dependent = self.dependent
        for _ in range(iterations):
            gaps, sizes = self.constraints.position(0.0, q), self.constraints.row_sizes(0.0, q)
            slope = scaled(self.constraints.gradient(0.0, q), sizes, self.constraints.scales)[:, dependent]
            if not (np.all(np.isfinite(gaps)) and np.all(np.isfinite(slope))):
                return None
            found = -fast_least_solution(slope, in_natural_units(gaps, sizes))
            size = float(np.max(np.abs(found), initial=0.0))
            step[dependent] = self.scale[dependent] * found * min(1.0, LONGEST / max(size, LONGEST))
            q = self.displaced(q, step)
            if size <= SETTLED:  # the next step is round-off
                break
        return q if self.is_closed(q) else None

    def is_closed(self, q: Array) -> bool:
        """Whether a configuration satisfies the constraints in the right assembly mode."""
        gaps = self.constraints.position(0.0, q)
        right = np.all(self.constraints.branch_checks(0.0, q) > 0.0)
        return bool(np.all(np.abs(gaps) <= CLOSED * self.constraints.row_sizes(0.0, q)) and right)

    def rates(self, q: Array, speeds: Array, accelerations: Array) -> tuple[Array, Array] | None:
        """u (nv,) and u' (nv,) for speeds (n,) and accelerations (n,) of the drives; None at a dead point."""
        matrix, sizes = self.stacked(q), self.constraints.row_sizes(0.0, q)
        left, values, right = np.linalg.svd(matrix, full_matrices=False)
        if values[-1] <= SINGULAR * values[0]:
            return None

        def solved(rows: Array, driven: Array) -> Array:
            wanted = np.concatenate([in_natural_units(rows, sizes), driven / self.scale[self.u_driven]])
            found = right.T @ ((left.T @ wanted) / values)
            found += right.T @ ((left.T @ (wanted - matrix @ found)) / values)
            result = self.scale * found
            result[self.u_driven] = driven
            return np.asarray(result)

        u = solved(np.zeros(len(matrix) - len(self.drives)), speeds)
        return u, solved(-self.bias(q, u), accelerations)

    def stacked(self, q: Array) -> Array:
        """G above S in natural units."""
        selection = np.eye(self.layout.nv)[self.u_driven]
        return np.vstack([self.constraints.scaled_gradient(0.0, q), selection])

    def _plain_angles(self) -> NDArray[np.bool_]:
        """Which of the coordinates (nq,) are angles."""
        found = np.zeros(self.layout.nq, dtype=bool)
        for name, joint in self.mechanism.joints.items():
            if joint.kind.quaternion is None:
                found[self.layout.q[name]] = [one.rotation for one in joint.kind.coordinates]
        return found

    def _require_determined(self) -> None:
        free, given = self.degrees_of_freedom, len(self.drives)
        if free == given:
            return
        others = [name for name in drivable(self.mechanism) if name not in self.drives]
        remedy = f"Give ranges for {counted(free, 'coordinate')}, of {listed(list(drivable(self.mechanism)))}."
        if free > given:
            remedy = f"Give ranges for {free - given} more of {listed(others)}; a constant one holds a coordinate."
            if sum(joint.type == "spherical" for joint in self.mechanism.all_joints.values()) > 1:
                remedy += " A part between two spherical joints can turn idly: replace it by a 'distance' constraint."
        raise InputError(
            f"{self.mechanism.name} has {free} degree{'s' if free != 1 else ''} of freedom, and {given} "
            f"coordinate{'s are' if given != 1 else ' is'} driven",
            remedy,
        )


def in_natural_units(rows: Array, sizes: Array) -> Array:
    """Right sides (m, …) of rows with their sizes (m,), such as gaps; zero for rows without a size."""
    return np.asarray((rows.T / np.where(sizes > 0.0, sizes, np.inf)).T)


class UnreachableError(MbdSimError):
    """A drive cannot go through its range: the text says how far it gets."""
