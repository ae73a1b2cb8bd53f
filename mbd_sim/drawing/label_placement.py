"""Placement of names: near the points that they name, and clear of lines and of each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mbd_sim.drawing.sheet import BACK, Sheet, SheetText
from mbd_sim.geometry.pose import Array

DISTANCES = (13.0, 18.0, 25.0, 34.0)  # pt, from the named point to the edge of the text
DIRECTIONS = 16
STEP = 3.0  # pt, between the sampled points of lines


def place_labels(sheet: Sheet, names: Sequence[tuple[SheetText, float]]) -> list[SheetText]:
    """Move each text away from its point to where it covers least; texts that cost more than their limit are left out.

    :param names: texts at the points (2,) that they name, the most important first, each with the most it may cost.
    """
    lines, weights = _probes(sheet)
    placed: list[SheetText] = []
    for text, limit in names:
        offsets, costs = _candidates(0.5 * (text.box[1] - text.box[0]))
        centers = text.at + offsets
        costs = costs + _hidden(centers - text.half, centers + text.half, lines, weights, placed)
        best = int(np.argmin(costs))
        if costs[best] <= limit:
            placed.append(replace(text, at=centers[best]))
    return placed


def _candidates(half: Array) -> tuple[Array, Array]:
    """Places (k, 2) for the center of a text of half this size (2,), relative to the named point, and their costs."""
    offsets, costs = [], []
    for number in range(DIRECTIONS):
        angle = 2.0 * np.pi * number / DIRECTIONS
        direction = np.array([np.cos(angle), np.sin(angle)])
        edge = min(half[0] / max(abs(direction[0]), 1e-9), half[1] / max(abs(direction[1]), 1e-9))
        for rank, distance in enumerate(DISTANCES):
            offsets.append((distance - 6.0 + edge) * direction)
            costs.append(1.1 * rank + 0.01 * number)
    return np.array(offsets), np.array(costs)


def _hidden(low: Array, high: Array, lines: Array, weights: Array, placed: Sequence[SheetText]) -> Array:
    """The costs (k,) of the lines and texts that a text with corners `low` and `high` (k, 2) covers."""
    low, high = low - 2.0, high + 2.0
    near = np.flatnonzero(np.all((lines > low.min(axis=0)) & (lines < high.max(axis=0)), axis=1))
    (x, y), weights = lines[near].T, weights[near]
    inside = (x > low[:, :1]) & (x < high[:, :1]) & (y > low[:, 1:]) & (y < high[:, 1:])
    covered: Array = np.where(inside, weights, 0.0).sum(
        axis=1
    )  # the weights are halves: sums of them are exact in any order
    for other in placed:
        overlap = np.minimum(high, other.box[1]) - np.maximum(low, other.box[0])
        covered += np.where(np.all(overlap > 0.0, axis=1), 60.0 + np.prod(overlap, axis=1), 0.0)
    return covered


def _probes(sheet: Sheet) -> tuple[Array, Array]:
    """Points (n, 2) along all lines, and the cost (n,) of covering each."""
    points, weights = [np.zeros((0, 2))], [np.zeros(0)]
    for path in sheet.paths:
        corners = np.vstack([path.points, path.points[:1]]) if path.closed else path.points
        steps = np.hypot(*np.diff(corners, axis=0).T)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(int(along[-1] / STEP), 1) + 1
        where = np.linspace(0.0, along[-1], count)
        points.append(np.column_stack([np.interp(where, along, corners[:, 0]), np.interp(where, along, corners[:, 1])]))
        weights.append(np.full(count, 0.5 if path.layer == BACK else 1.0))
    return np.vstack(points), np.concatenate(weights)
