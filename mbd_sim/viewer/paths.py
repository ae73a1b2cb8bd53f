"""The names of things in the recording."""

from __future__ import annotations

from mbd_sim.mechanism.model import GROUND, Joint, Mechanism

TIMELINE = "sim_time"
WORLD = "world"
EVENTS = "events"
POSITION = "joints/position"
VELOCITY = "joints/velocity"
EFFORT = "joints/effort"
BALANCE = "energy/balance"
EXCHANGE = "energy/exchange"
RESIDUAL = "energy/residual_pJ"  # plots write their numbers out in full: in J they would be rows of zeros
PICO = 1e-12


def part(name: str) -> str:
    """The entity that moves with a part; ground's does not move."""
    return f"{WORLD}/ground" if name == GROUND else f"{WORLD}/parts/{name}"


def trace(name: str) -> str:
    """The path that the end of a part leaves behind, in ground's frame."""
    return f"{WORLD}/traces/{name}"


def units(joint: Joint) -> list[str]:
    """The unit of each of a joint's coordinates, as in `Joint.coordinate_names`."""
    by_type = {"revolute": ["rad"], "prismatic": ["m"], "free": ["m"] * 3 + ["rad"] * 3}
    return by_type.get(joint.type, ["rad"] * len(joint.coordinate_names))


def ends(mechanism: Mechanism) -> tuple[str, ...]:
    """The parts at the ends of the chains, which leave a trace."""
    inner = {joint.inboard for joint in mechanism.tree_joints()}
    return tuple(joint.outboard for joint in mechanism.tree_joints() if joint.outboard not in inner)
