"""The laws of one-sided elements, actuators and sensors, and the meaning of all symbols, as LaTeX.

One-sided elements are given by complementarity, friction as a set-valued law, and the law of impact (Glocker 2001). For
sensors the formulas say what they measure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import Any

from mbd_sim.mechanism.elements.joint_types import JOINT_KINDS
from mbd_sim.mechanism.elements.sensors import Encoder
from mbd_sim.studies.algebra.names import escaped, plain, write
from mbd_sim.studies.algebra.samples import ParameterSymbol
from mbd_sim.studies.symbolic.actuators import SymbolicActuator
from mbd_sim.studies.symbolic.constraints import SymbolicConstraint, SymbolicContact
from mbd_sim.studies.symbolic.coordinates import Coordinate
from mbd_sim.studies.symbolic.equations import SymbolicEquations
from mbd_sim.studies.symbolic.sensors import INDEX, SymbolicSensor

Names = dict[Any, str]
_RELATIONS = (r"\perp", r"\in ")
Terms = Callable[[SymbolicConstraint], list[str]]


def contact_lines(
    contacts: Sequence[SymbolicContact], names: Names, rate: Terms, gap: Terms, *, constrained: bool
) -> list[str]:
    """The lines of a document that state the conditions of all elements.

    :param constrained: whether there are two-sided constraints as well.
    :param rate: the terms of the rate G u + b of a row.
    :param gap: the terms of the position of a row.
    """
    if not contacts:
        return []
    conditions = [line for contact in contacts for line in _conditions(contact, names, rate, gap)]
    what = (any(contact.gap for contact in contacts), any(contact.slip for contact in contacts))
    words = {(True, True): "one-sided constraints and friction", (True, False): "one-sided constraints"}
    begin = "and" if constrained else "with"
    lines = [f"{begin} the {words.get(what, 'friction')}", *_equations(conditions)]
    gaps = [contact for contact in contacts if contact.gap is not None and not contact.clutch]
    slips = [contact for contact in contacts if contact.gap is not None and contact.slip]
    if gaps:
        impacts = [_impact(contact, names) for contact in gaps]
        impacts += [_law(contact, names, impulsive=True) for contact in slips]
        still = "the constraints still hold and " if constrained else ""
        law = r"$M \left(u^{+} - u^{-}\right) = G^{T} \Lambda$"
        lines += [f"At an impact, {law}, where {still}all closed gaps satisfy", *_equations(impacts)]
    return lines


def contact_meanings(contacts: Sequence[SymbolicContact], names: Names) -> Iterator[str]:
    """What the symbols of each element mean."""
    for contact in contacts:
        words = []
        owner = rf"\texttt{{{escaped(contact.rows[0].owner)}}}"
        if contact.gap is not None:
            kind = "a clutch's rate" if contact.clutch else "a gap"
            what, unit = escaped(contact.gap.quantity), contact.gap.load or "J per unit of the gap"
            words.append(
                f"${_size(contact)}$ is {kind} ({what}), ${names[contact.gap.multiplier]}$ its multiplier, {unit}"
            )
        if contact.slip:
            forces = ", ".join(f"${names[row.multiplier]}$" for row in contact.slip)
            words.append(f"${_slip(contact)}$ {'are slip velocities' if contact.slip[1:] else 'is a slip velocity'}")
            words.append(f"{forces} {'their' if contact.slip[1:] else 'its'} friction")
        if contact.loaded is not None:
            words.append(f"${_load(contact, names)}$ is the force that the joint transmits across its axis")
        yield f"of {owner}: {', '.join(words)};"
    if any(contact.gap is not None and not contact.clutch for contact in contacts):
        yield r"$\Lambda$ are impulses, and $u^{-}$ and $u^{+}$ the speeds before and after an impact;"


def _conditions(contact: SymbolicContact, names: Names, rate: Terms, gap: Terms) -> Iterator[tuple[str, str]]:
    """Left and right sides."""
    if contact.gap is not None:
        row = contact.gap
        force = names[row.multiplier]
        yield _size(contact), " ".join(signed(rate(row) if contact.clutch else gap(row)))
        yield rf"0 \leq {_size(contact)}", rf"\perp {force} \geq 0"
    if contact.slip:
        for number, row in enumerate(contact.slip, 1):
            yield _slip(contact, number), " ".join(signed(rate(row)))
        yield _law(contact, names)


def _impact(contact: SymbolicContact, names: Names) -> tuple[str, str]:
    """0 ≤ ġ⁺ + e ġ⁻ ⟂ Λ ≥ 0."""
    assert contact.gap is not None
    rate, rest = rf"\dot{{{_size(contact)[0]}}}_{{{contact.name}}}", ""
    if contact.restitution != 0:
        factor = write(contact.restitution, names)
        rest = f" + {rate}^{{-}}" if contact.restitution == 1 else rf" + {factor}\, {rate}^{{-}}"
    return rf"0 \leq {rate}^{{+}}{rest}", rf"\perp \Lambda_{{{contact.name}}} \geq 0"


def _law(contact: SymbolicContact, names: Names, *, impulsive: bool = False) -> tuple[str, str]:
    """Coulomb's friction: one force while it slides, and all up to the largest one while it sticks."""
    forces = [names[row.multiplier] for row in contact.slip]
    load, after = _load(contact, names), ""
    if impulsive:
        forces, load, after = [_impulse(force) for force in forces], _impulse(load), "^{+}"
    slip = " ,".join(_slip(contact, number) + after for number in range(1, len(forces) + 1))
    own, plane = (forces[0], "") if len(forces) == 1 else (rf"\left({', '.join(forces)}\right)", "^{2}")
    slip = slip if len(forces) == 1 else rf"\left({slip.replace(' ,', ', ')}\right)"
    sliding = _times(contact.sliding, load, names)
    most = sliding if impulsive else _times(contact.static, load, names)
    moving = rf"\left\{{- {sliding}\, {slip} / \left|{slip}\right|\right\}} & {slip} \neq 0"
    resting = rf"\left\{{x \in \mathbb{{R}}{plane} : \left|x\right| \leq {most}\right\}} & {slip} = 0"
    return own, rf"\in \begin{{cases}} {moving} \\ {resting} \end{{cases}}"


def _times(size: Any, load: str, names: Names) -> str:
    """The size of friction times the load, if there is one."""
    factor = write(size, names)
    if not load:
        return rf"\left({factor}\right)" if getattr(size, "is_Add", False) else factor
    return load if size == 1 else rf"{factor}\, {load}"


def _load(contact: SymbolicContact, names: Names) -> str:
    if contact.loaded is not None:
        return rf"N_{{{contact.name}}}"
    return "" if contact.gap is None else names[contact.gap.multiplier]


def _impulse(force: str) -> str:
    return force.replace(r"\lambda", r"\Lambda")


def _size(contact: SymbolicContact) -> str:
    return rf"{'w' if contact.clutch else 'g'}_{{{contact.name}}}"


def _slip(contact: SymbolicContact, number: int | None = None) -> str:
    """The symbol of a slip velocity; without a number, all of them."""
    if len(contact.slip) == 1:
        return rf"v_{{{contact.name}}}"
    if number is None:
        return ", ".join(_slip(contact, each) for each in range(1, len(contact.slip) + 1))
    return rf"v_{{{contact.name},{number}}}"


def signed(terms: Sequence[str]) -> list[str]:
    """The terms of a sum with their signs; 0 if there are none."""
    return [term if number == 0 or term.startswith("-") else f"+ {term}" for number, term in enumerate(terms or ["0"])]


def aligned(lines: Sequence[str]) -> list[str]:
    """Formulas one below the other."""
    return [r"\begin{align*}", *(rf"  {line} \\" for line in lines[:-1]), f"  {lines[-1]}", r"\end{align*}"]


def _equations(pairs: Sequence[tuple[str, str]]) -> list[str]:
    """Equations from their left and right sides, of which some begin with a relation of their own."""
    return aligned([f"{left} &{'' if right.startswith(_RELATIONS) else '='} {right}" for left, right in pairs])


# Of the quantities; the tilde tells what is measured from the coordinates, loads and currents themselves.
LETTERS = {
    "angular_velocity": r"\tilde{\omega}",
    "specific_force": r"\tilde{a}",
    "orientation": r"\tilde{R}",
    "position": r"\tilde{r}",
    "velocity": r"\tilde{v}",
    "force": r"\tilde{F}",
    "torque": r"\tilde{M}",
    "distance": r"\tilde{d}",
    "current": r"\tilde{\imath}",
    INDEX: r"\tilde{z}",
}
WORDS = {"specific_force": "specific force (acceleration less that of gravity)", INDEX: "index pulse"}


def sensor_rows(sensors: Sequence[SymbolicSensor], names: Names) -> Iterator[tuple[str, str]]:
    """The left and right sides: a row for each component, and for each rotation matrix."""
    for one in sensors:
        for quantity, value in one.values.items():
            symbol = _symbol(one, quantity)
            if value.shape == (3, 3):
                yield symbol, _matrix(value, names)
            elif len(value) == 1:
                yield symbol, write(value[0], names)
            else:
                for axis, entry in zip("xyz", value, strict=True):
                    yield f"{symbol[:-1]},{axis}}}", write(entry, names)


def sensor_lines(sensors: Sequence[SymbolicSensor], names: Names) -> list[str]:
    """The lines of a document that state what is measured."""
    rows = list(sensor_rows(sensors, names))
    lines = []
    if rows:
        lines = ["The sensors measure, without their errors and delays,", *_equations(rows)]
    others = (rf"The measurement of sensor \texttt{{{_name(one)}}} is {one.reason}." for one in sensors if one.reason)
    return [*lines, *others]


def sensor_meanings(sensors: Sequence[SymbolicSensor]) -> Iterator[str]:
    """What the symbols of each sensor mean."""
    for one in sensors:
        words = []
        for quantity in one.values:
            word = WORDS.get(quantity, quantity.replace("_", " "))
            steps = " in whole steps" if isinstance(one.sensor, Encoder) and quantity != INDEX else ""
            words.append(f"${_symbol(one, quantity)}$ is the {word}{steps}{_unit(one, quantity)}")
        if words:
            yield rf"{', '.join(words)}, measured by sensor \texttt{{{_name(one)}}};"


def _unit(one: SymbolicSensor, quantity: str) -> str:
    units = {known.name: known.unit for known in one.sensor.quantities}
    if quantity == "orientation":
        return " as the matrix from its axes to those of ground"
    return f", {_UNITS[units[quantity]]}" if quantity in units else ""


_UNITS = {"rad/s": "rad/s", "m/s²": "m/s$^2$", "rad": "rad", "m": "m", "m/s": "m/s", "N": "N", "N·m": r"N\,m", "A": "A"}


def _symbol(one: SymbolicSensor, quantity: str) -> str:
    letter = r"\tilde{q}" if isinstance(one.sensor, Encoder) and quantity != INDEX else LETTERS[quantity]
    return rf"{letter}_{{\mathrm{{{_name(one)}}}}}"


def _name(one: SymbolicSensor) -> str:
    return escaped(one.sensor.name)


def _matrix(value: Any, names: Names) -> str:
    inside = r" \\ ".join(" & ".join(write(entry, names) for entry in value.row(row)) for row in range(3))
    return rf"\begin{{pmatrix}} {inside} \end{{pmatrix}}"


UNITS = {"voltage": "V", "current": "A", "effort": r"N or N\,m"}


def actuator_rows(actuators: Sequence[SymbolicActuator], names: Names) -> list[tuple[str, str]]:
    """The left and right sides: the effort of each actuator, the rates of its states, and their samples."""
    rows = []
    for actuator in actuators:
        rows.append((names[actuator.effort], write(actuator.law, names)))
        for state in actuator.states:
            if state.sampled is not None:
                rows.append((rf"{{{names[state.symbol]}}}^{{+}}", write(state.sampled, names)))
            else:
                rows.append((rf"\dot{{{names[state.symbol][0]}}}{names[state.symbol][1:]}", write(state.rate, names)))
    return rows


def actuator_lines(actuators: Sequence[SymbolicActuator], names: Names) -> list[str]:
    """The lines of a document that state the laws."""
    if not actuators:
        return []
    if any(actuator.law is None for actuator in actuators):
        return ["The laws of the actuators are too long to be written out."]
    sampled = any(state.sampled is not None for actuator in actuators for state in actuator.states)
    after = ["where ${}^{+}$ marks the values after a sample, which are held until the next one."] if sampled else []
    return ["The actuators obey", *_equations(actuator_rows(actuators, names)), *after]


def actuator_meanings(actuators: Sequence[SymbolicActuator], names: Names) -> Iterator[str]:
    """What the symbols of each actuator mean."""
    for actuator in actuators:
        unit = r"N\,m" if actuator.rotation else "N"
        words = [rf"${names[actuator.effort]}$ is the effort of actuator \texttt{{{escaped(actuator.name)}}}, {unit}"]
        late = f", given {actuator.delay:g} s earlier" if actuator.delay else ""
        for channel, symbol in actuator.commands.items():
            what = f", {UNITS[channel]}" if channel in ("voltage", "current") else ""
            words.append(f"${names[symbol]}$ its command of {channel}{what}{late}")
        for state in actuator.states:
            held = f", sampled every {state.period:g} s" if state.sampled is not None else ""
            words.append(f"${names[state.symbol]}$ its state {escaped(state.name)}{held}")
        yield ", ".join(words) + ";"


def meanings(equations: SymbolicEquations) -> Iterator[str]:
    """What each symbol means, an item each."""
    names = equations.names
    order = ", ".join(f"{names[symbol]}" for symbol in equations.u)
    yield rf"$u = ({order})$ are the generalized speeds, in the order of the rows;"
    for coordinate in equations.coordinates:
        yield from _coordinate_meaning(coordinate, names)
    yield from actuator_meanings(equations.actuators, names)
    for parameter in equations.parameters:
        yield _parameter_meaning(parameter)
    if equations.built_in:
        listed = ", ".join(rf"\texttt{{{plain(key.removeprefix('parameters.'))}}}" for key in equations.built_in)
        yield f"parameters whose values are built into the equations: {listed};"
    rows = [(c.position or 0) + c.drift + sum(c.gradient) for c in equations.rows]
    measured = [value for one in equations.sensors for value in one.values.values()]
    expressions = (*equations.inertial, *equations.forces, *rows, *measured)
    if equations.time in {symbol for expression in expressions for symbol in expression.free_symbols}:
        yield r"$t$ is the time, s;"
    if equations.constraints:
        yield (
            r"$G^{T} \lambda$ are the constraint forces; a row of $G u + b$ is the rate of a holonomic constraint, "
            "or a nonholonomic constraint itself;"
        )
    yield from contact_meanings(equations.contacts, names)
    for _, group in groupby(equations.constraints, lambda constraint: constraint.owner):
        yield _multiplier_meaning(list(group), names)
    yield from sensor_meanings(equations.sensors)
    if equations.left_out:
        yield f"omitted, as the other rows imply them: {escaped(', '.join(equations.left_out))};"


def _parameter_meaning(parameter: ParameterSymbol) -> str:
    own = rf" \texttt{{{plain(parameter.key.removeprefix('parameters.'))}}}" if parameter.key else ""
    return rf"${parameter.latex}$ is {plain(parameter.stands_for)}{own}: {plain(parameter.written)};"


def _multiplier_meaning(rows: list[SymbolicConstraint], names: dict[Any, str]) -> str:
    """The multipliers of one joint or constraint, with the quantity that each row keeps at zero."""
    first = rows[0]
    owner = rf"joint \texttt{{{escaped(first.owner)}}}, which closes a loop" if first.closes else ""
    owner = owner or rf"constraint \texttt{{{escaped(first.owner)}}}"
    listed = "; ".join(_row_meaning(row, names) for row in rows)
    return f"{'multipliers' if rows[1:] else 'multiplier'} of {owner}: {listed};"


def _row_meaning(row: SymbolicConstraint, names: dict[Any, str]) -> str:
    unit = row.load or "J per unit of the equation"
    kind = ", nonholonomic" if row.position is None else ""
    return f"${names[row.multiplier]}$, {unit}, of {escaped(row.quantity)}{kind}"


def _coordinate_meaning(coordinate: Coordinate, names: dict[Any, str]) -> Iterator[str]:
    joint = rf"joint \texttt{{{escaped(coordinate.joint)}}}"
    kind = JOINT_KINDS[coordinate.type]
    if kind.quaternion is None:
        for q, effort, freedom in zip(coordinate.q, coordinate.efforts, kind.coordinates, strict=False):
            what, load = ("angle", r"N\,m") if freedom.rotation else ("displacement", "N")
            yield f"${names[q]}$ is the {what} of {joint}, {freedom.unit}, and ${names[effort]}$ its effort, {load};"
        return
    if kind.quaternion:  # after a position
        yield f"$q$ is the position of the second part of {joint}, m, $v$ its velocity, m/s, and $F$ its force, N;"
    rates = r"$\dot{p} = \tfrac{1}{2}\, p \circ (0, \omega)$"
    yield f"$p$ is the unit quaternion $(w, x, y, z)$ of {joint}, with {rates};"
    yield r"$\omega$ is its angular velocity in the axes of the second part, rad/s, and $\tau$ its moment, N\,m;"
