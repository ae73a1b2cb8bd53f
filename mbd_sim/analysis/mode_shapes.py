"""The shapes of natural modes: how all coordinates move in each of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbd_sim.analysis.linearization import Linearization, Mode, is_second_of_pair, mode_of, mode_order, size_of_zeros
from mbd_sim.dynamics.equations import Equations
from mbd_sim.geometry.pose import Array


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
