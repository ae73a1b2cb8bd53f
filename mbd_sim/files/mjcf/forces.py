"""The forces of a compiled MJCF: actuators, and what joints of a mechanism file do not have themselves.

An actuator of MuJoCo exerts (g₀ + g₁ l + g₂ l') ctrl + b₀ + b₁ l + b₂ l' along its length l. With b₁ = -g₀ or b₂ = -g₀
it is a servo of the position or the velocity, otherwise a motor with gain and bias.

The armature of a joint adds to the diagonal of the mass matrix, as the inertia of the rotor of a motor does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Pose
from mbd_sim.files.mjcf.compiled_model import odd_polynomial, polynomial, signed, weighted_sum
from mbd_sim.files.mjcf.couplings import Tendon
from mbd_sim.files.mjcf.parts import SLIDE, ModelParts, has_spring_force
from mbd_sim.files.text.xml import rows
from mbd_sim.mechanism.values.names import in_expression

IN_JOINT, IN_PARENT, _, IN_TENDON, AT_SITE = range(5)  # mjtTrn
OTHERS = {2: "slider-crank", AT_SITE: "site relative to another one", 5: "body", 6: "pair of orientations"}
Range = tuple[float, float]
EVERYTHING: Range = (-math.inf, math.inf)


@dataclass(frozen=True)
class Place:
    """Where an actuator acts: keys of a mechanism file, and `scale`, which is l for a position of 1.

    `coordinates` are those on which it acts, with their factors, unless it acts along a line or at a site.
    `force_range` is that of all actuators there. On a ball or a free joint, or at a site, there is no position.
    """

    keys: dict[str, Any]
    scale: float
    coordinates: dict[str, float]
    has_position: bool = True
    force_range: Range = EVERYTHING

    @property
    def gear(self) -> float:
        """l for a sum of the coordinates of 1, also where l is the length of a tendon over one joint."""
        return self.scale / next(iter(self.coordinates.values())) if "joint" in self.keys else self.scale


class Actuators:
    """Adds the actuators of a model; `motors` are the first ones on each coordinate, `armature` is what they add."""

    def __init__(self, parts: ModelParts, tendons: list[Tendon]) -> None:
        self._parts, self._model, self._tendons = parts, parts.model, tendons
        self.motors: dict[str, str] = {}
        self.armature: dict[str, float] = {}
        self._used: set[tuple[int, int]] = set()
        m = self._model.m
        for index in range(m.nactuator):
            group = int(m.actuator_group[index])
            if self._model.disabled("ACTUATION") or (m.opt.disableactuator >> group) & 1:
                self._model.leave_out("actuators, which are disabled", "actuator", index)
            elif (place := self._place(index)) is not None:
                self._add_passive(index, place)
                if reason := self._form(index):
                    self._model.leave_out(reason, "actuator", index)
                elif place.coordinates or "joint" not in place.keys:
                    self._add(index, place)

    def _form(self, index: int) -> str:
        """Why the force of an actuator cannot be expressed; empty if it can."""
        m, mujoco = self._model.m, self._model.mujoco
        dynamics = mujoco.mjtDyn(m.actuator_dyntype[index]).name.removeprefix("mjDYN_").lower()
        gain = mujoco.mjtGain(m.actuator_gaintype[index]).name.removeprefix("mjGAIN_").lower()
        bias = mujoco.mjtBias(m.actuator_biastype[index]).name.removeprefix("mjBIAS_").lower()
        if m.actuator_plugin[index] >= 0:
            return "actuators of plugins, which exert no force"
        if dynamics != "none" or m.actuator_actadr[index] >= 0:
            return f"actuators with an activation ({dynamics}), which exert no force"
        if gain not in ("fixed", "affine") or bias not in ("none", "affine"):
            return f"actuators whose gain is {gain} and bias {bias}, which exert no force"
        if m.actuator_ctrlnum[index] != 1 or m.actuator_outnum[index] != 1:
            return "actuators with several controls or outputs, which exert no force"
        return ""

    def _place(self, index: int) -> Place | None:
        parts, m = self._parts, self._model.m
        kind, target = int(m.actuator_trntype[index]), int(m.actuator_trnid[index][0])
        gear = m.actuator_gear[m.actuator_outadr[index]].copy()
        if kind in (IN_JOINT, IN_PARENT):
            names, limit = parts.coordinates(target), _limit(m.jnt_actfrclimited[target], m.jnt_actfrcrange[target])
            if parts.single(target):
                return Place({"joint": names[0]}, float(gear[0]), {names[0]: 1.0}, True, limit)
            turned = np.any(gear[3:] if len(names) == 6 else gear[:3])
            if kind == IN_PARENT and turned:
                self._leave_out(index, "actuators about axes of the parent of a ball or free joint")
                return None
            return _on_coordinates(dict(zip(names, gear.tolist(), strict=False)))
        if kind == IN_TENDON:
            return self._on_tendon(index, self._tendons[target], float(gear[0]))
        if kind == AT_SITE and int(m.actuator_trnid[index][1]) < 0:
            frame = parts.sites[target]
            name = self._model.name("site", target) or "site"
            if frame.part == "ground":
                self._leave_out(index, "actuators at sites of the world")
                return None
            at = parts.point(frame.part, frame.pose, name)
            return Place({"at": at, "wrench": gear.tolist()}, 1.0, {}, False)
        self._leave_out(index, f"actuators at a {OTHERS[kind]}")
        return None

    def _leave_out(self, index: int, what: str) -> None:
        self._model.leave_out(f"{what}, which exert no force", "actuator", index)

    def _on_tendon(self, index: int, tendon: Tendon, gear: float) -> Place | None:
        m = self._model.m
        lower, upper = _limit(m.tendon_actfrclimited[tendon.index], m.tendon_actfrcrange[tendon.index])
        if len(tendon.terms) == 1:
            ((own, factor),) = tendon.terms.items()
            ends = sorted((lower * factor, upper * factor))
            return Place({"joint": own}, gear * factor, {own: factor}, True, (ends[0], ends[1]))
        if tendon.terms:
            return Place({"terms": dict(tendon.terms)}, gear, dict(tendon.terms), True, (lower, upper))
        if tendon.has_line:
            return Place({"between": list(tendon.ends)}, gear, {}, True, (lower, upper))
        self._leave_out(index, "actuators of tendons around geoms or over several sites")
        return None

    def _add(self, index: int, place: Place) -> None:
        model, m, s = self._model, self._model.m, place.scale
        gain = [float(value) for value in m.actuator_gainprm[index][:3]]
        bias = [float(value) for value in m.actuator_biasprm[index][:3]]
        if m.actuator_gaintype[index] == model.mujoco.mjtGain.mjGAIN_FIXED:
            gain[1:] = [0.0, 0.0]
        if m.actuator_biastype[index] == model.mujoco.mjtBias.mjBIAS_NONE:
            bias = [0.0, 0.0, 0.0]
        if not place.has_position and "at" not in place.keys and (gain[1] or bias[1]):
            model.leave_out("bias by the position of a ball or free joint, which is missing", "actuator", index)
        if m.actuator_delay[index]:
            model.leave_out("delays of actuators, whose commands act at once", "actuator", index)
        record: dict[str, Any] = {"type": "effort", **place.keys}
        servo = _servo(gain, bias, s) if place.has_position else None
        wanted = model.name("actuator", index) or f"actuator_{index + 1}"
        name = self._parts.add("actuators", "actuator", index, wanted, record)
        control = int(m.actuator_ctrladr[index])
        clamped = m.actuator_ctrllimited[control] and not model.disabled("CLAMPCTRL")
        commands = _limit(clamped, m.actuator_ctrlrange[control])
        if servo:
            record |= {"servo": servo}
            factor = 1.0 / s
            if s != 1.0:
                model.reading.leave_out("commands are of the joint, MuJoCo's ctrl divided by", f"{name}: {s:g}")
        else:
            factor = self._add_gain(record, name, gain, bias, s)
        efforts = [_limit(m.actuator_forcelimited[index], s * m.actuator_forcerange[index]), place.force_range]
        self._add_ranges(record, tuple(factor * end for end in commands), efforts, bool(servo) or any(bias))
        if "joint" in place.keys:
            self.motors.setdefault(place.keys["joint"], name)
        where = (int(m.actuator_trntype[index]), int(m.actuator_trnid[index][0]))
        if where in self._used and place.force_range != EVERYTHING:
            sentence = "actuatorfrcrange where several actuators act, here of each of them"
            model.leave_out(sentence, "actuator", index)
        self._used.add(where)

    def _add_gain(self, record: dict[str, Any], name: str, gain: list[float], bias: list[float], s: float) -> float:
        """Add gain and bias of a motor; what an effort that is commanded is for a ctrl of 1."""
        scales = (s, s * s, s * s)
        if any(bias):
            record["bias"] = [scale * b for scale, b in zip(scales, bias, strict=True)]
        factor = gain[0] * s
        if any(gain[1:]) or not factor:
            record["gain"] = [scale * g for scale, g in zip(scales, gain, strict=True)]
            factor = 1.0
        if factor != 1.0:
            self._model.reading.leave_out("motors take efforts, MuJoCo's ctrl times", f"{name}: {factor:g}")
        return factor

    def _add_ranges(
        self, record: dict[str, Any], commands: tuple[float, ...], efforts: list[Range], differs: bool
    ) -> None:
        """Add the limits of the command and of the effort: of a plain motor the two are one, if they are symmetric."""
        lower, upper = sorted(commands)
        channel = record["servo"]["controls"] if "servo" in record else "effort"
        first = min(max(0.0, lower), upper)
        if first or channel != "effort":
            record["command"] = {channel: first}
        if not differs and "gain" not in record and lower == -upper:
            efforts = [*efforts, (lower, upper)]
        elif (lower, upper) != EVERYTHING:
            record["command_range"] = [lower, upper]
        low, high = max(low for low, _ in efforts), min(high for _, high in efforts)
        if low == -high and high > 0.0:
            record |= {"effort_limit": high} if high < math.inf else {}
        else:
            record["effort_range"] = [min(low, high), high]

    def _add_passive(self, index: int, place: Place) -> None:
        """Add the inertia and the damping of an actuator, which its limits do not concern."""
        m, s = self._model.m, place.scale
        if armature := float(m.actuator_armature[index]):
            if "joint" in place.keys and place.has_position:
                (own,) = place.coordinates
                self.armature[own] = self.armature.get(own, 0.0) + armature * s**2
            else:
                self._model.leave_out("armature of actuators that act on no single joint", "actuator", index)
        damping = [float(m.actuator_damping[index]), *m.actuator_dampingpoly[index].tolist()]
        if not any(damping) or self._model.disabled("DAMPER"):
            return
        if not place.coordinates:
            self._model.leave_out("damping of actuators that act on no joint, which is missing", "actuator", index)
            return
        speed = weighted_sum(place.coordinates, "velocity")
        for own, factor in place.coordinates.items():
            effort = f"{signed(-(place.gear**2) * factor)}*({odd_polynomial(damping, f'({speed})')})"
            record = {"type": "effort", "coordinate": own, "effort": effort}
            name = self._model.name("actuator", index) or f"actuator_{index + 1}"
            self._parts.add("forces", "actuator", index, f"{name}_damping", record)


def _on_coordinates(factors: dict[str, float]) -> Place:
    """On a ball or a free joint, along the components of its gear."""
    used = {name: factor for name, factor in factors.items() if factor}
    if len(used) == 1:
        ((name, factor),) = used.items()
        return Place({"joint": name}, factor, {name: 1.0}, False)
    return Place({"terms": used}, 1.0, used, False) if used else Place({"joint": ""}, 1.0, {}, False)


def _limit(limited: Any, ends: Any) -> Range:
    lower, upper = sorted(map(float, ends))
    return (lower, upper) if limited else EVERYTHING


def _servo(gain: list[float], bias: list[float], s: float) -> dict[str, Any] | None:
    """The servo that an actuator with this gain and bias is; None if it is none."""
    g, square = gain[0], s * s
    if any(gain[1:]) or bias[0] or g <= 0.0 or not square or bias[2] > 0.0:
        return None
    if bias[1] == -g:
        return {"controls": "position", "kp": g * square} | ({"kd": -bias[2] * square} if bias[2] else {})
    if bias[1] == 0.0 and bias[2] == -g:
        return {"controls": "velocity", "kp": g * square}
    return None


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
