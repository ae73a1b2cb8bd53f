"""`mbd_sim run`: a simulation as fast as possible, with a progress bar and a summary."""

from __future__ import annotations

import time

from mbd_sim.simulation.simulation import Simulation
from mbd_sim.viewer import Viewer

SHOWN_RATE = 60.0  # states per simulated second that a viewer gets
OPEN = 1e-6  # m and m/s, from where on constraints count as not met
WAITING = 10_000  # states after which the viewer may catch up, so that it drops none


def run(simulation: Simulation, duration: float, *, rerun: str | None = None, quiet: bool = False) -> str:
    """Run for `duration` s and return a summary; `rerun` names a sink of the viewer.

    :raises DivergedError: the motion became infinite.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f} s"),
        TimeRemainingColumn(),
    )
    viewer = Viewer(simulation.model, rerun, rate=SHOWN_RATE) if rerun else None
    chunk = max(1, round(1.0 / (SHOWN_RATE * simulation.step_size))) if viewer else 20_000
    last = round(duration / simulation.step_size)
    stepping, shown = 0.0, 0
    try:
        with Progress(*columns, disable=quiet, transient=True) as progress:
            task = progress.add_task(simulation.mechanism.name, total=duration)
            if viewer is not None:
                viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
            while simulation.steps < last:
                began = time.perf_counter()
                simulation.advance(min(chunk, last - simulation.steps))
                stepping += time.perf_counter() - began
                progress.update(task, completed=simulation.time)
                if viewer is not None:
                    viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
                    shown += 1
                    if shown % WAITING == 0:
                        viewer.flush()
    finally:
        if viewer is not None:
            viewer.close()
    return _summary(simulation, stepping)


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
            f"  took             {seconds:.3g} s: {simulation.time / max(seconds, 1e-9):,.0f} × real time, "
            f"{1e6 * seconds / steps:.3g} µs a step",
            f"  energy residual  {energies.residual:.3g} J of {energies.total:.6g} J total "
            f"(applied {energies.work_applied:.6g}, drives {energies.work_drives:.6g}, "
            f"dissipated {energies.dissipated:.6g})",
            *_accuracy(simulation),
            *_constraints(simulation),
            f"  {'coordinate':16s}  position and velocity",
            *values,
        ]
    )


def _accuracy(simulation: Simulation) -> list[str]:
    """The estimated error of a step, with a warning where it is large."""
    advice = simulation.step_advice
    lines = [f"  error of a step  {simulation.error_estimate:.1g} of 1 + |q|, 1 + |u| at most, as estimated"]
    return lines if advice is None else [*lines, f"  WARNING          {advice}"]


def _constraints(simulation: Simulation) -> list[str]:
    """How far loops and constraints are off, redundant ones included, with a warning where that is much."""
    if not simulation.model.equations.rows:
        return []
    position, velocity = simulation.violation
    lines = [f"  constraints      off by {position:.3g} m, {velocity:.3g} m/s (or rad) at most"]
    if max(position, velocity) > OPEN:
        lines.append("  WARNING          a constraint does not hold: take a smaller step or look at redundant ones")
    return lines
