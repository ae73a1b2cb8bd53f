"""The names of things in the recording."""

from __future__ import annotations

from mbd_sim.mechanism.records import GROUND, Joint, Mechanism

TIMELINE = "sim_time"
WORLD = "world"
ABOUT = "about"
EVENTS = "events/log"
STATES = "events/states"
JOINTS = "joints"
POSITION, VELOCITY, EFFORT = (f"{JOINTS}/{kind}" for kind in ("position", "velocity", "effort"))
REACTION = f"{JOINTS}/reaction"
ACCOUNT = "energy/account"
STACK = "energy/stack"
RESIDUAL = "energy/residual"
RESIDUAL_PJ = "energy/residual_pJ"  # plots write their numbers out in full: in J they would be rows of zeros
PICO = 1e-12

ANGULAR, LINEAR = "angular", "linear"
UNITS = {  # of what is plotted, by entity
    f"{POSITION}/{ANGULAR}": "rad",
    f"{POSITION}/{LINEAR}": "m",
    f"{VELOCITY}/{ANGULAR}": "rad/s",
    f"{VELOCITY}/{LINEAR}": "m/s",
    f"{EFFORT}/{ANGULAR}": "N·m",
    f"{EFFORT}/{LINEAR}": "N",
}


def part(name: str) -> str:
    """The entity that moves with a part; ground's does not move."""
    return f"{WORLD}/ground" if name == GROUND else f"{WORLD}/parts/{name}"


def trace(name: str) -> str:
    """The path that a point leaves behind, in ground's frame."""
    return f"{WORLD}/traces/{name}"


def kinds(joint: Joint) -> list[str]:
    """Whether each of a joint's coordinates is an angle or a displacement, as in `Joint.motion_names`."""
    return [ANGULAR if coordinate.rotation else LINEAR for coordinate in joint.kind.coordinates]


def free_kinds(mechanism: Mechanism) -> list[str]:
    """The kind of each generalized speed u."""
    return [kind for joint in mechanism.joints.values() if not joint.drive for kind in kinds(joint)]


def driven_kinds(mechanism: Mechanism) -> list[str]:
    """The kind of each driven coordinate."""
    return [kind for joint in mechanism.joints.values() if joint.drive for kind in kinds(joint)]


def ends(mechanism: Mechanism) -> tuple[str, ...]:
    """The parts at the ends of the chains, which leave a trace."""
    inner = {joint.inboard for joint in mechanism.tree_joints()}
    return tuple(joint.outboard for joint in mechanism.tree_joints() if joint.outboard not in inner)
