"""Numbers and arrays that have a value for each of many variants, computed together as one would be.

A `Batch` takes part in the arithmetic of Python and NumPy in place of a number or an array. Each variant gets the bits
that it would get alone: sums, products and roots are rounded in one way only, products of matrices are computed by the
same routine, and every other function is called for each variant. A decision, such as `if length > 0`, follows the
first variant; those for which it would be another one are marked as not `valid`, and so are those for which a function
has no value. What a batch cannot do raises TypeError.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from mbd_sim.base.linear_algebra import products

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])

# Rounded in one way only, so that arrays of any size get the same bits.
_EXACT = {
    np.add, np.subtract, np.multiply, np.true_divide, np.negative, np.absolute, np.sqrt, np.rint, np.sign,
    np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal, np.isfinite,
    np.logical_and, np.logical_or, np.logical_not,
}  # fmt: skip


class Batch(NDArrayOperatorsMixin):
    """A number or an array for each of k variants: `values` (k, …).

    All batches of one computation share `valid` (k,), which says for which variants it is right.
    """

    __slots__ = ("valid", "values")
    __hash__ = None  # type: ignore[assignment]  # equal batches may differ in further digits

    def __init__(self, values: NDArray[Any], valid: NDArray[np.bool_]) -> None:
        self.values, self.valid = values, valid

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the array of one variant; () for a number."""
        return self.values.shape[1:]

    @property
    def T(self) -> Batch:  # noqa: N802  (the name in NumPy)
        """The transposed matrix."""
        return self._with(self.values.swapaxes(-1, -2) if len(self.shape) > 1 else self.values)

    def any(self) -> Batch:
        """Whether any entry is not zero."""
        return self._with(np.any(_rows(self.values), axis=1))

    def uniform(self) -> Any:
        """The number or array itself if it is the same for all variants, otherwise this batch."""
        rows = _rows(self.values)
        if not np.array_equal(rows, np.broadcast_to(rows[:1], rows.shape)):
            return self
        return self.values[0] if self.shape else self.values[0].item()

    def require(self, holds: NDArray[np.bool_]) -> None:
        """Mark the variants for which a condition (k,) does not hold."""
        self.valid &= holds

    def _with(self, values: NDArray[Any]) -> Batch:
        return Batch(values, self.valid)

    def __bool__(self) -> bool:
        if self.shape:
            raise TypeError("an array is neither true nor false")
        decisions = self.values != 0
        self.require(decisions == decisions[0])
        return bool(decisions[0])

    def __float__(self) -> float:
        raise TypeError("a batch is not one number")

    def __format__(self, spec: str) -> str:
        return format(self.values[0], spec)

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a number has no length")
        return self.shape[0]

    def __iter__(self) -> Iterator[Batch]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, key: Any) -> Batch:
        return self._with(self.values[(slice(None), *(key if isinstance(key, tuple) else (key,)))])

    def __pow__(self, exponent: Any) -> Batch:
        # NumPy's powers differ from Python's in the last bit.
        return cast(Batch, _for_each(operator.pow, (self, exponent), self))

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options or not all(isinstance(value, _OPERANDS) for value in inputs):
            return NotImplemented
        if ufunc is np.matmul:
            return self._product(*inputs)
        if ufunc not in _EXACT:
            return _for_each(ufunc, inputs, self)
        dimensions = max(len(_shape(value)) for value in inputs)
        arrays = [_aligned(value, dimensions) for value in inputs]
        with np.errstate(all="ignore"):
            result = ufunc(*arrays)
        if ufunc is np.true_divide:  # of plain numbers, a division by zero raises an exception
            self.require(np.all(_rows(np.broadcast_to(arrays[1] != 0.0, result.shape)), axis=1))
        return self._with(result)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if (own := _FUNCTIONS.get(function)) is not None:
            return own(self, *args, **options)
        return _for_each(functools.partial(function, **options), args, self)

    def _product(self, one: Any, other: Any) -> Batch:
        """The product of matrices and vectors, with the bits of one variant alone."""
        left, right = (value.values if isinstance(value, Batch) else np.asarray(value) for value in (one, other))
        is_row, is_column = len(_shape(one)) == 1, len(_shape(other)) == 1
        result = products(left[..., None, :] if is_row else left, right[..., None] if is_column else right)
        result = result[..., 0] if is_column else result
        if is_row:
            result = result[..., 0] if is_column else result[..., 0, :]
        return self._with(result)


_OPERANDS = (Batch, np.ndarray, float, int, np.generic)


def array(values: Any) -> Any:
    """`np.array(values, dtype=float)` of numbers in nested sequences, or a batch if one of them is a batch."""
    if isinstance(values, Batch):
        return values
    found = _first_batch(values)
    if found is None:
        return np.array(values, dtype=float)
    if isinstance(values, Batch | float | int):
        return values
    entries = [array(entry) for entry in values]
    shape = max((_shape(entry) for entry in entries), key=len)
    size = len(found.values)
    columns = [
        entry.values if isinstance(entry, Batch) else np.broadcast_to(np.asarray(entry, dtype=float), (size, *shape))
        for entry in entries
    ]
    return Batch(np.stack(columns, axis=1), found.valid)


def of_all(value: Any, count: int) -> Array:
    """The values (count, …) of all variants, of a batch or of what is the same for all of them."""
    return value.values if isinstance(value, Batch) else np.broadcast_to(value, (count, *np.shape(value)))


def uniform(value: Any) -> Any:
    """A batch that is the same for all variants without the batch; everything else as it is."""
    return value.uniform() if isinstance(value, Batch) else value


def per_variant(function: Function) -> Function:
    """The function, called for each variant where one of its arguments is a batch, or a sequence with one."""

    @functools.wraps(function)
    def called(*args: Any) -> Any:
        found = _first_batch(args)
        return function(*args) if found is None else _for_each(function, args, found)

    return cast(Function, called)


fsum: Callable[[Sequence[Any]], Any] = per_variant(math.fsum)  # the sum of numbers, rounded once
distance: Callable[[Any, Any], Any] = per_variant(math.dist)  # between two points


def is_finite(value: Any) -> bool:
    """Whether a number is finite; variants for which it is not are marked."""
    if isinstance(value, Batch):
        value.require(np.isfinite(value.values))
        return bool(np.isfinite(value.values[0]))
    return bool(np.isfinite(value))


def _for_each(function: Callable[..., Any], args: Sequence[Any], batch: Batch) -> Any:
    """The results of a function of plain values for all variants; only once if all of these are the same."""
    args = [_uniform_entries(arg) for arg in args]
    if _first_batch(args) is None:
        return function(*args)
    results: list[Any] = []
    for index in range(len(batch.values)):
        try:
            results.append(function(*(_of_variant(arg, index) for arg in args)))
        except (ArithmeticError, ValueError):
            if not results:
                raise
            batch.valid[index] = False
            results.append(results[0])
    if not isinstance(results[0], float | int | np.ndarray | np.generic):
        raise TypeError("the result is not a number")
    return Batch(np.array(results), batch.valid)


def _uniform_entries(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return type(value)(_uniform_entries(entry) for entry in value)
    return uniform(value)


def _of_variant(value: Any, index: int) -> Any:
    if isinstance(value, Batch):
        return value.values[index] if value.shape else value.values[index].item()
    if isinstance(value, list | tuple):
        return type(value)(_of_variant(entry, index) for entry in value)
    return value


def _first_batch(value: Any) -> Batch | None:
    if isinstance(value, Batch):
        return value
    if isinstance(value, list | tuple):
        for entry in value:
            if type(entry) is not float and (found := _first_batch(entry)) is not None:
                return found
    return None


def _shape(value: Any) -> tuple[int, ...]:
    return value.shape if isinstance(value, Batch) else np.shape(value)


def _rows(values: NDArray[Any]) -> NDArray[Any]:
    """The values (k, n) of each variant in one row."""
    return values.reshape(len(values), -1)


def _aligned(value: Any, dimensions: int) -> Any:
    """Values that broadcast with those of a batch of arrays with this number of dimensions."""
    if not isinstance(value, Batch):
        return value
    return value.values.reshape(len(value.values), *[1] * (dimensions - len(value.shape)), *value.shape)


def _where(batch: Batch, condition: Any, one: Any, other: Any) -> Batch:
    dimensions = max(len(_shape(value)) for value in (condition, one, other))
    return Batch(np.where(*(_aligned(value, dimensions) for value in (condition, one, other))), batch.valid)


def _block(batch: Batch, blocks: Sequence[Sequence[Any]]) -> Batch:
    size = len(batch.values)
    wide = [
        [b.values if isinstance(b, Batch) else np.broadcast_to(b, (size, *np.shape(b))) for b in row] for row in blocks
    ]
    return Batch(np.concatenate([np.concatenate(row, axis=2) for row in wide], axis=1), batch.valid)


_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.max: lambda batch, values: Batch(np.max(_rows(values.values), axis=1), batch.valid),
    np.all: lambda batch, values: Batch(np.all(_rows(values.values), axis=1), batch.valid),
    np.any: lambda batch, values: values.any(),
    np.round: lambda batch, values: np.rint(values),
    np.block: _block,
    np.linalg.eigvalsh: lambda batch, values: Batch(np.linalg.eigvalsh(values.values), batch.valid),
}
