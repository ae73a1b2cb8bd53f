"""STEP files of assemblies, written with OpenCASCADE; lengths are in mm."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder, BRepPrimAPI_MakeSphere
from OCP.gp import gp_Ax1, gp_Ax2, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
from OCP.Interface import Interface_Static
from OCP.Quantity import Quantity_Color, Quantity_TypeOfColor
from OCP.STEPCAFControl import STEPCAFControl_Writer
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.XCAFApp import XCAFApp_Application
from OCP.XCAFDoc import XCAFDoc_ColorType, XCAFDoc_DocumentTool


def box(corner, size):
    return BRepPrimAPI_MakeBox(gp_Pnt(*map(float, corner)), *map(float, size)).Shape()


def cylinder(start, axis, radius, length):
    return BRepPrimAPI_MakeCylinder(
        gp_Ax2(gp_Pnt(*map(float, start)), gp_Dir(*map(float, axis))), radius, length
    ).Shape()


def sphere(center, radius):
    return BRepPrimAPI_MakeSphere(gp_Pnt(*map(float, center)), radius).Shape()


def fused(first, *others):
    for other in others:
        first = BRepAlgoAPI_Fuse(first, other).Shape()
    return first


def cut(first, *others):
    for other in others:
        first = BRepAlgoAPI_Cut(first, other).Shape()
    return first


def mirrored(shape, axis):
    """The mirror image of a shape in the plane through the origin that is normal to an axis."""
    motion = gp_Trsf()
    motion.SetMirror(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(*map(float, axis))))
    return BRepBuilderAPI_Transform(shape, motion, True).Shape()


def placement(position=(0, 0, 0), axis=(0, 0, 1), angle=0.0):
    turned, moved = gp_Trsf(), gp_Trsf()
    turned.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(*map(float, axis))), angle)
    moved.SetTranslation(gp_Vec(*map(float, position)))
    return TopLoc_Location(moved.Multiplied(turned))


def _text(name):
    return TCollection_ExtendedString(name, True)


@dataclass
class StepAssembly:
    """An assembly to be written; `add` returns the product, which may be placed several times."""

    name: str = "assembly"
    root: object = field(init=False)

    def __post_init__(self):
        self.document = TDocStd_Document(TCollection_ExtendedString("BinXCAF"))
        XCAFApp_Application.GetApplication_s().NewDocument(TCollection_ExtendedString("BinXCAF"), self.document)
        self.shapes = XCAFDoc_DocumentTool.ShapeTool_s(self.document.Main())
        self.colors = XCAFDoc_DocumentTool.ColorTool_s(self.document.Main())
        self.root = self.group(self.name)

    def group(self, name):
        """A sub-assembly, to be placed."""
        label = self.shapes.NewShape()
        TDataStd_Name.Set_s(label, _text(name))
        return label

    def product(self, name, shape, color=None):
        label = self.shapes.AddShape(shape, False)
        TDataStd_Name.Set_s(label, _text(name))
        if color is not None:
            paint = Quantity_Color(*color, Quantity_TypeOfColor.Quantity_TOC_sRGB)
            self.colors.SetColor(label, paint, XCAFDoc_ColorType.XCAFDoc_ColorSurf)
        return label

    def place(self, product, location=None, into=None, name=None):
        label = self.shapes.AddComponent(into or self.root, product, location or TopLoc_Location())
        if name is not None:
            TDataStd_Name.Set_s(label, _text(name))
        return label

    def add(self, name, shape, color=None, location=None, into=None):
        product = self.product(name, shape, color)
        self.place(product, location, into)
        return product

    def write(self, path, unit="MM"):
        self.shapes.UpdateAssemblies()
        Interface_Static.SetCVal_s("write.step.unit", unit)
        writer = STEPCAFControl_Writer()
        writer.SetColorMode(True)
        writer.SetNameMode(True)
        assert writer.Transfer(self.document)
        writer.Write(str(path))
        Interface_Static.SetCVal_s("write.step.unit", "MM")
        return path


CRANK, ROD, PITCH, BORE = 40.0, 140.0, 100.0, 35.0  # mm: crank radius, rod length, distance and radius of the bores
SHAFT, PIN, WRIST = 25.0, 20.0, 10.0  # mm: radii of main journals, crank pins and wrist pins


def engine(cylinders=3):
    """An engine: block, crankshaft, flywheel, and a rod, a piston and a pin for each cylinder; all at assembly.

    The crankshaft is along y, the pistons move along z, and the cranks are 120° apart.
    """
    assembly = StepAssembly("engine")
    length = PITCH * cylinders
    block = box((-60, -20, -70), (120, length + 40, 140))
    inner = box((-55, 0, -75), (110, length, 150))
    block = cut(block, inner, cylinder((0, -30, 0), (0, 1, 0), SHAFT, length + 60))
    deck = box((-60, -20, 70), (120, length + 40, 160))
    bores = [cylinder((0, PITCH * (k + 0.5), 60), (0, 0, 1), BORE, 200) for k in range(cylinders)]
    assembly.add("block", cut(fused(block, deck), *bores), (0.6, 0.6, 0.65))
    angles = [2.0 * math.pi * k / 3.0 for k in range(cylinders)]
    pins = [(CRANK * math.sin(a), PITCH * (k + 0.5), CRANK * math.cos(a)) for k, a in enumerate(angles)]
    shaft = [cylinder((0, -60, 0), (0, 1, 0), SHAFT, 60), cylinder((0, length, 0), (0, 1, 0), SHAFT, 60)]
    for x, y, z in pins:
        for side in (-1, 1):
            web = cylinder((0, y + (15 if side > 0 else -50), 0), (0, 1, 0), 65.0, 35.0)
            shaft.append(web)
        shaft.append(cylinder((x, y - 15, z), (0, 1, 0), PIN, 30.0))
    assembly.add("crankshaft", fused(*shaft), (0.3, 0.3, 0.35))
    wheel = cut(cylinder((0, -60, 0), (0, 1, 0), 120.0, 30.0), cylinder((0, -61, 0), (0, 1, 0), SHAFT, 32.0))
    assembly.add("flywheel", wheel, (0.4, 0.2, 0.2))
    rod, piston, pin = _rod(), _piston(), cylinder((0, -30, 0), (0, 1, 0), WRIST, 60.0)
    rod, piston, pin = (
        assembly.product("rod", rod, (0.7, 0.5, 0.2)),
        assembly.product("piston", piston, (0.8, 0.8, 0.85)),
        assembly.product("pin", pin, (0.2, 0.3, 0.6)),
    )
    for x, y, z in pins:
        top = z + math.sqrt(ROD**2 - x**2)
        tilt = math.atan2(-x, top - z)
        assembly.place(rod, placement((x, y, z), (0, 1, 0), tilt))
        assembly.place(piston, placement((0, y, top)))
        assembly.place(pin, placement((0, y, top)))
    return assembly


def _rod():
    big = cylinder((0, -15, 0), (0, 1, 0), 32.0, 30.0)
    small = cylinder((0, -12, ROD), (0, 1, 0), 16.0, 24.0)
    shank = box((-9, -8, 0), (18, 16, ROD))
    return cut(
        fused(big, small, shank),
        cylinder((0, -16, 0), (0, 1, 0), PIN, 32.0),
        cylinder((0, -16, ROD), (0, 1, 0), WRIST, 32.0),
    )


def _piston():
    body = cylinder((0, 0, -25), (0, 0, 1), BORE, 60.0)
    slot = box((-20, -12, -30), (40, 24, 52))
    return cut(body, slot, cylinder((0, -40, 0), (0, 1, 0), WRIST, 80.0))


def volume_of(shape):
    """Volume in mm³, by OpenCASCADE."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, found)
    return found.Mass()


def rotation(axis, angle):
    """A rotation matrix (3, 3), by Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)
