"""The compiled functions, which take addresses in place of arrays and records."""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.ir.python_functions import emit_function, name_of, prototype, signature_of
from mbd_sim.simulation.contact.compiled import members, search, step

EXPORTED: tuple[Callable[..., Any], ...] = (
    step.advance,
    members.advance_members,
    step.switch,
    search.stage,
    search.first_event,
)


@functools.cache
def library() -> SimpleNamespace:
    """The compiled functions; they release the interpreter's lock."""
    module = new_module()
    for function in EXPORTED:
        emit_function(module, function, exported=True)
    code = compile_module(module)
    names = {one.__name__: prototype(*signature_of(one))(code.address(name_of(one))) for one in EXPORTED}
    return SimpleNamespace(code=code, **names)
