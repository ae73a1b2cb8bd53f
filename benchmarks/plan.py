"""A mechanism in a form that every simulator accepts: hinges and sliders along z, rigid bodies, and loop-closing pins.

A `Plan` is built from our own record of the mechanism, so that no length or mass is written twice. It is plain data
and can be pickled, so a process that measures another simulator need not load ours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks.tape import Tape, tape_of

if TYPE_CHECKING:
    from mbd_sim.base.geometry.pose import Pose
    from mbd_sim.mechanism.elements.parts import Joint, Part

Array = NDArray[np.float64]
GROUND = -1


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body and the joint that carries it.

    The body's frame is that of its joint: with q = 0 it lies at `position` (3,) and `rotation` (3, 3), or `quaternion`
    (w, x, y, z), in the frame of the body `parent` (an index, or GROUND), and it rotates about its own z axis, or
    slides along it. `mass` in kg, `center` (3,) in m and `inertia` (3, 3) about it in kg·m² are in the body's
    frame. The joint has a spring of `stiffness` N/m or N·m/rad with its rest at `rest`, and a damper
    of `damping` N·s/m or N·m·s/rad.
    """

    name: str
    parent: int
    slides: bool
    position: Array
    rotation: Array
    quaternion: Array
    mass: float
    center: Array
    inertia: Array
    stiffness: float
    rest: float
    damping: float

    def definite_inertia(self, least: float = 1e-13) -> Array:
        """The inertia with `least` kg·m² added where it has none, for simulators that allow no massless directions."""
        values, axes = np.linalg.eigh(self.inertia)
        if values[0] >= least:
            return self.inertia
        return self.inertia + (axes * np.where(values < least, least, 0.0)) @ axes.T


@dataclass(frozen=True, eq=False)
class Pin:
    """A pin that closes a loop: `first_point` (3,) of one body is where `second_point` of another is.

    Its axis is along z of both bodies, which the rest of the mechanism guarantees.
    """

    first: int
    first_point: Array
    second: int
    second_point: Array


@dataclass(frozen=True, eq=False)
class Plan:
    """A mechanism: `bodies` in the order of the coordinates, each after its parent, and the start state q and u.

    `text` is the mechanism file that it was made from, and `tape` has the same mechanism as equations. A robot has no
    bodies here, but our export of it as `mjcf`, and the names of its hinges and sliders in the order of the
    coordinates; if it is `floating`, those of its base come first: a position and a unit quaternion, with linear and
    angular velocity.
    """

    name: str
    text: str
    gravity: Array
    bodies: tuple[Body, ...]
    pins: tuple[Pin, ...]
    q: Array
    u: Array
    tape: Tape
    mjcf: str = ""
    names: tuple[str, ...] = ()
    floating: bool = False

    @property
    def conservative(self) -> bool:
        """Whether nothing dissipates energy."""
        return not any(body.damping for body in self.bodies)

    def random_states(self, count: int) -> list[tuple[Array, Array]]:
        """Coordinates and speeds with normal distribution, the same at each call."""
        rng, states = np.random.default_rng(4), []
        for _ in range(count):
            q, u = rng.normal(size=len(self.q)), rng.normal(size=len(self.u))
            if self.floating:
                q[3:7] /= np.linalg.norm(q[3:7])
            states.append((q, u))
        return states


def plan_of(text: str) -> Plan:
    """The plan of a mechanism file, with the start state that `mbd_sim` finds for it.

    :raises ValueError: the mechanism has elements that plans do not support.
    """
    from mbd_sim import Simulation
    from mbd_sim.base.geometry.pose import identity_pose

    sim = Simulation.from_text(text)
    mechanism = sim.mechanism
    if mechanism.two_point_elements or mechanism.applied or mechanism.constraints:
        raise ValueError(f"{mechanism.name}: springs between points, forces and constraints are not compared")
    index: dict[str, int] = {"ground": GROUND}
    frames: dict[str, Pose] = {"ground": identity_pose()}  # of each body, in its part's axes
    bodies = []
    for joint in mechanism.joints.values():
        if joint.inboard not in index:
            raise ValueError(f"{mechanism.name}: joint '{joint.name}' is declared before what carries it")
        start, frame = _frames(joint)
        placed = frames[joint.inboard].inverse() @ start
        bodies.append(_body(joint, mechanism.parts[joint.outboard], index[joint.inboard], placed, frame))
        index[joint.outboard], frames[joint.outboard] = len(index) - 1, frame
    pins = tuple(_pin(joint, index, frames) for joint in mechanism.closing.values())
    gravity = np.array(mechanism.gravity)
    return Plan(mechanism.name, text, gravity, tuple(bodies), pins, sim.q.copy(), sim.u.copy(), tape_of(sim))


def robot_plan(text: str) -> Plan:
    """The plan of a tree of hinges and sliders on a fixed or free base, for simulators that read our MJCF or equations.

    :raises ValueError: the mechanism has other joints, loops or constraints.
    """
    from mbd_sim import Simulation
    from mbd_sim.files.mjcf.writer import to_mjcf

    sim = Simulation.from_text(text)
    mechanism = sim.mechanism
    if mechanism.closing or mechanism.constraints:
        raise ValueError(f"{mechanism.name}: only trees are compared by their MJCF, because MuJoCo's loops are soft")
    moving = [joint for joint in mechanism.joints.values() if joint.type != "fixed"]
    floating = moving[0].type == "free"
    names = mechanism.coordinate_names[6:] if floating else mechanism.coordinate_names
    if set(names) != {joint.name for joint in moving[floating:]}:
        raise ValueError(f"{mechanism.name}: only hinges and sliders are compared, and a free joint before them")
    gravity, exported = np.array(mechanism.gravity), to_mjcf(mechanism).text
    start = (sim.q.copy(), sim.u.copy())
    return Plan(mechanism.name, text, gravity, (), (), *start, tape_of(sim), exported, tuple(names), floating)


def _frames(joint: Joint) -> tuple[Pose, Pose]:
    """The joint's frame with its axis along z, in the axes of the inboard part and in those of the outboard part."""
    from mbd_sim.base.geometry.pose import Pose
    from mbd_sim.base.geometry.rotation import aligning_z

    simple = joint.type in ("revolute", "prismatic") and not joint.drive
    if not simple or joint.spring or joint.damper or joint.friction:
        raise ValueError(f"joint '{joint.name}' is more than a hinge or slider with a spring and a damper")
    inboard, outboard, axis = joint.parent_pose, joint.child_pose, joint.axis
    if joint.reversed:
        inboard, outboard, axis = outboard, inboard, -axis
    turned = Pose(np.zeros(3), aligning_z(axis))
    return inboard @ turned, outboard @ turned


def _body(joint: Joint, part: Part, parent: int, placed: Pose, frame: Pose) -> Body:
    from mbd_sim.base.geometry.rotation import to_quaternion

    inertia = frame.rotation.T @ part.inertia @ frame.rotation
    return Body(
        name=part.name,
        parent=parent,
        slides=joint.type == "prismatic",
        position=placed.position,
        rotation=placed.rotation,
        quaternion=to_quaternion(placed.rotation),
        mass=part.mass,
        center=frame.rotation.T @ (part.center - frame.position),
        inertia=0.5 * (inertia + inertia.T),
        stiffness=float(joint.stiffness[0]),
        rest=float(joint.rest[0]),
        damping=float(joint.damping[0]),
    )


def _pin(joint: Joint, index: dict[str, int], frames: dict[str, Pose]) -> Pin:
    first, second = frames[joint.parent].inverse(), frames[joint.child].inverse()
    axes = [place.rotation @ pose.rotation @ joint.axis for place, pose in zip(
        (first, second), (joint.parent_pose, joint.child_pose), strict=True
    )]  # fmt: skip
    if joint.type != "revolute" or not all(np.allclose(np.abs(axis), [0.0, 0.0, 1.0]) for axis in axes):
        raise ValueError(f"joint '{joint.name}' closes a loop and is not a pin in the plane of the mechanism")
    return Pin(
        index[joint.parent],
        (first @ joint.parent_pose).position,
        index[joint.child],
        (second @ joint.child_pose).position,
    )
