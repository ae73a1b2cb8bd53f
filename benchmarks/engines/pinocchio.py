"""Pinocchio: its forward dynamics in compiled code, stepped by the classical Runge–Kutta method in Python.

Pinocchio has no integrator. Open chains use `aba`. Loops use `constraintDynamics` with a point constraint, which is
exact except for a proximal term; Baumgarte's method corrects its drift.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from benchmarks.plan import GROUND, Array, Plan

VERSION = pin.__version__
METHODS = {"aba + RK4 in Python": "rk4"}
PROXIMAL = 1e-12
STABILIZING = 10.0  # 1/s


class Pinocchio:
    """A plan as a Pinocchio model, whose joints are the aligned ones that are fastest."""

    def __init__(self, plan: Plan, step: float, method: str) -> None:
        self._model, self._step = _model(plan), step
        self._data = self._model.createData()
        self._springs = np.array([body.stiffness for body in plan.bodies])
        self._rests = np.array([body.rest for body in plan.bodies])
        self._tau = np.zeros(self._model.nv)
        self._dampers = np.array([body.damping for body in plan.bodies])
        self._sprung, self._damped = bool(np.any(self._springs)), not plan.conservative
        self._pins, self._pins_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for constraint in _pins(self._model, plan):
            self._pins.append(constraint)
            self._pins_data.append(constraint.createData())
        if plan.pins:
            pin.initConstraintDynamics(self._model, self._data, self._pins, self._pins_data)
            self._settings = pin.ProximalSettings(PROXIMAL, PROXIMAL, 1)
        self._closed = bool(plan.pins)
        self.reset(plan.q, plan.u)

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""
        self._q, self._u = q.copy(), u.copy()

    def each(self, steps: int) -> None:
        """Single steps: hinges and sliders need no more than a sum of vectors."""
        h, rates = self._step, self.accelerations
        half, sixth = 0.5 * h, h / 6.0
        q, u = self._q, self._u
        for _ in range(steps):
            a1 = rates(q, u)
            u2 = u + half * a1
            a2 = rates(q + half * u, u2)
            u3 = u + half * a2
            a3 = rates(q + half * u2, u3)
            u4 = u + h * a3
            a4 = rates(q + h * u3, u4)
            q = q + sixth * (u + 2.0 * (u2 + u3) + u4)
            u = u + sixth * (a1 + 2.0 * (a2 + a3) + a4)
        self._q, self._u = q, u

    many = each

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds."""
        return self._q, self._u

    def accelerations(self, q: Array, u: Array) -> Array:
        """Forward dynamics."""
        tau = self._springs * (self._rests - q) if self._sprung else self._tau
        if self._damped:
            tau = tau - self._dampers * u
        if not self._closed:
            # `aba` returns its own array, which the next call would overwrite.
            return pin.aba(self._model, self._data, q, u, tau).copy()
        return pin.constraintDynamics(
            self._model, self._data, q, u, tau, self._pins, self._pins_data, self._settings
        ).copy()


def _model(plan: Plan) -> pin.Model:
    model = pin.Model()
    model.gravity = pin.Motion(plan.gravity, np.zeros(3))
    for index, body in enumerate(plan.bodies):
        parent = 0 if body.parent == GROUND else body.parent + 1
        joint = pin.JointModelPZ() if body.slides else pin.JointModelRZ()
        identifier = model.addJoint(parent, joint, pin.SE3(body.rotation, body.position), body.name)
        if identifier != index + 1:
            raise ValueError(f"{plan.name}: Pinocchio has its joints in another order")
        inertia = pin.Inertia(body.mass, body.center, body.inertia)
        model.appendBodyToJoint(identifier, inertia, pin.SE3.Identity())
    return model


def _pins(model: pin.Model, plan: Plan) -> list[pin.RigidConstraintModel]:
    constraints, corrector = [], pin.BaumgarteCorrectorParameters(STABILIZING**2, 2.0 * STABILIZING)
    for loop in plan.pins:
        places = [pin.SE3(np.eye(3), point) for point in (loop.first_point, loop.second_point)]
        constraint = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D,
            model,
            loop.first + 1,
            places[0],
            loop.second + 1,
            places[1],
            pin.ReferenceFrame.LOCAL,
        )
        constraint.setBaumgarteCorrectorParameters(corrector)
        constraints.append(constraint)
    return constraints
