"""The plots of a page, from the samples of the session: energies, coordinates, a reading, the phase portrait."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.frames import Frame
from mbd_sim.lab.session.session import Session
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.palette import Color

POINTS = 400
HEIGHT = 170  # pixels
MOST_CURVES = 8
NO_READING = "Reading: none chosen"
ELECTRIC = {"voltage": "V", "current": "A"}
TURNING = {**ELECTRIC, "position": "rad", "velocity": "rad/s", "effort": "N·m"}  # of an actuator; the rest are powers
SLIDING = {**ELECTRIC, "position": "m", "velocity": "m/s", "effort": "N"}
ENERGY = slice(1, 8)  # of a row of samples

Reading = Callable[[Bench], float]


def readings_of(bench: Bench) -> dict[str, Reading]:
    """What can be plotted besides coordinates and energies, by names with units."""
    simulation, found = bench.simulation, dict[str, Reading]()
    for name in simulation.mechanism.all_joints:
        found[f"force through {name} (N)"] = partial(_joint_force, name)
    for name in simulation.contacts():
        found[f"contact force {name} (N)"] = partial(_of_contact, name, "normal")
        found[f"gap {name} (m)"] = partial(_of_contact, name, "gap")
    turns = {one.name: one.port.rotation for one in simulation.mechanism.actuators}
    for name, state in simulation.actuators().items():
        for quantity in _numbers(state):
            unit = (TURNING if turns[name] else SLIDING).get(quantity, "W")
            found[f"{quantity.replace('_', ' ')} of {name} ({unit})"] = partial(_of_actuator, name, quantity)
    for sensor in simulation.mechanism.sensors:
        measured, *_ = sensor.quantities
        found[f"{measured.name.replace('_', ' ')} of sensor {sensor.name} ({measured.unit})"] = partial(
            _measured, sensor.name
        )
    return found


def _joint_force(name: str, bench: Bench) -> float:
    return float(np.linalg.norm(bench.simulation.reactions()[name].force))


def _of_contact(name: str, quantity: str, bench: Bench) -> float:
    return float(getattr(bench.simulation.contacts()[name], quantity))


def _of_actuator(name: str, quantity: str, bench: Bench) -> float:
    return float(getattr(bench.simulation.actuators()[name], quantity))


def _measured(name: str, bench: Bench) -> float:
    reading = bench.simulation.sensors().get(name)
    return math.nan if reading is None else float(np.linalg.norm(next(iter(reading.values.values()))))


def _numbers(state: Any) -> list[str]:
    fields = getattr(state, "__dataclass_fields__", None) or getattr(state, "_fields", ())
    return [name for name in fields or () if isinstance(getattr(state, name), float)]


class PlotsTab:
    """The curves of a mechanism in the panel of a page."""

    def __init__(self, gui: Any, session: Session, *, dark: bool) -> None:
        """Add the plots to the container that is open in viser's `gui`."""
        self._session, simulation = session, session.bench.simulation
        self._add_choice(gui)
        mechanism = simulation.mechanism
        self._names = simulation.coordinate_names
        count = len(self._names)
        self._positions = slice(8, 8 + count)
        self._speeds = slice(8 + count, 8 + 2 * count)
        rotates = [mechanism.coordinate(name).rotation for name in self._names]
        self._degrees = np.where(rotates, 180.0 / math.pi, 1.0)
        shown = range(min(count, MOST_CURVES))
        colors = [_css(color, dark) for color in palette.series_colors(mechanism)[: len(shown)]]
        units = ["deg" if turns else "m" for turns in rotates]
        energies = [
            ("kinetic", palette.KINETIC),
            ("potential", palette.POTENTIAL),
            ("dissipated", palette.DISSIPATED),
            ("applied work", palette.WORK_APPLIED),
            ("residual", palette.WORK_DRIVES),
        ]
        energy_colors = [_css(color, dark) for _, color in energies]
        self._energy = _plot(gui, "Energies (J)", [name for name, _ in energies], energy_colors)
        self._motion, self._rates = dict[str, Any](), dict[str, Any]()
        self._of_unit = {unit: [n for n in shown if units[n] == unit] for unit in dict.fromkeys(units[: len(shown)])}
        for title, suffix, plots in (("Coordinates", "", self._motion), ("Speeds", "/s", self._rates)):
            for unit, which in self._of_unit.items():
                labels, own = [self._names[n] for n in which], [colors[n] for n in which]
                plots[unit] = _plot(gui, f"{title} ({unit}{suffix})", labels, own)
        self._reading_color = _css(palette.PARTS[0], dark)
        self._reading = _plot(gui, NO_READING, ["chosen reading"], [self._reading_color])
        self._phase = gui.add_uplot(
            (np.zeros(1), np.zeros(1)),
            ({"label": "position"}, {"label": "speed", "stroke": colors[0] if colors else "gray", "width": 1.5}),
            title=f"Phase portrait: {self._names[0]} ({units[0]}, {units[0]}/s)" if count else "Phase portrait",
            scales={"x": {"time": False, "auto": True}, "y": {"auto": True}},
            height=HEIGHT + 60,
        )

    def _add_choice(self, gui: Any) -> None:
        """What the plot of a reading shows."""
        self._readings = readings_of(self._session.bench)
        chosen = gui.add_dropdown("Reading", ("none", *self._readings), initial_value="none")
        chosen.on_update(lambda _: self.choose(chosen.value))

    def choose(self, name: str) -> None:
        """Plot a reading from now on, by its name; `none`: no more."""
        reading = self._readings.get(name)
        self._reading.title = NO_READING if reading is None else name
        self._reading.series = _series([name], [self._reading_color])

        def request(session: Session) -> None:
            session.reading = reading
            session.samples.rows.clear()

        self._session.ask("reading", request)

    def show(self, _: Frame) -> None:
        """Draw the newest samples."""
        table = self._session.samples.table(POINTS)
        if len(table) < 2:
            return
        time, energies = table[:, 0].copy(), table[:, ENERGY]
        chosen = [energies[:, 0], energies[:, 1], energies[:, 2], energies[:, 3], energies[:, 6]]
        self._energy.data = (time, *(np.ascontiguousarray(one) for one in chosen))
        positions = table[:, self._positions] * self._degrees
        speeds = table[:, self._speeds] * self._degrees
        for unit, which in self._of_unit.items():
            self._motion[unit].data = (time, *_columns(positions[:, which]))
            self._rates[unit].data = (time, *_columns(speeds[:, which]))
        if self._of_unit:
            self._phase.data = (positions[:, 0].copy(), speeds[:, 0].copy())
        self._reading.data = (time, table[:, -1].copy())


def _columns(table: Array) -> list[Array]:
    return [np.ascontiguousarray(column) for column in table.T]


def _plot(gui: Any, title: str, labels: list[str], colors: list[str]) -> Any:
    series = _series(labels, colors)
    blank = tuple(np.zeros(1) for _ in series)
    if len(series) < 2:
        series, blank = (*series, {"label": ""}), (np.zeros(1), np.zeros(1))
    return gui.add_uplot(
        blank, series, title=title, scales={"x": {"time": False, "auto": True}, "y": {"auto": True}}, height=HEIGHT
    )


def _series(labels: list[str], colors: list[str]) -> tuple[Any, ...]:
    curves = ({"label": n, "stroke": c, "width": 1.5} for n, c in zip(labels, colors, strict=True))
    return ({"label": "t (s)"}, *curves)


def _css(color: Color, dark: bool) -> str:
    red, green, blue = color if dark else palette.mixed(color, (0, 0, 0), 0.2)
    return f"rgb({red},{green},{blue})"
