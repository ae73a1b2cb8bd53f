"""At which steps messages are due: at the rate asked, whatever the step."""

import pytest

from mbd_sim.recordings.messages.events import publication_schedule, rate_remark


def due_ticks(rate: float, step_size: float, last: int) -> list[int]:
    """The ticks up to the last one at which messages are due, from the schedule's jumps."""
    schedule = publication_schedule(rate, step_size)
    assert schedule is not None
    ticks = [0]
    while (tick := schedule.next_tick(ticks[-1])) <= last:
        ticks.append(tick)
    return ticks


@pytest.mark.parametrize(
    ("rate", "step_size", "first"),
    [
        (100.0, 1e-3, [0, 10, 20, 30]),
        (333.0, 1e-3, [0, 4, 7, 10]),
        (30.0, 1e-3, [0, 34, 67, 100]),
        (60.0, 1.0 / 3000.0, [0, 50, 100, 150]),
        (1.0 / 3.0, 1e-3, [0, 3000, 6000, 9000]),
        (0.001, 1e-3, [0, 1_000_000, 2_000_000, 3_000_000]),
        (5000.0, 1e-3, [0, 1, 2, 3]),
    ],
)
def test_messages_are_due_at_the_first_step_at_or_after_their_time(rate, step_size, first):
    assert due_ticks(rate, step_size, first[-1]) == first


@pytest.mark.parametrize("rate", [7.0, 30.0, 99.9, 333.0, 666.6, 1000.0])
@pytest.mark.parametrize("step_size", [1e-3, 2.5e-4, 1e-3 / 3.0])
def test_any_rate_is_met_to_one_message(rate, step_size):
    last = round(2.0 / step_size)
    ticks = due_ticks(rate, step_size, last)
    assert abs(len(ticks) - 1 - 2.0 * rate) <= 1.0
    schedule = publication_schedule(rate, step_size)
    assert [tick for tick in range(last + 1) if schedule.is_due(tick)] == ticks


def test_rate_zero_is_never_due():
    assert publication_schedule(0.0, 1e-3) is None


def test_a_rate_of_more_than_a_message_for_each_step_is_remarked_on():
    remark = rate_remark("publish_rate", 5000.0, 1e-3)
    assert "publish_rate is 5000 Hz" in remark and "at 1000 Hz" in remark
    assert rate_remark("publish_rate", 1000.0, 1e-3) == ""
    assert rate_remark("publish_rate", 333.0, 1e-3) == ""
