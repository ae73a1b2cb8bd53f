"""`mbd_sim run`: run a mechanism as fast as possible, with a progress bar, a summary, and files on request."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from typing import Protocol

from mbd_sim.base.errors import counted
from mbd_sim.cli.shared.command import SECONDS, Command, ProgressBar
from mbd_sim.cli.shared.common import add_duration, add_mechanism, add_method_and_step, add_quiet, pace, rounded
from mbd_sim.cli.shared.run_outputs import RunOutputs, add_outputs
from mbd_sim.cli.shared.setup_options import add_robot, add_set, add_start, build_simulation
from mbd_sim.mechanism.natural_units import coordinate_sizes, energy_size
from mbd_sim.pictures.rerun.viewer import Viewer
from mbd_sim.recordings.messages.events import publication_schedule
from mbd_sim.simulation.model.model import UNKNOWN_ENERGY
from mbd_sim.simulation.run.arguments import steps_in
from mbd_sim.simulation.run.simulation import BaseSimulation

SHOWN_RATE = 60.0  # states per simulated second that go to the viewer
CHUNK = 20_000  # steps per call without a viewer
FLUSH_INTERVAL = (
    10_000  # states and measured quantities after which the run waits for the viewer, so that its queue drops none
)
VIOLATION_LIMIT = 1e-6  # m and m/s, above which a violated constraint is worth a warning


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    add_mechanism(parser)
    add_duration(parser)
    add_method_and_step(parser, "from the file")
    add_set(parser)
    add_robot(parser)
    add_start(parser)
    add_outputs(parser)
    viewer = parser.add_mutually_exclusive_group()
    viewer.add_argument("--rerun", metavar="SINK", help="show the run in Rerun: spawn, serve, connect, or a file.rrd")
    viewer.add_argument(
        "--foxglove",
        metavar="PORT",
        help="show the run to Foxglove, by a server on a port such as 8765: it waits for Foxglove, then runs in real "
        "time",
    )
    add_quiet(parser)


def _execute(options: argparse.Namespace) -> int:
    """Run the mechanism, print the summary, and write the files."""
    outputs = RunOutputs(options)
    simulation = build_simulation(options)
    try:
        with outputs.of(simulation):
            viewer = _viewer(options, simulation)
            summary = simulate(simulation, options.time, viewer=viewer, quiet=options.quiet, outputs=outputs)
        print(summary)
    finally:
        for written in outputs.written:
            print(f"  wrote {written}")
    return 0


def _viewer(options: argparse.Namespace, simulation: BaseSimulation) -> Viewer | None:
    """The viewer that is asked for; that of Foxglove is being watched when this returns."""
    from mbd_sim.pictures.foxglove.viewer import FoxgloveViewer
    from mbd_sim.pictures.rerun.viewer import Viewer

    if options.rerun:
        return Viewer(simulation.model, options.rerun, rate=SHOWN_RATE)
    if options.foxglove is None:
        return None
    viewer = FoxgloveViewer(simulation.model, options.foxglove, rate=SHOWN_RATE)
    print(f"{viewer.address}\nThe run begins when this connection is opened in Foxglove.", flush=True)
    try:
        while not viewer.watched.wait(0.2):
            if viewer.failure is not None:
                raise viewer.failure
    except BaseException:
        viewer.close()
        raise
    return viewer


def simulate(
    simulation: BaseSimulation,
    duration: float,
    *,
    viewer: Viewer | None = None,
    quiet: bool = False,
    outputs: RunOutputs | None = None,
) -> str:
    """Run for `duration` s, in a viewer if there is one, which is closed then; returns a summary.

    :raises InputError: the duration is less than a step.
    :raises DivergedError: the state became infinite.
    """
    last = steps_in(duration, simulation.step_size)
    feed = None if viewer is None else _ViewerFeed(viewer, simulation)
    samplers: list[PeriodicOutput] = [] if feed is None else [feed]
    if outputs is not None and outputs.frame_rate:
        samplers.append(_Frames(outputs, simulation))
    seconds_stepping = 0.0
    try:
        with ProgressBar(simulation.mechanism.name, quiet, total=duration, amount=SECONDS) as progress:
            for sampler in samplers:
                sampler.sample()
            if feed is not None:
                feed.measure()
            schedules = [publication_schedule(sampler.rate, simulation.step_size) for sampler in samplers]
            while simulation.steps < last:
                due = [schedule.next_tick(simulation.steps) for schedule in schedules if schedule]
                if feed is not None:
                    due.append(simulation.steps + simulation.steps_to_arrival(CHUNK))
                began = time.perf_counter()
                simulation.advance(min(*due, simulation.steps + CHUNK, last) - simulation.steps)
                seconds_stepping += time.perf_counter() - began
                progress.show(simulation.time)
                if feed is not None:
                    feed.measure()
                for sampler, schedule in zip(samplers, schedules, strict=True):
                    if schedule and schedule.is_due(simulation.steps):
                        sampler.sample()
    finally:
        if viewer is not None:
            viewer.close()
    return _summary(
        simulation, seconds_stepping, "computed and recorded" if outputs and outputs.records else "computed"
    )


class PeriodicOutput(Protocol):
    """Takes a sample of a simulation at a rate in Hz."""

    rate: float

    def sample(self) -> None:
        """Take a sample."""
        ...


class _ViewerFeed:
    """Feeds the viewer."""

    rate = SHOWN_RATE

    def __init__(self, viewer: Viewer, simulation: BaseSimulation) -> None:
        self._viewer, self._simulation, self._waiting = viewer, simulation, 0
        self._began = time.monotonic() - simulation.time if viewer.keeps_time else None

    def sample(self) -> None:
        simulation = self._simulation
        if self._began is not None:
            time.sleep(max(self._began + simulation.time - time.monotonic(), 0.0))
        self._viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
        self._count()

    def measure(self) -> None:
        """Show the measurements that arrive at the present step."""
        sensors = self._simulation.sensor_model
        for number, sample in self._simulation.arrivals:
            assert sensors is not None
            reading = sensors.reading(number, sample)
            self._viewer.measure(self._simulation.time, sensors.sensors[number].name, reading)
            self._count(len(reading.values))

    def _count(self, items: int = 1) -> None:
        self._waiting += items
        if self._waiting >= FLUSH_INTERVAL:
            self._viewer.flush()
            self._waiting = 0


class _Frames:
    """Keeps the poses of an animation."""

    def __init__(self, outputs: RunOutputs, simulation: BaseSimulation) -> None:
        self._outputs, self._simulation, self.rate = outputs, simulation, outputs.frame_rate

    def sample(self) -> None:
        self._outputs.add_frame(self._simulation)


def _summary(simulation: BaseSimulation, seconds: float, done: str) -> str:
    steps = max(simulation.steps, 1)
    return "\n".join(
        [
            f"{simulation.mechanism.name}: {simulation.time:g} s in {counted(simulation.steps, 'step')} "
            f"of {simulation.step_size:g} s ({simulation.model.method_name})",
            f"  {done + ' in':16s} {seconds:.3g} s: {pace(simulation.time, seconds)} × real time, "
            f"{1e6 * seconds / steps:.3g} µs per step",
            *_energies(simulation),
            *(f"  note             {remark}" for remark in simulation.remarks),
            *_accuracy(simulation),
            *_constraints(simulation),
            f"  {'coordinate':16s}  position and velocity",
            *_coordinates(simulation),
        ]
    )


def _coordinates(simulation: BaseSimulation) -> Iterator[str]:
    """The position and the velocity of each coordinate, with 0 in place of round-off, then those of driven ones.

    That of a velocity is what moves the coordinate by the round-off of its position in the whole run, or what is
    round-off in comparison with the largest velocity of this dimension.
    """
    names, sizes = simulation.coordinate_names, coordinate_sizes(simulation.mechanism, simulation.step_size)
    positions, speeds = simulation.model.coordinates(simulation.state).tolist(), simulation.u.tolist()
    time = simulation.time or simulation.step_size
    largest = {size: max(abs(u) for u, own in zip(speeds, sizes, strict=True) if own == size) for size in set(sizes)}
    for name, size, position, speed in zip(names, sizes, positions, speeds, strict=True):
        place, rate = rounded(position, size), rounded(speed, max(largest[size], size / time))
        yield f"  {name:16s} {place: .9g}  {rate: .9g}"
    for name, drive in simulation.drives().items():
        yield f"  {name:16s} {drive.position: .9g}  {drive.velocity: .9g}  (driven)"


def _energies(simulation: BaseSimulation) -> Iterator[str]:
    """The energy account, with 0 in place of what is round-off in comparison with its largest term."""
    energies = simulation.energies
    size = max(map(abs, energies), default=0.0)
    size = max(size, energy_size(simulation.mechanism, simulation.step_size))
    total, applied, drives, dissipated = (
        rounded(value, size)
        for value in (energies.total, energies.work_applied, energies.work_drives, energies.dissipated)
    )
    yield (
        f"  energy residual  {energies.residual:.3g} J of {total:.6g} J total "
        f"(applied {applied:.6g}, drives {drives:.6g}, dissipated {dissipated:.6g})"
    )
    if math.isnan(energies.residual):
        yield f"  WARNING          {UNKNOWN_ENERGY}"


def _accuracy(simulation: BaseSimulation) -> list[str]:
    """The largest estimated error of a step, with a warning if it is too large."""
    advice = simulation.step_advice
    lines = [f"  step error       at most {simulation.error_estimate:.1g}, estimated, relative to scales of q and u"]
    return lines if advice is None else [*lines, f"  WARNING          {advice}"]


def _constraints(simulation: BaseSimulation) -> list[str]:
    """The violation of loops and constraints, including redundant ones, with a warning if it is too large."""
    if not simulation.model.row_names:
        return []
    position, velocity = simulation.violation
    lines = [f"  constraints      violated by at most {position:.3g} m, {velocity:.3g} m/s (or rad, rad/s)"]
    if max(position, velocity) > VIOLATION_LIMIT:
        lines.append(
            "  WARNING          a constraint is violated: use a smaller step, or check the redundant constraints"
        )
    return lines


COMMANDS = {
    "run": Command(
        "Run a mechanism as fast as possible, without ROS, and report speed, energy residual and final state. The "
        "run can be recorded, written as a table, plotted, animated, and shown in Rerun or Foxglove.",
        _add_arguments,
        _execute,
    ),
}
