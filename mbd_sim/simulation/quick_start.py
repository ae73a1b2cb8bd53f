"""Models that were never built before start with code that is compiled quickly, until optimized code is ready.

LLVM takes up to half of the time of a first build. Code that is not optimized is ready sooner. Its steps take two to
five times as long, with the same results to the bit. A process in the background builds the model as usual, for the
cache, and its code then takes the place of the other. That process goes on if the program ends before.
"""

from __future__ import annotations

import atexit
import logging
import os
import pickle
import subprocess
import tempfile
import threading
import time
import weakref

from mbd_sim.compiler import machine_code
from mbd_sim.compiler.bound_kernel import Kernel
from mbd_sim.mechanism.one_sided import has_one_sided
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism_cache import versions
from mbd_sim.own_interpreter import start_interpreter
from mbd_sim.simulation.build_order import BuildOrder
from mbd_sim.simulation.prepared_model import load_prepared

# s between the starts of two builds of a program from which on the second starts quickly as well. Programs that build
# one model after another would keep all processors busy in the background, and need each of them only for a moment.
APART = 10.0
ENDING = 1.0  # s; loading code takes some milliseconds
PROGRAM = "mbd_sim.simulation.optimizing_process"
_VARIABLE = "MBD_SIM_QUICK_START"

_log = logging.getLogger(__name__)
_last_build = -APART
_loading = threading.Lock()


def starts_quickly(mechanism: Mechanism) -> bool:
    """Whether the model that is now built begins with code that is not optimized.

    Not if it cannot be stored, has been preceded by another one recently, or if the environment variable
    `MBD_SIM_QUICK_START` is 0, off or empty.
    """
    global _last_build
    apart = time.monotonic() - _last_build
    _last_build += apart
    allowed = os.environ.get(_VARIABLE, "on").lower() not in ("", "0", "off")
    return allowed and machine_code.LEVEL > 0 and apart >= APART and not has_one_sided(mechanism)


def optimize_later(kernel: Kernel, key: str, order: BuildOrder) -> None:
    """Build a model in another process, and let its `kernel` adopt the optimized code when it is in the cache.

    :param key: that of the model in the cache.
    """
    with tempfile.TemporaryFile() as given:
        pickle.dump((key, versions(), order), given)
        given.seek(0)
        try:
            process = start_interpreter("-m", PROGRAM, stdin=given, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        except OSError as error:
            _warn(str(error))
            return
    arguments = process, weakref.ref(kernel), key
    threading.Thread(target=_adopt_when_ready, args=arguments, daemon=True, name="optimized code").start()


def _adopt_when_ready(process: subprocess.Popen[bytes], kernel: weakref.ref[Kernel], key: str) -> None:
    began = time.monotonic()
    _, errors = process.communicate()
    with _loading:
        if process.returncode:
            last = errors.decode(errors="replace").strip().rpartition("\n")[2]
            _warn(last or f"exit status {process.returncode}")
        elif (model := kernel()) is not None and (found := load_prepared(key)) is not None:
            model.adopt(found[1])
            _log.info("optimized code is in use after %.1f s", time.monotonic() - began)


def _warn(reason: str) -> None:
    _log.warning(
        "there is no optimized code, so that steps take two to five times as long: its process failed (%s). "
        "%s=off compiles it before the first step.",
        reason,
        _VARIABLE,
    )


@atexit.register
def _stop_loading() -> None:
    """Load no code while the program ends, when LLVM is being unloaded."""
    _loading.acquire(timeout=ENDING)
