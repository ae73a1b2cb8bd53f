"""Ropes, which can pull but not push: taut they are straight, slack they hang with their own length."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mbd_sim.drawing.projection import Page
from mbd_sim.drawing.sheet import SheetPath
from mbd_sim.drawing.spring_symbols import cable_paths
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.expression import TimeExpression
from mbd_sim.mechanism.records import Mechanism

TAUT = 1e-6  # of the length that may be missing
POINTS = 33  # of the curve of a slack rope
HALVINGS = 60


def rope_paths(page: Page, mechanism: Mechanism, points: Array, length: TimeExpression) -> list[SheetPath]:
    """A rope along points (n, 3) in ground's frame; one whose length varies with time is drawn straight."""
    between = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    whole = between if length.variables else length.at(0.0)
    line = points
    if whole > between * (1.0 + TAUT):
        gravity = float(np.linalg.norm(mechanism.gravity))
        down = mechanism.gravity / gravity if gravity else np.array([0.0, 0.0, -1.0])
        excess = (whole - between) / (len(points) - 1)
        line = np.vstack([hanging(*ends, excess, down) for ends in pairwise(points)])
    return cable_paths(page, line, page.depth(points.mean(axis=0)))


def hanging(start: Array, stop: Array, excess: float, down: Array) -> Array:
    """A parabola (n, 3) from `start` to `stop`, longer than their distance by `excess` in m, that sags along `down`."""
    parameter = np.linspace(0.0, 1.0, POINTS)[:, None]
    straight, shape = start + parameter * (stop - start), 4.0 * parameter * (1.0 - parameter)
    wanted = float(np.linalg.norm(stop - start)) + excess
    low, high = 0.0, wanted  # a sag as deep as the whole length makes the line longer than that
    for _ in range(HALVINGS):
        sag = 0.5 * (low + high)
        line = straight + sag * shape * down
        too_long = np.linalg.norm(np.diff(line, axis=0), axis=1).sum() > wanted
        low, high = (low, sag) if too_long else (sag, high)
    return np.asarray(straight + low * shape * down)
