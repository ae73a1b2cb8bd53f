"""Mechanisms in other units of length, mass and time: every quantity of a file is multiplied by what its unit becomes.

With factors that are powers of 1024, no number is rounded, and every digit of a motion stays the same unless a number
with a dimension is hidden in the engine. Angles and currents keep their units. Sensors are left out.
"""

import ast
import typing
from dataclasses import dataclass, replace

from mbd_sim.files.builders.actuators import TRANSITION
from mbd_sim.files.builders.mechanism import build
from mbd_sim.files.checks.repetition import expanded
from mbd_sim.files.checks.validation import validate
from mbd_sim.files.schema import actuators, constraints, forces, laws
from mbd_sim.files.schema.fields import ExpressionField, QuantityField, Spec
from mbd_sim.files.text.library import find
from mbd_sim.files.text.yaml_text import parse_source
from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS
from mbd_sim.mechanism.values.expression import TimeExpression

VOLTAGE_CONTROLS = {"voltage": "V", "current": "A", "opening": ""}


@dataclass(frozen=True)
class Units:
    """The factors by which lengths, masses and times are multiplied."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def factor(self, unit: str) -> float:
        """The factor for a quantity in an SI unit, such as N*m/rad."""
        length, mass, time = self.length, self.mass, self.time
        force = mass * length / time**2
        power = force * length / time
        names = {
            "m": length,
            "kg": mass,
            "s": time,
            "rad": 1.0,
            "turn": 1.0,
            "Hz": 1.0 / time,
            "A": 1.0,
            "N": force,
            "J": force * length,
            "W": power,
            "Pa": force / length**2,
            "V": power,
            "ohm": power,
            "H": power * time,
        }
        return float(eval(unit, {"__builtins__": {}}, names)) if unit else 1.0


def scaled(name: str, units: Units):
    """A shipped mechanism, or that of a file, in other units."""
    path = find(name)
    source = expanded(parse_source(path.read_text(encoding="utf-8"), str(path)))
    file, parameters = validate(source)
    return build(_Scaler(units, file).of_file(), parameters, source)


class _Scaler:
    def __init__(self, units: Units, file) -> None:
        self.units, self.file = units, file
        self.unit_of = {}  # of each coordinate
        for name, joint in file.joints.items():
            for coordinate in JOINT_KINDS[joint.type].coordinates:
                self.unit_of[name + coordinate.label] = "rad" if coordinate.rotation else "m"

    def of_file(self):
        kept = self.file.model_copy(update={"sensors": {}, "bases": {}})
        return self.record(kept)

    def record(self, spec: Spec) -> Spec:
        kinds = typing.get_type_hints(type(spec), include_extras=True)
        changes = {key: self.value(getattr(spec, key), kinds[key]) for key in type(spec).model_fields}
        changes |= self.special(spec)
        result = spec.model_copy(update=changes)
        object.__setattr__(result, "__pydantic_fields_set__", set(spec.model_fields_set))
        return result

    def value(self, value, kind):
        if isinstance(value, Spec):
            return self.record(value)
        if isinstance(value, dict):
            return {
                key: self.value(entry, typing.get_args(kind)[1] if _is(kind, dict) else kind)
                for key, entry in value.items()
            }
        if isinstance(value, list | tuple):
            inner = _inner(kind, len(value))
            return type(value)(self.value(entry, one) for entry, one in zip(value, inner, strict=True))
        mark = _mark(kind)
        if mark is None or mark.unit is None or value is None:
            return value
        return (
            self.expression(value, mark.unit)
            if isinstance(value, TimeExpression)
            else value * self.units.factor(mark.unit)
        )

    def expression(self, value: TimeExpression, unit: str, local: str = "m") -> TimeExpression:
        """An expression in other units, which has its old values between its scaled variables and its result.

        :param local: the unit of x, y and z, and of x.velocity times s.
        """
        factors = {"t": "s", "x": local, "y": local, "z": local, "x.velocity": f"{local}/s", "angle": "rad"}
        for state in value.state:
            coordinate = self.unit_of[state.coordinate]
            factors[state.written] = f"{coordinate}/s" if state.speed else coordinate
        factors = {name: 1.0 / self.units.factor(unit) for name, unit in factors.items() if name not in value.names}
        tree = _Substituted(factors).visit(ast.parse(value.text.strip().replace("^", "**"), mode="eval"))
        factor = self.units.factor(unit)
        text = ast.unparse(tree)
        return replace(value, text=text if factor == 1.0 else f"({text})*{factor!r}")

    def special(self, spec: Spec) -> dict:
        """The fields whose units depend on others."""
        factor, units = self.units.factor, self.unit_of
        match spec:
            case laws.TorqueCurveSpec() if spec.force is not None:
                return {"force": self.expression(spec.force, "N*m", "rad")}
            case forces.DamperSpec() | laws.LinearPowerSpec():
                return {"coefficient": spec.coefficient * factor("N") / factor("m/s") ** spec.exponent}
            case laws.TorsionPowerSpec():
                return {"coefficient": spec.coefficient * factor("N*m") / factor("rad/s") ** spec.exponent}
            case forces.EffortSpec():
                unit = "N*m" if units[spec.coordinate] == "rad" else "N"
                return {"effort": self.expression(spec.effort, unit)}
            case forces.BushingSpec():
                return {
                    key: self.matrix(getattr(spec, key), time)
                    for key, time in (("stiffness_matrix", ""), ("damping_matrix", "*s"))
                }
            case constraints.CouplingSpec() | constraints.ClutchSpec():
                return self.coupling(spec)
            case constraints.OnSurfaceSpec():
                one, two = spec.equation, spec.equations
                return {
                    "equation": one and self.expression(one, "m"),
                    "equations": two and tuple(self.expression(equation, "m") for equation in two),
                }
            case constraints.ContactSpec() if spec.stiffness is not None:
                return {"stiffness": spec.stiffness * factor("N") / factor("m") ** spec.exponent}
            case actuators.ActuatorSpec():
                return self.actuator(spec)
        return {}

    def coupling(self, spec) -> dict:
        """A coupling or a clutch of any length is one of lengths: its angles have factors in m."""
        is_length = any(self.unit_of[name] == "m" for name in spec.terms)
        scale = self.units.factor("m") if is_length else 1.0
        found = {
            "terms": {name: value if self.unit_of[name] == "m" else value * scale for name, value in spec.terms.items()}
        }
        if isinstance(spec, constraints.ClutchSpec):
            unit = "N" if is_length else "N*m"
            return found | {"capacity": spec.capacity and self.expression(spec.capacity, unit)}
        if spec.slip is not None:
            found["slip"] = {
                name: value * scale / self.units.factor(self.unit_of[name]) for name, value in spec.slip.items()
            }
        found["value"] = self.expression(spec.value, "m" if is_length else "rad")
        return found | {"backlash": spec.backlash and spec.backlash * scale}

    def matrix(self, rows, time: str):
        if rows is None:
            return None
        place = [(f"N{'' if index < 3 else '*m'}", "m" if index < 3 else "rad") for index in range(6)]
        return tuple(
            tuple(value * self.units.factor(f"{place[i][0]}{time}/{place[j][1]}") for j, value in enumerate(row))
            for i, row in enumerate(rows)
        )

    def actuator(self, spec) -> dict:
        rotation = (
            spec.joint is not None and self.unit_of.get(spec.joint, self.unit_of.get(f"{spec.joint}.angle")) == "rad"
        )
        angle, effort = ("rad", "N*m") if rotation else ("m", "N")
        output = {"effort": effort, **VOLTAGE_CONTROLS}[_control(spec)]
        units = {"position": angle, "velocity": f"{angle}/s", "effort": effort, **VOLTAGE_CONTROLS}
        found = {
            "command": {
                channel: float(value) * self.units.factor(units[channel]) for channel, value in spec.command.items()
            }
        }
        if getattr(spec, "effort_limit", None) is not None:
            found["effort_limit"] = float(spec.effort_limit) * self.units.factor(effort)
        if getattr(spec, "torque_speed", None) is not None:
            pair = (self.units.factor(f"{angle}/s"), self.units.factor(effort))
            found["torque_speed"] = [(float(a) * pair[0], float(b) * pair[1]) for a, b in spec.torque_speed]
        if isinstance(spec, actuators.FluidCylinderSpec) and spec.transition is None:
            found["transition"] = TRANSITION[spec.type] * self.units.factor("Pa")
        if spec.servo is not None:
            position = spec.servo.controls == "position"
            error = angle if position else f"{angle}/s"
            output = output or "1"
            of_servo = {"kp": f"{output}/({error})", "ki": f"{output}/(({error})*s)", "kd": f"{output}*s/({error})"}
            of_servo |= {"velocity_feedforward": f"{output}*s/{angle}", "limit": output, "rate_limit": f"{error}/s"}
            changed = {
                key: float(value) * self.units.factor(unit)
                for key, unit in of_servo.items()
                if (value := getattr(spec.servo, key)) is not None
            }
            found["servo"] = self.record(spec.servo).model_copy(update=changed)
        return found


def _control(spec) -> str:
    if isinstance(spec, actuators.EffortActuatorSpec):
        return "effort"
    return spec.control if isinstance(spec, actuators.DcMotorSpec) else "opening"


class _Substituted(ast.NodeTransformer):
    """Multiplies variables by factors."""

    def __init__(self, factors: dict[str, float]) -> None:
        self.factors = factors

    def _scaled(self, node: ast.expr, name: str) -> ast.expr:
        factor = self.factors.get(name, 1.0)
        return node if factor == 1.0 else ast.BinOp(node, ast.Mult(), ast.Constant(factor))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._scaled(node, node.id)

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        return self._scaled(node, ast.unparse(node))

    def visit_Call(self, node: ast.Call) -> ast.expr:
        first = 1 if isinstance(node.func, ast.Name) and node.func.id == "table" else 0
        node.args[first:] = [self.visit(argument) for argument in node.args[first:]]
        return node


def _is(kind, origin) -> bool:
    return typing.get_origin(kind) is origin


def _plain(kind):
    """A kind without its metadata."""
    return typing.get_args(kind)[0] if hasattr(kind, "__metadata__") else kind


def _alternatives(kind):
    """The kinds that a value may have, without unions around them."""
    if _mark_here(kind) is not None:
        yield kind
    elif hasattr(kind, "__metadata__"):
        yield from _alternatives(_plain(kind))
    elif typing.get_origin(kind) is typing.Union or type(kind).__name__ == "UnionType":
        for inner in typing.get_args(kind):
            yield from _alternatives(inner)
    else:
        yield kind


def _mark_here(kind):
    """The last mark of a quantity, which is the one that counts."""
    marks = [mark for mark in getattr(kind, "__metadata__", ()) if isinstance(mark, QuantityField | ExpressionField)]
    return marks[-1] if marks else None


def _mark(kind):
    return next((mark for one in _alternatives(kind) if (mark := _mark_here(one)) is not None), None)


def _inner(kind, count: int):
    for one in _alternatives(kind):
        if typing.get_origin(one) in (tuple, list):
            inner = typing.get_args(one)
            return inner if _is(one, tuple) and len(inner) == count else (inner[0],) * count
    return (None,) * count
