"""Springs, dampers and actuators of a mechanism as the tendons and actuators of an MJCF."""

from __future__ import annotations

import math

from mbd_sim.mechanism.actuators import Actuator, CoordinatePort, DcMotor, EffortMotor, LinePort, Servo
from mbd_sim.mechanism.constraints import Cable, Distance
from mbd_sim.mechanism.cylinders import Cylinder
from mbd_sim.mechanism.force_elements import Damper, Spring
from mbd_sim.mechanism.laws import Linear
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mjcf.mjcf_document import Document, add_element, number
from mbd_sim.mjcf.written_loops import spatial_tendon


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
        if isinstance(actuator.port, LinePort):
            found |= {actuator.port.first.part, actuator.port.second.part}
    return found


def add_elements(document: Document) -> None:
    """Write springs and dampers between points; other force elements are noted."""
    mechanism = document.mechanism
    for spring in mechanism.springs:
        _add_spring(document, spring)
    for damper in mechanism.dampers:
        _add_damper(document, damper)
    joints = mechanism.all_joints
    own = [bushing.name for bushing in mechanism.bushings if bushing.name not in joints]
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
    motor, servo, port = actuator.motor, actuator.servo, actuator.port
    match motor:
        case EffortMotor(curve=()) if not actuator.delay and (servo is None or _is_plain(servo)):
            limit = min(motor.effort_limit, math.inf if servo is None else servo.limit)
        case EffortMotor() | DcMotor() | Cylinder():
            return False
    if isinstance(port, CoordinatePort):
        if port.coordinate not in document.joints:
            return False
        attributes = {"name": actuator.name, "joint": port.coordinate}
    else:
        tendon = spatial_tendon(document, f"{actuator.name}.line", (port.first, port.second))
        attributes = {"name": actuator.name, "tendon": tendon.attrib["name"]}
    section, force_range = document.section("actuator"), f"{number(-limit)} {number(limit)}" if limit < math.inf else ""
    if servo is None:
        limits = {"ctrllimited": "true", "ctrlrange": force_range} if force_range else {}
        add_element(section, "motor", attributes | limits)
        return True
    limits = {"forcelimited": "true", "forcerange": force_range} if force_range else {}
    gains = (
        {"kp": number(servo.kp), "kv": number(servo.kd)} if servo.controls == "position" else {"kv": number(servo.kp)}
    )
    add_element(section, servo.controls, attributes | gains | limits)
    return True


def _is_plain(servo: Servo) -> bool:
    """Whether it has a form that MuJoCo's servos have: proportional, with a damper for positions."""
    return not servo.ki and not servo.feedforward and servo.period is None and servo.rate_limit == math.inf
