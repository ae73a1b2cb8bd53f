"""Refuses assignments that a kernel would not see, and names the method that has the intended effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from mbd_sim.geometry.pose import Array


class ReadOnlyView(np.ndarray[Any, np.dtype[np.float64]]):
    """A view of an array that cannot be written through; copies and results of operations are ordinary arrays."""

    def __setitem__(self, key: Any, value: Any) -> None:
        self._require_writable()
        super().__setitem__(key, value)

    def __array_ufunc__(self, ufunc: np.ufunc, method: Any, *inputs: Any, **options: Any) -> Any:
        if targets := options.get("out"):
            for target in targets:
                if isinstance(target, ReadOnlyView):
                    target._require_writable()
            options["out"] = tuple(map(_plain, targets))
        return getattr(ufunc, method)(*map(_plain, inputs), **options)

    def copy(self, order: Any = "C") -> Array:  # type: ignore[override]
        """A copy, which can be written."""
        return np.array(self, order=order)

    def __reduce__(self) -> Any:
        return self.copy().__reduce__()

    def _require_writable(self) -> None:
        if not self.flags.writeable:
            raise ValueError(
                "this array is read-only: it shows numbers of a running simulation. Call reset(q=…, u=…) to start "
                "from other coordinates or speeds, restore(…) to continue from a snapshot, set_efforts(…), "
                "set_wrench(…) or set_live(…) to change the inputs, or copy() to compute with the numbers."
            )


def _plain(value: Any) -> Any:
    return value.view(np.ndarray) if isinstance(value, ReadOnlyView) else value


def read_only(array: Array) -> Array:
    """A view of an array that refuses to be written through."""
    view = array.view(ReadOnlyView)
    view.flags.writeable = False
    return view


class ReadOnlyAttributes:
    """Refuses to replace the attributes in `REMEDIES`, each with its remedy, after `_seal` has been called."""

    REMEDIES: ClassVar[Mapping[str, str]] = {}
    _sealed = False

    def _seal(self) -> None:
        self._sealed = True

    def __setattr__(self, name: str, value: object) -> None:
        if self._sealed and name in self.REMEDIES:
            raise AttributeError(f"'{name}' of a {type(self).__name__} cannot be assigned. {self.REMEDIES[name]}")
        super().__setattr__(name, value)
