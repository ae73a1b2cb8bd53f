"""What a user should know about a model before its first step.

A prescribed motion can jump, in position or in speed. A jump of the speed v of a prescribed coordinate is an impact:
with the impulse Λ = (G M⁻¹ Gᵀ)⁻¹ Δv of the constraint, all other speeds jump as well. A simulation does not compute
this impulse.

Forces of time can act within single steps, where no method sees them. Parts can turn so far within a step, or fly so
fast, that a contact between its ends may be missed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, assert_never

import numpy as np

from mbd_sim.base.errors import listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.files.checks.bare_angles import bare_angle_remarks
from mbd_sim.mechanism.contents import expressions_of_forces
from mbd_sim.mechanism.elements.constraints import (
    Cable,
    Clutch,
    Coupling,
    Distance,
    Flat,
    KnifeEdge,
    Rolling,
    Surface,
    expressions_of,
)
from mbd_sim.mechanism.elements.joint_types import CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.mechanism.values.expression import TIME, TimeExpression
from mbd_sim.simulation.model.contact_pairs import endless_remarks
from mbd_sim.simulation.model.model import Model

if TYPE_CHECKING:
    import casadi as ca

    from mbd_sim.dynamics.contact.passing import PassingFunctions

TURN = 0.5  # rad within a step, up to which the rates of a gap at its ends show whether it closes between them
STILL = 1e-6  # of the natural length, by which a place may move while its part turns


def passing_advice(model: Model, time: float, y: Array, inputs: Array, step: float) -> Iterator[str]:
    """A sentence on the contacts that steps of `step` s may miss in this state, with a step that does not."""
    if (functions := model.passing) is None:
        return
    from mbd_sim.dynamics.math.expressions import evaluated
    from mbd_sim.simulation.run.advice import round_down

    given = inputs[: model.input_layout.values.start]
    turning, second, third, speed = evaluated(functions.motions, time, y, given)
    least = STILL * natural_units(model.mechanism, step).length
    moves = (second > least * turning**2) | (third > least * turning**3)
    if names := _names(functions, turns := moves & (turning * step > TURN)):
        fastest = float(np.max(turning[turns]))
        yield (
            f"parts at {listed(names)} turn by {fastest * step:.3g} rad in a step of {step:g} s, so that contacts "
            f"within it may be missed. Try step {round_down(TURN / fastest):g}."
        )
    sizes = np.array([np.inf if size is None else size for size in functions.sizes])
    if names := _names(functions, passes := speed * step > sizes):
        farthest, shortest = float(np.max(speed[passes])) * step, float(np.min(sizes[passes] / speed[passes]))
        yield (
            f"bodies at {listed(names)} move by up to {farthest:.3g} m in a step of {step:g} s, "
            f"and can pass each other within it, as the contact is compliant. Try step {round_down(0.1 * shortest):g}, "
            "or make the contact rigid."
        )


def _names(functions: PassingFunctions, which: Array) -> list[str]:
    return list(dict.fromkeys(f"'{functions.names[index]}'" for index in np.flatnonzero(which)))


MAY_JUMP = re.compile(r"\b(where|floor|sign|mod|abs|min|max|clip|table)\b|[<>]")
MOST_POINTS = 200_000  # at which an expression is evaluated
MOST_CANDIDATES = 50  # intervals that are searched
BISECTIONS = 60
LEAST = 1e-6  # jump, relative to the range of the quantity, that counts


@dataclass(frozen=True, slots=True)
class Jump:
    """A jump of a `quantity` ("position" or "speed") by an amount at a time in s."""

    quantity: str
    amount: float
    time: float


def jump_remarks(mechanism: Mechanism, end: float) -> Iterator[str]:
    """A sentence on each prescribed motion that jumps between the times 0 and `end` in s."""
    for owner, expression, unit in _prescribed(mechanism):
        found = jumps(expression, mechanism.step, end)
        if not found:
            continue
        first, more = found[0], len(found) - 1
        unit = unit if first.quantity == "position" else f"{unit}/s"
        others = f", and {more} more time{'s' if more > 1 else ''} until t = {found[-1].time:.6g} s" if more else ""
        yield (
            f"{owner} jumps in {first.quantity} by {first.amount:.6g} {unit} at t = {first.time:.6g} s{others}. The "
            "impulse of such an impact is not computed: the speeds of all other coordinates stay, and the energy "
            "residual contains its work. Let the motion change within several steps."
        )


def _prescribed(mechanism: Mechanism) -> Iterator[tuple[str, TimeExpression, str]]:
    """The expressions of time alone that prescribe motions: whose, the expression, and the unit."""
    for name, joint in mechanism.joints.items():
        if not isinstance(joint.drive, CommandedDrive):
            for motion, expression, kind in zip(joint.motion_names, joint.drive, joint.kind.coordinates, strict=False):
                yield f"the drive of '{motion if len(joint.drive) > 1 else name}'", expression, kind.unit
    for constraint in mechanism.constraints:
        match constraint:
            case Distance() | Cable():
                unit = "m"
            case Coupling() | Surface():
                unit = "units"
            case Clutch() | Flat() | Rolling() | KnifeEdge():
                continue
            case _:
                assert_never(constraint)
        for expression in expressions_of(constraint):
            yield f"the constraint '{constraint.name}'", expression, unit


def jumps(expression: TimeExpression, step: float, end: float) -> list[Jump]:
    """The jumps of an expression of time and of its rate between 0 and `end` in s, in order.

    They are sought between points that are a step apart, or more if the time is long: two within a step that cancel
    each other are not found.
    """
    if expression.variables != {TIME} or not MAY_JUMP.search(expression.text):
        return []
    import casadi as ca

    from mbd_sim.dynamics.math.expressions import time_functions

    t = ca.SX.sym("t")
    evaluated = ca.Function("prescribed", [t], list(time_functions([expression], t)))
    times = np.linspace(0.0, end, min(max(round(end / step), 1), MOST_POINTS) + 1)
    position, rate, rate_of_rate = (np.asarray(one).ravel() for one in evaluated(times[None]))
    found: dict[float, Jump] = {}
    for quantity, index, values, slopes in (("speed", 1, rate, rate_of_rate), ("position", 0, position, rate)):
        amounts: dict[float, float] = {}
        for low, high in _candidates(times, values, slopes):
            amount, at = _located(evaluated, index, low, high)
            if abs(amount) > LEAST * np.ptp(values[np.isfinite(values)]):
                at = float(f"{at:.12g}")  # at a kink, the rate may have a value of its own, between two jumps
                amounts[at] = amounts.get(at, 0.0) + amount
        found |= {at: Jump(quantity, amount, at) for at, amount in amounts.items()}
    return [found[time] for time in sorted(found)]


def _candidates(times: Array, values: Array, slopes: Array) -> list[tuple[float, float]]:
    """Intervals in which a quantity changes otherwise than its slopes say, those with the largest difference."""
    with np.errstate(all="ignore"):
        off = np.abs(np.diff(values) - np.diff(times) * (slopes[1:] + slopes[:-1]) / 2.0)
    off = np.where(np.isfinite(off), off, 0.0)
    off[off <= LEAST * float(np.ptp(values[np.isfinite(values)], axis=None))] = 0.0
    rows = np.sort(np.argsort(-off, kind="stable")[:MOST_CANDIDATES])
    return [(float(times[row]), float(times[row + 1])) for row in rows if off[row]]


def _located(function: ca.Function, index: int, low: float, high: float) -> tuple[float, float]:
    """The largest change of a result of a function between two neighboring times of an interval, and its time."""

    def value(time: float) -> float:
        return float(function(time)[index])

    first, last = value(low), value(high)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        between = value(middle)
        if abs(between - first) >= abs(last - between):
            high, last = middle, between
        else:
            low, first = middle, between
    return last - first, low


SAMPLES = 64  # in a step
SEARCHED = 1024  # steps from the start on; later ones are searched near the numbers of the expression
LATEST = 1e9  # steps, to which numbers of an expression may be times
MISSED = 0.01  # of the largest value, that the mean over a step may differ from that of its ends
NUMBER = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def pulse_remarks(mechanism: Mechanism, step: float) -> Iterator[str]:
    """A sentence on each force of time that changes within a step and is the same at its ends, in steps of `step` s."""
    for force in expressions_of_forces(mechanism):
        expression = force.expression
        if expression.variables != {TIME}:
            continue
        if (found := _missed(expression, step)) is not None:
            where = ".".join(map(str, force.location))
            yield (
                f"{where} changes within the step at {found:.6g} s and is back at its end, so that it may not be seen. "
                f"Use a step below {step:g} s that resolves it, or a longer and smaller force."
            )


def _missed(expression: TimeExpression, step: float) -> float | None:
    """The start in s of the first step within which a change is missed; None without one."""
    import casadi as ca

    from mbd_sim.dynamics.math.expressions import function_of

    t = ca.SX.sym("t")
    function = ca.Function("force", [t], [function_of(expression, {TIME: t})])
    named = [*map(float, NUMBER.findall(expression.text)), *expression.names.values()]
    near = [np.floor(time / step) + np.array([-1.0, 0.0, 1.0]) for time in named if SEARCHED < time / step < LATEST]
    starts = np.unique(np.concatenate([np.arange(SEARCHED, dtype=float), *near]))
    times = step * (starts[:, None] + np.arange(SAMPLES + 1) / SAMPLES)
    values = np.array(function(times.reshape(1, -1)), dtype=float).reshape(times.shape)
    largest = float(np.max(np.abs(values)))
    if not 0.0 < largest < np.inf:
        return None
    first, last, mean = values[:, 0], values[:, -1], values[:, :-1].mean(axis=1)
    missed = np.abs(mean - 0.5 * (first + last)) > MISSED * largest
    unseen = np.flatnonzero(missed & (np.abs(last - first) < MISSED * largest))
    return float(times[unseen[0], 0]) if len(unseen) else None


LOOK_AHEAD = 10_000  # steps after the start in which jumps of drives are sought


def remarks(model: Model, time: float, y: Array, inputs: Array, step: float, end: float = 0.0) -> tuple[str, ...]:
    """Sentences on what acts in another way than a reader of the file may expect.

    An unusual method, limits that do not act, undetermined friction, forces shorter than a step, contacts that a
    step may miss, cams without ends, drives that jump, and angles beyond a full turn.

    :param step: in s.
    :param end: the time in s until which jumps of drives are sought, by default that of `LOOK_AHEAD`.
    """
    found = (
        *model.mechanism.source.remarks,
        model.method_remark,
        limits_remark(model.mechanism),
        friction_remark(model),
        sharing_remark(model, time, y, inputs),
        *endless_remarks(model),
        *passing_advice(model, time, y, inputs, step),
        *pulse_remarks(model.mechanism, step),
        *bare_angle_remarks(model.mechanism.source),
        *_jump_remarks(model.mechanism, end or LOOK_AHEAD * step),
    )
    return tuple(remark for remark in found if remark)


def _jump_remarks(mechanism: Mechanism, end: float) -> list[str]:
    if not mechanism.driven_names and not mechanism.constraints:
        return []
    return [*jump_remarks(mechanism, end)]


def friction_remark(model: Model) -> str:
    """Which joints have friction that depends on a force which redundant joints share; empty if there are none."""
    contact = model.one_sided
    if contact is None or not contact.loaded:
        return ""
    undetermined = model.load_sharing.undetermined_forces(0.0, model.start, model.inputs)
    joints = [contact.owners[contact.frictions[index][0][0]][1] for index in contact.loaded]
    shared = [f"'{name}'" for name in joints if name in undetermined]
    if not shared:
        return ""
    return (
        f"friction of {listed(shared)} depends on forces that redundant joints share, and that equilibrium does not "
        "determine. It is computed from one of the possible forces, which depends on the joint that is cut, and not "
        "from those of reactions(). Choose joints without the redundant equations that `mbd_sim check` lists, such as "
        "a spherical joint in place of a revolute one."
    )


def sharing_remark(model: Model, time: float, y: Array, inputs: Array) -> str:
    """Which contacts share a load in a state in a way that equilibrium leaves open: by friction at rest, or without."""
    contact = model.one_sided
    if contact is None:
        return ""
    modes = contact.modes(inputs)
    sliding = set(contact.sliding(modes))
    resting = [
        (rows, contact.names[gap] if gap is not None else contact.row_names[rows[0]])
        for index, (rows, gap) in enumerate(contact.frictions)
        if index not in sliding and index not in contact.loaded and (gap is None or modes[gap])
    ]
    rows = [row for own, _ in resting for row in own]
    closed = [gap for gap in range(contact.layout.gaps) if modes[gap]]
    if max(len(resting), len(closed)) < 2:
        return ""
    from mbd_sim.simulation.contact.complementarity import independent

    matrix = contact.terms(time, y, inputs).matrix
    if len(independent(matrix, rows)) < len(rows):
        what, names, how = "friction at rest of", [name for _, name in resting], ", as far as their limits allow"
    elif len(independent(matrix, closed)) < len(closed):
        what, names, how = "the normal forces of", [contact.names[gap] for gap in closed], ""
    else:
        return ""
    verb = "is" if how else "are"
    return (
        f"{what} {listed([repr(name) for name in names])} {verb} statically indeterminate: the motion is determined, "
        f"but how these share the load is not. They share it as equal elastic supports{how}."
    )


def limits_remark(mechanism: Mechanism) -> str:
    """Which joints have limits that are only passed on to other programs; empty if there are none."""
    idle = [
        f"'{joint.name}'"
        for joint in mechanism.all_joints.values()
        if any(
            limits is not None and limits.stiffness is None and limits.restitution is None for limits in joint.limits
        )
    ]
    if not idle:
        return ""
    remedy = "To make all of them stops: --limits stops; to make some, give limits.stiffness or limits.restitution"
    if mechanism.source.file.endswith(".urdf"):
        remedy += " in a mechanism file with 'urdf:'"
    elif mechanism.source.format:
        remedy += " in the mechanism file that `mbd_sim convert` prints"
    return f"the limits of {listed(idle)} do not act on the motion. {remedy}."
