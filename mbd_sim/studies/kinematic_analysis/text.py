"""A prescribed motion as readable text, and as columns of numbers.

The text names dead points, limit positions, transmission angles and loads, and ends with a short table. The columns
have units in their names, like those of a recorded run; they can be chosen by name, and their magnitudes limited.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.mechanism.values.names import split_assignment
from mbd_sim.studies.kinematic_analysis.curve import shown, value_shown
from mbd_sim.studies.kinematic_analysis.extremes import limit_positions, transmission_extremes
from mbd_sim.studies.kinematic_analysis.loads import CouplerAndFollower, DriveLoads, TransmissionAngle
from mbd_sim.studies.kinematic_analysis.modes import AssemblyModes
from mbd_sim.studies.kinematic_analysis.motion import DrivenMotion
from mbd_sim.studies.kinematic_analysis.system import coordinate_columns, is_rotation

QUANTITIES = ("position", "velocity", "acceleration")


def motion_columns(
    motion: DrivenMotion,
    points: Sequence[str] = (),
    pins: Sequence[CouplerAndFollower] = (),
    loads: DriveLoads | None = None,
) -> dict[str, Array]:
    """The columns (n,): coordinates such as `crank.velocity_rad_s`, points such as `coupler.tip.x_m`, and the rest.

    `advantage.rocker` is the mechanical advantage of an undriven coordinate, in SI units of its effort over those of
    the drive's. nan where a number is undefined, as velocities are at dead points.
    """
    system, found = motion.system, dict[str, Array]({"time_s": motion.time})
    plain = [*motion.system.drives, *motion.outputs]
    for name in sorted(plain, key=lambda name: motion.names.index(name) if name in motion.names else len(plain)):
        unit, quantities = "rad" if motion.is_rotation(name) else "m", motion.coordinate(name)
        for quantity, suffix, numbers in zip(QUANTITIES, ("", "_s", "_s2"), quantities, strict=True):
            found[f"{name}.{quantity}_{unit}{suffix}"] = numbers
    for name, place in zip(motion.names, motion.columns, strict=True):
        if place < 0:
            found[f"{name}.velocity_rad_s"] = motion.u[:, motion.index(name)]
            found[f"{name}.acceleration_rad_s2"] = motion.u_rates[:, motion.index(name)]
    for name in points:
        point = motion.point(name)
        for prefix, values, unit in (
            ("", point.position, "m"),
            ("v", point.velocity, "m_s"),
            ("a", point.acceleration, "m_s2"),
        ):
            found |= {f"{name}.{prefix}{axis}_{unit}": values[:, index] for index, axis in enumerate("xyz")}
    for joints in pins:
        angle = TransmissionAngle(system, joints)
        found[f"transmission.{joints.pin}_rad"] = np.array([angle(q) for q in motion.q])
    for name in motion.outputs:
        found[f"advantage.{name}"] = motion.advantage(name)
    return found if loads is None else found | _load_columns(motion, loads)


def grounded_outputs(motion: DrivenMotion) -> list[str]:
    """The outputs of joints with ground; all outputs if there are none."""
    joints = motion.mechanism.all_joints.values()
    on_ground = [joint for joint in joints if GROUND in (joint.parent, joint.child)]
    grounded = {name for joint in on_ground for name in (joint.name, *joint.motion_names)}
    return [name for name in motion.outputs if name in grounded] or list(motion.outputs)


def drive_at(motion: DrivenMotion, value: float | np.floating) -> str:
    """Where the first moving drive is, in rad or m, for people: `crank = 30 deg`."""
    return f"{motion.drive_name} = {shown(motion.mechanism, motion.drive_name, float(value))}"


def _load_columns(motion: DrivenMotion, loads: DriveLoads) -> dict[str, Array]:
    found = {}
    for name, effort in loads.efforts.items():
        found[f"{name}.effort_{'Nm' if is_rotation(motion.mechanism, name) else 'N'}"] = effort
    for name, reaction in loads.reactions.items():
        found[f"reaction.{name}.force_N"] = np.linalg.norm(reaction.force, axis=1)
        for quantity, values, unit in (("force", reaction.force, "N"), ("moment", reaction.moment, "Nm")):
            for index, axis in enumerate("xyz"):
                found[f"reaction.{name}.{quantity}_{axis}_{unit}"] = values[:, index]
    return {**found, "power_W": loads.power}


HEAD = 20  # width of the first column
LINES = 13  # of the table, and more only for singular points
WIDTH = 14  # of its columns
TABLE_ROUND_OFF = 1e-12  # of a number, relative to those from which it is computed
JUMP = 0.25  # change from one position to the next, relative to the range of the values, that is remarked


def motion_text(
    motion: DrivenMotion,
    points: Sequence[str],
    pins: Sequence[CouplerAndFollower],
    loads: DriveLoads | None,
    further: Iterable[str] = (),
    columns: Mapping[str, Array] | None = None,
) -> str:
    """The report on a motion, with `further` lines. Angles are in degrees, everything else in SI units.

    :param columns: those of the table, in the units of their names; by default positions, points and efforts.
    """
    lines = [*_head(motion), *_singular(motion), *_limits(motion)]
    for joints in pins:
        least, most = transmission_extremes(motion, joints)
        ends = (f"{np.degrees(one.value):.6g} deg at {drive_at(motion, one.drive)}" for one in (least, most))
        lines.append(row("Transmission angle", f"{joints.pin}: from {' to '.join(ends)}"))
    lines += [row("Advantage", f"{name}: {_advantage(motion, name)}") for name in grounded_outputs(motion)]
    if loads is not None:
        lines += _loads(motion, loads)
    return "\n".join([*lines, *further, "", *_table(motion, columns or _usual_columns(motion, points, loads))])


def modes_text(modes: AssemblyModes) -> str:
    """The assembly modes, one a line, and how they were found."""
    mechanism = modes.mechanism
    given = ", ".join(f"{name} = {shown(mechanism, name, value)}" for name, value in modes.drives.items())
    found = f"{len(modes)} at {given}, found from {modes.starts} starts, each at least {min(modes.found)} times"
    lines = [row("Assembly modes", found)]
    for number, q in enumerate(modes.q, 1):
        positions = zip(mechanism.coordinate_names, coordinate_columns(mechanism), strict=True)
        values = [f"{name} = {shown(mechanism, name, float(q[column]))}" for name, column in positions if column >= 0]
        lines.append(row(f"  {number}", ", ".join(values)))
    if modes.chance_of_another:
        lines.append(row("", f"there may be more: another start finds one with {modes.chance_of_another:.2g}"))
    return "\n".join(lines)


def row(head: str, text: str) -> str:
    """A line of a report, with its heading."""
    return f"{head:<{HEAD}}{text}".rstrip()


def _head(motion: DrivenMotion) -> Iterator[str]:
    for index, name in enumerate(motion.system.drives):
        start, stop = motion.line.start[index], motion.line.stop[index]
        text = f"{name} from {shown(motion.mechanism, name, start)} to {shown(motion.mechanism, name, stop)}"
        if start == stop:
            text = f"{name} held at {shown(motion.mechanism, name, start)}"
        elif index == motion.leading:
            unit = "rad/s" if is_rotation(motion.mechanism, name) else "m/s"
            text += f", {len(motion)} positions, at {motion.speed:.6g} {unit}"
        yield row("Drive" if index == 0 else "", text)


def _singular(motion: DrivenMotion) -> Iterator[str]:
    for kind, title in (("dead point", "Dead points"), ("change point", "Change points")):
        places = [
            ", ".join(f"{name} = {shown(motion.mechanism, name, value)}" for name, value in one.drives.items())
            for one in motion.singular
            if one.kind == kind
        ]
        yield row(title, "; ".join(places) or "none")


def _limits(motion: DrivenMotion) -> Iterator[str]:
    for name in grounded_outputs(motion):
        found = [
            f"{'greatest' if one.greatest else 'least'} {value_shown(one.value, rotation=motion.is_rotation(name))} at "
            f"{drive_at(motion, one.drive)}"
            for one in limit_positions(motion, name)
        ]
        if found:
            yield row("Limit positions", f"{name}: {'; '.join(found)}")


def _advantage(motion: DrivenMotion, name: str) -> str:
    values = np.abs(motion.advantage(name))
    if not np.any(np.isfinite(values)):
        return "infinite: it stands still"
    index = int(np.nanargmin(values))
    one, other = (motion.is_rotation(key) for key in (name, motion.drive_name))
    unit = "" if one == other else " N·m/N" if one else " N/(N·m)"
    return f"at least {values[index]:.6g}{unit}, at {drive_at(motion, motion.drive[index])}"


def _loads(motion: DrivenMotion, loads: DriveLoads) -> Iterator[str]:
    def peak(values: Array, unit: str) -> str:
        index = int(np.nanargmax(np.abs(values)))
        return f"{values[index]:.6g} {unit} at {drive_at(motion, motion.drive[index])}, of {len(motion)} positions"

    for name, effort in loads.efforts.items():
        unit = "N·m" if is_rotation(motion.mechanism, name) else "N"
        yield row("Largest effort", f"{name}: {peak(effort, unit)}")
        yield from _jumps(motion, effort, unit)
    for name, reaction in loads.reactions.items():
        yield row("Largest force", f"{name}: {peak(np.linalg.norm(reaction.force, axis=1), 'N')}")


def _jumps(motion: DrivenMotion, values: Array, unit: str) -> Iterator[str]:
    """A remark where a value changes so much between two positions that its largest value is uncertain."""
    changes = np.abs(np.diff(values))
    span = np.nanmax(values) - np.nanmin(values)
    if not np.any(changes > JUMP * span):
        return
    index = int(np.nanargmax(changes))
    second = shown(motion.mechanism, motion.drive_name, float(motion.drive[index + 1]))
    yield row(
        "",
        f"it changes by {changes[index]:.6g} {unit} between {drive_at(motion, motion.drive[index])} and {second}, "
        f"so that the largest may be missed: take more positions than {len(motion)}, unless it jumps there",
    )


def _usual_columns(motion: DrivenMotion, points: Sequence[str], loads: DriveLoads | None) -> dict[str, Array]:
    columns = {}
    for name in (*motion.system.drives, *motion.outputs):
        angle = motion.is_rotation(name)
        columns[f"{name} ({'deg' if angle else 'm'})"] = motion.coordinate(name)[0] * (180.0 / np.pi if angle else 1.0)
    for name in points:
        position = motion.point(name).position
        columns |= {f"{name} {axis} (m)": position[:, index] for index, axis in enumerate("xyz")
                    if np.ptp(position[:, index]) > TABLE_ROUND_OFF * motion.system.constraints.size}  # fmt: skip
    if loads is not None:
        for name, effort in loads.efforts.items():
            columns[f"{name} ({'N·m' if is_rotation(motion.mechanism, name) else 'N'})"] = effort
    return columns


def _table(motion: DrivenMotion, columns: Mapping[str, Array]) -> Iterator[str]:
    """Some rows: evenly spaced ones, and all dead and change points."""
    rows = {int(place) for place in np.linspace(0, len(motion) - 1, min(LINES, len(motion))).round()}
    marks = {one.row: one.kind for one in motion.singular}
    widths = [max(len(name), WIDTH) for name in columns]
    cleaned = [_without_round_off(motion, name, values) for name, values in columns.items()]
    yield "  ".join(name.rjust(width) for name, width in zip(columns, widths, strict=True))
    for row in sorted(rows | marks.keys()):
        numbers = [f"{values[row]:.6g}" for values in cleaned]
        text = "  ".join(number.rjust(width) for number, width in zip(numbers, widths, strict=True))
        yield f"{text}  {marks.get(row, '')}".rstrip()


def _without_round_off(motion: DrivenMotion, name: str, values: Array) -> Array:
    """A column with 0 in place of round-off: of a full turn, of the size of the mechanism, or of its largest number."""
    unit = {"(deg)": 360.0, "(m)": motion.system.constraints.size}.get(name.rpartition(" ")[2], 0.0)
    scale = max(unit, float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values))))
    return np.where(np.abs(values) <= TABLE_ROUND_OFF * scale, 0.0, values)


def chosen_columns(columns: Mapping[str, Array], patterns: Sequence[str]) -> dict[str, Array]:
    """The columns whose names match patterns, such as `reaction.*.force_N`, in the order of the patterns.

    :raises InputError: none matches a pattern; a similar one is suggested.
    """
    found: dict[str, Array] = {}
    for pattern in patterns:
        names = [name for name in columns if fnmatchcase(name, pattern)]
        if not names:
            remedy = nearest(pattern, list(columns)) or "Write a name or a pattern such as 'reaction.*.force_N'."
            raise InputError(f"no column is called '{pattern}'", remedy)
        found |= {name: columns[name] for name in names}
    return found


def column_limit(text: str) -> tuple[str, float]:
    """The name or pattern, and the limit of the magnitude, of `NAME=VALUE`.

    :raises InputError: the text cannot be read, or the limit is not a positive number.
    """
    name, value = split_assignment(text)
    try:
        limit = float(value)
    except ValueError:
        limit = 0.0
    if not name or not 0.0 < limit < np.inf:
        message = f"'{text}' gives no limit"
        raise InputError(
            message, "Write the name of a column and a positive number in its unit: reaction.pin.force_N=500."
        )
    return name, limit


def exceeded_limits(
    motion: DrivenMotion, columns: Mapping[str, Array], limits: Sequence[tuple[str, float]]
) -> tuple[list[str], bool]:
    """A line for each column with a limit, and whether one is exceeded; numbers that are undefined do not count.

    :raises InputError: there is no such column.
    """
    lines, exceeded = [], False
    for pattern, limit in limits:
        for name, values in chosen_columns(columns, [pattern]).items():
            sizes = np.abs(np.nan_to_num(values, nan=0.0))
            index, beyond = int(np.argmax(sizes)), int(np.sum(sizes > limit))
            verdict = f"exceeded in {beyond} of {len(motion)} positions" if beyond else "kept"
            largest = f"{values[index]:.6g} at {drive_at(motion, motion.drive[index])}"
            lines.append(row("Limit", f"{name}: at most {limit:.6g}, {verdict}: {largest}"))
            exceeded = exceeded or beyond > 0
    return lines, exceeded
