"""The viewer's process sends rows to a viewer as they come, and to a file a second of them at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mbd_sim.pictures.rerun import worker
from mbd_sim.pictures.rerun.worker import RowBatches


class Stream:
    """Keeps what it is sent."""

    def __init__(self) -> None:
        self.sent: list[Any] = []

    def send_samples(self, values: Any) -> None:
        self.sent.append(values)


def test_rows_for_a_file_are_collected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "FILE_PERIOD", 1e9)
    monkeypatch.setattr(worker, "FILE_BATCH", 10 * 3 * 8)
    stream, rows = Stream(), np.arange(36.0).reshape(12, 3)
    batches = RowBatches(stream, 3, live=False)  # type: ignore[arg-type]
    for row in rows:
        batches.add(row.tobytes())
    assert [len(values) for values in stream.sent] == [10]
    batches.send()
    batches.send()
    assert np.array_equal(np.concatenate(stream.sent), rows) and len(stream.sent) == 2
    monkeypatch.setattr(worker, "FILE_PERIOD", 0.0)
    batches.add(rows[0].tobytes())
    assert len(stream.sent) == 3


def test_rows_for_a_viewer_are_sent_at_once() -> None:
    stream = Stream()
    batches = RowBatches(stream, 3, live=True)  # type: ignore[arg-type]
    for _ in range(3):
        batches.add(np.zeros(3).tobytes())
    assert len(stream.sent) == 3


def test_the_period_grows_with_the_run_so_that_the_number_of_chunks_stays_small(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr(worker.time, "monotonic", lambda: now[0])
    stream = Stream()
    batches = RowBatches(stream, 3, live=False)  # type: ignore[arg-type]
    for step in range(1, 20 * 3600):  # an hour at 20 rows a second
        now[0] = 0.05 * step
        batches.add(np.zeros(3).tobytes())
    assert len(stream.sent) < 600
