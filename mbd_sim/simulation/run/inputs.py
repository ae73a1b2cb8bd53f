"""The inputs of a run that act from the next step on: efforts, wrenches and commands of actuators and drives.

`Simulation.apply_live` writes live values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.kernel.memory import KernelMemory
from mbd_sim.simulation.model.commands import CommandMap, EffortMap, Efforts, WrenchMap
from mbd_sim.simulation.model.model import Model
from mbd_sim.simulation.run.arguments import ReadOnlyView
from mbd_sim.simulation.run.events import (
    AppliedCommands,
    AppliedEfforts,
    AppliedWrench,
    EventKind,
    RunReports,
)

EffortWriter = Callable[[Efforts], None]


class RunInputs:
    """Writes the inputs of a kernel, and reports what changes them; `efforts`, `commands` and `values` are views."""

    def __init__(
        self, model: Model, mechanism: Mechanism, memory: KernelMemory, effort_map: EffortMap, reports: RunReports
    ) -> None:
        layout = model.input_layout
        self.all = memory.inputs
        self.efforts, self.commands, self.values = (
            memory.inputs[place] for place in (layout.efforts, layout.commands, layout.values)
        )
        self.wrench_map = WrenchMap(mechanism, layout)
        self.command_map = CommandMap(mechanism.commanded, layout)
        self.effort_map, self._reports, self._reserved = effort_map, reports, memory.reserved

    def effort_writer(self, fallback: EffortWriter, signature: str) -> EffortWriter:
        """Compiled code that does without a listener what `set_efforts` does, and calls `fallback` if it cannot."""
        return effort_writer(self.efforts, self.effort_map, self._reserved, fallback, signature)

    def set_efforts(self, efforts: Efforts) -> None:
        """See `Simulation.set_efforts`."""
        new = self.effort_map.clamped(self.effort_map.merged(self.efforts, efforts))
        self._reports.replace(self.efforts, new, AppliedEfforts(new))

    def expire_efforts(self, names: Sequence[str]) -> None:
        """See `Simulation.expire_efforts`."""
        new = self.effort_map.merged(self.efforts, dict.fromkeys(names, 0.0))
        self._reports.replace(self.efforts, new, AppliedEfforts(new, tuple(names)), EventKind.EXPIRED)

    def set_wrench(self, part: str, numbers: Array, kind: EventKind = EventKind.COMMAND) -> None:
        """Apply the inputs (15,) of a wrench: see `WrenchMap.numbers`."""
        self._reports.replace(self.all[self.wrench_map.slices[part]], numbers, AppliedWrench(part, numbers), kind)

    def set_commands(self, values: Array) -> None:
        """Command all channels (n,), in the order of `command_map.names`."""
        self._reports.replace(self.commands, values, AppliedCommands(values.copy()))


def effort_writer(
    target: Array, efforts: EffortMap, reserved: NDArray[np.int64], fallback: EffortWriter, signature: str
) -> EffortWriter:
    """Compiled code that writes efforts (nv,) within their limits to a target, and calls `fallback` if it cannot.

    :param reserved: (1,); where this is not 0, it always calls `fallback`.
    :param signature: for error messages.
    """
    from mbd_sim.compiler.python.bounded_write import bounded_writer

    return bounded_writer(target, efforts.limits, reserved, fallback, signature, ReadOnlyView)
