"""The laws of actuators as LaTeX."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from mbd_sim.symbolic.latex_printer import escaped, write
from mbd_sim.symbolic.symbolic_actuators import SymbolicActuator

Names = dict[Any, str]
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
    lines = [f"  {left} &= {right}" for left, right in actuator_rows(actuators, names)]
    sampled = any(state.sampled is not None for actuator in actuators for state in actuator.states)
    after = ["where ${}^{+}$ marks the values after a sample, which are held until the next one."] if sampled else []
    return [
        "The actuators obey",
        r"\begin{align*}",
        *(rf"{line} \\" for line in lines[:-1]),
        lines[-1],
        r"\end{align*}",
        *after,
    ]


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
