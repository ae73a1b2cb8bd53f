"""The shapes of natural modes: how all coordinates move in each of them, and animations of the mechanism in one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

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
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.dynamics.equations import Equations
from mbd_sim.pictures.drawing.animation import Animation, require_animation_packages, write_animation
from mbd_sim.simulation.run.simulation import Simulation


class ModeShape(NamedTuple):
    """A `mode`, and the changes of all coordinates in it: the real part of `displacements` (nv,) times exp(λ t).

    With the eigenvalue λ. Displacements are in m and rad along the generalized speeds, and small. The one that is
    largest in size is 1, and so is the reference of their phases. They are zero where only actuators change.
    """

    mode: Mode
    displacements: NDArray[np.complex128]


def mode_shapes(linearization: Linearization) -> list[ModeShape]:
    """The natural modes with their shapes, in the order of `modes`."""
    values, vectors = np.linalg.eig(linearization.a)
    zero, found = float(size_of_zeros(values)), []
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
    simulation: Simulation, shape: ModeShape, path: str | Path, amplitude: float | None = None, title: str = ""
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


def _poses(simulation: Simulation, shape: ModeShape, amplitude: float, phase: float) -> Mapping[str, Pose]:
    model, y, inputs = simulation.model, simulation.state, simulation.inputs
    q = displaced_coordinates(model.equations, y[model.q_range], shape, amplitude, phase)
    values = inputs[model.input_layout.values]
    y[model.q_range] = model.consistent(q, np.zeros(model.layout.nv), values)[0]
    return model.poses(simulation.time, y, inputs)


def _visible_amplitude(simulation: Simulation, shape: ModeShape) -> float:
    """The amplitude with which no part moves or turns more than is easily seen, by the linear motion."""
    small, equations = 1e-6, simulation.model.equations
    rest, moved = (_poses(simulation, shape, amplitude, 0.0) for amplitude in (0.0, small))
    quarter = _poses(simulation, shape, small, 0.5 * math.pi)
    lengths, angles = [1e-9], [1e-9]
    for other in (moved, quarter):
        for name, pose in rest.items():
            lengths.append(float(np.linalg.norm(other[name].position - pose.position)) / small)
            angles.append(float(np.linalg.norm(other[name].rotation - pose.rotation)) / math.sqrt(2.0) / small)
    size = equations.constraints.size
    return min(LARGEST * _extent(rest, size) / max(lengths), LARGEST_ANGLE / max(angles))


def _extent(poses: Mapping[str, Pose], least: float) -> float:
    places: Array = np.array([pose.position for pose in poses.values()])
    return max(least, float(np.max(np.ptp(places, axis=0), initial=0.0)))
