"""Springs, dampers and actuators of a mechanism as the tendons and actuators of an MJCF."""

from __future__ import annotations

import math
from typing import assert_never

import numpy as np

from mbd_sim.mechanism.actuators import (
    Actuator,
    CoordinatePort,
    DcMotor,
    EffortMotor,
    LinePort,
    Servo,
    SumPort,
    WrenchPort,
)
from mbd_sim.mechanism.constraints import Cable, Distance
from mbd_sim.mechanism.cylinders import Cylinder
from mbd_sim.mechanism.force_elements import Damper, Spring
from mbd_sim.mechanism.laws import Linear
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mjcf.mjcf_document import Document, add_element, number, text
from mbd_sim.mjcf.written_loops import UNBOUNDED, fixed_tendon, spatial_tendon


def attached_parts(mechanism: Mechanism) -> set[str]:
    """The parts to which something besides the joints of the tree is attached."""
    found = {part for joint in mechanism.closures.values() for part in (joint.parent, joint.child)}
    for element in mechanism.two_point_elements:
        found |= {element.first.part, element.second.part}
    for constraint in mechanism.constraints:
        if isinstance(constraint, Distance):
            found |= {constraint.first.part, constraint.second.part}
        elif isinstance(constraint, Cable):
            found |= {point.part for point in constraint.points}
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


def add_elements(document: Document) -> None:
    """Write springs and dampers between points; other force elements are noted."""
    mechanism = document.mechanism
    for spring in mechanism.springs:
        _add_spring(document, spring)
    for damper in mechanism.dampers:
        _add_damper(document, damper)
    own = [bushing.name for bushing in mechanism.bushings if not bushing.in_joint]
    applied = [*(one.name for one in mechanism.applied), *(one.name for one in mechanism.efforts)]
    for name in (*applied, *(one.name for one in mechanism.potentials), *own):
        document.leave_out("forces, efforts, potentials and bushings", name)


def _add_spring(document: Document, spring: Spring) -> None:
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


def _add_damper(document: Document, damper: Damper) -> None:
    if damper.law.exponent != 1.0 or not damper.needs_line:
        document.leave_out("dampers that are not linear, or act against all relative motion", damper.name)
        return
    tendon = spatial_tendon(document, damper.name, (damper.first, damper.second))
    tendon.set("damping", number(damper.law.coefficient))


def add_actuators(document: Document) -> None:
    """Write motors and servos without states, and the inertia of all rotors as armature."""
    for actuator in document.mechanism.actuators:
        _add_armature(document, actuator)
        if not _add_actuator(document, actuator):
            document.leave_out("actuators", actuator.name)


def _add_armature(document: Document, actuator: Actuator) -> None:
    motor, port = actuator.motor, actuator.port
    if isinstance(motor, Cylinder) or not isinstance(port, CoordinatePort) or not motor.rotor_inertia:
        return
    for element in document.root.iter("joint"):
        if element.get("name") == port.coordinate and element.get("type") in ("hinge", "slide"):
            before = float(element.get("armature", "0"))
            element.set("armature", number(before + motor.gear**2 * motor.rotor_inertia))
            return
    document.leave_out("rotors on ball and free joints", actuator.name)


def _add_actuator(document: Document, actuator: Actuator) -> bool:
    """Whether an actuator could be written."""
    motor, servo = actuator.motor, actuator.servo
    match motor:
        case EffortMotor(curve=()) if not actuator.delay and (servo is None or _is_plain(servo)):
            limit = min(motor.effort_limit, math.inf if servo is None else servo.limit)
        case EffortMotor() | DcMotor() | Cylinder():
            return False
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


def _place(document: Document, actuator: Actuator) -> dict[str, str] | None:
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
