"""Solids of OpenCASCADE as plain data: exact volume, center and inertia, triangles, and planes and round faces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from mbd_sim.base.errors import InputError
from mbd_sim.base.geometry.pose import Array
from mbd_sim.imports.assembly import Body, PartFace, covered_angle
from mbd_sim.mechanism.mass_properties import MassProperties

MILLIMETER = 1e-3  # m
DEVIATION = 1e-3  # of triangles from a face, relative to the size of the solid
TURN = 0.2  # rad, between neighboring triangles
RECOGNIZED = 1e-4  # mm, deviation up to which a free-form face is a plane or a round face
MOST_TRIANGLES = 2_000_000  # of a solid


def solids_of(shape: Any) -> Iterator[Any]:
    """The solids in a shape."""
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    explorer = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_SOLID)
    while explorer.More():
        yield TopoDS.Solid(explorer.Current())
        explorer.Next()


def faces_of(shape: Any) -> Iterator[Any]:
    """The faces of a shape."""
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    explorer = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_FACE)
    while explorer.More():
        yield TopoDS.Face(explorer.Current())
        explorer.Next()


def body_of(solid: Any, name: str) -> Body:
    """A solid as data, in m.

    :raises InputError: it is not closed, or encloses no volume.
    """
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    volume = _volume(solid, name)
    if volume.mass < 0.0:  # its faces are turned inside out
        solid = solid.Reversed()
        volume = MassProperties(-volume.mass, volume.center, -volume.inertia)
    box = Bnd_Box()
    BRepBndLib.Add_s(solid, box)
    size = math.sqrt(box.SquareExtent())
    BRepMesh_IncrementalMesh(solid, DEVIATION * size, False, TURN, False)
    faces, triangles = [], []
    for face in faces_of(solid):
        corners = _triangles(face)
        if not len(corners):
            continue
        triangles.append(corners)
        if (found := _face(face, corners)) is not None:
            faces.append(found)
    if not triangles:
        raise InputError(f"the faces of {name} cannot be divided into triangles", "Check and repair it in CAD.")
    whole = np.concatenate(triangles)
    if len(whole) > MOST_TRIANGLES:
        message = f"{name} has {len(whole)} triangles, more than {MOST_TRIANGLES}"
        raise InputError(message, "Remove threads, texts and small details in CAD.")
    return Body(volume, whole, tuple(faces))


def _volume(solid: Any, name: str) -> MassProperties:
    """Volume in m³ as mass, center and inertia, by the integrals of OpenCASCADE over the exact faces."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer

    shells = TopExp_Explorer(solid, TopAbs_ShapeEnum.TopAbs_SHELL)
    while shells.More():
        if not BRep_Tool.IsClosed_s(shells.Current()):
            message = f"the solid {name} is not closed, so that its mass is not known"
            raise InputError(message, "Repair it in CAD, and export it again.")
        shells.Next()
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, found)
    volume, center = found.Mass() * MILLIMETER**3, found.CentreOfMass()
    matrix = found.MatrixOfInertia()
    inertia = np.array([[matrix.Value(row, column) for column in (1, 2, 3)] for row in (1, 2, 3)]) * MILLIMETER**5
    if not volume or not np.all(np.isfinite(inertia)):
        raise InputError(f"the solid {name} encloses no volume", "Repair it in CAD, or leave it out.")
    return MassProperties(volume, _point(center), inertia)


def _triangles(face: Any) -> Array:
    """The triangles (n, 3, 3) of a face, which turn to the left seen from outside."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopLoc import TopLoc_Location

    location = TopLoc_Location()
    found = BRep_Tool.Triangulation_s(face, location)
    if found is None:
        return np.zeros((0, 3, 3))
    moved = location.Transformation()
    nodes = [found.Node(index).Transformed(moved) for index in range(1, found.NbNodes() + 1)]
    points = MILLIMETER * np.array([(node.X(), node.Y(), node.Z()) for node in nodes])
    indices = np.array([found.Triangle(index).Get() for index in range(1, found.NbTriangles() + 1)]) - 1
    if face.Orientation() == TopAbs_Orientation.TopAbs_REVERSED:
        indices = indices[:, ::-1]
    corners: Array = points[indices]
    return corners


def _face(face: Any, triangles: Array) -> PartFace | None:
    """A plane or a round face; None for any other face."""
    found = _surface(face)
    if found is None:
        return None
    kind, axis, radius = found
    point, direction = _point(axis.Location()), _direction(axis.Direction())
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])  # outward, twice the area long
    middles = triangles.mean(axis=1)
    if kind == "plane":
        outward = normals.sum(axis=0)
        return PartFace(
            "plane", point, direction if direction @ outward > 0.0 else -direction, 0.0, True, 0.0, triangles
        )
    away = middles - point
    if kind == "sphere":
        return PartFace("sphere", point, np.zeros(3), radius, bool(np.sum(away * normals) > 0.0), 0.0, triangles)
    radial = away - np.outer(away @ direction, direction)
    convex = bool(np.sum(radial * normals) > 0.0)
    return PartFace(kind, point, direction, radius, convex, covered_angle(triangles, point, direction), triangles)


def _surface(face: Any) -> tuple[Any, Any, float] | None:
    """Kind, axis, and radius in m, of the surface under a face."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_SurfaceType as Type

    surface = BRepAdaptor_Surface(face)
    match surface.GetType():
        case Type.GeomAbs_Plane:
            return "plane", surface.Plane().Axis(), 0.0
        case Type.GeomAbs_Cylinder:
            return "cylinder", surface.Cylinder().Axis(), MILLIMETER * surface.Cylinder().Radius()
        case Type.GeomAbs_Sphere:
            return "sphere", surface.Sphere().Position().Axis(), MILLIMETER * surface.Sphere().Radius()
        case Type.GeomAbs_Cone | Type.GeomAbs_Torus:
            return None
    return _recognized(face)


def _recognized(face: Any) -> tuple[Any, Any, float] | None:
    """What a free-form surface is within the precision of CAD: some programs write every face as one."""
    from OCP.gp import gp_Cylinder, gp_Pln, gp_Sphere
    from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition

    form = ShapeAnalysis_CanonicalRecognition(face)
    plane, cylinder, sphere = gp_Pln(), gp_Cylinder(), gp_Sphere()
    if form.IsPlane(RECOGNIZED, plane):
        return "plane", plane.Axis(), 0.0
    if form.IsCylinder(RECOGNIZED, cylinder):
        return "cylinder", cylinder.Axis(), MILLIMETER * cylinder.Radius()
    if form.IsSphere(RECOGNIZED, sphere):
        return "sphere", sphere.Position().Axis(), MILLIMETER * sphere.Radius()
    return None


def _point(point: Any) -> Array:
    return MILLIMETER * np.array([point.X(), point.Y(), point.Z()])


def _direction(direction: Any) -> Array:
    return np.array([direction.X(), direction.Y(), direction.Z()])
