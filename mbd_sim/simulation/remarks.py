"""What a user should know about a model before its first step."""

from __future__ import annotations

from mbd_sim.errors import listed
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import Model


def remarks(model: Model) -> tuple[str, ...]:
    """A sentence on the method, if it is not an ordinary one, and one on limits that do not act on the motion."""
    return tuple(remark for remark in (model.method_remark, limits_remark(model.mechanism)) if remark)


def limits_remark(mechanism: Mechanism) -> str:
    """Which joints have limits that are only passed on to other programs; empty if there are none."""
    idle = [
        f"'{joint.name}'"
        for joint in mechanism.all_joints.values()
        if joint.limits is not None and joint.limits.stiffness is None
    ]
    if not idle:
        return ""
    remedy = "To make them elastic stops, give limits.stiffness"
    if mechanism.source.file.endswith(".urdf"):
        remedy += " in a mechanism file with 'urdf:'"
    return f"the limits of {listed(idle)} do not act on the motion. {remedy}."
