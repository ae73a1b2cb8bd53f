"""The masses of the bodies of an MJCF, by the rules of MuJoCo's compiler: from `<inertial>` or from geoms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.mass_properties import MassProperties, composite, inertia_defect
from mbd_sim.mjcf.compiler_options import Compiler, Context
from mbd_sim.mjcf.geoms import UNKNOWN, Geom, mass_of
from mbd_sim.mjcf.items import Item

NOTHING = MassProperties(0.0, np.zeros(3), np.zeros((3, 3)))
UPPER = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # the order of `fullinertia`


def body_mass(context: Context, body: Item, inertial: Item | None, geoms: Sequence[Geom]) -> MassProperties:
    """The mass properties of a body in its frame, before all masses are scaled to `settotalmass`."""
    compiler = context.compiler
    first, last = compiler.inertiagroups
    counted = [geom for geom in geoms if first <= geom.item.number("group") <= last]
    explicit = None if inertial is None else _inertial(context, inertial)
    from_geoms = compiler.inertiafromgeom == "true" or (compiler.inertiafromgeom == "auto" and explicit is None)
    if from_geoms and counted:
        return _bounded(_of_geoms(counted), compiler)
    return _bounded(explicit or NOTHING, compiler)


def _of_geoms(geoms: Sequence[Geom]) -> MassProperties:
    massive = [geom for geom in geoms if geom.counts]
    known = []
    for geom in massive:
        if geom.kind in UNKNOWN:
            geom.item.report("", f"a {geom.kind} has a mass that depends on another file", REMEDY)
        elif geom.item.text("shellinertia") == "true":
            geom.item.report("shellinertia", "the mass of shells is not computed", REMEDY)
        else:
            known.append(mass_of(geom))
    return composite(known)


REMEDY = (
    'Give the body an <inertial>, or the geom mass="0". Of a mujoco.MjModel, body_mass, body_ipos, body_iquat and '
    "body_inertia are its mass, pos, quat and diaginertia."
)


def _inertial(context: Context, inertial: Item) -> MassProperties:
    pose = context.pose(inertial)
    if not inertial.has("mass"):
        inertial.report("", "'mass' is missing", "Add it.")
    mass = inertial.number_from_zero("mass")
    if inertial.has("fullinertia"):
        full = inertial.numbers("fullinertia", 6) or [0.0] * 6
        tensor = np.zeros((3, 3))
        for index, value in zip(UPPER, full, strict=True):
            tensor[index] = tensor[index[::-1]] = value
        if inertial.has("diaginertia"):
            inertial.report("diaginertia", "is given besides fullinertia", "Give one of them.")
    else:
        if not inertial.has("diaginertia"):
            inertial.report("", "neither 'diaginertia' nor 'fullinertia' is there", "Add one of them.")
        tensor = np.diag(inertial.numbers("diaginertia", 3) or [0.0] * 3)
    if inertia_defect(tensor) and not context.compiler.balanceinertia:
        inertial.leave_out("inertia that no rigid body can have, used as given")
    return MassProperties(mass, np.zeros(3), tensor).placed(pose)


def _bounded(body: MassProperties, compiler: Compiler) -> MassProperties:
    """With the least mass and moments, and with equal moments in place of those that no rigid body can have."""
    mass, tensor = max(body.mass, compiler.boundmass), body.inertia
    if compiler.boundinertia or (compiler.balanceinertia and inertia_defect(tensor)):
        moments, axes = np.linalg.eigh(tensor)
        moments = np.maximum(moments, compiler.boundinertia)
        if compiler.balanceinertia and moments[0] + moments[1] < moments[2]:
            moments = np.full(3, moments.mean())
        tensor = axes @ np.diag(moments) @ axes.T
    return MassProperties(mass, body.center, tensor)


def scaled(bodies: Sequence[MassProperties], total: float) -> list[MassProperties]:
    """The bodies with the total mass in kg, in their proportions; unchanged if it is not positive."""
    mass = sum(body.mass for body in bodies)
    return [body.scaled(total / mass) for body in bodies] if total > 0.0 and mass > 0.0 else list(bodies)


def tensor_entry(tensor: Array) -> list[float] | dict[str, float]:
    """The key `inertia` of a part."""
    tensor = 0.5 * (tensor + tensor.T)
    if not np.any(tensor - np.diag(np.diag(tensor))):
        return [float(value) + 0.0 for value in np.diag(tensor)]
    return {name: float(tensor[index]) for name, index in zip(("xx", "yy", "zz", "xy", "xz", "yz"), UPPER, strict=True)}
