"""Parameters of a mechanism that serve a goal best, and the design as text, as a mechanism file and as a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from mbd_sim.base.errors import InputError, MbdSimError, counted, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.packages import require_packages
from mbd_sim.base.short_repr import record
from mbd_sim.files.checks.override import values_of, with_values
from mbd_sim.files.text.mesh_files import with_meshes_seen_from
from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.mechanism.mechanism import Mechanism, require_mechanism
from mbd_sim.studies.kinematic_analysis.curve import require_reached, sampled, shown, traced_curve
from mbd_sim.studies.kinematic_analysis.drive_line import DriveLine
from mbd_sim.studies.kinematic_analysis.loads import couplers_and_followers, drive_loads
from mbd_sim.studies.kinematic_analysis.motion import driven_motion
from mbd_sim.studies.kinematic_analysis.picture import draw_motion
from mbd_sim.studies.kinematic_analysis.system import KinematicSystem, is_rotation
from mbd_sim.studies.synthesis.conditions import Condition, KeptCondition
from mbd_sim.studies.synthesis.minimizers import least_peak, least_squares
from mbd_sim.studies.synthesis.problem import DesignProblem, EffortGoal, FunctionGoal, Goal, PathGoal

Norm = Literal["rms", "peak"]
MOST_STEPS = 200
SAME = 1e-6  # difference of configurations that are the same, in rad or sizes of the mechanism


@record
class Design:
    """The `values` of the parameters by key, in SI units, their `bounds`, and the `mechanism` with them.

    `deviations` (k,) from the goal are in m, rad, N or N·m; `rms` and `peak` are their root mean square and largest
    size, `start_rms` and `start_peak` those at the start. `drives` (n,) are the positions of the `drive`, and `offset`
    is the constant of a function with a free offset. `converged` is False where the search ended after too many steps.
    Of a global search, `trials` is the number of sets of parameters that were tried before the last `steps`.
    `conditions` are those that were to be kept.
    """

    values: Mapping[str, float]
    bounds: Mapping[str, tuple[float, float]]
    mechanism: Mechanism
    drive: str
    deviations: Array
    start_deviations: Array
    drives: Array
    offset: float
    steps: int
    converged: bool
    trials: int = 0
    conditions: tuple[KeptCondition, ...] = ()

    @property
    def keeps_conditions(self) -> bool:
        """Whether all conditions are met."""
        return all(one.is_met for one in self.conditions)

    @property
    def rms(self) -> float:
        """The root mean square of the deviations."""
        return _rms(self.deviations)

    @property
    def peak(self) -> float:
        """The largest deviation."""
        return float(np.max(np.abs(self.deviations)))

    @property
    def start_rms(self) -> float:
        """The root mean square of the deviations at the start."""
        return _rms(self.start_deviations)

    @property
    def start_peak(self) -> float:
        """The largest deviation at the start."""
        return float(np.max(np.abs(self.start_deviations)))


def synthesize(
    mechanism: Mechanism,
    drive: str,
    goal: Goal,
    variables: Mapping[str, tuple[float, float]],
    *,
    norm: Norm = "rms",
    conditions: Sequence[Condition] = (),
    most_steps: int = MOST_STEPS,
) -> Design:
    """Find parameters between bounds with which a mechanism of one degree of freedom serves a goal best.

    The search starts from the values in the file and ends in an optimum nearby, which need not be the best one of all.
    Derivatives are exact. The mechanism found can move through all positions of the drive without a dead point; its
    start positions are those at the first position of the drive.

    :param variables: the bounds (lower, upper) of each parameter, by key of the file, in SI units.
    :param norm: "rms" minimizes the root mean square of the deviations (SciPy's `least_squares`), "peak" the largest
        one (`least_peak`).
    :param conditions: what the design has to keep besides; whether it does, `Design.keeps_conditions` says.
    :raises MissingPackageError: SciPy is not installed.
    :raises InputError: bounds do not contain the values in the file, or a name in the goal does not exist.
    :raises UnreachableError: the drive does not reach the positions of the goal in the mechanism of the file.
    :raises MechanismError: a key does not exist, or cannot be a parameter of the equations.
    :raises MbdSimError: the optimum cannot move through the positions of the drive.
    """
    problem = design_problem(mechanism, drive, goal, variables, norm, conditions)
    return local_design(problem, variables, drive, norm, most_steps)


def local_design(
    problem: DesignProblem, variables: Mapping[str, tuple[float, float]], drive: str, norm: Norm, most_steps: int
) -> Design:
    """The same for a problem whose equations are traced."""
    start, goal, mechanism = problem.start, problem.goal, problem.mechanism
    bounds = bounds_of_unknowns(variables, start)
    problem.begin(configurations_along(problem.parametric.system, problem.parametric.system.start, goal.drives))
    before = problem.deviations(start)
    if not np.all(np.isfinite(before)):
        raise MbdSimError(f"{mechanism.name}: a position of the goal is at a dead point of the mechanism at the start.")
    first = problem.measured(start)
    x, steps, converged = local_optimum(problem, start, bounds, norm, most_steps)
    return design_of(problem, variables, drive, x, before, steps, converged=converged, measured=first)


def design_problem(
    mechanism: Mechanism,
    drive: str,
    goal: Goal,
    variables: Mapping[str, tuple[float, float]],
    norm: Norm,
    conditions: Sequence[Condition] = (),
) -> DesignProblem:
    """What `synthesize` solves; for its errors, see there."""
    if norm not in get_args(Norm):
        raise InputError(f"there is no norm {norm!r}", f"Valid: {', '.join(get_args(Norm))}.")
    require_packages("scipy", purpose="Synthesis")
    if not variables:
        raise InputError("no parameter may change", "Give bounds for at least one.")
    if conditions and isinstance(goal, PathGoal) and goal.free_timing:
        raise InputError("conditions need the positions of the drive", "Leave out the free timing, or the conditions.")
    return DesignProblem(require_mechanism(mechanism), drive, goal, list(variables), conditions)


def local_optimum(
    problem: DesignProblem, start: Array, bounds: tuple[Array, Array], norm: Norm, most_steps: int
) -> tuple[Array, int, bool]:
    """The unknowns of the optimum near the start, the number of steps, and whether the search converged."""
    conditions: dict[str, Any] = {}
    if problem.conditions:
        equal = np.array([one.relation == "=" for one in problem.conditions])
        conditions = {"excess": problem.excesses, "equal": equal}
    if norm == "peak":
        scales = _scales(start, bounds)
        return least_peak(problem.deviations, problem.jacobian, start, bounds, scales, most_steps, **conditions)
    return least_squares(problem.deviations, problem.jacobian, start, bounds, most_steps, **conditions)


def design_of(
    problem: DesignProblem, variables: Mapping[str, tuple[float, float]], drive: str, x: Array, before: Array,
    steps: int, *, converged: bool, trials: int = 0, measured: Array,
) -> Design:  # fmt: skip
    """The design with unknowns x; `before` are the deviations at the start, and `measured` what conditions measure.

    :raises MbdSimError: the mechanism cannot move through the positions of the drive.
    """
    goal, mechanism = problem.goal, problem.mechanism
    problem.jacobian(x)
    _require_movable(problem, x)
    count = len(variables)
    values = dict(zip(variables, x[:count].tolist(), strict=True))
    return Design(
        values,
        dict(variables),
        _with_start(mechanism, problem, values, x, drive),
        drive,
        problem.deviations(x),
        before,
        problem.drives(x).copy(),
        float(x[count]) if len(x) == count + 1 and not isinstance(goal, PathGoal) else 0.0,
        steps,
        converged,
        trials,
        tuple(
            KeptCondition(one, first, last)
            for one, first, last in zip(
                problem.conditions, measured.tolist(), problem.measured(x).tolist(), strict=True
            )
        ),
    )


def bounds_of_unknowns(
    variables: Mapping[str, tuple[float, float]], start: Array, *, around: bool = True
) -> tuple[Array, Array]:
    """The lower and upper bounds of the unknowns; with `around`, the start must lie between them.

    :raises InputError: it does not.
    """
    lower, upper = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    for index, (key, (low, high)) in enumerate(variables.items()):
        if around and not low < start[index] < high:
            message = f"the value {start[index]:.6g} of {key} is not between its bounds {low:.6g} and {high:.6g}"
            raise InputError(message, "Give wider bounds, another value in the file, or search globally (--global).")
        lower[index], upper[index] = low, high
    return lower, upper


def _scales(start: Array, bounds: tuple[Array, Array]) -> Array:
    widths = bounds[1] - bounds[0]
    return np.where(np.isfinite(widths), np.maximum(np.abs(start), 0.1 * np.minimum(widths, 1e300)), 1.0)


def configurations_along(system: KinematicSystem, q: Array, drives: Array) -> Array:
    """The configurations (n, nq) at positions of the drive, by motion from the configuration q.

    :raises UnreachableError: the drive does not reach them.
    """
    given, found = q[system.q_driven], np.empty((len(drives), len(q)))
    for rows, end in ((drives < given[0], np.min(drives)), (drives > given[0], np.max(drives))):
        if not np.any(rows):
            continue
        line = DriveLine(system, given, np.array([end]))
        curve = traced_curve(line, line.forward(q, 0.0, 1.0), through=False)
        require_reached(system, line, curve)
        places = np.where(drives[rows] == end, 1.0, (drives[rows] - given[0]) / (end - given[0]))
        by_place = {s: one for s, one, _ in sampled(line, curve, np.unique(places))}
        found[rows] = [by_place[s] for s in places.tolist()]
    found[drives == given[0]] = q
    return found


def _require_movable(problem: DesignProblem, x: Array) -> None:
    """Refuse an optimum whose configurations are not those of one motion."""
    drives, found = problem.drives(x), problem.configurations()
    system = problem.parametric.at(np.ascontiguousarray(x[: len(problem.parametric.keys)]))
    try:
        moved = configurations_along(system, found[0], drives)
    except MbdSimError as error:
        raise MbdSimError(_broken(system.mechanism, f"it has a dead point in the range ({error.message})")) from error
    difference = moved - found
    difference[:, system.angles] = np.mod(difference[:, system.angles] + np.pi, 2.0 * np.pi) - np.pi
    if np.max(np.abs(difference) / system.constraints.coordinate_scales) > SAME:
        raise MbdSimError(_broken(system.mechanism, "its positions are on different branches of the motion"))


def _broken(mechanism: Mechanism, why: str) -> str:
    return (
        f"{mechanism.name}: the optimum cannot move through the positions of the drive: {why}. "
        "Give narrower bounds, another start, or more positions."
    )


def _with_start(
    mechanism: Mechanism, problem: DesignProblem, values: Mapping[str, float], x: Array, drive: str
) -> Mechanism:
    """The mechanism with these values and the start positions of the first configuration.

    :raises MbdSimError: its file would be assembled in another mode.
    """
    system, first = problem.parametric.system, problem.configurations()[0]
    changes: dict[str, Any] = dict(values)
    for name, joint in mechanism.joints.items():
        if joint.kind.nv == 1 and not joint.drive:
            changes[f"joints.{name}.position"] = float(first[system.layout.q[name].start])
            if name != drive:
                changes[f"joints.{name}.guess"] = True
    changed = with_values(mechanism, changes)
    again = KinematicSystem(changed, [drive])
    q = configurations_along(again, again.start, problem.drives(x)[:1])[0]
    difference = q - first
    difference[again.angles] = np.mod(difference[again.angles] + np.pi, 2.0 * np.pi) - np.pi
    if np.max(np.abs(difference) / again.constraints.coordinate_scales) > SAME:
        joints = listed([name for name, joint in mechanism.joints.items() if joint.kind.nv > 1])
        raise InputError(
            f"{mechanism.name}: the file cannot start in the assembly mode of the optimum",
            f"Give start positions of {joints or 'its joints'} that select it.",
        )
    return changed


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


HEAD = 20  # width of the first column
FINER = 8  # times as many positions, at which the effort of an optimum is looked at
UNSEEN = 0.01  # of the largest effort, by which it may be larger there
NEAR = 1e-6  # distance from a bound, relative to the range, at which a value counts as lying on it


def design_text(mechanism: Mechanism, design: Design, goal: Goal, norm: Norm) -> str:
    """The values before and after, and the deviations from the goal."""
    before, unit = values_of(mechanism, list(design.values)), _unit(mechanism, design.drive, goal)
    lines = []
    for key, value in design.values.items():
        low, high = design.bounds[key]
        near = next((f"  at its bound {bound:.6g}" for bound in (low, high) if _is_near(value, bound, high - low)), "")
        lines.append(f"{key:<{HEAD}}{before[key]:.6g} -> {value:.10g}{near}")
    if isinstance(goal, FunctionGoal) and goal.free_offset:
        lines.append(f"{'Offset':<{HEAD}}{design.offset:.10g} {unit}")
    what = "Effort" if isinstance(goal, EffortGoal) else "Deviation"
    for name, start, end in (("rms", design.start_rms, design.rms), ("peak", design.start_peak, design.peak)):
        mark = "  (minimized)" if name == norm else ""
        first = f"{start:.6g} -> " if np.isfinite(start) else ""
        lines.append(f"{f'{what}, {name}':<{HEAD}}{first}{end:.6g} {unit}{mark}")
    if isinstance(goal, EffortGoal):
        lines += _between(design, goal, unit)
    lines += [_condition_line(one) for one in design.conditions]
    ended = "" if design.converged else "; not converged: run again from the values found"
    tried = f"{counted(design.trials, 'trial')}, then " if design.trials else ""
    lines.append(f"{'Search':<{HEAD}}{tried}{counted(design.steps, 'step')}{ended}")
    return "\n".join(lines)


def _condition_line(kept: KeptCondition) -> str:
    """What a condition measures before and after."""
    condition, unit = kept.condition, kept.condition.unit
    first = f"{kept.start:.6g} -> " if np.isfinite(kept.start) else ""
    wanted = f"{condition.relation} {condition.value:.10g} {unit}"
    said = "kept" if kept.is_met else "NOT KEPT: give wider bounds, or vary more"
    return f"{condition.text:<{HEAD - 2}}  {first}{kept.end:.10g} {unit}  ({wanted}: {said})"


def _between(design: Design, goal: EffortGoal, unit: str) -> Iterator[str]:
    """A remark if the effort is larger between the positions of the drive than at them, as where a force sets in."""
    ends = float(np.min(design.drives)), float(np.max(design.drives))
    count = FINER * (len(design.drives) - 1) + 1
    motion = driven_motion(design.mechanism, {design.drive: ends}, count, speed=goal.speed)
    effort = np.abs(drive_loads(motion).efforts[design.drive])
    row = int(np.argmax(effort))
    if effort[row] > (1.0 + UNSEEN) * design.peak:
        place = shown(design.mechanism, design.drive, float(motion.drive[row]))
        yield (
            f"{'':<{HEAD}}between the positions it reaches {effort[row]:.6g} {unit}, at {design.drive} = {place}: this "
            f"may be no optimum. Take more positions than {len(design.drives)}; if a force sets in at once there, let "
            "it grow over several of them."
        )


def write_mechanism(path: Path, design: Design) -> None:
    """Write the mechanism with the values found; comments of the file are not kept.

    :raises MbdSimError: it cannot be written.
    """
    mechanism = with_meshes_seen_from(design.mechanism, path.parent)
    try:
        path.write_text(mechanism_text(mechanism.source), encoding="utf-8")
    except OSError as error:
        raise MbdSimError(f"{path} cannot be written: {error}") from error


def draw_design(path: Path, design: Design, goal: Goal) -> None:
    """Draw the motion of the mechanism found through the positions of the drive.

    :raises MbdSimError: the picture cannot be written.
    """
    ends = float(np.min(design.drives)), float(np.max(design.drives))
    speed = goal.speed if isinstance(goal, EffortGoal) else 1.0
    motion = driven_motion(design.mechanism, {design.drive: ends}, speed=speed)
    points = [goal.point] if isinstance(goal, PathGoal) else []
    targets = goal.positions if isinstance(goal, PathGoal) else None
    loads = drive_loads(motion) if isinstance(goal, EffortGoal) else None
    draw_motion(path, motion, points, couplers_and_followers(motion.mechanism, [design.drive]), loads, targets)


def _is_near(value: float, bound: float, width: float) -> bool:
    return abs(value - bound) <= NEAR * (width if np.isfinite(width) else abs(bound))


def _unit(mechanism: Mechanism, drive: str, goal: Goal) -> str:
    match goal:
        case PathGoal():
            return "m"
        case FunctionGoal(output=output):
            return "rad" if is_rotation(mechanism, output) else "m"
        case EffortGoal():
            return "N·m" if is_rotation(mechanism, drive) else "N"
