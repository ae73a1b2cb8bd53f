"""The queue between the simulation and the viewer."""

import pytest

from mbd_sim.pictures.rerun.viewer import Mailbox


def test_a_mailbox_keeps_the_newest_and_counts_the_others():
    box = Mailbox(3)
    for number in range(5):
        box.put(number)
    assert len(box) == 3
    assert box.take(2) == [2, 3]
    assert box.dropped == 2
    box.put(5)
    assert box.take(10) == [4, 5]
    assert box.take(10) == []
    assert box.dropped == 2
    with pytest.raises(ValueError, match="at least 1"):
        Mailbox(0)
