"""MuJoCo as an oracle for mechanisms that were read from an MJCF or written as one. Its q and u are ours."""

import numpy as np
import pytest

from mbd_sim.dynamics.equations import derive
from mbd_sim.dynamics.math.expressions import evaluated


def import_mujoco():
    """The module, or the test is skipped. Its warnings would be written to a log file."""
    mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install '.[test]'")
    mujoco.set_mju_user_warning(lambda message: None)
    return mujoco


class MujocoOracle:
    """A model with neither contacts nor limits nor a medium, which mechanisms that are read do not have either."""

    def __init__(self, mujoco, model):
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT
        model.opt.density = model.opt.viscosity = 0.0
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)

    def commands(self, rng):
        """Random commands within their ranges, or within 1."""
        model = self.model
        limited = model.actuator_ctrllimited.astype(bool)
        low, high = (np.where(limited, model.actuator_ctrlrange[:, end], sign) for end, sign in ((0, -1.0), (1, 1.0)))
        return rng.uniform(low, high)

    def accelerations(self, q, u, efforts, commands=()):
        """u' (nv,) without constraints, or with those that are in equilibrium."""
        self.forward(q, u, efforts, commands)
        return self.data.qacc_smooth.copy()

    def constrained(self, q, u, efforts, commands=()):
        """u' (nv,) where equalities hold exactly: M u' - Jᵀ λ = f, J u' + J̇ u = 0.

        MuJoCo's equalities are soft, so that only its M, f and J are used. J̇ u is a central difference of J u along
        the motion, with Richardson's extrapolation.
        """
        mujoco, model, data = self.mujoco, self.model, self.data
        free = self.accelerations(q, u, efforts, commands)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        jacobian = self._jacobian(q, u, 0.0)
        coarse, fine = ((self._jacobian(q, u, h) @ u - self._jacobian(q, u, -h) @ u) / (2.0 * h) for h in (2e-4, 1e-4))
        bias = (4.0 * fine - coarse) / 3.0
        inverse = np.linalg.solve(mass, jacobian.T)
        multipliers = np.linalg.lstsq(jacobian @ inverse, -bias - jacobian @ free, rcond=1e-10)[0]
        return free + inverse @ multipliers

    def _jacobian(self, q, u, time):
        """J (m, nv) of the equalities at the coordinates that constant speeds reach."""
        moved = np.array(q, dtype=float)
        self.mujoco.mj_integratePos(self.model, moved, u, time)
        self.forward(moved, u, np.zeros(len(u)), ())
        return self.data.efc_J.reshape(-1, self.model.nv)[: self.data.ne].copy()

    def forward(self, q, u, efforts, commands):
        data = self.data
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, u, efforts
        data.ctrl[:] = 0.0
        data.ctrl[: len(commands)] = commands
        self.mujoco.mj_forward(self.model, data)


class OwnAccelerations:
    """The accelerations of a mechanism at a state, with commands of its actuators by name."""

    def __init__(self, mechanism):
        self.mechanism, self.equations = mechanism, derive(mechanism)
        self._inputs = self.equations.inputs_without_commands
        self._places = {}
        start = self.equations.inputs.commands.start
        for actuator in mechanism.actuators:
            self._places[actuator.name] = start
            start += len(actuator.channels)

    def __call__(self, q, u, efforts, commands=None):
        layout, inputs = self.equations.layout, self._inputs.copy()
        y = self.equations.start_state.copy()
        y[: layout.nq], y[layout.nq : layout.nq + layout.nv] = q, u
        inputs[self.equations.inputs.efforts] = efforts
        for name, value in (commands or {}).items():
            inputs[self._places[name]] = value
        return evaluated(self.equations.rates, 0.0, y, inputs).ravel()[layout.nq : layout.nq + layout.nv]
