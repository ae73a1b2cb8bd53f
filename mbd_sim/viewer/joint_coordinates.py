"""The coordinates of joints for many samples at once."""

from __future__ import annotations

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import SceneDescription


def coordinates(scene: SceneDescription, rows: Rows) -> Array:
    """A position for each generalized speed, (n, nv), as `Model.coordinates` gives it for one state."""
    y = rows.of("y")
    parts = [np.empty((len(rows), 0))]
    for name, where in scene.q.items():
        values = y[:, where]
        if name in scene.quaternions:
            offset = scene.quaternions[name] - where.start
            values = np.hstack([values[:, :offset], rotation_vectors(values[:, offset:])])
        parts.append(values)
    return np.hstack(parts)


def rotation_vectors(quaternions: Array) -> Array:
    """Rotation vectors (n, 3), at most π long, of unit quaternions (n, 4) in the order (w, x, y, z)."""
    turned = np.where(quaternions[:, :1] >= 0.0, quaternions, -quaternions)
    w, v = turned[:, 0], turned[:, 1:]
    sine = np.linalg.norm(v, axis=1)
    safe = np.where(sine > 1e-9, sine, 1.0)
    factor = np.where(sine > 1e-9, 2.0 * np.arctan2(sine, w) / safe, 2.0)
    return np.asarray(v * factor[:, None])
