"""A program that builds a model for the cache, while the one that needs it runs with code that is not optimized.

Its standard input has the key of the model, the state of all modules on which that depends, and the order. One such
program builds at a time, and all of them leave the processors to others.
"""

from __future__ import annotations

import os
import pickle
import sys

from mbd_sim import disk_cache
from mbd_sim.mechanism_cache import versions
from mbd_sim.simulation.build_order import BuildOrder
from mbd_sim.simulation.model_builder import build
from mbd_sim.simulation.prepared_model import load_prepared, store_prepared

LEAVES = 10  # added to the niceness


def main() -> None:
    """The program."""
    os.nice(LEAVES)
    key, state, order = pickle.load(sys.stdin.buffer)  # noqa: S301  (from the program that has started this one)
    if state != versions():
        raise SystemExit("its modules have changed since the program started")
    with disk_cache.one_at_a_time("optimizing"):
        if load_prepared(key) is None:
            store(key, order)


def store(key: str, order: BuildOrder) -> None:
    """Build a model, and store it in the cache under a key."""
    built = build(order.mechanism, order.method, order.trace, order.step)
    store_prepared(key, built.prepared, built.kernel)


if __name__ == "__main__":
    main()
