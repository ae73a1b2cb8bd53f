"""Forces of a compiled MJCF that joints of a mechanism file do not have themselves.

The armature of a joint adds to the diagonal of the mass matrix, as the inertia of the rotor of a motor does.
"""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.names import in_expression
from mbd_sim.mjcf.expressions import odd_polynomial, polynomial, signed
from mbd_sim.mjcf.model_actuators import Actuators
from mbd_sim.mjcf.model_joints import SLIDE, has_spring_force
from mbd_sim.mjcf.model_parts import ModelParts
from mbd_sim.mjcf.model_tendons import Tendon
from mbd_sim.urdf.value_reader import rows

PER_TURN = 2.0 * math.pi  # lead in m with which a rotor turns by 1 rad for 1 m
SMOOTH = 0.01  # rad/s or m/s, below which friction falls to zero, as in joints with one coordinate


def add_joint_forces(parts: ModelParts) -> None:
    """Add springs and dampers that are polynomials, and the friction of joints with several coordinates."""
    model, m = parts.model, parts.model.m
    for joint in range(m.njnt):
        names, first = parts.coordinates(joint), int(m.jnt_dofadr[joint])
        if m.jnt_plasticadr[joint] >= 0:
            model.leave_out("springyield of joints, whose springs stay elastic here", "joint", joint)
        if has_spring_force(model, joint) and not model.disabled("SPRING"):
            _add_spring(parts, joint)
        for name, dof in zip(names, range(first, first + len(names)), strict=True):
            linear = min(float(m.dof_damping[dof]), 0.0)  # the rest is in the joint
            damping = [linear, *m.dof_dampingpoly[dof].tolist()]
            if any(damping) and not model.disabled("DAMPER"):
                effort = f"-({odd_polynomial(damping, f'{in_expression(name)}.velocity')})"
                record = {"type": "effort", "coordinate": name, "effort": effort}
                parts.add("forces", "joint", joint, f"{name}_damper", record)
            if (friction := float(m.dof_frictionloss[dof])) and len(names) > 1 and not model.disabled("FRICTIONLOSS"):
                effort = f"{signed(-friction)}*tanh({in_expression(name)}.velocity/{SMOOTH})"
                record = {"type": "effort", "coordinate": name, "effort": effort}
                parts.add("forces", "joint", joint, f"{name}_friction", record)


def _add_spring(parts: ModelParts, joint: int) -> None:
    m = parts.model.m
    if not parts.single(joint):
        parts.model.leave_out("springs of ball and free joints that are polynomials", "joint", joint)
        return
    name, rest = parts.joints[joint], float(m.qpos_spring[m.jnt_qposadr[joint]])
    stiffness = [float(m.jnt_stiffness[joint]), *m.jnt_stiffnesspoly[joint].tolist()]
    terms = [0.0, 0.0, *(k / (power + 2) for power, k in enumerate(stiffness))]
    energy = polynomial(terms, f"({in_expression(name)}.position - {signed(rest)})")
    parts.add("forces", "joint", joint, f"{name}_spring", {"type": "potential", "energy": energy})


def add_gravity_compensation(parts: ModelParts) -> None:
    """Add the forces that carry a share of the weight of bodies."""
    model, m = parts.model, parts.model.m
    if model.disabled("GRAVITY"):
        return
    for body in range(1, m.nbody):
        if not (share := float(m.body_gravcomp[body] * m.body_mass[body])):
            continue
        name = parts.parts[body]
        at = parts.point(name, Pose(m.body_ipos[body].copy(), np.eye(3)), "center")
        record = {"type": "force", "at": at, "vector": rows(-share * m.opt.gravity)}
        parts.add("forces", "body", body, f"{name}_gravcomp", record)


def add_armature(parts: ModelParts, tendons: list[Tendon], actuators: Actuators) -> None:
    """Add the armature to the motor of each joint; a joint without one gets an actuator that has only a rotor."""
    model, m = parts.model, parts.model.m
    added = dict(actuators.armature)
    for tendon in tendons:
        for name, factor in tendon.terms.items() if len(tendon.terms) == 1 else ():
            added[name] = added.get(name, 0.0) + factor**2 * float(m.tendon_armature[tendon.index])
    for joint in range(m.njnt):
        first = int(m.jnt_dofadr[joint])
        for offset, name in enumerate(parts.coordinates(joint)):
            inertia = float(m.dof_armature[first + offset]) + added.get(name, 0.0)
            if not inertia:
                continue
            own = actuators.motors.get(name)
            if own is None:
                record = {"type": "effort", "joint": name}
                own = parts.add("actuators", "joint", joint, f"{name}_armature", record)
                if offset == 0:
                    model.leave_out("armature of joints without a motor, here rotors of a motor", "joint", joint)
            slides = int(m.jnt_type[joint]) == SLIDE or (len(parts.coordinates(joint)) == 6 and offset < 3)
            parts.sections["actuators"][own] |= ({"lead": PER_TURN} if slides else {}) | {"rotor_inertia": inertia}
