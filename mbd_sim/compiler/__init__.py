"""From instruction lists to machine code; nothing here knows mechanics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbd_sim.lazy_names import lazy_names

if TYPE_CHECKING:
    from mbd_sim.compiler.bound_call import CompiledFunction as CompiledFunction
    from mbd_sim.compiler.bounded_write import bounded_writer as bounded_writer
    from mbd_sim.compiler.readers import CompiledReaders as CompiledReaders
else:
    __getattr__ = lazy_names(
        __name__,
        {
            "bound_call": ("CompiledFunction",),
            "bounded_write": ("bounded_writer",),
            "readers": ("CompiledReaders",),
        },
    )
