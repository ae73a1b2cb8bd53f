"""Actuators of an MJCF, and the armature of its joints.

An actuator of MuJoCo exerts gear · (g ctrl + b0 + b1 l + b2 l') along a joint, with the length l = gear · q. Without
bias it is a motor; with b1 = -g or b2 = -g a servo of the position or the velocity. Any other bias becomes a force of
its own.
The armature of a joint adds to the diagonal of the mass matrix, as the inertia of the rotor of a motor does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from mbd_sim.mjcf.body_tree import key_of
from mbd_sim.mjcf.items import Item
from mbd_sim.mjcf.mechanism_data import MechanismData
from mbd_sim.mjcf.tendons import Tendon
from mbd_sim.urdf.xml_elements import Element

LABELS = {"ball": (".rx", ".ry", ".rz"), "free": (".x", ".y", ".z", ".rx", ".ry", ".rz")}
TRANSMISSIONS = ("joint", "jointinparent", "tendon", "site", "body", "cranksite", "slidersite")
PER_TURN = 2.0 * math.pi  # lead in m with which a rotor turns by 1 rad for 1 m


@dataclass(frozen=True)
class Gain:
    """g, b0, b1 and b2 of an actuator's force."""

    gain: float
    constant: float = 0.0
    length: float = 0.0
    speed: float = 0.0


@dataclass(frozen=True)
class Port:
    """Where an actuator acts: the key and value of a mechanism file, the gear, and how a coordinate is called."""

    place: dict[str, Any]
    gear: float
    coordinate: str = ""
    joint: str = ""


class Actuators:
    """Adds the actuators of a model, and then the armature of its joints."""

    def __init__(self, data: MechanismData, tendons: dict[str, Tendon]) -> None:
        self._data, self._tendons = data, tendons
        self._armature = {
            name: value
            for name, joint in data.joints.items()
            if joint.single and (value := joint.item.number_from_zero("armature"))
        }
        self._motors: dict[str, dict[str, Any]] = {}  # the first actuator on each joint

    def add(self, element: Element, number: int) -> None:
        """Add an actuator, or note what cannot be expressed."""
        item = self._data.context.defaults.item(element, key_of(element))
        port = self._port(item)
        if port is None or (gain := _gain(item)) is None:
            return
        for name in ("armature", "damping"):
            if (value := item.number_from_zero(name)) and port.joint:
                self._add_to_joint(name, port, value * port.gear**2)
            elif value:
                item.leave_out(f"{name} of actuators that do not act on a joint")
        record: dict[str, Any] = {"type": "effort", **port.place}
        servo = _servo(gain, port)
        if servo and port.place.get("joint", "") == port.coordinate and port.joint == "":
            item.leave_out("servos on ball and free joints")
            return
        name = self._data.add("actuators", item, item.text("name") or f"actuator_{number}", record)
        if servo:
            record |= {"servo": servo, "command": {servo["controls"]: 0.0}}
            if port.gear != 1.0:
                item.reading.leave_out("commands are of the joint, MuJoCo's ctrl divided by", f"{name}: {port.gear:g}")
        else:
            self._add_bias(item, name, gain, port)
            if (factor := gain.gain * port.gear) != 1.0:
                item.reading.leave_out("motors take efforts, MuJoCo's ctrl times", f"{name}: {factor:g}")
        self._add_limit(item, record, gain, port, bool(servo))
        if port.joint:
            self._motors.setdefault(port.joint, record)

    def add_armature(self) -> None:
        """Add the armature of joints to their motors; a joint without one gets an actuator that has only a rotor."""
        for joint, inertia in self._armature.items():
            own, slides = self._data.names[joint], self._data.joints[joint].kind == "slide"
            record = self._motors.get(joint)
            if record is None:
                record = {"type": "effort", "joint": own}
                self._data.add("actuators", self._data.joints[joint].item, f"{own}_armature", record)
                self._data.joints[joint].item.leave_out("armature of joints without a motor, here rotors of a motor")
            record |= ({"lead": PER_TURN} if slides else {}) | {"rotor_inertia": inertia}

    def _port(self, item: Item) -> Port | None:
        data, given = self._data, [name for name in TRANSMISSIONS if item.has(name)]
        gear = (item.numbers("gear", 1, 6) or [1.0]) + [0.0] * 5
        if not given:
            item.report("", "names no joint or tendon", "Add 'joint' or 'tendon'.")
        elif given[0] in ("joint", "jointinparent"):
            name = data.reference(item, given[0], [*data.joints], "joint")
            if name is None:
                return None
            joint, own = data.joints[name], data.names[name]
            if joint.single:
                return Port({"joint": own}, gear[0], own, name)
            used = [index for index, value in enumerate(gear) if value]
            if len(used) == 1 and used[0] < len(LABELS[joint.kind]) and given[0] == "joint":
                coordinate = own + LABELS[joint.kind][used[0]]
                return Port({"joint": coordinate}, gear[used[0]], coordinate)
            item.leave_out("actuators about an axis of a ball or free joint that is none of its coordinates")
        elif given[0] == "tendon":
            name = data.reference(item, "tendon", [*self._tendons], "tendon")
            return None if name is None else self._tendon_port(item, self._tendons[name], gear[0])
        else:
            item.leave_out(f"actuators at a {given[0]}")
        return None

    def _tendon_port(self, item: Item, tendon: Tendon, gear: float) -> Port | None:
        if len(tendon.ends) == 2:
            return Port({"between": tendon.ends}, gear)
        if len(tendon.terms) == 1:
            (own, factor), *_ = tendon.terms.items()
            return Port({"joint": own}, gear * factor, own, {new: old for old, new in self._data.names.items()}[own])
        item.leave_out("actuators of tendons over several joints or sites")
        return None

    def _add_to_joint(self, name: str, port: Port, value: float) -> None:
        if name == "armature":
            self._armature[port.joint] = self._armature.get(port.joint, 0.0) + value
        else:
            record = self._data.sections["joints"][self._data.names[port.joint]]
            record["damping"] = record.get("damping", 0.0) + value

    def _add_bias(self, item: Item, name: str, gain: Gain, port: Port) -> None:
        if not (gain.constant or gain.length or gain.speed):
            return
        constant, length, speed = port.gear * gain.constant, port.gear**2 * gain.length, port.gear**2 * gain.speed
        if not port.coordinate or (length and not port.joint):
            item.leave_out("bias of actuators that do not act on a joint with one coordinate")
            return
        terms = [f"{constant!r}", f"({length!r})*{port.coordinate}.position", f"({speed!r})*{port.coordinate}.velocity"]
        effort = " + ".join(term for term, value in zip(terms, (constant, length, speed), strict=True) if value)
        record = {"type": "effort", "coordinate": port.coordinate, "effort": effort}
        self._data.add("forces", item, f"{name}_bias", record)

    def _add_limit(self, item: Item, record: dict[str, Any], gain: Gain, port: Port, servo: bool) -> None:
        """The largest effort by the ranges of the command, the force, and the force on the joint."""
        automatic, found = self._data.context.compiler.autolimits, []
        if item.limited("ctrllimited", "ctrlrange", automatic):
            if servo:
                item.leave_out("ctrlrange of servos")
            else:
                found.append(_bound(item, "ctrlrange", abs(gain.gain * port.gear)))
        if item.limited("forcelimited", "forcerange", automatic):
            if gain.constant or ((gain.length or gain.speed) and not servo):
                item.leave_out("forcerange of actuators with a bias")
            else:
                found.append(_bound(item, "forcerange", abs(port.gear)))
        if port.joint:
            joint = self._data.joints[port.joint].item
            if joint.limited("actuatorfrclimited", "actuatorfrcrange", automatic):
                found.append(_bound(joint, "actuatorfrcrange", 1.0))
                if port.joint in self._motors:
                    joint.leave_out("actuatorfrcrange of joints with several actuators, here of each of them")
        if limits := [limit for limit in found if limit]:
            record["effort_limit"] = min(limits)


def _gain(item: Item) -> Gain | None:
    """The coefficients of the force; None if it has a form that cannot be expressed, which is noted."""
    match item.element.tag:
        case "motor":
            return Gain(1.0)
        case "position" if not (item.number("dampratio") or item.number("timeconst")):
            kp = item.number("kp", 1.0)
            return Gain(kp, 0.0, -kp, -item.number("kv"))
        case "velocity":
            kv = item.number("kv", 1.0)
            return Gain(kv, 0.0, 0.0, -kv)
        case "general":
            plain = item.text("gaintype", "fixed") == "fixed" and item.text("dyntype", "none") == "none"
            bias = item.text("biastype", "none")
            if plain and bias in ("none", "affine"):
                gain = (item.numbers("gainprm", 1, 10) or [1.0])[0]
                b = (item.numbers("biasprm", 1, 10) or [0.0]) + [0.0] * 3 if bias == "affine" else [0.0] * 3
                return Gain(gain, *b[:3])
    item.leave_out(f"{item.element.tag} actuators of a form that is not expressed here")
    return None


def _servo(gain: Gain, port: Port) -> dict[str, Any] | None:
    square = port.gear**2
    if gain.constant or gain.gain <= 0.0 or gain.speed > 0.0 or not square:
        return None
    if gain.length == -gain.gain:
        return {"controls": "position", "kp": gain.gain * square} | ({"kd": -gain.speed * square} if gain.speed else {})
    if gain.length == 0.0 and gain.speed == -gain.gain:
        return {"controls": "velocity", "kp": gain.gain * square}
    return None


def _bound(item: Item, name: str, factor: float) -> float | None:
    lower, upper = item.numbers(name, 2) or [0.0, 0.0]
    if not lower < upper:
        item.report(name if item.has(name) else "", "has no lower limit below an upper one", f"Give {name!r}.")
        return None
    if lower != -upper:
        item.leave_out(f"{name} that is not symmetric, here by its larger bound")
    return factor * max(abs(lower), abs(upper))
