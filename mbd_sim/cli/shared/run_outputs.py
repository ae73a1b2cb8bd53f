"""The files that `mbd_sim run` leaves: a recording, a table, a plot, an animation."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbd_sim.base.errors import DivergedError, InputError, counted
from mbd_sim.base.geometry.pose import Pose
from mbd_sim.cli.shared.command import COUNT, ProgressBar, temporary_file
from mbd_sim.cli.shared.common import (
    add_coordinates,
    add_plot_style,
    add_repeatable,
    add_show,
    chosen_style,
    plotted_coordinates,
    positive_in,
    positive_number,
    print_undrawn_meshes,
    require_styled,
    shown_plots,
)
from mbd_sim.mechanism.values.names import split_names
from mbd_sim.pictures.shapes.joints import traced_points
from mbd_sim.pictures.shapes.touching import Touching, touching_now
from mbd_sim.simulation.run.simulation import BaseSimulation

if TYPE_CHECKING:
    from mbd_sim.recordings.run.ring import RingRecorder

RECORDING = ".mcap"
SIZE = 600, 400  # px, of an animation


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """Declare the options that name files, and what they contain."""
    group = parser.add_argument_group("files")
    group.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="record the run to an .mcap file, or write it as a table: .csv, .parquet or .npz",
    )
    group.add_argument(
        "--plot", type=Path, metavar="FILE", help="plot energies, joints and residual: .png, .svg, .pdf or .html"
    )
    add_show(group)
    add_coordinates(group)
    add_plot_style(group)
    group.add_argument("--animate", type=Path, metavar="FILE", help="draw the motion: .gif, .webp, .mp4 or .html")
    add_repeatable(group, "--trace", "POINT", "draw the path of a part or part.point; repeatable")
    group.add_argument(
        "--pace",
        type=positive_number,
        metavar="X",
        help="seconds of motion in each second of the animation: 0.1 for slow motion (default 1)",
    )
    group.add_argument(
        "--size", type=_size, metavar="WxH", help="of the animation in pixels, such as 1280x720 (default 600x400)"
    )
    group.add_argument(
        "--rate",
        type=positive_in("Hz"),
        metavar="HZ",
        help="recorded states per simulated second (default 100, but at most one per step)",
    )
    _add_ring(group)
    group.add_argument("--reactions", action="store_true", help="also record the force and moment of each joint")
    group.add_argument(
        "--contact-forces", action="store_true", help="also record the point, the normal and the force of each contact"
    )
    group.add_argument("--violation", action="store_true", help="also record the violation of loops and constraints")
    group.add_argument(
        "--poses", metavar="PARTS", default="", help="also record the poses of these parts, separated by commas; *: all"
    )
    group.add_argument(
        "--accelerations",
        metavar="NAMES",
        default="",
        help="also record the accelerations of coordinates, parts and points (part.point), separated by commas; *: all",
    )


def _add_ring(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--last",
        type=positive_in("s"),
        metavar="S",
        help="with --out FILE.mcap: keep only the last S seconds, and up to twice that",
    )
    group.add_argument(
        "--when",
        metavar="EVENT",
        default="",
        help="with --last: write them after an event only: impact, or a condition such as 'abs(elbow.velocity) > 3'",
    )
    group.add_argument(
        "--after", type=positive_in("s"), metavar="S", help="with --when: seconds after the event (default 0)"
    )


def _require_ring(options: argparse.Namespace) -> None:
    """Refuse options of a ring without one.

    :raises InputError: an option has no effect.
    """
    if (options.when or options.after) and not options.last:
        raise InputError("--when, --after: everything is recorded", "Give --last too.")
    if options.after and not options.when:
        raise InputError("--after: there is no event", "Give --when too.")
    if options.last and (options.out is None or options.out.suffix != RECORDING or options.plot):
        raise InputError("--last is of a recording", "Give --out FILE.mcap, without --plot.")


def _size(text: str) -> tuple[int, int]:
    """An argument's width and height."""
    found = re.fullmatch(r"(\d{2,4})x(\d{2,4})", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a width and a height of 10 to 9999 pixels, such as 1280x720")
    return int(found[1]), int(found[2])


class RunOutputs:
    """The files of one run, as the options name them."""

    def __init__(self, options: argparse.Namespace) -> None:
        """Check the options before anything is computed.

        :raises InputError: a file has another suffix, its folder does not exist, an option has no effect without a
            file, or a package is not installed.
        """
        self._options, self._frames = options, list[tuple[float, Mapping[str, "Pose"]]]()
        self._contacts: list[Touching] = []
        self.written: list[str] = []
        self._ring: RingRecorder | None = None
        self._shown, self._coordinates = shown_plots(options, options.plot), plotted_coordinates(options, options.plot)
        require_styled(options, options.plot)
        if self.records:
            from mbd_sim.recordings.views import panels, plots
            from mbd_sim.recordings.views.table import require_table

            require_table(options.out, RECORDING)
            plots.require_plot(options.plot)
            panels.require_names(self._shown)
            chosen_style(options, options.plot)
        if options.animate is not None:
            from mbd_sim.pictures.drawing import animation
            from mbd_sim.recordings.views.table import require_suffix

            require_suffix(options.animate, animation.SUFFIXES)
            animation.require_animation_packages(options.animate)
        elif unused := [name for name in ("trace", "pace", "size") if getattr(options, name)]:
            raise InputError(f"--{unused[0]}: nothing is drawn", "Give --animate too.")
        self._pace, self._size = options.pace or 1.0, options.size or SIZE
        _require_ring(options)
        if not self.records:
            unused = [
                name.replace("_", "-")
                for name in ("rate", "reactions", "contact_forces", "violation", "poses", "accelerations")
                if getattr(options, name)
            ]
            if unused:
                names = ", ".join(f"--{name}" for name in unused)
                raise InputError(f"{names}: nothing is recorded", "Give --out or --plot too.")

    @property
    def frame_rate(self) -> float:
        """The samples for the animation per simulated second, 0 for none: frames, and points of traced paths."""
        if self._options.animate is None:
            return 0.0
        from mbd_sim.pictures.drawing.animation import TRACE_POINTS

        return self._drawn_rate * (TRACE_POINTS if self._options.trace else 1)

    @property
    def _drawn_rate(self) -> float:
        """The frames per simulated second."""
        from mbd_sim.pictures.drawing.animation import FRAME_RATE

        return FRAME_RATE / self._pace

    @contextmanager
    def of(self, simulation: BaseSimulation) -> Iterator[None]:
        """Record the run in this block, then write the files; also if the motion becomes infinite."""
        options = self._options
        traced_points(simulation.mechanism, options.trace)  # a wrong name is reported before the run
        if options.pace and options.animate:
            least = self._drawn_rate * self._pace * simulation.step_size
            if options.pace < least * (1.0 - 1e-9):
                raise InputError(
                    f"--pace {options.pace:g}: there are no {self._drawn_rate:g} steps per second to draw",
                    f"Give a pace of {least:g} or more, or a smaller --step.",
                )
        keeps = options.out is not None and options.out.suffix == RECORDING
        name = f"{simulation.mechanism.name}.mcap".replace("/", "_")
        with temporary_file(name) if self.records and not keeps else nullcontext(options.out or Path()) as path:
            try:
                with self._recording(simulation, path):
                    yield
            except DivergedError:
                self._write(simulation, path)
                raise
            self._write(simulation, path)

    def add_frame(self, simulation: BaseSimulation) -> None:
        """Keep the present poses and closed contacts for the animation."""
        self._frames.append((simulation.time, simulation.poses()))
        self._contacts.append(touching_now(simulation))

    @property
    def records(self) -> bool:
        """Whether the run is recorded."""
        return self._options.out is not None or self._options.plot is not None

    def _recording(self, simulation: BaseSimulation, path: Path) -> AbstractContextManager[object]:
        options = self._options
        if not self.records:
            return nullcontext()
        from mbd_sim.recordings.run.run_recorder import RunRecorder

        recorded: dict[str, Any] = {
            "rate": options.rate,
            "contact_forces": options.contact_forces or "contacts" in self._shown,
            "reactions": options.reactions or "reactions" in self._shown,
            "violation": options.violation,
            "poses": split_names(options.poses),
            "accelerations": split_names(options.accelerations),
        }
        if options.last:
            from mbd_sim.recordings.run.ring import RingRecorder

            self._ring = RingRecorder(
                simulation, path, options.last, when=options.when, after=options.after or 0.0, **recorded
            )
            return self._ring
        return RunRecorder(simulation, path, **recorded)

    def _write(self, simulation: BaseSimulation, path: Path) -> None:
        options = self._options
        if self._ring is not None:
            self._say_ring(self._ring)
        elif self.records:
            self._write_table_and_plot(path)
        if options.animate is not None:
            self._animate(simulation)

    def _say_ring(self, ring: RingRecorder) -> None:
        if not ring.written:
            self.written.append(f"nothing to {ring.path}: there was no {self._options.when}")
        for number, path in enumerate(ring.written):
            self.written.append(f"{path}" + (f": {ring.cause}" if number == 0 else ", which continues it"))

    def _write_table_and_plot(self, path: Path) -> None:
        from mbd_sim.cli.shared.recorded_run import read_run_table
        from mbd_sim.recordings.views import plots
        from mbd_sim.recordings.views.panels import panels
        from mbd_sim.recordings.views.table import export

        options = self._options
        table = read_run_table(path, options.quiet, options.mechanism if path != options.out else "")
        if path == options.out:
            self.written.append(f"{path}: {counted(len(table), 'state')}")
        elif options.out is not None:
            columns = export(options.out, table)
            self.written.append(f"{options.out}: {counted(len(table), 'row')} of {counted(columns, 'column')}")
        if options.plot is not None:
            chosen = panels(table, self._shown, self._coordinates, degrees=options.deg)
            plots.draw(options.plot, table, chosen, chosen_style(options, options.plot), kept=path == options.out)
            titles = ", ".join(dict.fromkeys(panel.title.lower() for panel in chosen))
            self.written.append(f"{options.plot}: {titles}")

    def _animate(self, simulation: BaseSimulation) -> None:
        from mbd_sim.pictures.drawing.animation import Animation, Frame, write_animation

        options = self._options
        width, height = self._size
        poses = [pose for _, pose in self._frames]
        animation = Animation(simulation.model, width, height, poses, options.trace)
        expected = 1 + int((self._frames[-1][0] - self._frames[0][0]) * self._drawn_rate + 1e-6)
        drawn = 0
        with ProgressBar("draw", self._options.quiet, total=expected, amount=COUNT) as progress:

            def frames() -> Iterator[Frame]:
                nonlocal drawn
                for frame in animation.frames(self._frames, self._drawn_rate, contacts=self._contacts):
                    yield frame
                    drawn += 1
                    progress.advance(1)

            write_animation(self._options.animate, frames(), simulation.mechanism.name)
        print_undrawn_meshes(simulation.mechanism)
        self.written.append(f"{self._options.animate}: {counted(drawn, 'frame')}")
