"""Explicit Runge–Kutta methods as data (Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*)."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.integrators.dop853 import A as DOP853_A
from mbd_sim.integrators.dop853 import B as DOP853_B
from mbd_sim.integrators.dop853 import C as DOP853_C

Row = tuple[float, ...]


@dataclass(frozen=True)
class Tableau:
    """y + h Σ b_i k_i with k_i = f(t + c_i h, y + h Σ_{j<i} a_ij k_j); `a` holds the rows below the diagonal."""

    name: str
    order: int
    a: tuple[Row, ...]
    b: Row
    c: Row

    @property
    def stages(self) -> int:
        """Evaluations of the accelerations a step."""
        return len(self.b)


METHODS: dict[str, Tableau] = {
    method.name: method
    for method in (
        Tableau("euler", 1, ((),), (1.0,), (0.0,)),
        Tableau("midpoint", 2, ((), (0.5,)), (0.0, 1.0), (0.0, 0.5)),
        Tableau(
            "rk4",
            4,
            ((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
            (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0),
            (0.0, 0.5, 0.5, 1.0),
        ),
        Tableau("dop853", 8, DOP853_A, DOP853_B, DOP853_C),
    )
}
