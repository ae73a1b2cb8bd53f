"""What the `<ros2_control>` blocks of a URDF say, as drives, actuators, starts and sensors of a mechanism file.

Command interfaces are those of joints. A joint serves one of them: position and velocity by a drive that follows
commands, effort by the effort of the joint. A joint that has an actuator or a drive in the file keeps it. Interfaces
that nothing serves, and everything else that is not read, are noted by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from mbd_sim.base.errors import InputError, listed, nearest, quoted
from mbd_sim.files.text.xml import NUMBER, Element, parse_elements
from mbd_sim.mechanism.values.names import accepted_names, reference, unique_name
from mbd_sim.mechanism.values.source import Location, Source

Interface = Literal["position", "velocity", "effort"]  # the command interface that a joint with several of them serves
INTERFACES: tuple[Interface, ...] = get_args(Interface)
KEY = "ros2_control"
BANDWIDTH = 100.0  # rad/s, of drives: a ramp of positions is followed 22 ms later
ONE_COORDINATE = ("revolute", "prismatic")
AXES = ("x", "y", "z")
IMU = {f"{quantity}.{axis}" for quantity in ("angular_velocity", "linear_acceleration") for axis in AXES}
ORIENTATION = {f"orientation.{axis}" for axis in (*AXES, "w")}
FORCE_TORQUE = {f"{quantity}.{axis}" for quantity in ("force", "torque") for axis in AXES}
READ_IN_JOINT = ("command_interface", "state_interface", "param")
BY_ACTUATORS = "efforts by actuators, as their ranges are not symmetric; actuator_timeout ends their commands"
TRANSMISSION = "<transmission>, which changes nothing, because commands and states are those of the joints"


def with_control(source: Source, preferred: Interface | None) -> Source:
    """The source, whose joints and sensors are those of its `<ros2_control>` blocks.

    :param preferred: replaces the file's key `control`; without both, the blocks do not act.
    """
    if not isinstance(source.data, dict):
        return source
    written = source.data.get("control")
    chosen = preferred or written
    if chosen not in INTERFACES:
        return source  # the schema reports a word that is none of them
    text = source.data.get(KEY)
    if not text:
        message = "there is no <ros2_control> block whose interfaces could act"
        remedy = "Leave it out; actuators or drives of a mechanism file that extends this one hold joints as well."
        source.problems.append(source.problem(("control",), message, remedy, chosen))
        return source
    if not all(isinstance(source.data.get(key, {}), dict) for key in ("parts", "joints", "actuators", "sensors")):
        return source  # the schema reports it
    try:
        blocks = parse_elements(str(text), KEY)
    except InputError:
        return source  # the same
    reader = _ControlBlocks(source, chosen)
    for block in blocks:
        reader.read(block)
    return reader.result()


@dataclass
class _Limits:
    """The range of an interface, and its value at the start."""

    least: float | None = None
    most: float | None = None
    initial: float | None = None


@dataclass
class _ControlBlocks:
    """The blocks of a file while they are read."""

    source: Source
    preferred: Interface
    joints: dict[str, Any] = field(init=False)
    actuators: dict[str, Any] = field(init=False)
    sensors: dict[str, Any] = field(init=False)
    served: dict[str, list[str]] = field(default_factory=dict)  # names of joints by what serves them
    unread: dict[str, list[str]] = field(default_factory=dict)  # names by what is not read

    def __post_init__(self) -> None:
        data = self.source.data
        self.joints, self.actuators, self.sensors = (
            dict(data.get(key) or {}) for key in ("joints", "actuators", "sensors")
        )
        couplings = [one for one in (data.get("constraints") or {}).values() if isinstance(one, dict)]
        self.followers = {follower for one in couplings if isinstance(follower := one.get("follower"), str)}
        self.moved = {one.get("joint") for one in self.actuators.values() if isinstance(one, dict)}
        self.seen: dict[str, str] = {}
        self._at: Location = (KEY,)  # of what is being read

    def read(self, block: Element) -> None:
        """Read a block."""
        name = block.attributes.get("name", "")
        for hardware in block.all("hardware"):
            for one in hardware.children:
                what = "plugins" if one.tag == "plugin" else "parameters of the hardware"
                shown = one.text if one.tag == "plugin" else one.attributes.get("name", one.tag)
                self._leave_out(f"{what} of <ros2_control>", f"{name}: {shown}")
        for element in block.children:
            own = element.attributes.get("name", "")
            self._at = (KEY, own)
            match element.tag:
                case "hardware":
                    pass
                case "joint":
                    self._joint(element, own, name)
                case "sensor":
                    self._sensor(element, own)
                case "transmission":
                    self._leave_out(TRANSMISSION, own)
                case _:
                    self._leave_out(f"<{element.tag}> of <ros2_control>", own)

    def result(self) -> Source:
        """The source with all that was read."""
        source = self.source
        served = [f"{what}: {listed(names, 100)}" for what, names in self.served.items()]
        remarks = (f"<ros2_control> acts ({'; '.join(served) or 'nothing in it can'}).",)
        notes = tuple(f"{what}: {listed(list(dict.fromkeys(names)), 40)}" for what, names in self.unread.items())
        own = f"<{KEY}>, which acts"
        kept = tuple(note for note in source.notes if not note.startswith(own))
        data = {**source.data, "joints": self.joints}
        data |= {key: found for key in ("actuators", "sensors") if (found := getattr(self, key))}
        data["control"] = self.preferred
        comments = source.comments or (f"From {source.file}.",)
        comments = tuple(line for line in comments if not line.startswith(own))
        return replace(
            source, data=data, text=None, notes=(*kept, *notes), comments=(*comments, *remarks, *notes),
            remarks=(*source.remarks, *remarks),
        )  # fmt: skip

    def _leave_out(self, what: str, name: str) -> None:
        self.unread.setdefault(what, []).append(name)

    def _problem(self, message: str, remedy: str) -> None:
        self.source.problems.append(self.source.problem(self._at, message, remedy))

    def _joint(self, element: Element, name: str, block: str) -> None:
        record = self.joints.get(name)
        if not isinstance(record, dict):
            self._problem(f"<{KEY} name={quoted(block)}> has a joint {quoted(name)}, which the robot does not have",
                          nearest(name, self.joints))  # fmt: skip
            return
        if name in self.seen:
            self._problem(f"the joint {quoted(name)} is in the blocks {self.seen[name]} and {block}", "Keep one.")
            return
        self.seen[name] = block
        for child in element.children:
            if child.tag not in READ_IN_JOINT:
                self._leave_out(f"<{child.tag}> of joints of <ros2_control>", name)
        commands = self._interfaces(element, "command_interface", name)
        states = self._interfaces(element, "state_interface", name)
        if record.get("type") not in ONE_COORDINATE:
            self._leave_out("joints of <ros2_control> that have no single coordinate", name)
            return
        self._serve(name, commands, states)

    def _interfaces(self, element: Element, tag: str, joint: str) -> dict[Interface, _Limits]:
        found: dict[Interface, _Limits] = {}
        for one in element.all(tag):
            name = one.attributes.get("name", "")
            if name not in INTERFACES:
                self._leave_out(f"<{tag}> other than position, velocity and effort", f"{joint}/{name}")
                continue
            found[name] = self._limits(one, f"{joint}/{name}")
        return found

    def _limits(self, element: Element, where: str) -> _Limits:
        values = {"min": element.attributes.get("min"), "max": element.attributes.get("max")}
        for parameter in element.all("param"):
            name = parameter.attributes.get("name", "")
            if name in ("min", "max", "initial_value"):
                values[name] = parameter.text
            else:
                self._leave_out("parameters of interfaces", f"{where} {name}")
        numbers = {name: self._number(text.strip(), f"{where} {name}") for name, text in values.items() if text}
        least, most = numbers.get("min"), numbers.get("max")
        if least is not None and most is not None and least >= most:
            self._problem(f"{where}: min {least:g} is not below max {most:g}", "Swap them.")
            least = most = None
        return _Limits(least, most, numbers.get("initial_value"))

    def _number(self, text: str, where: str) -> float | None:
        if NUMBER.fullmatch(text):
            return float(text)
        self._problem(f"{where}: {quoted(text)} is not a number", "Write a plain number.")
        return None

    def _serve(self, name: str, commands: Mapping[Interface, _Limits], states: Mapping[Interface, _Limits]) -> None:
        """Let a joint take the commands of one interface, and start where the states say."""
        record, by_actuator = self.joints[name], False
        if record.get("drive") is not None or name in self.moved:
            self.served.setdefault("by what the file has", []).append(name)
            return
        start = {key: limits.initial for key, limits in states.items() if limits.initial is not None}
        if name in self.followers:
            for interface in commands:
                self._leave_out("command interfaces of joints that follow another one", f"{name}/{interface}")
            for interface in start:
                self._leave_out("initial values of joints that follow another one", f"{name}/{interface}")
            return
        chosen = next((one for one in (self.preferred, *INTERFACES) if one in commands), None)
        used: set[Interface] = set() if chosen is None else {chosen}
        if chosen == "position" and "velocity" in commands:
            used.add("velocity")  # as a feedforward
        for interface in commands:
            if interface not in used:
                self._leave_out("command interfaces beside the one that acts", f"{name}/{interface}")
        if chosen in ("position", "velocity"):
            self.joints[name] = self._driven(name, chosen, commands, start)
        else:
            self.joints[name] = {**{key: start[key] for key in ("position", "velocity") if key in start}, **record}
            by_actuator = chosen == "effort" and self._limit_effort(name, commands["effort"])
        if "effort" in start:
            self._leave_out("initial values of efforts", name)
        if chosen is not None:
            kind = {"position": "positions by drives", "velocity": "velocities by drives", "effort": "efforts"}[chosen]
            self.served.setdefault(BY_ACTUATORS if by_actuator else kind, []).append(name)

    def _driven(
        self, name: str, chosen: Interface, commands: Mapping[Interface, _Limits], start: Mapping[Interface, float]
    ) -> dict[str, Any]:
        """The joint with a drive: its type, its ends and its axis stay."""
        record = self.joints[name]
        drive: dict[str, Any] = {"command": chosen, "bandwidth": BANDWIDTH}
        position, limits = commands.get("position", _Limits()), record.get("limits")
        limits = limits if isinstance(limits, dict) else {}
        lower = _innermost(max, position.least, limits.get("lower"))
        upper = _innermost(min, position.most, limits.get("upper"))
        drive |= {key: value for key, value in (("lower", lower), ("upper", upper)) if value is not None}
        if (speed := self._speed(name, commands.get("velocity", _Limits()), record.get("velocity_limit"))) is not None:
            drive["velocity_limit"] = speed
        at = record.get("position", start.get("position"))
        drive |= self._start(name, at, lower, upper)
        if "velocity" in start:
            self._leave_out("initial velocities of driven joints, which start at rest", name)
        for key in sorted(record.keys() & {"damping", "friction", "stiffness", "effort_limit"}):
            self._leave_out(f"{key} of joints with a drive, which moves whatever the force", name)
        return {key: value for key, value in record.items() if key in ("type", "between", "axis")} | {"drive": drive}

    def _start(self, name: str, at: Any, lower: Any, upper: Any) -> dict[str, Any]:
        """Where a drive starts: where it is told to, or at zero, within its range."""
        number = 0.0 if at is None else at
        if not isinstance(number, int | float):
            return {"position": number}
        inside = number
        if isinstance(lower, int | float):
            inside = max(inside, lower)
        if isinstance(upper, int | float):
            inside = min(inside, upper)
        if inside != number:
            self._leave_out("start positions out of the range, here at its end", name)
        return {"position": inside} if inside else {}

    def _speed(self, name: str, limits: _Limits, own: Any) -> Any:
        """The limit of the speed in both directions."""
        ends = [abs(value) for value in (limits.least, limits.most) if value is not None]
        if len(ends) == 2 and ends[0] != ends[1]:
            self._leave_out("velocity ranges that are not symmetric, here with the larger end", name)
        largest = max(ends, default=None)
        return _innermost(min, largest if largest else None, own)

    def _limit_effort(self, name: str, limits: _Limits) -> bool:
        """Bound the effort of a joint; whether that needs an actuator, because the range is not symmetric."""
        least, most = limits.least, limits.most
        if least is None and most is None:
            return False
        if least is None or most is None:
            self._leave_out("ranges of efforts with one end", name)
            return False
        if least == -most:
            record = self.joints[name]
            self.joints[name] = {**record, "effort_limit": _innermost(min, most, record.get("effort_limit"))}
            return False
        own = unique_name(name, self.actuators)
        self.actuators[own] = {"type": "effort", "joint": name, "command_range": [least, most]}
        return True

    def _sensor(self, element: Element, name: str) -> None:
        interfaces = {one.attributes.get("name", "") for one in element.all("state_interface")}
        parameters = {one.attributes.get("name", ""): one.text.strip() for one in element.all("param")}
        frame = parameters.pop("frame_id", name)
        kind = next((kind for kind in (IMU | ORIENTATION, FORCE_TORQUE) if interfaces & kind), set())
        for interface in sorted(interfaces - kind):
            self._leave_out("state interfaces of sensors that nothing measures", f"{name}/{interface}")
        for parameter in parameters:
            self._leave_out("parameters of sensors", f"{name} {parameter}")
        if not kind:
            return
        if frame not in self.source.data["parts"]:
            what = "sensors whose parameter frame_id names no link"
            self._leave_out(what, f"{name} ({frame})" if frame != name else name)
            return
        if kind == FORCE_TORQUE:
            joint = self._joint_before(frame)
            if joint is None:
                self._leave_out("force–torque sensors on a link that no joint carries", name)
                return
            record: dict[str, Any] = {"type": "force_torque", "joint": joint}
        else:
            record = {"type": "imu", "at": reference(frame)}
            record |= {"orientation": {}} if interfaces & ORIENTATION else {}
        own = accepted_names([name], "sensor")[name]
        if isinstance(written := self.sensors.setdefault(own, record), dict):
            same = written.get("type") in (None, record["type"])
            self.sensors[own] = {**record, **written} if same else written
        self.served.setdefault("sensors", []).append(own)

    def _joint_before(self, part: str) -> str | None:
        """The joint that carries a part."""
        for name, record in self.joints.items():
            between = record.get("between") if isinstance(record, dict) else None
            if isinstance(between, list) and between[1:] == [reference(part)]:
                return name
        return None


def _innermost(choose: Any, first: float | None, second: Any) -> Any:
    """The narrower of two limits; the first one where the other has a unit."""
    if first is None or second is None:
        return second if first is None else first
    return choose(first, second) if isinstance(second, int | float) else first
