"""Modules of IR for this machine, and their machine code."""

from __future__ import annotations

import logging
import pickle
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import llvmlite.binding as llvm

from mbd_sim.base import disk_cache
from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.code.machine_code import MachineCode, compiler_identity, host, linked, load_code
from mbd_sim.compiler.code.object_code import object_code
from mbd_sim.compiler.ir.builder import IRBuilder
from mbd_sim.compiler.ir.module import Module

LONG = 1_000_000  # characters of IR from which on the progress of a compilation, which takes seconds, is logged

T = TypeVar("T")

_log = logging.getLogger(__name__)


def new_module() -> Module:
    """An empty module for this machine."""
    return Module(llvm.get_default_triple(), IRBuilder, is_fast=machine_code.LEVEL > 0)


def compile_module(module: Module) -> MachineCode:
    """Optimize and compile a module, or load the object code of those of its units that were compiled before.

    Ctrl-C interrupts it after the present unit.
    """
    units = module.units()
    keys = [disk_cache.key(text, *compiler_identity()) for text in units]
    codes = {key: disk_cache.load(key) for key in keys}
    missing = {key: text for key, text in zip(keys, units, strict=True) if codes[key] is None}
    severity = logging.INFO if sum(map(len, missing.values())) >= LONG else logging.DEBUG
    began = time.monotonic()
    for index, (key, text) in enumerate(missing.items(), 1):
        _log.log(severity, "compiling unit %d of %d", index, len(missing))
        codes[key] = _compiled(key, text)
    _log.log(severity, "compiled in %.1f s", time.monotonic() - began)
    return linked(keys, [code for code in codes.values() if code is not None])


def compiled_before(compile_: Callable[[], tuple[MachineCode, T]], *contents: str) -> tuple[MachineCode, T]:
    """Code and what is known of it, without emitting its IR if it was compiled from these contents before.

    :param contents: everything that the IR depends on, but the versions.
    """
    name = disk_cache.key("emitted", *contents, *compiler_identity(), disk_cache.versions())
    if (stored := disk_cache.load(name)) is not None:
        key, about = pickle.loads(stored)  # noqa: S301  # as safe as the code there, which is executed
        if (code := load_code(key)) is not None:
            return code, about
    code, found = compile_()
    disk_cache.store(name, pickle.dumps((code.key, found)))
    return code, found


def compile_once(contents: Sequence[str], emit: Callable[[], str]) -> MachineCode:
    """Compile the IR that `emit` makes from these contents, or load the object code, without the IR."""
    key = disk_cache.key(*contents, *compiler_identity())
    code = disk_cache.load(key)
    return linked([key], [_compiled(key, emit()) if code is None else code])


def _compiled(key: str, text: str) -> bytes:
    code = object_code(text, *host(), machine_code.LEVEL)
    disk_cache.store(key, code)
    return code
