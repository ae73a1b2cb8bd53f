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
    from mbd_sim.simulation.model_builder import BuiltModel


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

    def build(self, *, quick: bool = False) -> BuiltModel:
        """Build the model: see `simulation.build`.

        Where it is likely to be long, the processes that compile are started before CasADi and the equations are
        imported, so that they are ready when the first functions have been traced.
        """
        from mbd_sim.compiler.concurrent_build import compile_processes, is_likely_long

        with compile_processes(0 if quick else None) as processes:
            if is_likely_long(len(self.mechanism.all_joints)):
                processes.start()
            return simulation.build(self.mechanism, self.method, self.trace, self.step, processes, quick=quick)

    def store(self, key: str) -> None:
        """Build the model, and store it in the cache under a key."""
        built = self.build()
        store_prepared(key, built.prepared, built.kernel)
