"""Parameters from measured runs by nonlinear least squares, with exact gradients and confidence intervals.

The measurements are cut into intervals. For each one the trajectory follows from a start state of its own, which is
unknown too, so that noise in it does no harm. It varies along the directions that constraints and unit quaternions
leave free. Parameters and start states minimize the sum of the squared deviations (output error method; Ljung 1999,
sec. 10.2), weighted by the standard deviation of each measured number, which is estimated from the residuals of a first
fit.

So a few unknowns, the parameters, are shared, and each interval has further ones. The Levenberg-Marquardt method
(Nocedal & Wright, *Numerical Optimization*, sec. 10.3) eliminates those of each interval from its linearized residuals
by a singular value decomposition.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.errors import DivergedError, InputError, MbdSimError, MechanismError, listed, quoted
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.base.short_repr import record, short_repr
from mbd_sim.files.checks.override import values_of, with_values
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.studies.optimization.measured_runs import MeasuredRun, Residuals, measured_runs
from mbd_sim.studies.optimization.sensitivities import SensitivityModel

ITERATIONS = 200
FIRST_DAMPING, LEAST_DAMPING, LARGEST_DAMPING = 1e-4, 1e-12, 1e8
CONVERGED = (
    1e-14  # decrease of the sum that the linearized problem predicts, relative to the sum, or change of unknowns
)
ROUNDING = 1e-10  # the same where a step does not decrease the sum, because of round-off in it
DEPENDENT = 1e-10  # relative size of singular values that count as zero

TINY = 1e-300


@dataclass(frozen=True, slots=True)
class LinearizedResiduals:
    """Residuals (k,), and their derivatives by the shared (k, m) and by the own unknowns (k, d)."""

    residuals: Array
    by_shared: Array
    by_own: Array


@dataclass(frozen=True, slots=True)
class Step:
    """Changes of the shared unknowns (m,) and those of each part, and the sum of squares that is predicted."""

    shared: Array
    own: list[Array]
    predicted: float


@dataclass(frozen=True, slots=True)
class Eliminated:
    """Residuals and derivatives by the shared unknowns that the own ones of a part cannot change, and their `rank`."""

    residuals: Array
    by_shared: Array
    pseudo_inverse: Array
    rank: int


def fit(
    linearize: Callable[[Array, Sequence[Array] | None], Sequence[LinearizedResiduals] | None],
    commit: Callable[[], None],
    shared: Array,
) -> tuple[Array, Sequence[LinearizedResiduals]]:
    """The shared unknowns that minimize the sum of squares, and the residuals there.

    :param linearize: evaluates shared unknowns and changes of the own ones from where they were committed last; None
        where there is no solution.
    :param commit: makes the own unknowns that were evaluated last the present ones.
    :raises MbdSimError: the first guess has no solution, or the search does not converge.
    """
    present = linearize(shared, None)
    if present is None:
        raise InputError("there is no trajectory with the first guesses", "Use better ones.")
    commit()
    damping = FIRST_DAMPING
    for _ in range(ITERATIONS):
        cost = _cost(present)
        step = solve(present, damping)
        if damping <= 1.0 and (cost - step.predicted <= CONVERGED * cost or _change(step, shared) <= CONVERGED):
            return shared, present
        tried = linearize(shared + step.shared, step.own)
        if tried is not None and _cost(tried) <= cost:
            commit()
            shared, present, damping = shared + step.shared, tried, max(0.1 * damping, LEAST_DAMPING)
            continue
        if damping <= 1.0 and cost - step.predicted <= ROUNDING * cost:
            return shared, present
        if damping > LARGEST_DAMPING:
            if _change(solve(present, 0.0), shared) <= ROUNDING:
                return shared, present
            break
        damping *= 10.0
    raise MbdSimError("the search for the parameters did not converge", "Use better guesses, or shorter intervals.")


def solve(parts: Sequence[LinearizedResiduals], damping: float) -> Step:
    """The step that minimizes the linearized residuals, with changes penalized by the damping and their columns."""
    sizes = column_sizes(parts)
    eliminated = [_eliminated(part, damping) for part in parts]
    penalty = np.sqrt(damping) * np.diag(sizes)
    matrix = np.vstack([*(one.by_shared for one in eliminated), penalty])
    right = np.concatenate([*(one.residuals for one in eliminated), np.zeros(len(sizes))])
    scaled = np.linalg.lstsq(matrix / sizes, -right, rcond=None)[0]
    shared = scaled / sizes
    own = [
        one.pseudo_inverse @ -(part.residuals + part.by_shared @ shared)
        for one, part in zip(eliminated, parts, strict=True)
    ]
    left = right + matrix @ shared
    return Step(shared, own, float(left @ left))


def eliminated_parts(parts: Sequence[LinearizedResiduals]) -> list[Eliminated]:
    """What the own unknowns of each part cannot change."""
    return [_eliminated(part, 0.0) for part in parts]


def column_sizes(parts: Sequence[LinearizedResiduals]) -> Array:
    """The norm (m,) of the derivatives by each shared unknown, 1 where they are zero."""
    norms = np.linalg.norm(np.vstack([part.by_shared for part in parts]), axis=0)
    return np.where(norms > 0.0, norms, 1.0)


def _eliminated(part: LinearizedResiduals, damping: float) -> Eliminated:
    rows = len(part.residuals)
    norms = np.linalg.norm(part.by_own, axis=0)
    sizes = np.where(norms > 0.0, norms, 1.0)
    count = len(sizes)
    own = np.vstack([part.by_own / sizes, np.sqrt(damping) * np.eye(count)])
    shared = np.vstack([part.by_shared, np.zeros((count, part.by_shared.shape[1]))])
    residuals = np.concatenate([part.residuals, np.zeros(count)])
    u, s, v = np.linalg.svd(own, full_matrices=False)
    kept = s > DEPENDENT * np.max(s, initial=0.0)
    u, inverse = u[:, kept], (v[kept].T / s[kept]) @ u[:rows, kept].T / sizes[:, None]
    return Eliminated(residuals - u @ (u.T @ residuals), shared - u @ (u.T @ shared), inverse, int(kept.sum()))


def _cost(parts: Sequence[LinearizedResiduals]) -> float:
    return float(sum(part.residuals @ part.residuals for part in parts))


def _change(step: Step, shared: Array) -> float:
    """The largest relative change of a shared unknown."""
    return float(np.max(np.abs(step.shared) / np.maximum(np.abs(shared), TINY), initial=0.0))


FITS = 2  # with the weights of the data, then with those of the residuals
SINGULAR = 1e-12  # of the information matrix, relative
TOGETHER = 1e-3  # share in the direction that is not determined, relative to the largest, from which one is named
FREE = 0.5  # a singular value of the projection onto constraints is 0, or at least 1


@dataclass(frozen=True)
class ParameterEstimate:
    """The `value` of a parameter, its standard `error`, and its confidence interval from `lower` to `upper`."""

    value: float
    error: float
    lower: float
    upper: float

    __repr__ = short_repr


@record
class Identification:
    """The `estimates` by key, their `covariance` (np, np), and the standard deviation of each measured number.

    `noise` (c,) are the standard deviations of the residuals of the numbers named in `measured` (c,), in SI units. An
    orientation has three: small rotations about the axes of the part.
    """

    estimates: Mapping[str, ParameterEstimate]
    covariance: Array
    noise: Array
    measured: tuple[str, ...]


def identify(
    mechanism: Mechanism,
    data: MeasuredRun | Sequence[MeasuredRun],
    parameters: Mapping[str, float | str] | Sequence[str],
    *,
    interval: int = 100,
    confidence: float = 0.95,
    method: str | None = None,
) -> Identification:
    """Identify parameters of a mechanism from measured runs.

    :param data: runs that all have the same step, and in which the same is measured.
    :param parameters: keys of its file with first guesses, as for `with_values`; by default those are the values in the
        file.
    :param interval: steps after which the trajectory restarts, where states are measured. Runs of which only outputs
        are measured are not divided.
    :param confidence: the probability that a confidence interval contains the true value, for independent normal noise.
    :param method: of integration, by default that of the mechanism; see `SensitivityModel`.
    :raises MissingPackageError: SciPy is not installed.
    :raises MechanismError: see `casadi_functions`; or a first guess cannot be a value of the file.
    :raises InputError: the measurements do not fit the mechanism, or `confidence` is not between 0 and 1.
    :raises MbdSimError: the measurements do not determine the parameters, the search does not converge, or it ends at
        values that the file refuses, such as a negative damping.
    """
    require_packages("scipy", purpose="Identifying parameters")
    from scipy.special import stdtrit

    runs, keys = measured_runs(data), [parameters] if isinstance(parameters, str) else list(parameters)
    if not keys or interval < 1:
        raise InputError("there is nothing to identify", "Give parameters, measured runs, and a positive interval.")
    if not 0.0 < confidence < 1.0:
        raise InputError(
            f"the confidence must be between 0 and 1, not {quoted(confidence)}", "Give a probability, such as 0.95."
        )
    model = SensitivityModel(mechanism, keys, method=method, step=runs[0].step, by_efforts=False)
    residuals = [Residuals(model.functions, run) for run in runs]
    names = residuals[0].names
    if any(other.names != names or other.run.step != model.step for other in residuals):
        raise InputError("the runs differ in their steps, or in what is measured", "Identify from runs of one kind.")
    problem = _Problem(model, residuals, interval)
    first = model.functions.values
    if isinstance(parameters, Mapping):
        given = values_of(with_values(mechanism, parameters), keys)
        first = np.array([given[key] for key in keys], dtype=float)
    values, parts, freedom = problem.solution(np.array(first, dtype=float))
    covariance = _covariance(parts, keys)
    errors, reach = np.sqrt(np.diag(covariance)), float(stdtrit(freedom, 0.5 + confidence / 2.0))
    estimates = {
        key: ParameterEstimate(float(value), float(error), float(value - reach * error), float(value + reach * error))
        for key, value, error in zip(model.functions.parameters, values, errors, strict=True)
    }
    _require_valid(mechanism, estimates)
    return Identification(estimates, covariance, problem.weights, names)


@dataclass(eq=False)
class _Piece:
    """A part of a run between two steps: its present `start` state, and that which was tried last."""

    residuals: Residuals
    first: int
    last: int
    start: Array
    basis: Array
    tried: tuple[Array, Array] | None = None


class _Problem:
    """The pieces of all runs, and the present standard deviations `weights` (c,) of what is measured."""

    def __init__(self, model: SensitivityModel, runs: Sequence[Residuals], interval: int) -> None:
        self._model, self._channels = model, np.zeros(0, dtype=np.intp)
        self.weights = np.max([run.spread for run in runs], axis=0)
        self._pieces = []
        for run in runs:
            for first, last in pairwise(run.starts(interval)):
                start = run.first_guess(first)
                self._pieces.append(_Piece(run, first, last, start, np.zeros((len(start), 0))))

    def solution(self, guess: Array) -> tuple[Array, Sequence[LinearizedResiduals], int]:
        """The parameters, the weighted residuals there, and their degrees of freedom."""
        smallest = 1e-12 * self.weights
        values = guess
        for _ in range(FITS):
            values, parts = fit(self._linearized, self._commit, values)
            freedom = self._reweigh(parts, smallest)
        present = self._linearized(values, None)
        assert present is not None
        return values, present, freedom

    def _reweigh(self, parts: Sequence[LinearizedResiduals], smallest: Array) -> int:
        left = np.concatenate([part.residuals for part in parts]) * self.weights[self._channels]
        ranks = sum(one.rank for one in eliminated_parts(parts))
        freedom = max(int(len(left) - ranks - parts[0].by_shared.shape[1]), 1)
        squares = np.bincount(self._channels, left**2, len(self.weights))
        counts = np.bincount(self._channels, minlength=len(self.weights))
        noise = np.sqrt(squares / np.maximum(counts, 1) * len(left) / freedom)
        self.weights = np.maximum(noise, smallest)
        return freedom

    def _commit(self) -> None:
        for piece in self._pieces:
            assert piece.tried is not None
            piece.start, piece.basis = piece.tried

    def _linearized(self, values: Array, changes: Sequence[Array] | None) -> Sequence[LinearizedResiduals] | None:
        found, channels = [], []
        for index, piece in enumerate(self._pieces):
            start = piece.start if changes is None else piece.start + piece.basis @ changes[index]
            try:
                part, own = self._piece(piece, values, start)
            except (DivergedError, InputError):
                return None
            found.append(part)
            channels.append(own)
        self._channels = np.concatenate(channels)
        return found

    def _piece(self, piece: _Piece, values: Array, start: Array) -> tuple[LinearizedResiduals, NDArray[np.intp]]:
        own = piece.residuals
        rows = own.rows[(own.rows >= piece.first) & (own.rows <= piece.last)]
        if piece.last < own.rows[-1]:
            rows = rows[rows < piece.last]  # the last one belongs to the next piece
        wanted = sorted({0, *(rows - piece.first).tolist()})
        time = own.run.start + piece.first * own.run.step
        schedule = own.schedule(piece.first, piece.last)
        found = self._model.at_steps(wanted, schedule, t0=time, x0=start, parameters=values, points=own.points)
        assert found.dx.by_start is not None
        directions, sizes, _ = np.linalg.svd(found.dx.by_start[0])
        piece.tried = found.x[0].copy(), directions[:, sizes > FREE]
        kept = found if len(wanted) == len(rows) else found.at(slice(1, None))
        residuals, by_shared, by_own, channels = own.of(rows, kept, piece.tried[1])
        weights = self.weights[channels]
        return LinearizedResiduals(
            residuals / weights, by_shared / weights[:, None], by_own / weights[:, None]
        ), channels


def _require_valid(mechanism: Mechanism, estimates: Mapping[str, ParameterEstimate]) -> None:
    """Refuse estimates that cannot be values of the file.

    :raises MbdSimError: with each such estimate.
    """
    try:
        with_values(mechanism, {key: estimate.value for key, estimate in estimates.items()})
    except MechanismError as error:
        found = [f"{key} = {one.value:.6g} (from {one.lower:.6g} to {one.upper:.6g})" for key, one in estimates.items()]
        raise MbdSimError(
            f"The measurements are fitted best by {', '.join(found)}, which the file refuses: {str(error)[:-1]}",
            "Leave out what cannot be determined, with a valid value in the file, or measure longer.",
        ) from error


def _covariance(parts: Sequence[LinearizedResiduals], keys: Sequence[str]) -> Array:
    """The covariance of the parameters of these keys, for residuals with the variance one.

    :raises MbdSimError: the information matrix is singular; those that cannot be told apart are named.
    """
    without_effect = np.all([np.all(part.by_shared == 0.0, axis=0) for part in parts], axis=0)
    if np.any(without_effect):
        names = listed([key for key, none in zip(keys, without_effect, strict=True) if none])
        raise MbdSimError(f"The measurements do not depend on {names}", "Leave this out, or measure another motion.")
    sizes = column_sizes(parts)
    scaled = np.vstack([one.by_shared for one in eliminated_parts(parts)]) / sizes
    missing = max(len(keys) - len(scaled), 0)  # rows, if there are fewer measurements than parameters
    _, values, directions = np.linalg.svd(np.pad(scaled, ((0, missing), (0, 0))), full_matrices=False)
    if values[-1] ** 2 <= SINGULAR * max(values[0] ** 2, 1.0):
        share = np.abs(directions[-1])
        names = listed([key for key, part in zip(keys, share, strict=True) if part > TOGETHER * np.max(share)])
        raise MbdSimError(
            f"The measurements do not determine the parameters: {names} can change together without changing the "
            "motion",
            "Leave one of them out, or measure a motion with known efforts.",
        )
    inverse = np.linalg.inv(scaled.T @ scaled)
    return np.asarray(inverse / np.outer(sizes, sizes))
