"""What an observer of contacts sees, and that it changes nothing."""

import pytest

from mbd_sim import Simulation


class Seen:
    def __init__(self):
        self.impacts, self.events = [], []

    def impact(self, time, before, after):
        self.impacts.append((time, before, after))

    def event(self, event):
        self.events.append(event)


def test_an_observer_sees_events_and_the_energies_of_impacts_and_changes_nothing():
    plain, observed, seen = Simulation.from_file("bounce"), Simulation.from_file("bounce"), Seen()
    observed.observe_contacts(seen)
    for sim in (plain, observed):
        sim.run(until=2.0)
    assert observed.state.tobytes() == plain.state.tobytes()
    assert tuple(seen.events) == observed.contact_events == plain.contact_events
    losses = [before - after for _, before, after in seen.impacts]
    assert [time for time, _, _ in seen.impacts] == [event.time for event in seen.events]
    assert losses == pytest.approx([event.loss for event in seen.events], abs=1e-13)
    assert losses[0] == pytest.approx((1.0 - 0.8**2) * 9.81, abs=1e-12)  # of m g h
    count = len(seen.events)
    observed.observe_contacts(None)
    observed.run(until=3.0)
    assert observed.contact_event_count > len(seen.events) == count


def test_without_one_sided_elements_there_is_nothing_to_observe():
    with pytest.raises(ValueError, match="mechanism 'double_rod' has no one-sided elements to observe"):
        Simulation.from_file("double_rod").observe_contacts(Seen())
