"""The load of a joint in a recorded run, for the sizing of its drive."""

from __future__ import annotations

import numpy as np

from mbd_sim.base.errors import InputError, listed, nearest
from mbd_sim.recordings.views.table import RunTable
from mbd_sim.studies.sizing.cycle import LoadCycle


def run_cycle(table: RunTable, name: str | None = None) -> LoadCycle:
    """What a joint did in a run: its speed, and the effort of its drive, its actuator or its commands.

    :param name: of the coordinate; by default the only one that has an effort.
    :raises InputError: there is no such coordinate, or the run does not contain its speed and its effort, or it was
        reset; a part of the run can be taken by `LoadCycle.between`.
    """
    with_effort = [one for index, one in enumerate(table.names) if np.any(np.nan_to_num(table.effort[:, index]))]
    if name is None:
        if len(with_effort) != 1:
            what = (
                "no joint has an effort in this run" if not with_effort else "several joints have efforts in this run"
            )
            raise InputError(what, f"Name one with --joint: {listed(with_effort or list(table.names))}.")
        name = with_effort[0]
    if name not in table.names:
        raise InputError(f"there is no coordinate '{name}' in this run", nearest(name, table.names))
    if any(row > 0 for row in table.resets):
        times = [f"{table.times[row]:g}" for row in table.resets]
        raise InputError(
            f"the run was reset at {listed(times)} s, so that its times repeat", "Record a run without resets."
        )
    index = table.names.index(name)
    speed, effort = table.velocity[:, index], table.effort[:, index]
    if np.any(np.isnan(speed)) or np.any(np.isnan(effort)):
        raise InputError(f"this run does not contain the speed and the effort of '{name}' at all times", "Record both.")
    kept = np.append(True, np.diff(table.times) > 0.0)
    return LoadCycle.of_arrays(
        table.times[kept],
        speed[kept],
        effort[kept],
        name=name,
        rotation=table.units[index] != "m",
        position=table.position[kept, index],
    )
