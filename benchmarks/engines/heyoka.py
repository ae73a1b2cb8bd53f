"""heyoka: Taylor series of adaptive order and step, propagated, not stepped by 1 ms.

heyoka integrates equations, so it receives ours: the recursion of `mbd_sim`, as symbols. It chooses its steps, tens of
milliseconds long, at its default tolerance of 2e-16; times are per simulated millisecond. Loops are not projected.
"""

from __future__ import annotations

import heyoka as hy
import numpy as np

from benchmarks.plan import Array, Plan

VERSION = hy.__version__
METHODS = {"Taylor, own steps": "taylor"}
LARGE = 1000  # operations from which on heyoka's code is not unrolled, which would take many minutes to compile


class Heyoka:
    """A plan's equations as a Taylor integrator."""

    def __init__(self, plan: Plan, step: float, method: str, tolerance: float | None = None) -> None:
        count, self._step = len(plan.q), step
        names = [f"q{index}" for index in range(count)] + [f"u{index}" for index in range(len(plan.u))]
        variables = hy.make_vars(*names)
        rates = [hy.expression(value) if isinstance(value, float) else value for value in plan.tape.run(
            variables, hy.sin, hy.cos
        )]  # fmt: skip
        system = list(zip(variables, rates, strict=True))
        options = {} if tolerance is None else {"tol": tolerance}
        compact = len(plan.tape.steps) >= LARGE
        self._taylor = hy.taylor_adaptive(system, np.concatenate([plan.q, plan.u]), compact_mode=compact, **options)
        self._system = (rates[count:], variables)
        self._count, self._starts = count, True

    def reset(self, q: Array, u: Array) -> None:
        """Start from a state."""
        self._taylor.time = 0.0
        self._taylor.state[:] = np.concatenate([q, u])
        self._starts = True

    def many(self, steps: int) -> None:
        """Advance by the duration of a number of steps."""
        until = steps * self._step + self._taylor.time
        if self._starts:
            # At rest in a symmetric pose the last terms of the series vanish, and heyoka would take one infinite step.
            self._taylor.step(min(self._step, until))
            self._starts = False
        self._taylor.propagate_until(until)

    each = None

    def state(self) -> tuple[Array, Array]:
        """Coordinates and speeds."""
        return self._taylor.state[: self._count].copy(), self._taylor.state[self._count :].copy()

    def accelerations(self, q: Array, u: Array) -> Array:
        """The compiled right-hand side."""
        return hy.cfunc(*self._system, compact_mode=True)(np.concatenate([q, u]))
