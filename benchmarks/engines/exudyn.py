"""Exudyn: a kinematic tree in minimal coordinates, propagated by one call of its solver.

A call of Exudyn's solver has a much larger set-up cost than a step, so it is not driven step by step: times are per
simulated millisecond of one long call. Open chains use its explicit RK44. A loop is closed by a spherical joint, with
the implicit trapezoidal rule of index 2 and a full Newton method: of seven settings it was the fastest, and none was
more accurate.
"""

from __future__ import annotations

from importlib.metadata import version

import exudyn as exu
import numpy as np
from exudyn import itemInterface as items  # noqa: N813

from benchmarks.plan import Array, Plan

VERSION = version("exudyn")
METHODS = {"kinematic tree, one call": "tree"}


class Exudyn:
    """A plan as one kinematic tree."""

    def __init__(self, plan: Plan, step: float, method: str) -> None:
        self._plan, self._step = plan, step
        self._system = exu.SystemContainer()
        self._mbs = self._system.AddSystem()
        self._node = self._mbs.AddNode(
            items.NodeGenericODE2(
                numberOfODE2Coordinates=len(plan.q),
                referenceCoordinates=np.zeros(len(plan.q)),
                initialCoordinates=plan.q,
                initialCoordinates_t=plan.u,
            )
        )
        tree = self._mbs.AddObject(_tree(plan, self._node))
        for pin in plan.pins:
            ends = [(pin.first, pin.first_point), (pin.second, pin.second_point)]
            markers = [
                self._mbs.AddMarker(
                    items.MarkerKinematicTreeRigid(objectNumber=tree, linkNumber=link, localPosition=point)
                )
                for link, point in ends
            ]
            normal = plan.bodies[0].rotation[:, 2]
            axes = [0 if abs(value) > 0.5 else 1 for value in normal]
            self._mbs.AddObject(items.SphericalJoint(markerNumbers=markers, constrainedAxes=axes))
        self._mbs.Assemble()
        self._settings = _settings()
        kinds = exu.DynamicSolverType
        self._solver = kinds.TrapezoidalIndex2 if plan.pins else kinds.RK44
        self.reset(plan.q, plan.u)

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""
        self._q, self._u = q.copy(), u.copy()

    def many(self, steps: int) -> None:
        """Take the steps in one call."""
        data, start = self._mbs.systemData, exu.ConfigurationType.Initial
        data.SetODE2Coordinates(self._q, start)
        data.SetODE2Coordinates_t(self._u, start)
        integration = self._settings.timeIntegration
        integration.startTime, integration.endTime = 0.0, steps * self._step
        integration.numberOfSteps = steps
        if not self._mbs.SolveDynamic(self._settings, solverType=self._solver, showHints=False):
            raise RuntimeError(f"{self._plan.name}: Exudyn's solver failed")
        self._q, self._u = data.GetODE2Coordinates(), data.GetODE2Coordinates_t()

    each = None

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds."""
        return self._q, self._u

    def accelerations(self, q: Array, u: Array) -> Array:
        """From the mass matrix and the right-hand side of its explicit solver, which knows no loops."""
        if self._plan.pins:
            raise NotImplementedError
        data, start = self._mbs.systemData, exu.ConfigurationType.Initial
        data.SetODE2Coordinates(q, start)
        data.SetODE2Coordinates_t(u, start)
        self._settings.timeIntegration.solverType = exu.DynamicSolverType.RK44
        solver = exu.MainSolverExplicit()
        solver.InitializeSolver(self._mbs, self._settings)
        solver.ComputeMassMatrix(self._mbs, 1.0)
        solver.ComputeODE2RHS(self._mbs)
        found = np.linalg.solve(solver.GetSystemMassMatrix(), solver.GetSystemResidual())
        solver.FinalizeSolver(self._mbs, self._settings)
        return found


def _tree(plan: Plan, node: int) -> items.ObjectKinematicTree:
    kinds = {False: exu.JointType.RevoluteZ, True: exu.JointType.PrismaticZ}
    sprung = any(body.stiffness or body.damping for body in plan.bodies)
    control = {}
    if sprung:
        control = {
            "jointPositionOffsetVector": [body.rest for body in plan.bodies],
            "jointPControlVector": [body.stiffness for body in plan.bodies],
            "jointVelocityOffsetVector": [0.0] * len(plan.bodies),
            "jointDControlVector": [body.damping for body in plan.bodies],
        }
    return items.ObjectKinematicTree(
        nodeNumber=node,
        jointTypes=[kinds[body.slides] for body in plan.bodies],
        linkParents=np.array([body.parent for body in plan.bodies]),
        jointTransformations=exu.Matrix3DList([body.rotation for body in plan.bodies]),
        jointOffsets=exu.Vector3DList([body.position for body in plan.bodies]),
        linkInertiasCOM=exu.Matrix3DList([body.inertia for body in plan.bodies]),
        linkCOMs=exu.Vector3DList([body.center for body in plan.bodies]),
        linkMasses=[body.mass for body in plan.bodies],
        baseOffset=[0.0, 0.0, 0.0],
        gravity=list(plan.gravity),
        **control,
    )


def _settings() -> exu.SimulationSettings:
    """Solver settings: no output, dense matrices."""
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.verboseMode = 0
    settings.timeIntegration.explicit.computeEndOfStepAccelerations = False
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.linearSolver.solverType = exu.LinearSolverType.EXUdense
    settings.parallel.numberOfThreads = 1
    return settings
