"""MuJoCo, with one `mj_step` per step.

Everything that these mechanisms do not need is disabled (contacts, limits, friction, actuators, sensors, and springs
and dampers if there are none), which saves a tenth of the time of a step; dampers are not treated implicitly by Euler's
method. Loops are `connect` equalities, with dense matrices, which are faster at this size. Equalities are soft in
MuJoCo: `solimp` is the hardest that it allows, and `solref` (stiffness 0.1/h², damping 0.1/h) had the smallest error
with RK4 of ten settings; harder ones become unstable. The Newton solver satisfies equalities in one iteration.
"""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np

from benchmarks.plan import GROUND, Array, Plan

VERSION = mujoco.__version__
METHODS = {"Euler": "Euler", "implicitfast": "implicitfast", "RK4": "RK4"}
OFF = (
    "limit", "contact", "frictionloss", "damper", "clampctrl", "filterparent", "actuation", "refsafe", "sensor",
    "midphase", "nativeccd", "island", "eulerdamp", "warmstart", "autoreset",
)  # fmt: skip
IMPEDANCE = "0.9999 0.9999 0.001 0.5 2"

mujoco.set_mju_user_warning(lambda message: None)  # otherwise it writes a log file


class MuJoCo:
    """A plan as an MJCF model, for one of MuJoCo's integrators."""

    def __init__(self, plan: Plan, step: float, method: str) -> None:
        text = exported(plan, step, method) if plan.mjcf else mjcf(plan, step, method)
        self._model = mujoco.MjModel.from_xml_string(text)
        self._data = mujoco.MjData(self._model)
        if (self._model.nq, self._model.nv) != (len(plan.q), len(plan.u)):
            raise ValueError(f"{plan.name}: MuJoCo has {self._model.nv} speeds instead of {len(plan.u)}")
        base = range(7), range(6)
        joints = [self._model.joint(name) for name in plan.names or [body.name for body in plan.bodies]]
        # Where our coordinates and speeds are in MuJoCo's: bodies beside each other may have another order there.
        self._q = np.array([*base[0][: 7 * plan.floating], *(joint.qposadr[0] for joint in joints)])
        self._u = np.array([*base[1][: 6 * plan.floating], *(joint.dofadr[0] for joint in joints)])

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[self._q], self._data.qvel[self._u] = q, u

    def each(self, steps: int) -> None:
        """Take single steps, one call each."""
        step, model, data = mujoco.mj_step, self._model, self._data
        for _ in range(steps):
            step(model, data)

    def many(self, steps: int) -> None:
        """Take the steps in one call."""
        mujoco.mj_step(self._model, self._data, steps)

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds."""
        return self._data.qpos[self._q], self._data.qvel[self._u]

    def accelerations(self, q: Array, u: Array) -> Array:
        """The result of its forward dynamics."""
        self._data.qpos[self._q], self._data.qvel[self._u] = q, u
        mujoco.mj_forward(self._model, self._data)
        return self._data.qacc[self._u]


def mjcf(plan: Plan, step: float, method: str) -> str:
    """The model as MJCF."""
    root = Element("mujoco", model=plan.name)
    SubElement(root, "compiler", angle="radian", autolimits="false", boundmass="0", boundinertia="0")
    _add_option(root, plan, step, method)
    frames = {GROUND: SubElement(root, "worldbody")}
    for index, body in enumerate(plan.bodies):
        frames[index] = frame = SubElement(
            frames[body.parent], "body", name=body.name, pos=_text(body.position), quat=_text(body.quaternion)
        )
        SubElement(
            frame, "joint", name=body.name, type="slide" if body.slides else "hinge", axis="0 0 1",
            stiffness=repr(body.stiffness), springref=repr(body.rest), damping=repr(body.damping),
        )  # fmt: skip
        inertia = body.definite_inertia()
        inertial = SubElement(frame, "inertial", mass=repr(body.mass), pos=_text(body.center))
        if np.any(inertia - np.diag(np.diag(inertia))):
            upper = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            inertial.set("fullinertia", _text(upper))
        else:
            inertial.set("diaginertia", _text(np.diag(inertia)))
    for pin in plan.pins:
        # MuJoCo places the second body's point where the first one's is at q = 0, so both are given as sites.
        sites = []
        for end, point in ((pin.first, pin.first_point), (pin.second, pin.second_point)):
            sites.append(f"site{end}")
            SubElement(frames[end], "site", name=sites[-1], pos=_text(point))
        hardness = {"solref": f"{-0.1 / step**2!r} {-0.1 / step!r}", "solimp": IMPEDANCE}
        equality = root.find("equality")
        equality = SubElement(root, "equality") if equality is None else equality
        SubElement(equality, "connect", site1=sites[0], site2=sites[1], **hardness)
    return tostring(root, encoding="unicode")


def exported(plan: Plan, step: float, method: str) -> str:
    """Our export of a robot, without what only costs time: geoms, sites, start, and bodies fixed to others."""
    root = ElementTree.fromstring(plan.mjcf)
    compiler = root.find("compiler")
    if compiler is None:
        raise ValueError(f"{plan.name}: the exported MJCF has no <compiler>")
    compiler.set("fusestatic", "true")
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in ("option", "geom", "site", "keyframe", "actuator"):
                parent.remove(child)
    _add_option(root, plan, step, method)
    return tostring(root, encoding="unicode")


def _add_option(root: Element, plan: Plan, step: float, method: str) -> None:
    option = SubElement(
        root, "option", timestep=repr(step), gravity=_text(plan.gravity), integrator=method, jacobian="dense",
        solver="Newton", iterations="1", ls_iterations="1",
    )  # fmt: skip
    flags = dict.fromkeys(OFF, "disable")
    if not plan.pins:
        flags |= {"constraint": "disable", "equality": "disable"}
    if not any(body.stiffness for body in plan.bodies):
        flags["spring"] = "disable"
    if not plan.conservative:
        flags["damper"] = "enable"
    SubElement(option, "flag", flags)


def _text(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
