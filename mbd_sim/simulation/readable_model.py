"""What the parts of a `Model` have in common: a mechanism, its equations, and compiled functions that read a state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism

if TYPE_CHECKING:
    from mbd_sim.dynamics.equations import Equations


class ReadableModel(ABC):
    """The base of the parts of a `Model`, which defines the equations and how compiled functions are called."""

    mechanism: Mechanism

    @property
    @abstractmethod
    def equations(self) -> Equations:
        """The equations of motion."""

    @abstractmethod
    def _read(self, name: str, time: float, y: Array, out: Array, inputs: Array | None) -> Array:
        """Call the compiled function of this name at a time in s and a state; returns `out`, filled in place.

        :param inputs: the external inputs, by default those at the start.
        """
