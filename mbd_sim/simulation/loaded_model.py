"""The loads of the joints and constraints of a compiled mechanism."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism_cache import cached
from mbd_sim.simulation.contacting_model import ContactingModel
from mbd_sim.simulation.state_records import Reaction

if TYPE_CHECKING:
    from mbd_sim.analysis.load_sharing import LoadSharing
    from mbd_sim.compiler.readers import CompiledReaders
    from mbd_sim.simulation.load_path_reader import LoadPathReader

COMPILED = 5_000  # instructions of the multipliers up to which they are compiled, as with `LoadPathReader`


class LoadedModel(ContactingModel):
    """The part of a `Model` that concerns multipliers and reactions."""

    row_names: tuple[str, ...]
    rank: int
    key: str | None  # of the model in the cache

    def multipliers(self, time: float, y: Array, inputs: Array) -> Mapping[str, Array]:
        """The Lagrange multipliers λ of each loop and constraint by name, one for each equation: M u' + h = Q + Gᵀ λ.

        The multiplier of a distance constraint is the force in N that pushes its ends apart. Those of a rolling
        constraint are the normal force and the two components of friction. Redundant equations share the load as
        described in `LoadSharing`.
        """
        given = self.with_contact_forces(time, y, inputs)
        if self.compiles_multipliers:
            values = self._multiplier_reader.read("multipliers", time, y, given)
        else:
            values = self.load_sharing.multipliers(time, y, given)
        return {name: values[rows] for name, rows in self.rows_of.items()}

    @cached_property
    def rows_of(self) -> Mapping[str, NDArray[np.intp]]:
        """The places of the equations of each loop and constraint by name."""
        names = np.array(self.row_names, dtype=str)
        return {name: np.flatnonzero(names == name) for name in dict.fromkeys(self.row_names)}

    @cached_property
    def shares_load(self) -> bool:
        """Whether redundant joints or constraints share the load: see `LoadSharing`."""
        return self.rank < len(self.row_names) and self._known("shares load", lambda: self.load_sharing.can_share)

    @cached_property
    def compiles_multipliers(self) -> bool:
        """Whether multipliers are read by a compiled function: no load is shared, and the function is not long."""
        return not self.shares_load and self._known(
            "compiles multipliers", lambda: self.equations.multipliers.n_instructions() <= COMPILED
        )

    def _known(self, question: str, answer: Callable[[], bool]) -> bool:
        """The answer, which needs the equations, or the same from the cache."""
        return answer() if self.key is None else cached(answer, question, self.key)

    def reactions(self, time: float, y: Array, inputs: Array) -> Mapping[str, Reaction]:
        """The load that each joint transmits: the joints of the spanning tree first, then those that close loops."""
        given = self.with_contact_forces(time, y, inputs)
        if self.shares_load:
            found = self.load_sharing.reactions(time, y, given)
        else:
            found = self._reaction_reader.read("reactions", time, y, given).reshape(-1, 6)
        names = [*self.mechanism.joints, *self.mechanism.closing]
        return {name: Reaction(row[:3], row[3:]) for name, row in zip(names, found, strict=True)}

    @cached_property
    def _reaction_reader(self) -> CompiledReaders:
        from mbd_sim.compiler.readers import CompiledReaders

        return CompiledReaders({"reactions": self.equations.reactions})

    @cached_property
    def _multiplier_reader(self) -> CompiledReaders:
        from mbd_sim.compiler.readers import CompiledReaders

        return CompiledReaders({"multipliers": self.equations.multipliers})

    @cached_property
    def load_sharing(self) -> LoadSharing:
        """How redundant joints and constraints share the load."""
        from mbd_sim.analysis.load_sharing import LoadSharing

        return LoadSharing(self.mechanism, self.equations, self.load_paths)

    @cached_property
    def load_paths(self) -> LoadPathReader:
        """What load sharing reads of the equations."""
        from mbd_sim.simulation.load_path_reader import LoadPathReader

        return LoadPathReader(self.equations)
