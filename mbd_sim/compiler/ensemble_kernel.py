"""A system of differential equations compiled for many members at once, each one lane of vectors."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, starmap

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from mbd_sim.compiler.code.host_module import compile_module, new_module
from mbd_sim.compiler.code.machine_code import MachineCode
from mbd_sim.compiler.kernel import PartialSystem, StepNeeds, emit_system, step_of
from mbd_sim.compiler.lists.lowering import lower
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.compiler.python.bound_kernel import Kernel
from mbd_sim.compiler.steps.loop import emit_advance_members
from mbd_sim.integrators.between_steps import BetweenSteps
from mbd_sim.integrators.method import Method, Scales

Array = NDArray[np.float64]
Done = list[object]  # receives an entry as soon as some groups have taken their steps
Advance = Callable[[Mapping[str, Array], int, float, int, range, Done], None]

ALL = slice(None)
LANES = 8  # members in a group; docs/ensembles.md has the measurements

_ADDRESS, _INT, _DOUBLE = ctypes.c_void_p, ctypes.c_int64, ctypes.c_double


@dataclass(frozen=True, eq=False)
class MemberKernel:
    """`advance(y, inputs, estimates, alive, first, h, steps, from, to)`: see `emit_advance_members`.

    It releases the interpreter's lock.
    """

    advance: Callable[..., None]
    lanes: int
    code: MachineCode


def compile_members(
    rates: ca.Function,
    projection: ca.Function | None,
    method: Method,
    core: slice,
    partial_system: PartialSystem | None = None,
    between_steps: BetweenSteps | None = None,
    lanes: int = LANES,
    scales: Scales = (),
) -> MemberKernel:
    """Compile y' = rates(t, y, inputs) for groups of members: see `compile_kernel` and `System`."""
    module = new_module()
    program = arranged(rates)
    system = emit_system(module, rates, program, projection, method, core.stop, lanes, between_steps, scales=scales)
    needs = StepNeeds(
        rates, core, lambda: partial_system, lambda function, *_: lower(module, function, inline=False, lanes=lanes)
    )
    step = step_of(method, needs)
    size = rates.nnz_in(2)
    emit_advance_members(module, system, step, lanes, size + method.history_size(system.size, size))
    code = compile_module(module)
    signature = ctypes.CFUNCTYPE(None, *[_ADDRESS] * 4, _INT, _DOUBLE, *[_INT] * 3)
    return MemberKernel(signature(code.address("advance_members")), lanes, code)


class MemberGroups:
    """The arrays of many members, and the function that advances them.

    `y` (k, n), `inputs` (k, m), `estimates` (k, 1) and `alive` (k, 1) are stored in groups of `lanes` members as
    (groups, n, lanes), so that one component of all members of a group is contiguous.
    """

    def __init__(
        self, count: int, lanes: int, sizes: Mapping[str, int], advance: Advance, threaded_from: int = 0
    ) -> None:
        """Allocate the arrays for `count` members.

        :param sizes: the number of components of each array.
        :param threaded_from: the steps of all members together from which on threads are used.
        """
        self.count, self._lanes, self._advance, self._threaded_from = count, lanes, advance, threaded_from
        groups = -(-count // lanes)
        self._arrays = {name: np.zeros((groups, size, lanes)) for name, size in sizes.items()}

    def get(self, name: str, columns: slice = ALL) -> Array:
        """A copy of some columns of an array with one row for each member."""
        array = self._arrays[name][:, columns]
        rows = np.empty((array.shape[0], self._lanes, array.shape[1]))
        rows[:] = array.transpose(0, 2, 1)
        return rows.reshape(-1, array.shape[1])[: self.count]

    def put(self, name: str, rows: Array, columns: slice = ALL) -> None:
        """Set some columns of an array from one row for each member."""
        array = self._arrays[name][:, columns]
        if missing := array.shape[0] * self._lanes - self.count:
            rows = np.concatenate([rows, np.repeat(rows[-1:], missing, axis=0)])
        array[:] = rows.reshape(array.shape[0], self._lanes, -1).transpose(0, 2, 1)

    def put_members(self, name: str, members: NDArray[np.intp], rows: Array) -> None:
        """Set an array for some members, from one row for each of them."""
        groups, lanes = np.divmod(members, self._lanes)
        self._arrays[name][groups, :, lanes] = rows

    def advance(self, first: int, h: float, steps: int, threads: int, done: Done) -> None:
        """Advance all members by a number of steps of size h in s, beginning with step `first`.

        The groups are divided among threads as evenly as possible.

        :param done: receives an entry as soon as all members have taken the steps; whatever ends this earlier, such as
            Ctrl-C, leaves all of them where they were.
        """
        groups = len(self._arrays["y"])
        if steps * self.count < self._threaded_from:
            threads = 1
        cuts = np.linspace(0, groups, min(threads, groups) + 1).astype(int).tolist()
        shares = [range(start, end) for start, end in pairwise(cuts)]
        if len(shares) == 1 and self._lanes > 1:
            self._advance(self._arrays, first, h, steps, shares[0], done)
            return
        moved = {name: array.copy() for name, array in self._arrays.items()}
        work = partial(self._advance, moved, first, h, steps)
        if len(shares) == 1:
            work(shares[0], [])
        else:
            with ThreadPoolExecutor(len(shares)) as pool:
                tasks = [pool.submit(work, share, []) for share in shares]
                for task in tasks:
                    task.result()
        done.extend(map(vars(self).__setitem__, ["_arrays"], [moved]))  # in one call of C: see `advance_lanes`


def advance_lanes(kernel: MemberKernel) -> Advance:
    """Advance each group as one vector."""

    def advance(arrays: Mapping[str, Array], first: int, h: float, steps: int, groups: range, done: Done) -> None:
        addresses = [arrays[name].ctypes.data for name in ("y", "inputs", "estimates", "alive")]
        # In one call of C, so that Ctrl-C acts before the steps or after their mark.
        done.extend(starmap(kernel.advance, [(*addresses, first, h, steps, groups.start, groups.stop)]))

    return advance


def advance_one_by_one(kernel: Kernel) -> Advance:
    """Advance each member, in a group by itself, with the kernel of a single simulation."""

    def advance(arrays: Mapping[str, Array], first: int, h: float, steps: int, groups: range, done: Done) -> None:
        y, inputs, estimates, alive = (arrays[name] for name in ("y", "inputs", "estimates", "alive"))
        for group in groups:
            if alive[group, 0, 0]:
                addresses = y[group].ctypes.data, inputs[group].ctypes.data
                finite = kernel.estimating_advance(*addresses, first, h, steps, estimates[group].ctypes.data)
                alive[group, 0, 0] = float(finite)
        done.append(groups)

    return advance
