"""A trajectory with its derivatives by parameters, start values and efforts, as plain records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mbd_sim.geometry.pose import Array
from mbd_sim.short_repr import short_repr


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of a quantity of k numbers at n times, in SI units.

    - `by_parameters` (n, k, np).
    - `by_start` (n, k, nx): by the start state (q, u, states of actuators), before it is moved onto constraints.
    - `by_efforts` (n, k, m, ne): by the efforts, and commands of actuators, of each of m intervals.

    What was not asked for is None.
    """

    by_parameters: Array
    by_start: Array | None
    by_efforts: Array | None

    __repr__ = short_repr

    def of(self, numbers: slice, times: slice = slice(None)) -> Derivatives:
        """The derivatives of some of the numbers, at some of the times, as views."""
        start, efforts = (
            None if found is None else found[times, numbers] for found in (self.by_start, self.by_efforts)
        )
        return Derivatives(self.by_parameters[times, numbers], start, efforts)


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """A trajectory with its derivatives.

    `t` (n,) are the times in s, and `x` (n, nx) the states (q, u, states of actuators), of which `q` (n, nq) and `u`
    (n, nv) are views. `dx`, `dq` and `du` are their derivatives. `points` are the positions (n, 3) of points in m, in
    ground's axes, with their derivatives, by name. `parameters` are the names of the parameters.
    """

    parameters: tuple[str, ...]
    t: Array
    x: Array
    dx: Derivatives
    points: Mapping[str, tuple[Array, Derivatives]]
    _nq: int = field(repr=False)
    _nv: int = field(repr=False)

    __repr__ = short_repr

    def at(self, times: slice) -> Sensitivities:
        """Views of the results at some of the times."""
        points = {name: (place[times], own.of(slice(None), times)) for name, (place, own) in self.points.items()}
        dx = self.dx.of(slice(None), times)
        return Sensitivities(self.parameters, self.t[times], self.x[times], dx, points, self._nq, self._nv)

    @property
    def q(self) -> Array:
        """The coordinates (n, nq)."""
        return self.x[:, : self._nq]

    @property
    def u(self) -> Array:
        """The speeds (n, nv)."""
        return self.x[:, self._nq : self._nq + self._nv]

    @property
    def dq(self) -> Derivatives:
        """The derivatives of q."""
        return self.dx.of(slice(0, self._nq))

    @property
    def du(self) -> Derivatives:
        """The derivatives of u."""
        return self.dx.of(slice(self._nq, self._nq + self._nv))
