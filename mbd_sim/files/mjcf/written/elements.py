"""What an MJCF has beside its bodies: the equalities, tendons and actuators that a mechanism is written as.

Loops and constraints become equalities; springs, dampers and actuators become tendons and actuators.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import assert_never

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.mjcf.written.bodies import Element, MjcfDocument, add_element, number, text
from mbd_sim.mechanism.elements.actuators import (
    Actuator,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    FluidCylinder,
    LinePort,
    Servo,
    SumPort,
    WrenchPort,
)
from mbd_sim.mechanism.elements.constraints import (
    Cable,
    Clutch,
    Constraint,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
)
from mbd_sim.mechanism.elements.forces import AppliedEffort, AppliedForce, AppliedPotential, Bushing, Damper, Spring
from mbd_sim.mechanism.elements.parts import Attachment, Joint
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.values.expression import TimeExpression
from mbd_sim.mechanism.values.laws import Linear

ARM = 0.1  # m, from one point of a hinge that closes a loop to the other
UNBOUNDED = 1e10  # the other end of a one-sided range


def add_loops(document: MjcfDocument) -> None:
    """Write the joints that close loops, and the screws in the tree."""
    for joint in document.mechanism.closures.values():
        poses = (joint.parent_pose, joint.child_pose)
        match joint.type:
            case "fixed":
                _equality(document, "weld", joint.name, _sites(document, joint, poses, joint.name))
            case "spherical":
                _equality(document, "connect", joint.name, _sites(document, joint, poses, joint.name))
            case "revolute":
                for name, arm in ((joint.name, 0.0), (f"{joint.name}.axis", ARM)):
                    shift = Pose(arm * joint.axis, np.eye(3))
                    ends = [pose @ shift for pose in poses]
                    _equality(document, "connect", name, _sites(document, joint, (ends[0], ends[1]), name))
            case _:
                document.leave_out(f"{joint.type} joints that close loops", joint.name)
    for name, written in document.joints.items():
        if written.joint.kind.advances and written.kind == "slide":
            angle, law = written.joint.name, f"0 {number(written.joint.travel)} 0 0 0"
            _equality(document, "joint", f"{angle}.lead", {"joint1": name, "joint2": angle, "polycoef": law})


def _sites(document: MjcfDocument, joint: Joint, poses: tuple[Pose, Pose], name: str) -> dict[str, str]:
    first = document.site(joint.parent, poses[0], f"{name}.first")
    return {"site1": first, "site2": document.site(joint.child, poses[1], f"{name}.second")}


def _equality(document: MjcfDocument, tag: str, name: str, attributes: Mapping[str, str]) -> None:
    hard = {"solref": f"{number(2.0 * document.mechanism.step)} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
    add_element(document.section("equality"), tag, {"name": name, **attributes, **hard})


def add_constraints(document: MjcfDocument) -> None:
    """Write the constraints that MuJoCo can express."""
    for constraint in document.mechanism.constraints:
        if not _add_constraint(document, constraint):
            document.leave_out("constraints", constraint.name)


def _add_constraint(document: MjcfDocument, constraint: Constraint) -> bool:
    """Whether a constraint could be written."""
    match constraint:
        case Coupling():
            return _add_coupling(document, constraint)
        case Distance(first=first, second=second):
            return _add_line(document, constraint, (first, second))
        case Cable(points=points):
            return _add_line(document, constraint, points)
        case Clutch(capacity=TimeExpression() as capacity) if not capacity.variables and constraint.static == 1.0:
            if (tendon := fixed_tendon(document, constraint.name, constraint.factors)) is None:
                return False
            tendon.set("frictionloss", number(capacity.at(0.0)))
            return True
        case Clutch() | Flat() | Surface() | Rolling() | KnifeEdge():
            return False
        case _:
            assert_never(constraint)


def _add_coupling(document: MjcfDocument, coupling: Coupling) -> bool:
    factors = dict(coupling.factors)
    if coupling.value.variables or coupling.slip or not factors.keys() <= document.joints.keys():
        return False
    value = coupling.value.at(0.0)
    if coupling.bound is None and coupling.play is None and len(factors) == 2:
        (own, factor), (other, follows) = sorted(factors.items(), key=lambda one: one[0] != coupling.follower)
        law = f"{number(value / factor)} {number(-follows / factor)} 0 0 0"
        _equality(document, "joint", coupling.name, {"joint1": own, "joint2": other, "polycoef": law})
        return True
    tendon = fixed_tendon(document, coupling.name, factors)
    if tendon is None:
        return False
    if coupling.play is not None:
        _set_range(document, tendon, value - coupling.play.half, value + coupling.play.half)
    elif coupling.bound is not None:
        _bound(document, tendon, coupling.bound, value)
    else:
        law = f"{number(value)} 0 0 0 0"
        _equality(document, "tendon", coupling.name, {"tendon1": coupling.name, "polycoef": law})
    return True


def fixed_tendon(document: MjcfDocument, name: str, factors: Mapping[str, float]) -> Element | None:
    """A tendon that is a sum of coordinates; None if one of them is not a joint of the file."""
    if not factors.keys() <= document.joints.keys():
        return None
    tendon = add_element(document.section("tendon"), "fixed", {"name": name})
    for coordinate, factor in factors.items():
        add_element(tendon, "joint", {"joint": coordinate, "coef": number(factor)})
    return tendon


def _add_line(document: MjcfDocument, constraint: Distance | Cable, points: tuple[Attachment, ...]) -> bool:
    if constraint.length.variables:
        return False
    length, name = constraint.length.at(0.0), constraint.name
    tendon = spatial_tendon(document, name, points)
    if constraint.bound is not None:
        _bound(document, tendon, constraint.bound, length)
        return True
    places = [document.start(point.part, Pose(point.point, np.eye(3))).position for point in points]
    at_zero = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
    law = f"{number(length - at_zero)} 0 0 0 0"
    _equality(document, "tendon", name, {"tendon1": name, "polycoef": law})
    return True


def spatial_tendon(document: MjcfDocument, name: str, points: tuple[Attachment, ...]) -> Element:
    """A tendon along straight lines from point to point."""
    tendon = add_element(document.section("tendon"), "spatial", {"name": name})
    for index, point in enumerate(points, start=1):
        add_element(tendon, "site", {"site": document.end(point, f"{name}.{index}")})
    return tendon


def _bound(document: MjcfDocument, tendon: Element, bound: str, value: float) -> None:
    lower, upper = (value, UNBOUNDED) if bound == "at_least" else (-UNBOUNDED, value)
    _set_range(document, tendon, max(lower, 0.0) if tendon.tag == "spatial" else lower, upper)


def _set_range(document: MjcfDocument, tendon: Element, lower: float, upper: float) -> None:
    tendon.set("limited", "true")
    tendon.set("range", text(np.array([lower, upper])))
    document.leave_out("restitution of constraints", tendon.attrib["name"])


def attached_parts(mechanism: Mechanism) -> set[str]:
    """The parts to which something besides the joints of the tree is attached."""
    found = {part for joint in mechanism.closures.values() for part in (joint.parent, joint.child)}
    for element in mechanism.force_elements:
        match element:
            case Spring(first=first, second=second) | Damper(first=first, second=second):
                found |= {first.part, second.part}
            case AppliedForce() | AppliedEffort() | AppliedPotential() | Bushing():  # not written
                pass
            case _:
                assert_never(element)
    for constraint in mechanism.constraints:
        match constraint:
            case Distance(first=first, second=second):
                found |= {first.part, second.part}
            case Cable(points=points):
                found |= {point.part for point in points}
            case Coupling() | Clutch() | Flat() | Surface() | Rolling() | KnifeEdge():  # not written at points
                pass
            case _:
                assert_never(constraint)
    for actuator in mechanism.actuators:
        match actuator.port:
            case LinePort(first=first, second=second):
                found |= {first.part, second.part}
            case WrenchPort(at=at):
                found.add(at.part)
            case CoordinatePort() | SumPort():
                pass
            case _:
                assert_never(actuator.port)
    return found


def add_elements(document: MjcfDocument) -> None:
    """Write springs and dampers between points; other force elements are noted."""
    for element in document.mechanism.force_elements:
        match element:
            case Spring():
                _add_spring(document, element)
            case Damper():
                _add_damper(document, element)
            case Bushing(in_joint=True):  # named with its joint
                pass
            case AppliedForce() | AppliedEffort() | AppliedPotential() | Bushing():
                document.leave_out("forces, efforts, potentials and bushings", element.name)
            case _:
                assert_never(element)


def _add_spring(document: MjcfDocument, spring: Spring) -> None:
    if not isinstance(spring.law, Linear):
        document.leave_out("nonlinear springs", spring.name)
        return
    tendon = spatial_tendon(document, spring.name, (spring.first, spring.second))
    if spring.law.stiffness:
        tendon.set("stiffness", number(spring.law.stiffness))
        tendon.set("springlength", number(spring.length))
    if spring.damping:
        tendon.set("damping", number(spring.damping))
    if spring.mass:
        document.leave_out("masses of springs", spring.name)


def _add_damper(document: MjcfDocument, damper: Damper) -> None:
    if damper.law.exponent != 1.0 or not damper.needs_line:
        document.leave_out("dampers that are not linear, or act against all relative motion", damper.name)
        return
    tendon = spatial_tendon(document, damper.name, (damper.first, damper.second))
    tendon.set("damping", number(damper.law.coefficient))


def add_actuators(document: MjcfDocument) -> None:
    """Write motors and servos without states, and the inertia of all rotors as armature."""
    for actuator in document.mechanism.actuators:
        _add_armature(document, actuator)
        if not _add_actuator(document, actuator):
            document.leave_out("actuators", actuator.name)


def _add_armature(document: MjcfDocument, actuator: Actuator) -> None:
    motor, port = actuator.motor, actuator.port
    if not isinstance(port, CoordinatePort) or not motor.rotor_inertia:
        return
    for element in document.root.iter("joint"):
        if element.get("name") == port.coordinate and element.get("type") in ("hinge", "slide"):
            before = float(element.get("armature", "0"))
            element.set("armature", number(before + motor.gear**2 * motor.rotor_inertia))
            return
    document.leave_out("rotors on ball and free joints", actuator.name)


def _add_actuator(document: MjcfDocument, actuator: Actuator) -> bool:
    """Whether an actuator could be written."""
    motor, servo = actuator.motor, actuator.servo
    match motor:
        case EffortMotor(curve=()) if not actuator.delay and (servo is None or _is_plain(servo)):
            limit = min(motor.effort_limit, math.inf if servo is None else servo.limit)
        case EffortMotor() | DcMotor() | FluidCylinder():
            return False
        case _:
            assert_never(motor)
    if (place := _place(document, actuator)) is None:
        return False
    section, attributes = document.section("actuator"), {"name": actuator.name, **place}
    efforts = (max(-limit, motor.effort_range[0]), min(limit, motor.effort_range[1]))
    if servo is None and motor.gain == (1.0, 0.0, 0.0) and not any(motor.bias):
        commands = (max(efforts[0], actuator.command_range[0]), min(efforts[1], actuator.command_range[1]))
        add_element(section, "motor", attributes | _range("ctrl", commands))
        return True
    attributes |= _range("ctrl", actuator.command_range) | _range("force", efforts)
    if servo is None:
        law = {
            "gaintype": "affine",
            "gainprm": text(np.array(motor.gain)),
            "biastype": "affine",
            "biasprm": text(np.array(motor.bias)),
        }
        add_element(section, "general", attributes | law)
        return True
    gains = (
        {"kp": number(servo.kp), "kv": number(servo.kd)} if servo.controls == "position" else {"kv": number(servo.kp)}
    )
    add_element(section, servo.controls, attributes | gains)
    return True


def _place(document: MjcfDocument, actuator: Actuator) -> dict[str, str] | None:
    """The attributes that say where an actuator acts; None if MJCF cannot say it."""
    match actuator.port:
        case CoordinatePort(coordinate=name):
            return {"joint": name} if name in document.joints else None
        case LinePort(first=first, second=second):
            return {"tendon": spatial_tendon(document, f"{actuator.name}.line", (first, second)).attrib["name"]}
        case SumPort(factors=factors):
            tendon = fixed_tendon(document, f"{actuator.name}.sum", factors)
            return None if tendon is None else {"tendon": tendon.attrib["name"]}
        case WrenchPort(at=at, force=force, couple=couple):
            return {"site": document.end(at, f"{actuator.name}.at"), "gear": text(np.concatenate([force, couple]))}
        case _:
            assert_never(actuator.port)


def _range(of: str, ends: tuple[float, float]) -> dict[str, str]:
    """The attributes of a range; an end that is infinite is far away."""
    if ends == (-math.inf, math.inf):
        return {}
    return {f"{of}limited": "true", f"{of}range": text(np.clip(ends, -UNBOUNDED, UNBOUNDED))}


def _is_plain(servo: Servo) -> bool:
    """Whether it has a form that MuJoCo's servos have: proportional, with a damper for positions."""
    return not servo.ki and not servo.feedforward and servo.period is None and servo.rate_limit == math.inf
