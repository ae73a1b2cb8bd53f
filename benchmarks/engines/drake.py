"""Drake: a discrete MultibodyPlant, advanced by its Simulator with one step per call.

Its discrete update is of first order: TAMSI, which is faster, or SAP if a ball constraint closes a loop.
"""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    MultibodyForces,
    PrismaticJoint,
    PrismaticSpring,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from benchmarks.plan import GROUND, Array, Body, Plan

VERSION = version("drake")
METHODS = {"discrete": "discrete"}


class Drake:
    """A plan as a MultibodyPlant in a Simulator."""

    def __init__(self, plan: Plan, step: float, method: str) -> None:
        self._plan, self._plant, self._step = plan, _plant(plan, step), step
        self._simulator = Simulator(self._plant)
        self._context = self._simulator.get_mutable_context()
        self._taken = 0
        self.reset(plan.q, plan.u)

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""
        self._context.SetTime(0.0)
        self._taken = 0
        self._plant.SetPositionsAndVelocities(self._context, np.concatenate([q, u]))
        self._simulator.Initialize()

    def each(self, steps: int) -> None:
        """Take single steps, one call each."""
        advance, step, taken = self._simulator.AdvanceTo, self._step, self._taken
        for index in range(taken + 1, taken + steps + 1):
            advance(index * step)
        self._taken += steps

    def many(self, steps: int) -> None:
        """Take the steps in one call."""
        self._taken += steps
        self._simulator.AdvanceTo(self._taken * self._step)

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds."""
        return self._plant.GetPositions(self._context), self._plant.GetVelocities(self._context)

    def accelerations(self, q: Array, u: Array) -> Array:
        """From the mass matrix and the bias term; those of a loop belong to its solver."""
        if self._plan.pins:
            raise NotImplementedError
        plant, context = self._plant, self._plant.CreateDefaultContext()
        plant.SetPositionsAndVelocities(context, np.concatenate([q, u]))
        forces = plant.CalcGeneralizedForces(context, _forces(plant, context))
        return np.linalg.solve(plant.CalcMassMatrix(context), forces - plant.CalcBiasTerm(context))


def _forces(plant: MultibodyPlant, context: Context) -> MultibodyForces:
    forces = MultibodyForces(plant=plant)
    plant.CalcForceElementsContribution(context, forces)
    return forces


def _plant(plan: Plan, step: float) -> MultibodyPlant:
    plant = MultibodyPlant(step)
    plant.mutable_gravity_field().set_gravity_vector(plan.gravity)
    approximation = DiscreteContactApproximation.kSap if plan.pins else DiscreteContactApproximation.kTamsi
    plant.set_discrete_contact_approximation(approximation)
    bodies: dict[int, RigidBody] = {GROUND: plant.world_body()}
    for index, body in enumerate(plan.bodies):
        at_origin = body.definite_inertia() + body.mass * (
            body.center @ body.center * np.eye(3) - np.outer(body.center, body.center)
        )
        unit = at_origin / body.mass
        moments = UnitInertia(*np.diag(unit), unit[0, 1], unit[0, 2], unit[1, 2])
        inertia = SpatialInertia(body.mass, body.center, moments, skip_validity_check=True)
        bodies[index] = added = plant.AddRigidBody(body.name, inertia)
        kind = PrismaticJoint if body.slides else RevoluteJoint
        joint = plant.AddJoint(kind(
            body.name,
            _frame(plant, bodies[body.parent], body),
            added.body_frame(),
            np.array([0.0, 0.0, 1.0]),
            damping=body.damping,
        ))  # fmt: skip
        if body.stiffness:
            spring = PrismaticSpring if body.slides else RevoluteSpring
            plant.AddForceElement(spring(joint, body.rest, body.stiffness))
    for pin in plan.pins:
        plant.AddBallConstraint(bodies[pin.first], pin.first_point, bodies[pin.second], pin.second_point)
    plant.Finalize()
    return plant


def _frame(plant: MultibodyPlant, carrier: RigidBody, body: Body) -> FixedOffsetFrame:
    pose = RigidTransform(RotationMatrix(body.rotation), body.position)
    return plant.AddFrame(FixedOffsetFrame(f"{body.name}_joint", carrier.body_frame(), pose))
