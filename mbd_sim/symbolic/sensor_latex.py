"""What sensors measure as LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mbd_sim.mechanism.sensors import Encoder
from mbd_sim.symbolic.latex_printer import escaped, write
from mbd_sim.symbolic.symbolic_sensors import INDEX, SymbolicSensor

Names = dict[Any, str]
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
        lines = [
            "The sensors measure, without their errors and delays,",
            r"\begin{align*}",
            *(rf"  {left} &= {right} \\" for left, right in rows[:-1]),
            rf"  {rows[-1][0]} &= {rows[-1][1]}",
            r"\end{align*}",
        ]
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
