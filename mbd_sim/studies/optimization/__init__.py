"""Functions for optimizers: the equations and trajectories of a mechanism as CasADi functions; identification."""

from __future__ import annotations

from mbd_sim.studies.optimization.casadi_functions import CasadiFunctions, casadi_functions, one_step, trajectory
from mbd_sim.studies.optimization.identification import Identification, ParameterEstimate, identify
from mbd_sim.studies.optimization.measured_runs import MeasuredRun
from mbd_sim.studies.optimization.sensitivities import Derivatives, Sensitivities, SensitivityModel, sensitivities

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
