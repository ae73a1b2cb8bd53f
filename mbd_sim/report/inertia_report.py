"""`mbd_sim check --inertia`: center of mass, inertia tensor and principal axes of each part and of the whole."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbd_sim.geometry.pose import Pose
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.records import Part

WHOLE = "whole mechanism"
ROUND_OFF = 1e-15  # relative to the largest number


def inertia_report(parts: Mapping[str, Part], poses: Mapping[str, Pose]) -> list[dict[str, Any]]:
    """One record for each part in its own frame, and one for all parts as one rigid body in ground's frame at `poses`.

    Parts without mass are left out. The principal axes (3, 3) are unit vectors, one in each row, in the order of
    increasing principal moments.
    """
    bodies = {
        name: MassProperties(part.mass, part.center, part.inertia) for name, part in parts.items() if part.mass > 0.0
    }
    records = [_record(name, body) for name, body in bodies.items()]
    if bodies:
        records.append(_record(WHOLE, composite([body.placed(poses[name]) for name, body in bodies.items()])))
    return records


def _record(name: str, body: MassProperties) -> dict[str, Any]:
    moments, axes = np.linalg.eigh(body.inertia)
    axes = axes * np.where(axes[np.argmax(np.abs(axes), axis=0), range(3)] < 0.0, -1.0, 1.0)
    return {
        "name": name,
        "mass": body.mass,
        "center": body.center.tolist(),
        "inertia": body.inertia.tolist(),
        "inertia_at_origin": body.about(np.zeros(3)).tolist(),
        "principal_moments": moments.tolist(),
        "principal_axes": axes.T.tolist(),
    }


def inertia_text(records: list[dict[str, Any]]) -> str:
    """The report as text, in kg, m and kg·m²."""
    return "\n\n".join(_text(record) for record in records)


def _text(record: dict[str, Any]) -> str:
    frame = "the ground frame, at the start" if record["name"] == WHOLE else "the frame of the part"
    lines = [f"{record['name']}: {record['mass']:.6g} kg, center of mass {_row(record['center'])} m, in {frame}"]
    lines += _matrix("inertia about center of mass", record["inertia"])
    lines += _matrix("inertia about origin", record["inertia_at_origin"])
    moments = _cleaned(record["principal_moments"])
    lines += [
        f"  principal moment {moment:.6g} kg·m² about {_row(axis)}"
        for moment, axis in zip(moments, record["principal_axes"], strict=True)
    ]
    return "\n".join(lines)


def _matrix(title: str, rows: list[list[float]]) -> list[str]:
    size = float(np.max(np.abs(rows)))
    return [f"  {title if not index else '':30s} {_row(row, size)}" for index, row in enumerate(rows)]


def _row(values: list[float], size: float = 0.0) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in _cleaned(values, size)) + "]"


def _cleaned(values: list[float], size: float = 0.0) -> list[float]:
    """The values with round-off replaced by zero; otherwise it would hide that the axes are principal axes."""
    largest = max(size, *(abs(value) for value in values))
    return [0.0 if abs(value) < ROUND_OFF * largest else value for value in values]
