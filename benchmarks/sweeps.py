"""Sweeps on several workers: processor time of the caller and of the workers, beside that of the runs alone.

`python -m benchmarks.sweeps [runs] [seconds]`. The runs are computed in this process, then by Dask in one and in two
processes, in alternating rounds. The caller's share is not parallel. It bounds the speed-up on n idle processors, which
is printed as the efficiency: the processor time of the runs alone over n times the time in which n workers and the
caller, one after the other, would be done. A worker's start, which does not grow with the runs, is measured by itself.
"""

from __future__ import annotations

import os
import resource
import statistics
import sys
import time
from collections.abc import Sequence

import dask
import numpy as np

from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep.runs import Chunk, Settings, chunks, compute, sweep

ROUNDS, WORKERS = 3, (1, 2)


def settings(seconds: float) -> Settings:
    """Two rods, sampled every tenth of a second."""
    source = load_mechanism("double_rod").source
    return Settings(source.text, source.file, until=seconds, every=0.1)


def processor_times() -> tuple[float, float]:
    """Of this process, and of its children that have ended, in s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time(), children.ru_utime + children.ru_stime


def on_workers(of: Settings, work: Sequence[Chunk], workers: int) -> tuple[float, float]:
    """The processor times of the caller and of the workers."""
    before = processor_times()
    with dask.config.set(num_workers=workers):
        sweep(of, work)
    after = processor_times()
    return after[0] - before[0], after[1] - before[1]


def main(runs: int = 5120, seconds: float = 20.0) -> None:
    """Print the table."""
    lengths = np.random.default_rng(0).uniform(0.5, 2.0, runs).tolist()
    of, work = settings(seconds), chunks([{"l": length} for length in lengths])
    compute(of, work[0])
    alone: list[float] = []
    found: dict[int, list[tuple[float, float, float]]] = {workers: [] for workers in WORKERS}
    for _ in range(ROUNDS):
        began = time.process_time()
        for chunk in work:
            compute(of, chunk)
        alone.append(time.process_time() - began)
        for workers in WORKERS:
            start = sum(on_workers(of, [Chunk(0, work[0].changes[:1])] * (2 * workers), workers))
            found[workers].append((*on_workers(of, work, workers), start))
    plain = statistics.median(alone)
    print(f"{runs} runs of {seconds:g} s, load {os.getloadavg()[0]:.1f}; in this process {plain:.2f} s\n")
    print("| workers | caller, s | workers, s | of which start, s | efficiency | without the start |")
    print("|--:|--:|--:|--:|--:|--:|")
    for workers, rows in found.items():
        caller, children, start = (statistics.median(column) for column in zip(*rows, strict=True))
        whole, running = caller + children / workers, caller + (children - start) / workers
        print(
            f"| {workers} | {caller:.2f} | {children:.2f} | {start:.2f} "
            f"| {plain / (workers * whole):.2f} | {plain / (workers * running):.2f} |"
        )


if __name__ == "__main__":
    main(*(kind(word) for kind, word in zip((int, float), sys.argv[1:], strict=False)))
