"""The rates of a node, and what is due at a step."""

from __future__ import annotations

from dataclasses import dataclass

from mbd_sim.messages.publication_schedule import PublicationSchedule, publication_schedule
from mbd_sim.messages.snapshot import Due


@dataclass
class Rates:
    """Rates that may change during the run.

    `real_time_factor` 0 is as fast as possible; the others are in Hz of simulated time, 0 for never: of states, of the
    clock, of markers, and of samples for the Rerun scene.
    """

    real_time_factor: float = 1.0
    publish: float = 100.0
    clock: float = 200.0
    markers: float = 0.0
    view: float = 0.0

    def due(self, tick: int, step_size: float) -> Due:
        """What is due at a tick, with steps of `step_size` (s)."""
        due = Due.NONE
        for message, schedule in self._schedules(step_size).items():
            if schedule.is_due(tick):
                due |= message
        return due

    def steps_until_due(self, tick: int, step_size: float, *, at_most: int) -> int:
        """The steps from a tick to the next one at which something is due."""
        return min([at_most, *(schedule.next_tick(tick) - tick for schedule in self._schedules(step_size).values())])

    def _schedules(self, step_size: float) -> dict[Due, PublicationSchedule]:
        rates = {
            Due.STATE: self.publish,
            Due.CLOCK: self.clock,
            Due.MARKERS: self.markers,
            Due.VIEW: self.view,
        }
        schedules = {due: publication_schedule(rate, step_size) for due, rate in rates.items()}
        return {due: schedule for due, schedule in schedules.items() if schedule is not None}
