"""Mechanisms and simulations in a notebook: pictures and tables, plots and animations of runs, and Rerun's viewer.

Pictures and tables are HTML and PNG.
"""

from __future__ import annotations

import base64
import html
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from mbd_sim.analysis.mechanics.mobility import mobility
from mbd_sim.base.errors import InputError
from mbd_sim.base.packages import require_packages
from mbd_sim.base.short_repr import short_repr
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.animation import FRAME_RATE, TRACE_POINTS, Animation, write_animation
from mbd_sim.pictures.drawing.picture import draw
from mbd_sim.pictures.rerun.viewer import Viewer
from mbd_sim.pictures.shapes.joints import traced_points
from mbd_sim.pictures.shapes.touching import touching_now
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.recordings.views import plots
from mbd_sim.recordings.views.panels import panels, plot_style, require_names
from mbd_sim.recordings.views.table import read_table
from mbd_sim.simulation.run.arguments import step_at
from mbd_sim.simulation.run.simulation import BaseSimulation

PICTURE_WIDTH = 420  # px
MAX_COORDINATES = 12  # rows of the table of a simulation

MIME_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".webp": "image/webp"}


def mechanism_html(mechanism: Mechanism) -> str:
    """The picture at the start, the numbers of parts and joints, the mass, and the degrees of freedom."""
    simulation = BaseSimulation(mechanism)
    return _beside(_picture(simulation, ".svg"), mechanism, _summary(simulation))


def mechanism_png(mechanism: Mechanism) -> bytes:
    """The picture at the start."""
    return _picture(BaseSimulation(mechanism), ".png")


def simulation_html(simulation: BaseSimulation) -> str:
    """The picture in the present state, the time, the coordinates and the energies."""
    energies = simulation.energies
    rows = [("time", f"{simulation.time:g} s"), *_coordinates(simulation)]
    rows += [(name, f"{value:.6g} J") for name, value in zip(energies._fields, energies, strict=True)]
    return _beside(_picture(simulation, ".svg"), simulation.mechanism, rows)


def simulation_png(simulation: BaseSimulation) -> bytes:
    """The picture in the present state."""
    return _picture(simulation, ".png")


def embedded(content: bytes, suffix: str, text: str, width: int) -> str:
    """A picture as an element of HTML that contains it; `text` is shown by those who cannot see it."""
    data = base64.b64encode(content).decode()
    return (
        f'<img src="data:{MIME_TYPES[suffix]};base64,{data}" alt="{html.escape(text)}" width="{width}" '
        'style="max-width: 100%; background: white">'
    )


def _summary(simulation: BaseSimulation) -> list[tuple[str, str]]:
    mechanism, equations = simulation.mechanism, simulation.model.equations
    counted = mobility(mechanism, equations.rows, equations.start, simulation.poses())
    energies = simulation.energies
    return [
        ("parts", str(len(mechanism.parts))),
        ("joints", str(len(mechanism.all_joints))),
        ("degrees of freedom", str(counted.degrees_of_freedom)),
        ("mass", f"{mechanism.mass:.6g} kg"),
        ("kinetic energy at the start", f"{energies.kinetic:.6g} J"),
        ("potential energy at the start", f"{energies.potential:.6g} J"),
    ]


def _coordinates(simulation: BaseSimulation) -> list[tuple[str, str]]:
    names, q, u = simulation.coordinate_names, simulation.q, simulation.u
    if len(q) == len(names):
        rows = [(name, f"q = {q[index]:.6g}, u = {u[index]:.6g}") for index, name in enumerate(names)]
    else:  # quaternions have no names of their own
        rows = [(name, f"u = {u[index]:.6g}") for index, name in enumerate(names)]
    return rows if len(rows) <= MAX_COORDINATES else [*rows[:MAX_COORDINATES], ("…", f"{len(rows)} in all")]


def _picture(simulation: BaseSimulation, suffix: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        path = Path(folder, f"picture{suffix}")
        draw(simulation.mechanism, simulation.poses(), path, contacts=touching_now(simulation))
        return path.read_bytes()


def _beside(picture: bytes, mechanism: Mechanism, rows: Sequence[tuple[str, str]]) -> str:
    text = mechanism.description or mechanism.name
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows)
    return (
        '<div style="display: flex; flex-wrap: wrap; gap: 1em; align-items: center">'
        f"{embedded(picture, '.svg', text, PICTURE_WIDTH)}"
        f"<table><caption>{html.escape(mechanism.name)}</caption><tbody>{cells}</tbody></table></div>"
    )


PLOT_WIDTH, ANIMATION_SIZE = 720, (600, 400)  # px


@dataclass(frozen=True)
class RunPicture:
    """A picture of a run: a plot as PNG, or an animation as WebP. A notebook shows it."""

    content: bytes = field(repr=False)
    suffix: str
    text: str
    width: int

    __repr__ = short_repr

    def save(self, path: str | Path) -> None:
        """Write the picture to a file, which must end in `suffix`.

        :raises InputError: it does not.
        """
        if Path(path).suffix != self.suffix:
            raise InputError(f"this picture is a {self.suffix} file", f"Use a file name that ends in {self.suffix}.")
        Path(path).write_bytes(self.content)

    def _repr_html_(self) -> str:
        return embedded(self.content, self.suffix, self.text, self.width)


def plot(
    simulation: BaseSimulation, until: float, show: Sequence[str] = (), style: str = "screen", theme: str = "light"
) -> RunPicture:
    """Run to a time and plot what happened; see `Simulation.plot`."""
    look = plot_style(Path("run.png"), style, theme)  # wrong names are reported before the run
    show = [show] if isinstance(show, str) else show
    require_names(show)
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        recording, picture = Path(folder, f"{_file_name(simulation)}.mcap"), Path(folder, "run.png")
        with RunRecorder(simulation, recording):
            simulation.run(until)
        table = read_table(open_recording(recording))
        plots.draw(picture, table, panels(table, show), look, kept=False)
        content = picture.read_bytes()
    return RunPicture(content, ".png", f"The run of {simulation.mechanism.name} to {until:g} s", PLOT_WIDTH)


def animate(simulation: BaseSimulation, until: float, traces: Sequence[str] = ()) -> RunPicture:
    """Run to a time and draw the motion; see `Simulation.animate`."""
    traces = [traces] if isinstance(traces, str) else traces
    traced_points(simulation.mechanism, traces)  # a wrong name is reported before the run
    step_at(until, simulation.step_size, simulation.steps)  # and so is a wrong time
    begin, samples, contacts = simulation.time, [(simulation.time, simulation.poses())], [touching_now(simulation)]
    rate = FRAME_RATE * (TRACE_POINTS if traces else 1)
    for number in range(1, 1 + int((until - begin) * rate + 1e-9)):
        simulation.run(begin + number / rate)
        samples.append((simulation.time, simulation.poses()))
        contacts.append(touching_now(simulation))
    simulation.run(until)
    poses = [pose for _, pose in samples]
    animation = Animation(simulation.model, *ANIMATION_SIZE, configurations=poses, traces=traces)
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        path = Path(folder, "run.webp")
        write_animation(path, animation.frames(samples, FRAME_RATE, contacts=contacts), simulation.mechanism.name)
        content = path.read_bytes()
    text = f"{simulation.mechanism.name} in motion, to {until:g} s"
    return RunPicture(content, ".webp", text, ANIMATION_SIZE[0])


def _file_name(simulation: BaseSimulation) -> str:
    return simulation.mechanism.name.replace("/", "_")


RATE = 60.0  # states that are shown for each second
HEIGHT = 560  # px


def view(simulation: BaseSimulation, until: float) -> Any:
    """Run to a time and show the run in Rerun; see `Simulation.view`."""
    require_packages("rerun_notebook", purpose="Rerun in a notebook", otherwise="or use animate().")
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        path = Path(folder, "run.rrd")
        begin = simulation.time
        with Viewer(simulation.model, str(path), rate=None) as viewer:
            _offer(viewer, simulation)
            for number in range(1, 1 + int((until - begin) * RATE + 1e-9)):
                simulation.run(begin + number / RATE)
                _offer(viewer, simulation)
            simulation.run(until)
            viewer.flush()
        content = path.read_bytes()
    widget = import_module("rerun_notebook").Viewer(width="auto", height=HEIGHT)
    widget.send_rrd(content)
    return widget


def _offer(viewer: Viewer, simulation: BaseSimulation) -> None:
    viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
