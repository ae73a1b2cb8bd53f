"""What the inputs of a linear system can be: efforts, commands, forces, and the motion of drives and of ground."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mbd_sim.analysis.linear.small_motion import SmallMotion
from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.kinematics.drives import time_driven
from mbd_sim.dynamics.layouts.vectors import InputLayout
from mbd_sim.dynamics.math.expressions import evaluated
from mbd_sim.mechanism.contents import commanded_drives
from mbd_sim.mechanism.elements.joint_types import STATES, CommandedDrive
from mbd_sim.mechanism.mechanism import Mechanism

AXES = ("x", "y", "z")
COMMAND_UNITS = {
    "voltage": "V",
    "current": "A",
    "effort": "N or N·m",
    "position": "m or rad",
    "velocity": "m/s or rad/s",
}


@dataclass(frozen=True, eq=False)
class LinearInput:
    """An input: a unit of it changes the inputs of the equations, by their index, by `changes`.

    A force also has the `place` (3,) of its point in its `part`. Those of `drive` are the states r and v of the
    coordinate whose acceleration is the input: the indices in the inputs, or in the states of commanded drives where
    `is_commanded`. The input `filtered` is a command of the drive of this joint.
    """

    name: str
    unit: str
    changes: Mapping[int, float] = field(default_factory=dict)
    part: str = ""
    place: Array | None = None
    drive: tuple[int, int, int] | None = None
    is_commanded: bool = False
    filtered: str = ""


def possible_inputs(mechanism: Mechanism, layout: InputLayout) -> dict[str, LinearInput]:
    """All inputs of a mechanism by name, in a fixed order.

    :param layout: with disturbances; the changes of forces are left out for parts without a wrench there.
    """
    found = [
        *_efforts(mechanism),
        *_commands(mechanism, layout),
        *_drives(mechanism, layout),
        *_forces(mechanism, layout),
    ]
    found += [
        LinearInput(f"base.{axis}", "m/s²", {layout.disturbances.stop - 3 + row: 1.0}) for row, axis in enumerate(AXES)
    ]
    return {one.name: one for one in found}


def _efforts(mechanism: Mechanism) -> Iterator[LinearInput]:
    index = 0
    for joint in mechanism.joints.values():
        for name, coordinate in zip(joint.coordinate_names, joint.kind.coordinates, strict=False):
            yield LinearInput(f"efforts.{name}", coordinate.effort_unit, {index: 1.0})
            index += 1


def _commands(mechanism: Mechanism, layout: InputLayout) -> Iterator[LinearInput]:
    index = layout.commands.start
    for taker in mechanism.commanded:
        for channel in taker.channels:
            drive = taker.name if isinstance(taker, CommandedDrive) else ""
            yield LinearInput(
                f"commands.{taker.name}.{channel}", COMMAND_UNITS.get(channel, ""), {index: 1.0}, filtered=drive
            )
            index += 1


def _drives(mechanism: Mechanism, layout: InputLayout) -> Iterator[LinearInput]:
    by_time = dict(zip(time_driven(mechanism), layout.drive_disturbances, strict=True))
    by_command = {name: STATES * number for number, name in enumerate(commanded_drives(mechanism))}
    for name, joint in mechanism.joints.items():
        for own, coordinate in zip(joint.motion_names if joint.drive else (), joint.kind.coordinates, strict=False):
            unit = f"{coordinate.unit}/s²"
            if own in by_time:
                yield LinearInput(f"drives.{own}", unit, drive=by_time[own])
            else:
                first = by_command[name]
                yield LinearInput(f"drives.{own}", unit, drive=(first, first + 1, first + 2), is_commanded=True)


def _forces(mechanism: Mechanism, layout: InputLayout) -> Iterator[LinearInput]:
    for part, record in mechanism.parts.items():
        first = layout.forces[part].start if part in layout.forces else None
        for point, pose in (("", None), *record.points.items()):
            place = np.zeros(3) if pose is None else pose.position
            for row, axis in enumerate(AXES):
                changes = {} if first is None else {first + row: 1.0}
                name = f"{part}.{point}" if point else part
                yield LinearInput(f"forces.{name}.{axis}", "N", changes, part, place)
        for row, axis in enumerate(AXES):
            changes = {} if first is None else {first + 3 + row: 1.0}
            yield LinearInput(f"moments.{part}.{axis}", "N·m", changes, part)


@dataclass(frozen=True, eq=False)
class DrivenInputs:
    """How inputs and the states of drives change what is given, see `SmallMotion`.

    `inputs` (given, k) and `states` (given, n) are the changes by each input, and by each of the states `names`.
    `rates` (n, given) times these changes are the rates of these states.
    """

    inputs: Array
    states: Array
    rates: Array
    names: tuple[str, ...]


def driven_inputs(
    equations: Equations, small: SmallMotion, chosen: Sequence[LinearInput], t: float, y: Array, values: Array
) -> DrivenInputs:
    """The changes by chosen inputs, in a state of the equations with its inputs `values`."""
    layout, columns = equations.inputs, equations.derivative_layout
    place_of = {index: place for place, index in enumerate(layout.acting)}
    given, first = columns.size - columns.acting.start, columns.drives.start - columns.acting.start
    inputs, names = np.zeros((given, len(chosen))), list[str]()
    states, rates = list[Array](), list[Array]()
    unit, filters = np.eye(given), small.drive_rates[:, columns.acting.start :]
    done: set[str] = set()
    for column, one in enumerate(chosen):
        for index, change in one.changes.items():
            inputs[place_of[index], column] += change
        if one.place is not None:
            span = layout.forces[one.part]
            force = np.array([one.changes.get(span.start + row, 0.0) for row in range(3)])
            arm = _arm(equations, one, t, y, values)
            inputs[[place_of[span.start + 3 + row] for row in range(3)], column] += np.cross(arm, force)
        if one.drive is not None:
            position, velocity, acceleration = (
                first + place if one.is_commanded else place_of[place] for place in one.drive
            )
            inputs[acceleration, column] = 1.0
            states += [unit[position], unit[velocity]]
            rates += [unit[velocity], unit[acceleration]]
            names += [f"{one.name}.position", f"{one.name}.velocity"]
        if one.filtered and one.filtered not in done:
            done.add(one.filtered)
            own = equations.layout.drives[one.filtered]
            start = own.start - (equations.layout.nq - len(filters))
            states += [unit[first + start + number] for number in range(STATES)]
            rates += [filters[start + number] for number in range(STATES)]
            names += [f"drives.{one.filtered}.{what}" for what in ("position", "velocity", "acceleration")]
    return DrivenInputs(inputs, np.array(states).reshape(-1, given).T, np.array(rates).reshape(-1, given), tuple(names))


def _arm(equations: Equations, one: LinearInput, t: float, y: Array, values: Array) -> Array:
    """The vector (3,) in ground's axes from where the wrench on a part acts to the point of a force."""
    assert one.place is not None
    poses = evaluated(equations.poses, *(t, y, values)[: equations.poses.n_in()]).ravel()
    number = equations.part_names.index(one.part)
    rotation = poses[12 * number + 3 : 12 * number + 12].reshape(3, 3, order="F")
    return np.asarray(rotation @ (one.place - values[equations.inputs.wrenches[one.part]][-3:]))
