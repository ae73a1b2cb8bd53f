"""What every integration method says of itself: order, cost, what it can treat, and the estimate of its errors.

The package asks a method for these facts, and never for its class. Only `FAMILIES` in `mbd_sim.compiler.kernel` goes by
the class: it has what emits the steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from mbd_sim.base.short_repr import short_repr

Coefficients = tuple[float, ...]
Scales = Sequence[float]  # s of each component of a state y: errors are relative to s + |y|. Without any, they are 1


@dataclass(frozen=True)
class ErrorEstimate:
    """F² / √(F² + w C²) with F = |Σ fine k| and C = |Σ coarse k|, or F alone without `coarse`; w is `weight`.

    |·| is the Euclidean norm over the components of the state, each divided by s + |y| with its scale s. k are h times
    the slopes of a Runge–Kutta method, or the increments of a Rosenbrock method. With F of order hᵖ and C of order hᵠ
    the estimate is of order h²ᵖ⁻ᵠ. It is F if the step is so large that F exceeds C (Hairer, Nørsett & Wanner I, sec.
    II.10, where w = 0.01 for DOP853).
    """

    fine: Coefficients
    coarse: Coefficients = ()
    weight: float = 1.0

    __repr__ = short_repr


@dataclass(frozen=True)
class Method:
    """An integration method by its name, and its order.

    `for_stiff` methods are stable at any rate of a system, `explicit` ones solve no equations. Methods that keep a
    history begin anew after each change of the state between steps. `uses_series` of the rates and `uses_joints`, the
    derivatives of the forces within joints alone, need more of a system than its rates. `stability_limit` is roughly
    the largest h |λ| at which a step is stable, for a damped eigenvalue λ of the system. `time_stepping`: contacts act
    once in each step, and no event is located.
    """

    for_stiff: ClassVar[bool] = False
    explicit: ClassVar[bool] = True
    keeps_history: ClassVar[bool] = False
    uses_series: ClassVar[bool] = False
    uses_joints: ClassVar[bool] = False

    name: str
    order: int
    stability_limit: float = field(kw_only=True)
    time_stepping: bool = field(default=False, kw_only=True)

    __repr__ = short_repr

    @property
    def treats_events(self) -> bool:
        """Whether it, or its `one_step`, can end a step at any time, and the equations change there."""
        return not (self.for_stiff or self.uses_series)

    @property
    def stages(self) -> int:
        """The evaluations of the accelerations in the code of a step."""
        raise NotImplementedError

    @property
    def evaluations(self) -> int:
        """The evaluations of the accelerations that a step usually takes."""
        return self.stages

    @property
    def one_step(self) -> Method:
        """The method that takes a step without any history."""
        return self

    def history_size(self, size: int, inputs_size: int) -> int:
        """The numbers that are kept from step to step, for a state and inputs of these sizes."""
        return 0

    def inputs_in_history(self, size: int) -> int | None:
        """Where in the history, for a state of this size, the inputs are to which it belongs; None without these."""
        return None
