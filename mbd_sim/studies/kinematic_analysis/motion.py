"""The motion of a mechanism whose drives move through a range: positions, velocities and accelerations.

It includes the motion of points of parts, and the coordinates of joints that close loops. These are not among q, and
follow from the frames on both sides of the joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.dynamics.kinematics.frames import FrameQuantity, frame_function
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.mechanism.elements.parts import GROUND, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.run.moving_points import named_frame
from mbd_sim.studies.kinematic_analysis.curve import (
    Kind,
    SingularPoint,
    require_reached,
    require_regular,
    sampled,
    traced_curve,
)
from mbd_sim.studies.kinematic_analysis.drive_line import DriveLine
from mbd_sim.studies.kinematic_analysis.modes import modes_at
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem, coordinate_columns, coordinate_index, is_rotation


@record
class PointMotion:
    """`position`, `velocity` and `acceleration` (n, 3) of a point in ground's axes, in m and s."""

    position: Array
    velocity: Array
    acceleration: Array


class PointFunctions:
    """The kinematics of a point, or of a frame, of a part."""

    def __init__(self, system: KinematicSystem, name: str) -> None:
        """A point `part.point`, or the origin of a part.

        :raises InputError: there is no such point.
        """
        self._system = system
        self._part, pose = named_frame(system.mechanism, name)
        self._local = pose.position
        self._functions = {
            quantity: frame_function(system.traced, self._part, quantity)
            for quantity in (_QUANTITIES if self._part != GROUND else ())
        }
        self._inputs = np.zeros(system.traced.input_layout.size)
        self._inputs[system.traced.input_layout.values] = system.values
        self._rest = np.zeros(system.traced.y.shape[0] - system.layout.nq - system.layout.nv)

    def motion(self, q: Array, u: Array, u_rates: Array) -> PointMotion:
        """The motion in n states, with (n, nq) and (n, nv) numbers."""
        rows = [self.state(*row) for row in zip(q, u, u_rates, strict=True)]
        return PointMotion(*(np.array([row[index] for row in rows]) for index in range(3)))

    def state(self, q: Array, u: Array, u_rates: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration (3,) in a state."""
        if self._part == GROUND:
            return self._local, np.zeros(3), np.zeros(3)
        velocity, acceleration = self.twist(q, u, u_rates)
        return self._value("pose", q, u)[:3], velocity[:3], acceleration[:3]

    def twist(self, q: Array, u: Array, u_rates: Array) -> tuple[Array, Array]:
        """Velocity and angular velocity (6,) in a state, and their rates (6,)."""
        if self._part == GROUND:
            return np.zeros(6), np.zeros(6)
        jacobian = self.jacobian(q)
        return jacobian @ u, jacobian @ u_rates + self._value("bias_acceleration", q, u)

    def jacobian(self, q: Array) -> Array:
        """(6, nv): the velocity and the angular velocity for each unit speed."""
        nv = self._system.layout.nv
        if self._part == GROUND:
            return np.zeros((6, nv))
        return self._value("jacobian", q, np.zeros(nv)).reshape(6, nv)

    def pose(self, q: Array) -> Pose:
        """The position of the point and the rotation of its part."""
        if self._part == GROUND:
            return Pose(self._local, np.eye(3))
        values = self._value("pose", q, np.zeros(self._system.layout.nv))
        return Pose(values[:3], values[3:].reshape(3, 3, order="F"))

    def _value(self, quantity: FrameQuantity, q: Array, u: Array) -> Array:
        y = np.concatenate([q, u, self._rest])
        # Rows and columns: the functions give a column of numbers, matrices row by row.
        return evaluated(self._functions[quantity], 0.0, y, self._inputs, self._local).ravel(order="F")


_QUANTITIES: tuple[FrameQuantity, ...] = ("pose", "jacobian", "bias_acceleration")


def closing_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The revolute and prismatic joints that close loops."""
    return tuple(name for name, joint in mechanism.closing.items() if joint.type in ("revolute", "prismatic"))


class ClosingJoint:
    """The angle, or the displacement, of a revolute or prismatic joint that closes a loop."""

    def __init__(self, system: KinematicSystem, joint: Joint) -> None:
        """Trace the motion of both parts.

        :raises InputError: it is another type of joint.
        """
        if joint.type not in ("revolute", "prismatic"):
            raise InputError(
                f"'{joint.name}' closes a loop, and so has no coordinates", "Write 'cut: true' at another joint of it."
            )
        self._joint = joint
        self._parent, self._child = PointFunctions(system, joint.parent), PointFunctions(system, joint.child)

    def position(self, q: Array) -> float:
        """In rad, from -pi to pi, or in m."""
        joint = self._joint
        parent, child = self._parent.pose(q) @ joint.parent_pose, self._child.pose(q) @ joint.child_pose
        if joint.type == "prismatic":
            return float(parent.rotation @ joint.axis @ (child.position - parent.position))
        turn = parent.rotation.T @ child.rotation
        sine = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return float(np.arctan2(sine @ joint.axis, np.trace(turn) - 1.0))

    def rates(self, q: Array, u: Array, u_rates: Array) -> tuple[float, float]:
        """Its velocity and acceleration, in rad/s or m/s and so on."""
        joint = self._joint
        one, other = self._parent.twist(q, u, u_rates), self._child.twist(q, u, u_rates)
        pose, far = self._parent.pose(q), self._child.pose(q)
        axis = pose.rotation @ joint.parent_pose.rotation @ joint.axis
        if joint.type == "revolute":
            return float(axis @ (other[0][3:] - one[0][3:])), float(axis @ (other[1][3:] - one[1][3:]))
        # Both parts turn together. The Coriolis acceleration is perpendicular to the axis.
        arm = (far @ joint.child_pose).position - pose.position
        carried = far.rotation @ joint.child_pose.position
        spin, turning = one[0][3:], one[1][3:]

        def of_point(velocity: Array, acceleration: Array, reach: Array) -> tuple[Array, Array]:
            centripetal = np.cross(spin, np.cross(spin, reach))
            return velocity + np.cross(spin, reach), acceleration + np.cross(turning, reach) + centripetal

        near = of_point(one[0][:3], one[1][:3], arm)
        away = of_point(other[0][:3], other[1][:3], carried)
        return float(axis @ (away[0] - near[0])), float(axis @ (away[1] - near[1]))


POSITIONS = 361
AtDeadPoints = Literal["refuse", "follow"]


@dataclass(frozen=True)
class SingularRow:
    """A dead point or change point: its `row` in the motion, and the coordinates of the drives there, in rad or m."""

    kind: Kind
    row: int
    drives: Mapping[str, float]

    __repr__ = short_repr


class DrivenMotion:
    """The configurations of a mechanism, one in each row, in the order in which they follow each other.

    - `s` (n,): the part of the range through which the drives have gone, from 0 to 1; `drives` (n, drives) in rad or m.
    - `q` (n, nq), `u` (n, nv), `u_rates` (n, nv): coordinates, speeds and accelerations, as in a `Simulation`, at the
      `speed` of the first moving drive in rad/s or m/s; the drives do not accelerate. nan at dead and change points.
    - `ratios` (n, nv): u for a unit speed of the first moving drive, in the direction in which its range is given.
    - `direction` (n,): -1 where the drives go back, after a dead point, else 1. `time` (n,) in s.
    - `singular`: the dead and change points.
    """

    def __init__(
        self, line: DriveLine, rows: Sequence[tuple[float, Array, SingularPoint | None]], speed: float
    ) -> None:
        system = self.system = line.system
        self.line, self.mechanism, self.speed = line, system.mechanism, speed
        self.s, self.q = np.array([s for s, _, _ in rows]), np.array([q for _, q, _ in rows])
        self.drives = np.array([line.drives(s) for s in self.s.tolist()])
        travel = (line.stop - line.start).astype(float)
        self.leading = int(np.flatnonzero(travel)[0])
        self._unit = travel / abs(travel[self.leading])  # (drives,) for a unit speed of the leading one
        self.direction = _directions(self.s)
        steps = np.abs(np.diff(self.s, prepend=self.s[0])) * abs(travel[self.leading])
        self.time = np.cumsum(steps) / speed if speed else np.zeros(len(rows))
        singular = [(row, point) for row, (_, _, point) in enumerate(rows) if point is not None]
        self.singular = tuple(
            SingularRow(point.kind, row, dict(zip(system.drives, self.drives[row].tolist(), strict=True)))
            for row, point in singular
        )
        excluded = {row for row, _ in singular}
        rates = [None if row in excluded else self.unit_rates(q) for row, q in enumerate(self.q)]
        empty = np.full(system.layout.nv, np.nan)
        self.ratios = np.array([empty if one is None else one[0] for one in rates])
        self.u = self.ratios * (speed * self.direction)[:, None]
        self.u_rates = np.array([empty if one is None else one[1] for one in rates]) * speed**2
        self._points: dict[str, PointMotion] = {}
        self._closing_joints: dict[str, ClosingJoint] = {}

    def __len__(self) -> int:
        return len(self.s)

    def __repr__(self) -> str:
        drives = ", ".join(self.system.drives)
        return f"<DrivenMotion of {self.mechanism.name}: {len(self)} positions of {drives}, speed {self.speed:g}>"

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the coordinates (nv,)."""
        return self.mechanism.coordinate_names

    @property
    def drive(self) -> Array:
        """The coordinate (n,) of the first drive that moves, in rad or m."""
        return self.drives[:, self.leading]

    @property
    def drive_name(self) -> str:
        """The first drive that moves."""
        return self.system.drives[self.leading]

    def unit_rates(self, q: Array) -> tuple[Array, Array] | None:
        """u and u' (nv,) in a configuration, at a unit speed of the first moving drive; None at a singular one."""
        return self.system.rates(q, self._unit, np.zeros(len(self._unit)))

    def at(self, row: int, s: float) -> Array:
        """The configuration q (nq,) at a place s between a row and the next one.

        :raises InputError: there is none.
        """
        part = (s - self.s[row]) / (self.s[row + 1] - self.s[row])
        guess = self.q[row] + part * (self.q[row + 1] - self.q[row])
        q = self.system.closed_at(self.system.displaced(guess, np.zeros(self.system.layout.nv)), self.line.drives(s))
        if q is None:
            raise InputError(f"there is no configuration at {self.line.described(s)}", "Take more positions.")
        return q

    def coordinate(self, name: str) -> tuple[Array, Array, Array]:
        """The position (n,) of a coordinate, its velocity and its acceleration, in rad or m and s.

        :param name: of a coordinate, or of a revolute or prismatic joint that closes a loop.
        :raises InputError: there is no such coordinate, or it is a component of a rotation in space.
        """
        self.require_output(name)
        if name in self.mechanism.closing:
            return self._closing(name)
        index = self.index(name)
        return self.q[:, self.columns[index]], self.u[:, index], self.u_rates[:, index]

    def require_output(self, name: str) -> None:
        """Refuse what has no position of its own.

        :raises InputError: there is no such coordinate, or it is a component of a rotation in space.
        """
        if name in self.mechanism.closing:
            self.closing_joint(name)
        elif self.columns[self.index(name)] < 0:
            raise InputError(f"'{name}' is a component of a rotation in space", "Take a point of the part.")

    def _closing(self, name: str) -> tuple[Array, Array, Array]:
        joint = self.closing_joint(name)
        positions = np.array([joint.position(q) for q in self.q])
        if self.is_rotation(name):
            positions = np.unwrap(positions)
        rates = np.array([joint.rates(*row) for row in zip(self.q, self.u, self.u_rates, strict=True)])
        return positions, rates[:, 0], rates[:, 1]

    def closing_joint(self, name: str) -> ClosingJoint:
        """A revolute or prismatic joint that closes a loop.

        :raises InputError: it is another type of joint.
        """
        if name not in self._closing_joints:
            self._closing_joints[name] = ClosingJoint(self.system, self.mechanism.closing[name])
        return self._closing_joints[name]

    def is_rotation(self, name: str) -> bool:
        """Whether a coordinate, or a joint that closes a loop, is measured in rad."""
        if name in self.mechanism.closing:
            return self.mechanism.closing[name].type == "revolute"
        return is_rotation(self.mechanism, name)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The coordinates that follow the drives: those of the tree, then revolute and prismatic closing joints."""
        tree = [name for name, column in zip(self.names, self.columns, strict=True) if column >= 0]
        return tuple(name for name in (*tree, *closing_names(self.mechanism)) if name not in self.system.drives)

    def ratio(self, name: str) -> Array:
        """The velocity (n,) of a coordinate for a unit speed of the first moving drive; see `ratios`."""
        if name not in self.mechanism.closing:
            return self.ratios[:, self.index(name)]
        joint = self.closing_joint(name)
        rest = np.zeros(self.system.layout.nv)
        return np.array([joint.rates(q, u, rest)[0] for q, u in zip(self.q, self.ratios, strict=True)])

    @property
    def columns(self) -> tuple[int, ...]:
        """The index in q of each coordinate (nv,); -1 for components of a rotation in space."""
        return coordinate_columns(self.mechanism)

    def index(self, name: str) -> int:
        """The index of a coordinate in u.

        :raises InputError: there is none of this name.
        """
        return coordinate_index(self.mechanism, name)

    def point(self, name: str) -> PointMotion:
        """The path, velocity and acceleration (n, 3) of a point `part.point`, or of the origin of a part.

        In m and s, in ground's axes.

        :raises InputError: there is no such point.
        """
        if name not in self._points:
            self._points[name] = PointFunctions(self.system, name).motion(self.q, self.u, self.u_rates)
        return self._points[name]

    def advantage(self, output: str) -> Array:
        """The mechanical advantage (n,): the effort at a coordinate that a unit effort at the drive balances.

        By virtual power it is the speed of the first moving drive over that of the output, without friction, weight and
        inertia (Uicker, Pennock & Shigley, ch. 3). Infinite where the output stands still.

        :raises InputError: there is no such coordinate.
        """
        ratios = self.ratio(output)
        with np.errstate(divide="ignore"):
            return np.asarray(np.sign(self._unit[self.leading]) / ratios)


@interruptible()
def driven_motion(
    mechanism: Mechanism,
    drives: Mapping[str, float | tuple[float, float]],
    positions: int | Array = POSITIONS,
    *,
    speed: float = 1.0,
    mode: int | None = None,
    dead_points: AtDeadPoints = "refuse",
) -> DrivenMotion:
    """Move the drives of a mechanism through their ranges together, and determine the motion of everything else.

    Positions follow from the constraints to round-off, velocities and accelerations from their Jacobian and its rate.

    :param drives: the range (start, stop) of each driven coordinate in rad or m, or the value at which it is held.
    :param positions: their number, equally spaced in the range; or their places in it, from 0 to 1, in order.
    :param speed: of the first drive that moves, in rad/s or m/s.
    :param mode: the number of the assembly mode at the start of the range, see `assembly_modes`, from 1. By default the
        motion continues from the start position in the file.
    :param dead_points: "refuse" a range with dead points or change points, or "follow" the motion: the drive then turns
        back at a dead point, and a change point is passed straight on.
    :raises UnreachableError: the drives do not reach the whole range: the text says how far they go.
    :raises InputError: a drive does not exist, or there are not as many as degrees of freedom, or no range.
    :raises MechanismError: the loops cannot be closed, or something depends on time.
    """
    if dead_points not in get_args(AtDeadPoints):
        raise InputError(f"dead_points cannot be {dead_points!r}", 'Write "refuse" or "follow".')
    ranges = {name: _range(value) for name, value in drives.items()}
    system = KinematicSystem(mechanism, list(ranges))
    places = np.linspace(0.0, 1.0, positions) if isinstance(positions, int) else np.asarray(positions, dtype=float)
    if len(places) < 2 or not (np.isfinite(speed) and speed >= 0.0):
        raise InputError(f"{len(places)} positions at a speed of {speed}", "Give at least 2, and a speed of 0 or more.")
    if np.any(np.diff(places) <= 0.0) or places[0] < 0.0 or places[-1] > 1.0:
        raise InputError("the places of positions must increase from 0 to 1", "Give them in order, each once.")
    starts, stops = (np.array([one[end] for one in ranges.values()], dtype=float) for end in (0, 1))
    line = DriveLine(system, starts, stops)
    if line.length == 0.0:
        raise InputError("no drive moves: start and stop are equal", "Give a range to one of them.")
    first_q, s = _first(system, line, mode, follow=dead_points == "follow")
    sign = 1.0 if s < 1.0 else -1.0
    first = line.forward(first_q, s, sign)
    require_regular(system, line, first)
    curve = traced_curve(line, first, through=dead_points == "follow")
    if dead_points == "refuse":
        require_reached(system, line, curve)
    return DrivenMotion(line, sampled(line, curve, places), speed)


def _range(value: float | tuple[float, float]) -> tuple[float, float]:
    start, stop = (value, value) if isinstance(value, int | float) else value
    if not (np.isfinite(start) and np.isfinite(stop)):
        raise InputError(f"the range {value} is not finite", "Give numbers in rad or m.")
    return float(start), float(stop)


def _first(system: KinematicSystem, line: DriveLine, mode: int | None, *, follow: bool) -> tuple[Array, float]:
    """The configuration with which the motion begins, and its place s."""
    if mode is not None:
        modes = modes_at(system, line.start)
        if not 1 <= mode <= len(modes):
            raise InputError(f"there is no assembly mode {mode}", f"There are modes 1 to {len(modes)}.")
        return modes.q[mode - 1], 0.0
    given = system.start[system.q_driven]
    if np.array_equal(given, line.start):
        return system.start, 0.0
    approach = DriveLine(system, given, line.start)
    curve = traced_curve(approach, approach.forward(system.start, 0.0, 1.0), through=False)
    if curve.singular or curve.points[-1].s != 1.0:
        along = (given - line.start) @ (line.stop - line.start) / float(np.sum((line.stop - line.start) ** 2))
        off = np.abs(line.drives(float(along)) - given) / system.scale[system.u_driven]
        if follow and 0.0 <= along <= 1.0 and np.max(off) <= 1e-12:
            return system.start, float(along)
        require_reached(system, approach, curve)
    return curve.points[-1].q, 0.0


def _directions(s: Array) -> Array:
    """1 where s grows, -1 where it falls, from each row to the next one; at the end as before it."""
    steps = np.sign(np.diff(s))
    return np.append(steps, steps[-1:]) if len(steps) else np.ones(1)
