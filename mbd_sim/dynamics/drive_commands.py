"""The commands of drives among the inputs: after those of actuators, in the order of the file."""

from __future__ import annotations

import casadi as ca

from mbd_sim.dynamics.commanded_drives import FASTEST
from mbd_sim.dynamics.coordinate_layout import CoordinateLayout
from mbd_sim.dynamics.input_layout import InputLayout
from mbd_sim.errors import MechanismError
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.channels import default_command
from mbd_sim.mechanism.drives import CommandedDrive, commanded_drives
from mbd_sim.mechanism.records import Mechanism

RESOLVED = 0.5  # largest product of the step and the fastest rate of a drive


def drive_command_slices(mechanism: Mechanism, first: int) -> dict[str, slice]:
    """The commands of each drive, by the name of its joint, from the index `first` on."""
    found = {}
    for name, drive in commanded_drives(mechanism).items():
        found[name] = slice(first, first + len(drive.channels))
        first = found[name].stop
    return found


def drive_command_count(mechanism: Mechanism) -> int:
    """The number of commands of all drives."""
    return sum(len(drive.channels) for drive in commanded_drives(mechanism).values())


def hold_drives(
    mechanism: Mechanism, layout: CoordinateLayout, input_layout: InputLayout, y: Array | ca.SX, inputs: Array | ca.SX
) -> None:
    """Set the commands of all drives in place to those before the first command: the positions in y, without speed."""
    drives: dict[str, CommandedDrive] = dict(commanded_drives(mechanism))
    first = input_layout.commands.stop - drive_command_count(mechanism)
    for name, span in drive_command_slices(mechanism, first).items():
        position = y[layout.drives[name].start]
        for index, channel in enumerate(drives[name].channels, span.start):
            inputs[index] = default_command(channel, position)


def require_resolved(mechanism: Mechanism, step: float) -> None:
    """Refuse drives that are too fast for steps of `step` in s.

    :raises MechanismError: their joints are named.
    """
    problems = []
    for name, drive in commanded_drives(mechanism).items():
        if (longest := RESOLVED / (FASTEST * drive.bandwidth)) < step:
            message = f"a bandwidth of {drive.bandwidth:g} rad/s is too high for steps of {step:g} s"
            remedy = f"Give at most {RESOLVED / (FASTEST * step):g} rad/s, or use steps of at most {longest:g} s."
            problems.append(mechanism.source.problem(("joints", name, "drive", "bandwidth"), message, remedy))
    if problems:
        raise MechanismError(problems)
