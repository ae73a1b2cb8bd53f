"""What acts on a simulation from the next step on: efforts, wrenches, commands of actuators, and live values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.actuator_commands import CommandMap
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.efforts import EffortMap
from mbd_sim.simulation.events import AppliedCommands, AppliedEfforts, AppliedWrench
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.read_only import ReadOnlyView
from mbd_sim.simulation.run_reports import RunReports
from mbd_sim.simulation.wrenches import WrenchMap

Efforts = Mapping[str, float] | Sequence[float] | Array  # some by name, or all in order
EffortWriter = Callable[[Efforts], None]


class RunInputs:
    """Writes the inputs of a kernel, and reports what changes them; `efforts`, `commands` and `values` are views."""

    def __init__(self, model: Model, mechanism: Mechanism, memory: KernelMemory, reports: RunReports) -> None:
        layout = model.input_layout
        self.all = memory.inputs
        self.efforts, self.commands, self.values = (
            memory.inputs[place] for place in (layout.efforts, layout.commands, layout.values)
        )
        self.wrench_map = WrenchMap(mechanism, layout)
        self.command_map = CommandMap(mechanism.commanded, layout)
        self.effort_map = EffortMap(model.coordinate_names, mechanism.effort_limits(), model.driven_names)
        self._reports = reports

    def effort_writer(self, fallback: EffortWriter, signature: str) -> EffortWriter:
        """Compiled code that does without a listener what `set_efforts` does, and calls `fallback` if it cannot."""
        return effort_writer(self.efforts, self.effort_map, self._reports.unobserved, fallback, signature)

    def set_efforts(self, efforts: Efforts) -> None:
        """See `Simulation.set_efforts`."""
        new = self.effort_map.clamped(self.effort_map.merged(self.efforts, efforts))
        self._reports.replace(self.efforts, new, AppliedEfforts(new))

    def set_wrench(self, part: str, numbers: Array) -> None:
        """Apply the inputs (15,) of a wrench: see `WrenchMap.numbers`."""
        self._reports.replace(self.all[self.wrench_map.slices[part]], numbers, AppliedWrench(part, numbers))

    def set_commands(self, values: Array) -> None:
        """Command all channels (n,), in the order of `command_map.names`."""
        self._reports.replace(self.commands, values, AppliedCommands(values.copy()))


def effort_writer(
    target: Array, efforts: EffortMap, unobserved: NDArray[np.int64], fallback: EffortWriter, signature: str
) -> EffortWriter:
    """Compiled code that writes efforts (nv,) within their limits to a target, and calls `fallback` if it cannot.

    :param unobserved: (1,) where this is 0, it always calls `fallback`.
    :param signature: for error messages.
    """
    from mbd_sim.compiler.bounded_write import bounded_writer

    return bounded_writer(target, efforts.limits, unobserved, fallback, signature, ReadOnlyView)
