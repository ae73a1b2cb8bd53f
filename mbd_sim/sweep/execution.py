"""Execution of the chunks of a sweep by Dask: in local processes or on a cluster."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

from mbd_sim.errors import MbdSimError
from mbd_sim.packages import require_packages
from mbd_sim.sweep.sweep_runs import (
    Chunk,
    Results,
    Settings,
    compute,
    joined,
)

Progress = Callable[[int], None]


class ScheduleError(MbdSimError):
    """Dask is not installed, or its scheduler cannot be reached."""


def sweep(settings: Settings, work: Sequence[Chunk], scheduler: str = "", progress: Progress | None = None) -> Results:
    """Compute all chunks; `progress` is called with the number of runs of each chunk that is done.

    :param scheduler: the address of a Dask scheduler, such as tcp://host:8786; if empty, local processes.
    :raises MissingPackageError: Dask is not installed.
    :raises ScheduleError: the scheduler cannot be reached.
    """
    if len(work) == 1 and not scheduler:
        results = compute(settings, work[0], threads=None)
        if progress is not None:
            progress(len(work[0].changes))
        return results
    require_packages("dask", purpose="A sweep of this size")
    import dask

    tasks = [dask.delayed(compute, pure=False)(settings, chunk) for chunk in work]
    if scheduler:
        return joined(_on_cluster(tasks, work, scheduler, progress))
    with _reported(progress), _local_workers() as pool:
        return joined(dask.compute(*tasks, scheduler="processes", pool=pool))


@contextmanager
def _local_workers() -> Iterator[ProcessPoolExecutor]:
    """A process for each processor. An interrupt or an error ends them at once, and not after their present chunks."""
    from dask import config
    from dask.multiprocessing import get_context
    from dask.system import CPU_COUNT

    count = config.get("num_workers", None) or CPU_COUNT
    pool = ProcessPoolExecutor(count, mp_context=get_context(), initializer=_leave_interrupts_to_parent)
    try:
        yield pool
    except BaseException:
        # Python 3.14 is the first with `terminate_workers`. Other threads may have started processes of their own.
        for worker in list((pool._processes or {}).values()):
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_interrupts_to_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _reported(progress: Progress | None) -> Iterator[None]:
    """Call `progress` when Dask's local scheduler has computed a chunk."""
    from dask.callbacks import Callback

    def done(key: Any, result: Any, *_: Any) -> None:
        if progress is not None and isinstance(result, Results):
            progress(len(result.runs["run"]))

    with Callback(posttask=done):
        yield


def _on_cluster(
    tasks: Sequence[Any], work: Sequence[Chunk], scheduler: str, progress: Progress | None
) -> list[Results]:
    require_packages("distributed", purpose="A Dask scheduler")
    from distributed import Client, as_completed

    try:
        client = Client(scheduler, timeout=5)
    except (OSError, ValueError) as error:
        raise ScheduleError(f"there is no Dask scheduler at {scheduler}: {error}") from error
    with client:
        futures = client.compute(list(tasks))
        sizes = {future.key: len(chunk.changes) for future, chunk in zip(futures, work, strict=True)}
        for future in as_completed(futures):
            if progress is not None:
                progress(sizes[future.key])
        return list(client.gather(futures))
