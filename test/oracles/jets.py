"""Jets: values with their first and second time derivatives, by the rules of differentiation."""

from __future__ import annotations

import math

import numpy as np

from mbd_sim.mechanism.values.expression import FUNCTIONS, Arithmetic, evaluate_with


class Jet:
    """A value, or an array of values, with its first and second time derivatives."""

    __array_ufunc__ = None  # numpy leaves operators between arrays and jets to the jets

    def __init__(self, value, first=None, second=None):
        self.d = [np.asarray(value, dtype=float)]
        for derivative in (first, second):
            self.d.append(np.zeros(self.d[0].shape) if derivative is None else np.asarray(derivative, dtype=float))

    def __add__(self, other):
        return Jet(*(a + b for a, b in zip(self.d, jet(other).d, strict=True)))

    __radd__ = __add__

    def __neg__(self):
        return Jet(*(-a for a in self.d))

    def __sub__(self, other):
        return self + -jet(other)

    def __rsub__(self, other):
        return jet(other) - self

    def __matmul__(self, other):
        return self.product(other, np.matmul)

    def __mul__(self, other):
        return self.product(other, np.multiply)

    __rmul__ = __mul__

    def __truediv__(self, other):
        return self * jet(other).through(lambda x: (1.0 / x, -(x**-2.0), 2.0 * x**-3.0))

    def __rtruediv__(self, other):
        return jet(other) / self

    def __getitem__(self, index):
        return self.linear(lambda a: a[index])

    def product(self, other, by):
        (a, a1, a2), (b, b1, b2) = self.d, jet(other).d
        return Jet(by(a, b), by(a1, b) + by(a, b1), by(a2, b) + 2.0 * by(a1, b1) + by(a, b2))

    def linear(self, function):
        return Jet(*(function(a) for a in self.d))

    def through(self, function):
        """Apply a function of one variable that returns its value and its first two derivatives."""
        x, x1, x2 = self.d
        f, slope, bend = function(x)
        return Jet(f, slope * x1, slope * x2 + bend * x1**2)

    def dot(self, other):
        return self.product(other, np.dot)

    def cross(self, other):
        return self.product(other, np.cross)

    @property
    def norm(self):
        return sqrt(self.dot(self))

    @property
    def transposed(self):
        return self.linear(np.transpose)

    @property
    def rate(self):
        """The derivative; its own second derivative is unknown."""
        return Jet(self.d[1], self.d[2], np.full_like(self.d[0], np.nan))


def jet(value):
    return value if isinstance(value, Jet) else Jet(value)


def sqrt(x):
    return jet(x).through(lambda v: (np.sqrt(v), 0.5 / np.sqrt(v), -0.25 * v**-1.5))


def _power(base, exponent):
    if isinstance(exponent, Jet) and any(np.any(d) for d in exponent.d[1:]):
        return _SMOOTH["exp"](exponent * _SMOOTH["log"](jet(base)))
    p = float(jet(exponent).d[0])
    return jet(base).through(
        lambda x: (x**p, p * x ** (p - 1.0) if p else 0.0, p * (p - 1.0) * x ** (p - 2.0) if p not in (0, 1) else 0.0)
    )


def _smooth(function):
    return lambda x: jet(x).through(function)


_SMOOTH = {
    "sqrt": sqrt,
    "exp": _smooth(lambda x: (np.exp(x),) * 3),
    "log": _smooth(lambda x: (np.log(x), 1.0 / x, -1.0 / x**2)),
    "abs": _smooth(lambda x: (np.abs(x), np.sign(x), 0.0)),
    "sin": _smooth(lambda x: (np.sin(x), np.cos(x), -np.sin(x))),
    "cos": _smooth(lambda x: (np.cos(x), -np.sin(x), -np.cos(x))),
    "tan": _smooth(lambda x: (np.tan(x), 1.0 + np.tan(x) ** 2, 2.0 * np.tan(x) * (1.0 + np.tan(x) ** 2))),
    "asin": _smooth(lambda x: (np.arcsin(x), (1.0 - x * x) ** -0.5, x * (1.0 - x * x) ** -1.5)),
    "acos": _smooth(lambda x: (np.arccos(x), -((1.0 - x * x) ** -0.5), -x * (1.0 - x * x) ** -1.5)),
    "atan": _smooth(lambda x: (np.arctan(x), 1.0 / (1.0 + x * x), -2.0 * x / (1.0 + x * x) ** 2)),
    "min": lambda a, b: jet(a) if jet(a).d[0] <= jet(b).d[0] else jet(b),
    "max": lambda a, b: jet(a) if jet(a).d[0] >= jet(b).d[0] else jet(b),
    "hypot": lambda a, b: sqrt(jet(a) * a + jet(b) * b),
}


def _atan2(y, x):
    """The angle of a direction; its derivative is that of atan(y/x) where x is larger, and of -atan(x/y) elsewhere."""
    angle = _SMOOTH["atan"](jet(y) / x if abs(jet(x).d[0]) > abs(jet(y).d[0]) else -(jet(x) / y))
    return Jet(math.atan2(jet(y).d[0], jet(x).d[0]), *angle.d[1:])


_SMOOTH["atan2"] = _atan2
JETS = Arithmetic(
    {name: (FUNCTIONS[name][0], function) for name, function in _SMOOTH.items()},
    power=_power,
    divide=lambda a, b: a / b,
    where=lambda condition, a, b: a(JETS) if condition else b(JETS),
    look_up=lambda table, x: table.at(x),
)


def expression_jet(expression, **names):
    """The value of an expression whose variables are jets."""
    return jet(evaluate_with(expression.text, {**expression.names, **names}, JETS))
