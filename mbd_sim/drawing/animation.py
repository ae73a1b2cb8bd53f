"""Frames of a mechanism in motion, all of the same size, position and scale."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.drawing.composition import Composition, mechanism_sheet
from mbd_sim.drawing.curve_paths import constraint_curves
from mbd_sim.drawing.part_outlines import bounding_points
from mbd_sim.drawing.picture import POINTS, pixels
from mbd_sim.drawing.projection import Page, view_of
from mbd_sim.drawing.sheet import GRAY, SheetText
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.simulation.compiled_model import Model

SAMPLES = 60  # random configurations from which the window is found
STROKE = 0.5  # m in each direction, of sliding joints without limits
MARGIN = 1.12
CAPTION_PLACE, CAPTION_SIZE = np.array([60.0, 14.0]), 11.0  # pt


class Animation:
    """Frames of a mechanism, in a window that contains a set of configurations."""

    def __init__(
        self,
        model: Model,
        width: int = 600,
        height: int = 400,
        configurations: Sequence[Mapping[str, Pose]] | None = None,
    ) -> None:
        """Frames of `width` times `height` pixels.

        :param configurations: poses of the parts that the window shows; by default those that the joints and the loops
            allow.
        """
        self._mechanism, self._size = model.mechanism, np.array([width, height], dtype=float)
        start = model.poses(0.0, model.start)
        self._view = view_of(self._mechanism, start)
        axes = np.column_stack([self._view.right, self._view.up])
        shown = _reachable_poses(model) if configurations is None else configurations
        projected = [bounding_points(self._mechanism, poses) @ axes for poses in (start, *shown)]
        low, high = np.vstack(projected).min(axis=0), np.vstack(projected).max(axis=0)
        self._mechanism_size = max(
            float(np.max(np.ptp(projected[0], axis=0))), 1e-9
        )  # symbols are drawn in proportion to it
        scale = float(np.min(self._size / np.maximum((high - low) * MARGIN, 0.2 * self._mechanism_size)))
        self._page = Page(self._view, scale)
        self._shift = 0.5 * self._size - 0.5 * (low + high) * scale

    def frame(self, poses: Mapping[str, Pose], caption: str = "") -> NDArray[np.uint8]:
        """The mechanism with its parts at `poses`, in ground's frame in m: (height, width, 3)."""
        curves = constraint_curves(self._mechanism, poses, self._view)
        sheet = mechanism_sheet(self._page, self._mechanism, poses, self._mechanism_size, curves)
        sheet = sheet.translated(self._shift)
        if caption:
            sheet.texts.append(SheetText(caption, CAPTION_PLACE, CAPTION_SIZE, GRAY))
        return pixels(Composition(sheet, self._size), POINTS)


def _reachable_poses(model: Model) -> list[Mapping[str, Pose]]:
    """The poses in some of the configurations that the joints and the loops allow."""
    rng, found = np.random.default_rng(0), []
    y = model.start.copy()
    for _ in range(SAMPLES):
        try:
            y[model.q_range] = model.consistent(_random_configuration(model, rng), np.zeros(model.layout.nv))[0]
        except ValueError:  # the loops do not close near it
            continue
        found.append(model.poses(0.0, y))
    return found


def _random_configuration(model: Model, rng: np.random.Generator) -> Array:
    """Coordinates q, not yet consistent with the loops, drawn within the limits of the joints."""
    q = model.start[model.q_range].copy()
    for name, joint in model.mechanism.joints.items():
        indices = model.layout.q[name]
        if joint.type == "prismatic" and not joint.limits:
            q[indices] += rng.uniform(-STROKE, STROKE)
        elif joint.type in ("revolute", "universal") and not joint.limits:
            q[indices] = rng.uniform(-np.pi, np.pi, indices.stop - indices.start)
        for index, limits in zip(range(indices.start, indices.stop), joint.limits, strict=False):
            if limits is not None:
                q[index] = rng.uniform(limits.lower, limits.upper)
    return q
