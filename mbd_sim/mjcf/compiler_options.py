"""The settings with which MuJoCo reads a model: `<compiler>`, and the poses of elements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.geometry.rotation import about, from_quaternion, unit
from mbd_sim.mjcf.items import Defaults, Item
from mbd_sim.urdf.value_reader import Reading
from mbd_sim.urdf.xml_elements import Element

ORIENTATIONS = {"quat": 4, "axisangle": 4, "euler": 3, "xyaxes": 6, "zaxis": 3}
Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Compiler:
    """The settings of `<compiler>` that the motion depends on; `angle` is the unit of angles in rad."""

    angle: float = math.pi / 180.0
    eulerseq: str = "xyz"
    autolimits: bool = True
    inertiafromgeom: str = "auto"
    inertiagroups: tuple[float, float] = (0.0, 5.0)
    balanceinertia: bool = False
    boundmass: float = 0.0
    boundinertia: float = 0.0
    settotalmass: float = -1.0
    mesh_folder: str = ""
    strippath: bool = False


def compiler_of(root: Element, reading: Reading) -> Compiler:
    """The settings of a model; of several `<compiler>` elements, each attribute of the last one that has it."""
    places = {name: element for element in root.all("compiler") for name in element.attributes}
    item = Item(reading, root, "compiler", places)
    if item.text("coordinate", "local") != "local":
        remedy = "Load and save the model with an older MuJoCo, which writes local coordinates."
        item.report("coordinate", "only local coordinates are read", remedy)
    eulerseq = item.text("eulerseq", "xyz")
    if len(eulerseq) != 3 or set(eulerseq.lower()) - set("xyz"):
        item.report("eulerseq", "is not a sequence of axes", "Write three letters of x, y, z, X, Y and Z.")
        eulerseq = "xyz"
    groups = item.numbers("inertiagrouprange", 2) or [0.0, 5.0]
    return Compiler(
        angle=1.0 if item.choice("angle", ("radian", "degree"), "degree") == "radian" else math.pi / 180.0,
        eulerseq=eulerseq,
        autolimits=_flag(item, "autolimits", True),
        inertiafromgeom=item.choice("inertiafromgeom", ("true", "false", "auto"), "auto"),
        inertiagroups=(groups[0], groups[1]),
        balanceinertia=_flag(item, "balanceinertia", False),
        boundmass=item.number_from_zero("boundmass"),
        boundinertia=item.number_from_zero("boundinertia"),
        settotalmass=item.number("settotalmass", -1.0),
        mesh_folder=item.text("meshdir", item.text("assetdir")),
        strippath=_flag(item, "strippath", False),
    )


def _flag(item: Item, name: str, otherwise: bool) -> bool:
    return item.choice(name, ("true", "false"), str(otherwise).lower()) == "true"


@dataclass(frozen=True, eq=False)
class Context:
    """What reading any element needs: the problems and notes so far, the settings, and the default classes."""

    reading: Reading
    compiler: Compiler
    defaults: Defaults

    def pose(self, item: Item) -> Pose:
        """The pose of an element in the frame around it: `pos`, and one of five ways to give an orientation."""
        return Pose(np.array(item.numbers("pos", 3) or [0.0, 0.0, 0.0]), self._rotation(item))

    def _rotation(self, item: Item) -> Array:
        given = [name for name in ORIENTATIONS if item.element.attributes.get(name) is not None]
        given = given or [name for name in ORIENTATIONS if item.has(name)]
        if len(given) > 1:
            item.report(given[1], f"is given besides {given[0]}", "Give one orientation.")
        if not given or (values := item.numbers(given[0], ORIENTATIONS[given[0]])) is None:
            return np.eye(3)
        vector = np.array(values)
        if given[0] == "euler":
            return self.euler(vector)
        if not np.any(vector[:3] if given[0] != "quat" else vector):
            item.report(given[0], "must not be zero", "Write a direction.")
            return np.eye(3)
        match given[0]:
            case "quat":
                return from_quaternion(unit(vector))
            case "axisangle":
                return about(unit(vector[:3]), self.compiler.angle * vector[3])
            case "zaxis":
                return turning_z(unit(vector))
        return self._of_two_axes(item, vector)

    def euler(self, angles: Array) -> Array:
        """Rotations in the order of `eulerseq`: about moving axes by small letters, about fixed ones by capitals."""
        rotation = np.eye(3)
        for letter, angle in zip(self.compiler.eulerseq, angles, strict=True):
            turn = about(np.eye(3)["xyz".index(letter.lower())], self.compiler.angle * angle)
            rotation = rotation @ turn if letter.islower() else turn @ rotation
        return rotation

    def _of_two_axes(self, item: Item, vector: Array) -> Array:
        x = unit(vector[:3])
        y = vector[3:] - x * (x @ vector[3:])
        if float(np.linalg.norm(y)) <= 1e-9 * float(np.linalg.norm(vector[3:])) or not np.any(y):
            item.report("xyaxes", "has parallel axes", "Write two directions that differ.")
            return np.eye(3)
        y = unit(y)
        return np.column_stack([x, y, np.cross(x, y)])


def turning_z(direction: Array) -> Array:
    """The smallest rotation (3, 3) that turns z into a unit direction; about x if they are opposite."""
    across = np.cross(Z, direction)
    sine = float(np.linalg.norm(across))
    if sine < 1e-10:
        return np.eye(3) if direction[2] > 0.0 else about(np.array([1.0, 0.0, 0.0]), math.pi)
    return about(across / sine, math.atan2(sine, float(direction[2])))
