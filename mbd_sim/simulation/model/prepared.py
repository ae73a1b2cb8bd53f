"""What a run needs of the equations of a mechanism besides its kernel: plain data, which the cache keeps.

It is kept for each method of integration, of which the name is checked here.

A model that is found in the cache traces no equations and compiles nothing. So it needs neither CasADi nor the modules
that trace and compile, until something is read that few runs need.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass

from mbd_sim.base import disk_cache
from mbd_sim.base.disk_cache import casadi_version, records_digest, versions
from mbd_sim.base.errors import MechanismError, Problem, nearest
from mbd_sim.base.geometry.pose import Array
from mbd_sim.compiler.code.machine_code import compiler_identity, load_code
from mbd_sim.compiler.python.bound_kernel import Kernel, KernelSignature
from mbd_sim.dynamics.layouts.vectors import CoordinateLayout, InputLayout
from mbd_sim.mechanism.mechanism import Mechanism

AUTO = "auto"  # instead of the name of a method: chosen by the rates of the mechanism


def require_method(mechanism: Mechanism, method: str | None) -> str:
    """The name of the method that was asked for: `method`, or that of the mechanism's file; it may be `auto`.

    :raises MechanismError: there is no such method.
    """
    name = method or mechanism.method
    if name == AUTO:
        return name
    from mbd_sim.integrators.methods import METHODS

    if name in METHODS:
        return name
    message, remedy = f"there is no method '{name}'", nearest(name, (AUTO, *METHODS))
    if method:
        raise MechanismError([Problem(message, remedy, key="method")])
    raise MechanismError([mechanism.source.problem(("integrator", "method"), message, remedy)])


@dataclass(frozen=True, slots=True)
class PreparedModel:
    """The data of a `Model`: `method` is a name, `row_names` are those of the loop or constraint of each equation.

    `start` is the state (n,) and `inputs` are the inputs (m,) at the start. `history_size` is that of the method, and
    `rank` that of the constraints at the start.
    """

    method: str
    method_remark: str
    layout: CoordinateLayout
    input_layout: InputLayout
    start: Array
    inputs: Array
    history_size: int
    part_names: tuple[str, ...]
    row_names: tuple[str, ...]
    rank: int
    signature: KernelSignature


@dataclass(frozen=True, slots=True)
class _Entry:
    prepared: PreparedModel
    code: str  # the key of the object code


def model_key(mechanism: Mechanism, method: str, loaded: Sequence[str], step: float, live: str = "") -> str:
    """The key in the cache of a mechanism's model.

    It depends on all records of the mechanism, on the sources of this package, and on the versions and the processor
    on which equations and machine code depend.

    :param method: its name, which may be `auto`.
    :param loaded: parts on which external wrenches can act.
    :param step: in s.
    :param live: a digest of what says which numbers of the equations are inputs.
    """
    choices = method, repr((*loaded,)), step.hex(), live
    return disk_cache.key(
        "model", records_digest(mechanism), *choices, versions(), casadi_version(), *compiler_identity()
    )


def load_prepared(key: str) -> tuple[PreparedModel, Kernel] | None:
    """The data and the kernel of a key, if both are in the cache."""
    if (stored := disk_cache.load(key)) is None:
        return None
    entry: _Entry = pickle.loads(stored)  # noqa: S301  # as safe as the kernels there, which are executed
    if (code := load_code(entry.code)) is None:
        return None
    return entry.prepared, Kernel(code, entry.prepared.signature)


def store_prepared(key: str, prepared: PreparedModel, kernel: Kernel) -> None:
    """Store the data; the kernel is in the cache already."""
    disk_cache.store(key, pickle.dumps(_Entry(prepared, kernel.code.key)))
