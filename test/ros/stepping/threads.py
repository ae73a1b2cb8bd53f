"""How tests read from and wait for a stepping thread."""

import time

from test.waiting import PATIENCE, wait_until


def collected(stepping_thread):
    items = []
    while (item := stepping_thread.output.get(timeout=PATIENCE)) is not None:
        items.append(item)
    return items


def wait_for(condition):
    wait_until(condition, "the stepping thread", meanwhile=lambda: time.sleep(0.001))
