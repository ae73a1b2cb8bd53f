"""Readings of a simulation from compiled functions that are bound to its memory, each when it is first read."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.kernel_memory import KernelMemory
from mbd_sim.simulation.state_records import Reaction

# Instructions of derivatives up to which they are compiled, within about a second. Larger ones would take some seconds,
# which pay off after ten thousand calls; to compile them then would change the bits of results from call to call.
COMPILED = 15_000


class CompiledReadings:
    """Functions of the present state of a simulation; None where a reading is not compiled."""

    def __init__(self, model: Model, memory: KernelMemory) -> None:
        self._model, self._memory = model, memory
        self._arrays = memory.y, memory.inputs

    @cached_property
    def poses(self) -> Callable[[], dict[str, Pose]]:
        """The pose of each part in ground's frame."""
        memory, names = self._memory, self._model.part_names
        reader = memory.reader("poses", len(names) * 12)
        return reader.bound_records(memory.clock, memory.arguments("poses"), names, Pose, ((3,), (3, 3)))

    @cached_property
    def derivatives(self) -> Callable[[], Array] | None:
        """The derivatives of the equations; None if compiling them would take too long."""
        function = self._model.equations.derivatives
        if function.n_instructions() > COMPILED:
            return None
        return self._model.on_request.derivatives().bound(self._memory.clock, self._arrays, (-1, function.size1_out(0)))

    @cached_property
    def multipliers(self) -> Callable[[], Array] | None:
        """The multipliers of all rows; None with contacts, or if they are not read by a compiled function."""
        model = self._model
        if model.one_sided is not None or not model.compiles_multipliers:
            return None
        return model.on_request.multipliers().bound(self._memory.clock, self._arrays, (len(model.row_names),))

    @cached_property
    def reactions(self) -> Callable[[], dict[str, Reaction]] | None:
        """The loads of the joints; None with contacts, or if they are not compiled."""
        model, clock = self._model, self._memory.clock
        names = (*model.mechanism.joints, *model.mechanism.closing)
        if model.one_sided is not None:
            return None
        if not model.shares_load:
            return model.on_request.reactions().bound_records(clock, self._arrays, names, Reaction, ((3,), (3,)))
        sharing = model.load_sharing
        if (read := model.load_paths.bound(clock, self._arrays)) is None:
            return None
        return lambda: {
            name: Reaction(row[:3], row[3:]) for name, row in zip(names, sharing.shared_reactions(read()), strict=True)
        }
