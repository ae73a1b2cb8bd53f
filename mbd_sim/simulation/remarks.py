"""What a user should know about a model before its first step."""

from __future__ import annotations

from mbd_sim.contact.elimination import independent
from mbd_sim.errors import listed
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_file.bare_angles import bare_angle_remarks
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.contact_pairs import endless_remarks
from mbd_sim.simulation.drive_jumps import jump_remarks
from mbd_sim.simulation.passing import passing_advice
from mbd_sim.simulation.pulses import pulse_remarks

LOOK_AHEAD = 10.0  # s after the start in which jumps of drives are sought


def remarks(
    model: Model, time: float, y: Array, inputs: Array, step: float, end: float = LOOK_AHEAD
) -> tuple[str, ...]:
    """Sentences on what acts in another way than a reader of the file may expect.

    An unusual method, limits that do not act, undetermined friction, forces shorter than a step, contacts that a
    step may miss, cams without ends, drives that jump, and angles beyond a full turn.

    :param step: in s.
    :param end: the time in s until which jumps of drives are sought.
    """
    found = (
        *model.mechanism.source.remarks,
        model.method_remark,
        limits_remark(model.mechanism),
        friction_remark(model),
        sharing_remark(model, time, y, inputs),
        *endless_remarks(model),
        *passing_advice(model, time, y, inputs, step),
        *pulse_remarks(model.mechanism, step),
        *bare_angle_remarks(model.mechanism.source),
        *_jump_remarks(model.mechanism, end),
    )
    return tuple(remark for remark in found if remark)


def _jump_remarks(mechanism: Mechanism, end: float) -> list[str]:
    if not mechanism.driven_names and not mechanism.constraints:
        return []
    return [*jump_remarks(mechanism, end)]


def friction_remark(model: Model) -> str:
    """Which joints have friction that depends on a force which redundant joints share; empty if there are none."""
    contact = model.one_sided
    if contact is None or not contact.loaded:
        return ""
    undetermined = model.load_sharing.undetermined_forces(0.0, model.start, model.inputs)
    joints = [contact.owners[contact.frictions[index][0][0]][1] for index in contact.loaded]
    shared = [f"'{name}'" for name in joints if name in undetermined]
    if not shared:
        return ""
    return (
        f"friction of {listed(shared)} depends on forces that redundant joints share, and that equilibrium does not "
        "determine. It is computed from one of the possible forces, which depends on the joint that is cut, and not "
        "from those of reactions(). Choose joints without the redundant equations that `mbd_sim check` lists, such as "
        "a spherical joint in place of a revolute one."
    )


def sharing_remark(model: Model, time: float, y: Array, inputs: Array) -> str:
    """Which elements with friction at rest share a load in a state in a way that equilibrium leaves open."""
    contact = model.one_sided
    if contact is None:
        return ""
    modes = contact.modes(inputs)
    sliding = set(contact.sliding(modes))
    resting = [
        (rows, contact.names[gap] if gap is not None else contact.row_names[rows[0]])
        for index, (rows, gap) in enumerate(contact.frictions)
        if index not in sliding and index not in contact.loaded and (gap is None or modes[gap])
    ]
    rows = [row for own, _ in resting for row in own]
    if len(resting) < 2:
        return ""
    matrix = contact.terms(time, y, inputs).matrix
    if len(independent(matrix, rows)) == len(rows):
        return ""
    return (
        f"friction at rest of {listed([repr(name) for _, name in resting])} is statically indeterminate: the motion is "
        "determined, but how these share the load is not. They share it as equal elastic supports, as far as their "
        "limits allow."
    )


def limits_remark(mechanism: Mechanism) -> str:
    """Which joints have limits that are only passed on to other programs; empty if there are none."""
    idle = [
        f"'{joint.name}'"
        for joint in mechanism.all_joints.values()
        if any(
            limits is not None and limits.stiffness is None and limits.restitution is None for limits in joint.limits
        )
    ]
    if not idle:
        return ""
    remedy = "To make them stops, give limits.stiffness or limits.restitution"
    if mechanism.source.file.endswith(".urdf"):
        remedy += " in a mechanism file with 'urdf:'"
    elif mechanism.source.format:
        remedy += " in the mechanism file that `mbd_sim convert` prints"
    return f"the limits of {listed(idle)} do not act on the motion. {remedy}."
