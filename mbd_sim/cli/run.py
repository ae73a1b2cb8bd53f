"""`mbd_sim run`: run a mechanism as fast as possible, with a progress bar and a summary."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from mbd_sim.cli.common import (
    SECONDS,
    ProgressBar,
    add_duration,
    add_mechanism,
    add_method_and_step,
    add_quiet,
    split_assignment,
)
from mbd_sim.errors import InputError

if TYPE_CHECKING:
    from mbd_sim.simulation.simulation import Simulation

HELP = "run a mechanism as fast as possible, without ROS"
DESCRIPTION = "Run a mechanism as fast as possible, without ROS, and report speed, energy residual and final state."

SHOWN_RATE = 60.0  # states per simulated second that go to the viewer
CHUNK = 20_000  # steps per call without a viewer
FLUSH_INTERVAL = 10_000  # states after which the run waits for the viewer, so that its queue drops none
VIOLATION_LIMIT = 1e-6  # m and m/s, above which a violated constraint is worth a warning


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_mechanism(parser)
    add_duration(parser)
    add_method_and_step(parser, "from the file")
    parser.add_argument(
        "--effort",
        action="append",
        default=[],
        metavar="JOINT=VALUE",
        help="constant effort on a joint, in N or N·m; repeatable",
    )
    parser.add_argument("--rerun", metavar="SINK", help="show the run in Rerun: spawn, serve, connect, or a file.rrd")
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Run the mechanism and print the summary."""
    from mbd_sim.simulation.simulation import Simulation

    simulation = Simulation.from_file(options.mechanism, method=options.method, step=options.step)
    simulation.set_efforts(dict(_effort(text) for text in options.effort))
    print(simulate(simulation, options.time, rerun=options.rerun, quiet=options.quiet))
    return 0


def simulate(simulation: Simulation, duration: float, *, rerun: str | None = None, quiet: bool = False) -> str:
    """Run for `duration` s and return a summary; `rerun` names a sink of the viewer.

    :raises DivergedError: the state became infinite.
    """
    from mbd_sim.viewer import Viewer

    viewer = Viewer(simulation.model, rerun, rate=SHOWN_RATE) if rerun else None
    chunk = max(1, round(1.0 / (SHOWN_RATE * simulation.step_size))) if viewer else CHUNK
    last = round(duration / simulation.step_size)
    seconds_stepping, shown = 0.0, 0
    try:
        with ProgressBar(simulation.mechanism.name, quiet, total=duration, amount=SECONDS) as progress:
            if viewer is not None:
                viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
            while simulation.steps < last:
                began = time.perf_counter()
                simulation.advance(min(chunk, last - simulation.steps))
                seconds_stepping += time.perf_counter() - began
                progress.show(simulation.time)
                if viewer is not None:
                    viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
                    shown += 1
                    if shown % FLUSH_INTERVAL == 0:
                        viewer.flush()
    finally:
        if viewer is not None:
            viewer.close()
    return _summary(simulation, seconds_stepping)


def _effort(text: str) -> tuple[str, float]:
    try:
        name, value = split_assignment(text) or ("", "")
        return name, float(value)
    except ValueError:
        raise InputError(f"--effort {text}: not of the form JOINT=VALUE", "Write for example elbow=2.5.") from None


def _summary(simulation: Simulation, seconds: float) -> str:
    energies, steps = simulation.energies, max(simulation.steps, 1)
    values = [
        f"  {name:16s} {position: .9g}  {speed: .9g}"
        for name, position, speed in zip(
            simulation.coordinate_names, simulation.model.coordinates(simulation.state), simulation.u, strict=True
        )
    ]
    return "\n".join(
        [
            f"{simulation.mechanism.name}: {simulation.time:g} s in {simulation.steps} steps "
            f"of {simulation.step_size:g} s ({simulation.model.method.name})",
            f"  computed in      {seconds:.3g} s: {simulation.time / max(seconds, 1e-9):,.0f} × real time, "
            f"{1e6 * seconds / steps:.3g} µs per step",
            f"  energy residual  {energies.residual:.3g} J of {energies.total:.6g} J total "
            f"(applied {energies.work_applied:.6g}, drives {energies.work_drives:.6g}, "
            f"dissipated {energies.dissipated:.6g})",
            *(f"  note             {remark}" for remark in simulation.remarks),
            *_accuracy(simulation),
            *_constraints(simulation),
            f"  {'coordinate':16s}  position and velocity",
            *values,
        ]
    )


def _accuracy(simulation: Simulation) -> list[str]:
    """The largest estimated error of a step, with a warning if it is too large."""
    advice = simulation.step_advice
    lines = [f"  step error       at most {simulation.error_estimate:.1g}, estimated, relative to 1 + |q| and 1 + |u|"]
    return lines if advice is None else [*lines, f"  WARNING          {advice}"]


def _constraints(simulation: Simulation) -> list[str]:
    """The violation of loops and constraints, including redundant ones, with a warning if it is too large."""
    if not simulation.model.equations.rows:
        return []
    position, velocity = simulation.violation
    lines = [f"  constraints      violated by at most {position:.3g} m, {velocity:.3g} m/s (or rad, rad/s)"]
    if max(position, velocity) > VIOLATION_LIMIT:
        lines.append(
            "  WARNING          a constraint is violated: use a smaller step, or check the redundant constraints"
        )
    return lines
