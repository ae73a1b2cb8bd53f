"""Pictures of small motions: frequency responses, root loci, stability maps, and natural modes as animations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.linear.linearization import (
    Linearization,
    Mode,
    is_second_of_pair,
    mode_of,
    mode_order,
    size_of_zeros,
)
from mbd_sim.analysis.linear.state_space import StateSpace
from mbd_sim.base.errors import InputError, MbdSimError, cause_of
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.dynamics.equations import Equations
from mbd_sim.pictures.drawing.animation import Animation, require_animation_packages, write_animation
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.linear_analysis.loci import EigenvalueLocus

NEUTRAL = 1e-6  # growth, relative to the largest, at which the limit of stability is drawn: neutral states are within
_LEAST = 1e-300  # of a magnitude, for its logarithm
_LEGEND = 12  # entries


@interruptible()
def draw_bode(path: str | Path, system: StateSpace, frequencies: Sequence[float] | Array, title: str = "") -> None:
    """Draw magnitude and phase of all pairs of inputs and outputs over the frequencies in Hz, as .png, .svg or .pdf.

    :raises MissingPackageError: Matplotlib is not installed.
    :raises MbdSimError: the file cannot be written.
    """
    figure = _figure((7.0, 5.6))
    magnitude, phase = figure.subplots(2, sharex=True)
    found, x = system.response(frequencies), np.asarray(frequencies, dtype=float)
    for row, output in enumerate(system.outputs):
        for column, given in enumerate(system.inputs):
            values = found[:, row, column]
            if not np.any(np.abs(values) > 0.0):
                continue
            unit = f"{_in(system.output_units[row])} / {_in(system.input_units[column])}"
            magnitude.loglog(
                x, np.maximum(np.abs(values), _LEAST), linewidth=1.2, label=f"{output} / {given} in {unit}"
            )
            phase.semilogx(x, np.degrees(np.unwrap(np.angle(values))), linewidth=1.2)
    magnitude.set(ylabel="magnitude", title=title)
    phase.set(xlabel="frequency in Hz", ylabel="phase in °")
    phase.yaxis.get_major_locator().set_params(steps=[1, 1.5, 3, 4.5, 9, 10])
    for axes in (magnitude, phase):
        axes.grid(which="both", linewidth=0.3)
    if 0 < len(magnitude.lines) <= _LEGEND:
        magnitude.legend(fontsize=7)
    _save(figure, path)


@interruptible()
def draw_locus(path: str | Path, locus: EigenvalueLocus, title: str = "") -> None:
    """Draw the eigenvalues over one value as a root locus, or over two values as a map of the largest growth rate.

    :raises InputError: there are no values, or more than two.
    :raises MissingPackageError: Matplotlib is not installed.
    :raises MbdSimError: the file cannot be written.
    """
    if len(locus.names) not in (1, 2):
        raise InputError(f"a picture of {len(locus.names)} varied values is not drawn", "Vary one or two.")
    figure = _figure((7.0, 4.8))
    axes = figure.add_subplot()
    axes.set_title(title)
    if len(locus.names) == 1:
        _root_locus(figure, axes, locus)
    else:
        _stability_map(figure, axes, locus)
    _save(figure, path)


def _root_locus(figure: Any, axes: Any, locus: EigenvalueLocus) -> None:
    (values,), roots = locus.values, locus.eigenvalues
    colors = np.repeat(values, roots.shape[1])
    drawn = axes.scatter(roots.real.ravel(), roots.imag.ravel(), c=colors, s=7, cmap="viridis", zorder=3)
    first, last = roots[0], roots[-1]
    axes.plot(first.real, first.imag, "x", color="black", markersize=6, label=f"{values[0]:.4g}")
    axes.plot(last.real, last.imag, "o", color="black", markersize=6, fillstyle="none", label=f"{values[-1]:.4g}")
    axes.axvline(0.0, color="black", linewidth=0.6)
    axes.grid(linewidth=0.3)
    axes.set(xlabel="real part in 1/s", ylabel="imaginary part in rad/s")
    axes.legend(title=locus.names[0], fontsize=8, title_fontsize=8)
    figure.colorbar(drawn, ax=axes, label=locus.names[0])


def _stability_map(figure: Any, axes: Any, locus: EigenvalueLocus) -> None:
    (x, y), growth = locus.values, locus.growth.T
    largest = float(np.nanmax(np.abs(growth), initial=0.0)) or 1.0
    drawn = axes.pcolormesh(x, y, growth, shading="nearest", cmap="RdBu_r", vmin=-largest, vmax=largest)
    if min(growth.shape) > 1 and np.nanmin(growth) <= 0.0 < np.nanmax(growth):
        axes.contour(x, y, growth, levels=[NEUTRAL * largest], colors="black", linewidths=1.0)
    axes.set(xlabel=locus.names[0], ylabel=locus.names[1])
    figure.colorbar(drawn, ax=axes, label="largest real part in 1/s")


def _in(unit: str) -> str:
    return f"({unit})" if "/" in unit or " " in unit else unit or "1"


def _figure(size: tuple[float, float]) -> Any:
    require_packages("matplotlib", purpose="A plot")
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained")


def _save(figure: Any, path: str | Path) -> None:
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise MbdSimError(f"{path} cannot be drawn: {cause_of(error)}") from error


@dataclass(frozen=True, eq=False)
class ModeShape:
    """A `mode`, and the changes of all coordinates in it: the real part of `displacements` (nv,) times exp(λ t).

    With the eigenvalue λ. Displacements are in m and rad along the generalized speeds, and small. The one that is
    largest in size is 1, and so is the reference of their phases. They are zero where only actuators change.
    """

    mode: Mode
    displacements: NDArray[np.complex128]


def mode_shapes(linearization: Linearization) -> list[ModeShape]:
    """The natural modes with their shapes, in the order of `modes`."""
    values, vectors = np.linalg.eig(linearization.a)
    zero, found = float(size_of_zeros(values, linearization.rate)), []
    for value, vector in zip(values, vectors.T, strict=True):
        if is_second_of_pair(value):
            continue
        shape = linearization.displacements @ vector[: linearization.displacements.shape[1]].astype(complex)
        largest = shape[np.argmax(np.abs(shape))] if len(shape) else 0.0
        found.append(ModeShape(mode_of(value, zero), shape / largest if largest else shape))
    return sorted(found, key=lambda one: mode_order(one.mode))


def displaced_coordinates(equations: Equations, q: Array, shape: ModeShape, amplitude: float, phase: float) -> Array:
    """The coordinates (nq,) of a mode about q, at a phase in rad, with its largest displacement `amplitude`."""
    moved = amplitude * (shape.displacements * np.exp(1j * phase)).real
    return equations.constraints.displaced(q, moved)


CYCLE = 30  # frames, 1.2 s
LARGEST = 0.12  # displacement of a part, relative to the size of the mechanism, where no amplitude is given
LARGEST_ANGLE = 0.35  # rad


def animate_mode(
    simulation: BaseSimulation, shape: ModeShape, path: str | Path, amplitude: float | None = None, title: str = ""
) -> float:
    """Write a mode about the present state of a simulation as .gif, .webp, .mp4 or .html, one cycle in 1.2 s.

    Modes that do not oscillate are shown as if they did. Loops are closed in each frame. Damping is not shown.

    :param title: of an HTML page, by default the name of the mechanism.
    :param amplitude: of the coordinate that moves most, in m or rad; by default one that can be seen well.
    :returns: the amplitude.
    :raises MissingPackageError: Matplotlib or Pillow, or PyAV for MP4, is not installed.
    :raises DrawingError: the file cannot be written.
    """
    path = Path(path)
    require_animation_packages(path)
    size = _visible_amplitude(simulation, shape) if amplitude is None else amplitude
    phases = np.linspace(0.0, 2.0 * np.pi, CYCLE, endpoint=False)
    poses = [_poses(simulation, shape, size, float(phase)) for phase in phases]
    animation = Animation(simulation.model, configurations=poses)
    caption = f"{shape.mode.frequency:.4g} Hz" if shape.mode.frequency else ""
    write_animation(path, (animation.frame(one, caption) for one in poses), title or simulation.mechanism.name)
    return size


def _poses(simulation: BaseSimulation, shape: ModeShape, amplitude: float, phase: float) -> Mapping[str, Pose]:
    model, y, inputs = simulation.model, simulation.state, simulation.inputs
    q = displaced_coordinates(model.equations, y[model.q_range], shape, amplitude, phase)
    values = inputs[model.input_layout.values]
    y[model.q_range] = model.consistent(q, np.zeros(model.layout.nv), values)[0]
    return model.poses(simulation.time, y, inputs)


def _visible_amplitude(simulation: BaseSimulation, shape: ModeShape) -> float:
    """The amplitude with which no part moves or turns more than is easily seen, by the linear motion."""
    small, equations = 1e-6, simulation.model.equations
    rest, moved = (_poses(simulation, shape, amplitude, 0.0) for amplitude in (0.0, small))
    quarter = _poses(simulation, shape, small, 0.5 * math.pi)
    lengths, angles = [0.0], [0.0]
    for other in (moved, quarter):
        for name, pose in rest.items():
            lengths.append(float(np.linalg.norm(other[name].position - pose.position)) / small)
            angles.append(float(np.linalg.norm(other[name].rotation - pose.rotation)) / math.sqrt(2.0) / small)
    size = equations.constraints.size
    share = max(max(lengths) / (LARGEST * _extent(rest, size)), max(angles) / LARGEST_ANGLE)
    return 1.0 / share if share else 1.0


def _extent(poses: Mapping[str, Pose], least: float) -> float:
    places: Array = np.array([pose.position for pose in poses.values()])
    return max(least, float(np.max(np.ptp(places, axis=0), initial=0.0)))
