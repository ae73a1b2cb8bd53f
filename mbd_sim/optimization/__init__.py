"""Functions for optimizers: the equations and trajectories of a mechanism as CasADi functions; identification."""

from __future__ import annotations

from mbd_sim.optimization.casadi_functions import CasadiFunctions, casadi_functions
from mbd_sim.optimization.identification import Identification, ParameterEstimate, identify
from mbd_sim.optimization.measured_runs import MeasuredRun
from mbd_sim.optimization.sensitivities import SensitivityModel, sensitivities
from mbd_sim.optimization.sensitivity_records import Derivatives, Sensitivities
from mbd_sim.optimization.trajectories import one_step, trajectory

__all__ = [
    "CasadiFunctions",
    "Derivatives",
    "Identification",
    "MeasuredRun",
    "ParameterEstimate",
    "Sensitivities",
    "SensitivityModel",
    "casadi_functions",
    "identify",
    "one_step",
    "sensitivities",
    "trajectory",
]
