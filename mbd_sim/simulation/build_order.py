"""What a model is built from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from mbd_sim import dynamics, simulation
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.live_values import LiveParameters
from mbd_sim.simulation.prepared_model import store_prepared

if TYPE_CHECKING:
    from mbd_sim.dynamics.equations import Equations
    from mbd_sim.dynamics.symbolic_parameters import SymbolicParameters


class BuildOrder(NamedTuple):
    """The arguments of `build_model`, with the name of the method, which may be `auto`, and the step in s."""

    mechanism: Mechanism
    method: str
    loaded: tuple[str, ...]
    values: SymbolicParameters | LiveParameters | None
    step: float

    def trace(self) -> Equations:
        """Derive the equations."""
        symbols = self.values.symbolic if isinstance(self.values, LiveParameters) else self.values
        return dynamics.derive(self.mechanism, self.loaded, symbols, self.step)

    def store(self, key: str) -> None:
        """Build the model, and store it in the cache under a key."""
        built = simulation.build(self.mechanism, self.method, self.trace, self.step)
        store_prepared(key, built.prepared, built.kernel)
