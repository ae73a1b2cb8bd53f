"""A program that builds a model for the cache, while the one that needs it runs with code that is not optimized.

Its standard input has the key of the model, the state of all modules on which that depends, and the order. One such
program builds at a time, and all of them leave the processors to others.
"""

from __future__ import annotations

import os
import pickle
import sys

from mbd_sim import disk_cache

LOCK = "optimizing"
LEAVES = 10  # added to the niceness


def main() -> None:
    """The program."""
    os.nice(LEAVES)
    with disk_cache.one_at_a_time(LOCK):
        _build(sys.stdin.buffer.read())


def _build(order: bytes) -> None:
    # Imported now, because the modules take the memory of a program.
    from mbd_sim.mechanism_cache import versions
    from mbd_sim.simulation.prepared_model import load_prepared

    key, state, contents = pickle.loads(order)  # noqa: S301  (from the program that has started this one)
    if state != versions():
        raise SystemExit("modules of mbd_sim have changed since it started")
    if load_prepared(key) is None:
        contents.store(key)


if __name__ == "__main__":
    main()
