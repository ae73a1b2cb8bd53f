"""Parameters from measured states, with exact gradients and confidence intervals.

The measurements are cut into intervals. For each one the trajectory follows from a start state of its own, which is
unknown too, so that noise in it does no harm. Parameters and start states minimize the sum of the squared deviations
(output error method; Ljung 1999, sec. 10.2), weighted by the standard deviation of each component of the state, which
is estimated from the residuals of a first fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from mbd_sim.errors import InputError, MbdSimError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.optimization.casadi_functions import CasadiFunctions, casadi_functions
from mbd_sim.optimization.trajectories import DEFAULT, trajectory
from mbd_sim.packages import require_packages

FITS = 2  # with the weights of the data, then with those of the residuals
SINGULAR = 1e-12  # of the information matrix, relative


@dataclass(frozen=True, eq=False)
class MeasuredRun:
    """States (n + 1, nx), q and then u, measured every `step` s from `start` on; `efforts` (n, nv) between them."""

    step: float
    states: Array
    efforts: Array
    start: float = 0.0


@dataclass(frozen=True)
class ParameterEstimate:
    """The `value` of a parameter, its standard `error`, and its confidence interval from `lower` to `upper`."""

    value: float
    error: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Identification:
    """The `estimates` by key, their `covariance` (np, np), and the standard deviations `noise` (nx,) of residuals."""

    estimates: Mapping[str, ParameterEstimate]
    covariance: Array
    noise: Array


def identify(
    mechanism: Mechanism,
    data: MeasuredRun | Sequence[MeasuredRun],
    parameters: Mapping[str, float] | Sequence[str],
    *,
    interval: int = 100,
    confidence: float = 0.95,
    method: str = DEFAULT,
) -> Identification:
    """Identify parameters of a mechanism from measured runs.

    :param parameters: keys of its file with first guesses; by default those are the values in the file.
    :param interval: steps after which the trajectory starts anew.
    :param confidence: the probability that a confidence interval contains the true value, for independent normal noise.
    :param method: an explicit method, see `one_step`.
    :raises MissingPackageError: SciPy is not installed.
    :raises MechanismError: see `casadi_functions`.
    :raises InputError: the measurements do not fit the mechanism.
    :raises MbdSimError: the mechanism has constraints or quaternions, or the measurements do not determine the
        parameters.
    """
    require_packages("scipy", purpose="Identifying parameters")
    from scipy.stats import t as student  # type: ignore[import-untyped]

    functions = casadi_functions(mechanism, list(parameters))
    runs = [data] if isinstance(data, MeasuredRun) else list(data)
    _require_fitting(functions, runs, interval)
    pieces = [piece for run in runs for piece in _pieces(functions, run, interval, method)]
    guess = np.array(list(parameters.values())) if isinstance(parameters, Mapping) else functions.values
    values, covariance, noise, freedom = _fitted(pieces, guess)
    errors, reach = np.sqrt(np.diag(covariance)), float(student.ppf(0.5 + confidence / 2.0, freedom))
    estimates = {
        key: ParameterEstimate(float(value), float(error), float(value - reach * error), float(value + reach * error))
        for key, value, error in zip(functions.parameters, values, errors, strict=True)
    }
    return Identification(estimates, covariance, noise)


def _fitted(pieces: Sequence[_Piece], guess: Array) -> tuple[Array, Array, Array, int]:
    """The parameters, their covariance, the noise of each component, and the degrees of freedom of the residuals."""
    from scipy.optimize import least_squares  # type: ignore[import-untyped]

    unknown = np.concatenate([guess, *(piece.states[:, 0] for piece in pieces)])
    spread = np.std(np.hstack([piece.states for piece in pieces]), axis=1)
    weights = noise = np.where(spread > 0.0, spread, 1.0)
    smallest = 1e-12 * weights
    tolerances = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-14)
    for _ in range(FITS):
        problem = _Problem(pieces, len(guess), weights)
        found = least_squares(problem.residuals, unknown, problem.jacobian, x_scale="jac", **tolerances)
        unknown, freedom = found.x, max(found.fun.size - len(found.x), 1)
        left = found.fun.reshape(-1, len(weights)) * weights
        noise = np.sqrt(np.sum(left**2, axis=0) * len(weights) / freedom)
        weights = np.maximum(noise, smallest)
    information = _Problem(pieces, len(guess), weights).jacobian(unknown)
    return unknown[: len(guess)], _covariance(information, len(guess)), noise, freedom


@dataclass(frozen=True, eq=False)
class _Piece:
    """Measured `states` (nx, n + 1) of an interval, and the trajectory with its derivatives by x0 and p."""

    start: float
    states: Array
    efforts: Array
    function: ca.Function
    derivatives: ca.Function


def _pieces(functions: CasadiFunctions, run: MeasuredRun, interval: int, method: str) -> list[_Piece]:
    """The intervals of a run, which share functions."""
    found: dict[int, tuple[ca.Function, ca.Function]] = {}
    pieces = []
    for first in range(0, len(run.efforts), interval):
        steps = min(interval, len(run.efforts) - first)
        if steps not in found:
            function = trajectory(functions, steps, run.step, method)
            found[steps] = function, _derivatives(function)
        states, efforts = run.states[first : first + steps + 1].T, run.efforts[first : first + steps].T
        pieces.append(_Piece(run.start + first * run.step, states, efforts, *found[steps]))
    return pieces


def _derivatives(function: ca.Function) -> ca.Function:
    """(t0, x0, e, p) -> the derivatives of all states by the parameters and by the start state, side by side."""
    t0, x0, e, p = function.mx_in()
    both = ca.MX.sym("both", p.shape[0] + x0.shape[0])
    states = function.call([t0, both[p.shape[0] :], e, both[: p.shape[0]]])[0]
    by_both = ca.Function("by_both", [t0, both, e], [ca.jacobian(ca.vec(states), both)])
    return ca.Function("derivatives", [t0, x0, e, p], by_both.call([t0, ca.vertcat(p, x0), e]))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Weighted residuals of parameters (np,) and the start states of all pieces (nx,) each."""

    pieces: Sequence[_Piece]
    parameters: int
    weights: Array

    def residuals(self, unknown: Array) -> Array:
        """The deviations of all states, one after the other."""
        p, starts = self._split(unknown)
        found = [
            (np.array(piece.function(piece.start, start, piece.efforts, p)) - piece.states) / self.weights[:, None]
            for piece, start in zip(self.pieces, starts, strict=True)
        ]
        return np.concatenate([part.T.ravel() for part in found])

    def jacobian(self, unknown: Array) -> Array:
        """Their derivatives."""
        p, starts = self._split(unknown)
        rows = []
        for index, (piece, start) in enumerate(zip(self.pieces, starts, strict=True)):
            by_both = np.array(piece.derivatives(piece.start, start, piece.efforts, p))
            by_both /= np.tile(self.weights, piece.states.shape[1])[:, None]
            block = np.zeros((len(by_both), len(unknown)))
            block[:, : self.parameters] = by_both[:, : self.parameters]
            first = self.parameters + index * len(self.weights)
            block[:, first : first + len(self.weights)] = by_both[:, self.parameters :]
            rows.append(block)
        return np.vstack(rows)

    def _split(self, unknown: Array) -> tuple[Array, Array]:
        return unknown[: self.parameters], unknown[self.parameters :].reshape(len(self.pieces), -1)


def _covariance(jacobian: Array, count: int) -> Array:
    """The covariance of the first `count` unknowns, for residuals with the variance one.

    :raises MbdSimError: the information matrix is singular.
    """
    sizes = np.linalg.norm(jacobian, axis=0)
    if np.any(sizes == 0.0):
        raise MbdSimError("The measurements do not depend on one of the parameters. Leave it out.")
    scaled = jacobian / sizes
    values = np.linalg.svd(scaled, compute_uv=False)
    if values[-1] ** 2 <= SINGULAR * values[0] ** 2:
        raise MbdSimError(
            "The measurements do not determine the parameters: some change together without changing the motion. "
            "Leave one of them out, or measure a motion with known efforts."
        )
    inverse = np.linalg.inv(scaled.T @ scaled)[:count, :count]
    return np.asarray(inverse / np.outer(sizes[:count], sizes[:count]))


def _require_fitting(functions: CasadiFunctions, runs: Sequence[MeasuredRun], interval: int) -> None:
    nx, nv = len(functions.start), len(functions.coordinates)
    if functions.G.size1_out(0) or nx != 2 * nv:
        raise MbdSimError(
            f"{functions.mechanism.name}: parameters of mechanisms with constraints, spherical or free joints cannot "
            "be identified from states."
        )
    if not functions.parameters or not runs or interval < 1:
        raise InputError("there is nothing to identify", "Give parameters, measured runs, and a positive interval.")
    for run in runs:
        if run.states.shape != (len(run.efforts) + 1, nx) or run.efforts.shape[1:] != (nv,):
            wanted = f"states of the shape (n + 1, {nx}) and efforts of the shape (n, {nv})"
            raise InputError(
                f"measured are states {run.states.shape} and efforts {run.efforts.shape}", f"Give {wanted}."
            )
