"""How tests wait: on a condition, on the steady clock, with one patience that only a hang exceeds."""

import time
from collections.abc import Callable
from typing import Any

PATIENCE = 300.0  # s; every wait ends as soon as its condition holds, so that this costs nothing where a test passes


def wait_until(
    condition: Callable[[], Any],
    what: str,
    *,
    meanwhile: Callable[[], Any] = lambda: time.sleep(0.02),
    gone: Callable[[], Any] = lambda: False,
    report: Callable[[], str] = lambda: "",
) -> None:
    """Wait until a condition holds; fail after `PATIENCE`.

    :param what: what is waited for, for the message.
    :param meanwhile: what to do between two looks; it takes some time.
    :param gone: whether the condition can no longer come true, as after the end of a process; two more seconds are
        left for what is still on its way.
    :param report: more for the message.
    """
    deadline = time.monotonic() + PATIENCE
    while not condition():
        now = time.monotonic()
        if gone():
            deadline = min(deadline, now + 2.0)
        assert now < deadline, f"waited in vain for {what}\n{report()}"
        meanwhile()
