"""Geometry of plane motion: instant centers, velocity and acceleration polygons, centrodes, inflection circles.

| module | contents |
|---|---|
| `snapshot` | `PlanarDrive`: the links of a planar mechanism and their motion in a row of a driven motion |
| `centers` | the instant centers of all pairs of links, by Aronhold and Kennedy and by velocities |
| `polygons` | velocities and accelerations of joints, and the images of links |
| `centrodes` | the paths of poles, and inflection circles |
| `reports`, `pictures` | the results as text, columns and pictures |
"""

from __future__ import annotations

from mbd_sim.studies.plane_motion.centers import InstantCenter, instant_centers
from mbd_sim.studies.plane_motion.centrodes import Centrodes, InflectionCircle, centrodes, inflection_circle
from mbd_sim.studies.plane_motion.pictures import draw_plane_motion
from mbd_sim.studies.plane_motion.polygons import PointVector, Polygons, polygons
from mbd_sim.studies.plane_motion.snapshot import PlanarDrive, PlaneSnapshot, RigidLink

__all__ = [
    "Centrodes",
    "InflectionCircle",
    "InstantCenter",
    "PlanarDrive",
    "PlaneSnapshot",
    "PointVector",
    "Polygons",
    "RigidLink",
    "centrodes",
    "draw_plane_motion",
    "inflection_circle",
    "instant_centers",
    "polygons",
]
