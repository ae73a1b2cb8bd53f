"""Models that were never built before start with code that is compiled quickly, until optimized code is ready.

LLVM takes up to half of the time of a first build. Code that is not optimized is ready sooner. Its steps take two to
five times as long, with the same results to the bit. A process in the background builds the model as usual, for the
cache, and its code then takes the place of the other. That process goes on if the program ends before. If it is ended
as well, the next start builds the model as usual: a model starts quickly only once.
"""

from __future__ import annotations

import atexit
import logging
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from typing import NamedTuple

from mbd_sim import disk_cache
from mbd_sim.compiler import machine_code
from mbd_sim.compiler.bound_kernel import Kernel
from mbd_sim.mechanism.one_sided import has_one_sided
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_cache import versions
from mbd_sim.own_interpreter import QUICK_START, start_interpreter
from mbd_sim.simulation.build_order import BuildOrder
from mbd_sim.simulation.optimizing_process import LOCK
from mbd_sim.simulation.prepared_model import PreparedModel, load_prepared

# s between the starts of two builds of a program from which on the second starts quickly as well. Programs that build
# one model after another would keep all processors busy in the background, and need each of them only for a moment.
APART = 10.0
PROGRAM = "mbd_sim.simulation.optimizing_process"
LOOKS, PERIOD = 600, 0.5  # of a forked process for the optimized code, in s

_log = logging.getLogger(__name__)


class _QuickModel(NamedTuple):
    """A model whose optimized code is being built."""

    prepared: PreparedModel
    kernel: weakref.ref[Kernel]

    def adopt(self, key: str) -> bool:
        """Use the optimized code, or nothing if nobody uses the model any more; False if it is not in the cache."""
        if (kernel := self.kernel()) is None:
            return True
        found = load_prepared(key)
        if found is None or _identity(found[0]) != _identity(self.prepared):
            return False
        kernel.adopt(found[1])
        return True


_last_build = -APART
_unfinished: dict[str, _QuickModel] = {}  # by their keys
_loading = threading.Lock()
_is_ending = False


def note_build(mechanism: Mechanism, key: str) -> bool:
    """Note that a model is built now; whether it starts with code that is not optimized.

    Not if it cannot be stored, has done so before, follows another one, or another one is being optimized on this
    machine, or if the environment variable `MBD_SIM_QUICK_START` is 0, off or empty.

    :param key: that of the model in the cache.
    """
    global _last_build
    apart = time.monotonic() - _last_build
    _last_build += apart
    is_allowed = os.environ.get(QUICK_START, "on").lower() not in ("", "0", "off")
    has_interpreter = bool(sys.executable) and not getattr(sys, "frozen", False)
    if not is_allowed or not has_interpreter or not machine_code.LEVEL or apart < APART or has_one_sided(mechanism):
        return False
    begun = disk_cache.key("quick start", key)
    if disk_cache.load(begun) is not None or disk_cache.is_locked(LOCK):
        return False
    disk_cache.store(begun, b"")
    return disk_cache.load(begun) is not None  # and so will be what the process stores


def unfinished_model(key: str) -> tuple[PreparedModel, Kernel] | None:
    """The model of a key that another simulation of this program uses while its optimized code is being built."""
    if (model := _unfinished.get(key)) is None or (kernel := model.kernel()) is None:
        return None
    return model.prepared, kernel


def optimize_later(prepared: PreparedModel, kernel: Kernel, key: str, order: BuildOrder) -> None:
    """Build a model in another process, and let its `kernel` adopt the optimized code when it is in the cache.

    :param key: that of the model in the cache.
    """
    try:
        with tempfile.TemporaryFile() as given:
            given.write(pickle.dumps((key, versions(), order)))
            given.seek(0)
            process = start_interpreter("-m", PROGRAM, stdin=given, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        model = _unfinished[key] = _QuickModel(prepared, weakref.ref(kernel))
        arguments = process, model, key
        try:
            threading.Thread(target=_adopt_when_built, args=arguments, daemon=True, name="optimized code").start()
        except RuntimeError:
            del _unfinished[key]
            process.kill()
            process.communicate()
            raise
    except (OSError, RuntimeError) as error:  # no file, process or thread can be had
        _warn(str(error))


def _adopt_when_built(process: subprocess.Popen[bytes], model: _QuickModel, key: str) -> None:
    began = time.monotonic()
    _, errors = process.communicate()
    with _loading:
        if _is_ending:
            return
        _unfinished.pop(key, None)
        if process.returncode:
            last = errors.decode(errors="replace").strip().rpartition("\n")[2]
            _warn(last or f"exit status {process.returncode}")
        elif model.adopt(key):
            _log.info("optimized code is in use after %.1f s", time.monotonic() - began)
        else:
            _warn("it is not in the cache")


def _adopt_when_found() -> None:
    """Look for the optimized code, in a process that was forked from the one that waits for it."""
    for _ in range(LOOKS):
        time.sleep(PERIOD)
        with _loading:
            for key, model in list(_unfinished.items()):
                if _is_ending or model.adopt(key):
                    del _unfinished[key]
            if not _unfinished:
                return


def _go_on_in_fork() -> None:
    _loading.release()
    if _unfinished:
        threading.Thread(target=_adopt_when_found, daemon=True, name="optimized code").start()


# LLVM's lock would stay closed in a process that is forked while another thread loads code.
os.register_at_fork(before=_loading.acquire, after_in_parent=_loading.release, after_in_child=_go_on_in_fork)


@atexit.register
def _load_no_more() -> None:
    """Load no code while the program ends, when LLVM is being unloaded."""
    global _is_ending
    with _loading:
        _is_ending = True


def _identity(model: PreparedModel) -> tuple[object, ...]:
    """What the code of a model must have in common with other code that takes its place."""
    return model.method, model.history_size, model.start.tobytes(), model.inputs.shape, model.signature.readers


def _warn(reason: str) -> None:
    _log.warning(
        "optimized code cannot be used, so that steps take two to five times as long (%s). %s=off compiles it before "
        "the first step.",
        reason,
        QUICK_START,
    )
