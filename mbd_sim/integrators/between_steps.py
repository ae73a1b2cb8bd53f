"""What changes in a state at the start of a step, as data: delayed commands move on, and sampled controllers act."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mbd_sim.base.short_repr import short_repr

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, eq=False)
class Sampler:
    """`function(t, y, inputs)` gives the new values of some `components` of y, at every n-th step."""

    every: int
    function: ca.Function
    components: tuple[int, ...]


@dataclass(frozen=True)
class DelayLine:
    """An input waits in the components of y from `first` on for `length` steps, until it is moved to `into`.

    `source` is its index among the inputs.
    """

    source: int
    into: int
    first: int
    length: int


@dataclass(frozen=True)
class BetweenSteps:
    """The `delays`, which move on first, and the `samplers`, which follow. They change components that are `held`.

    These have the rate zero. No rate depends on the components `unread`: energies, and commands that wait.

    Step k of a run samples a function if k is a multiple of its number of steps. So everything follows from k and the
    state before step k.
    """

    delays: tuple[DelayLine, ...]
    samplers: tuple[Sampler, ...]
    held: frozenset[int] = frozenset()
    unread: frozenset[int] = frozenset()

    __repr__ = short_repr
