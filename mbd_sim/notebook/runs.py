"""Runs of a simulation as plots and animations that a notebook shows."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mbd_sim.drawing.animation import TRACE_POINTS, Animation, traced_points
from mbd_sim.drawing.animation_file import FRAME_RATE, write_animation
from mbd_sim.notebook.views import embedded
from mbd_sim.playback import run_plots
from mbd_sim.playback.panels import panels, require_names
from mbd_sim.playback.plot_style import plot_style
from mbd_sim.playback.run_table import read_table
from mbd_sim.recording.reader import open_recording
from mbd_sim.recording.run_recorder import RunRecorder
from mbd_sim.short_repr import short_repr
from mbd_sim.simulation.argument_checks import step_at
from mbd_sim.simulation.simulation import Simulation

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

        :raises ValueError: it does not.
        """
        if Path(path).suffix != self.suffix:
            raise ValueError(f"this picture is a {self.suffix} file: use a file name that ends in {self.suffix}.")
        Path(path).write_bytes(self.content)

    def _repr_html_(self) -> str:
        return embedded(self.content, self.suffix, self.text, self.width)


def plot(
    simulation: Simulation, until: float, show: Sequence[str] = (), style: str = "screen", theme: str = "light"
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
        run_plots.draw(picture, table, panels(table, show), look)
        content = picture.read_bytes()
    return RunPicture(content, ".png", f"The run of {simulation.mechanism.name} to {until:g} s", PLOT_WIDTH)


def animate(simulation: Simulation, until: float, traces: Sequence[str] = ()) -> RunPicture:
    """Run to a time and draw the motion; see `Simulation.animate`."""
    traces = [traces] if isinstance(traces, str) else traces
    traced_points(simulation.mechanism, traces)  # a wrong name is reported before the run
    step_at(until, simulation.step_size, simulation.steps)  # and so is a wrong time
    begin, samples = simulation.time, [(simulation.time, simulation.poses())]
    rate = FRAME_RATE * (TRACE_POINTS if traces else 1)
    for number in range(1, 1 + int((until - begin) * rate + 1e-9)):
        simulation.run(begin + number / rate)
        samples.append((simulation.time, simulation.poses()))
    simulation.run(until)
    poses = [pose for _, pose in samples]
    animation = Animation(simulation.model, *ANIMATION_SIZE, configurations=poses, traces=traces)
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        path = Path(folder, "run.webp")
        write_animation(path, animation.frames(samples, FRAME_RATE), simulation.mechanism.name)
        content = path.read_bytes()
    text = f"{simulation.mechanism.name} in motion, to {until:g} s"
    return RunPicture(content, ".webp", text, ANIMATION_SIZE[0])


def _file_name(simulation: Simulation) -> str:
    return simulation.mechanism.name.replace("/", "_")
