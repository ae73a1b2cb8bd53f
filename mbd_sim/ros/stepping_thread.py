"""The thread that steps the simulation in real time and emits snapshots and events. Independent of ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import SimpleQueue

from mbd_sim.errors import CommandError, DivergedError
from mbd_sim.messages.snapshot import Due, Snapshot
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.pacing import Pacer
from mbd_sim.ros.publication_schedule import PublicationSchedule, publication_schedule
from mbd_sim.ros.requests import RequestQueue
from mbd_sim.ros.snapshots import Counters, Item
from mbd_sim.ros.wrench_buffer import WrenchBuffer
from mbd_sim.simulation.events import AppliedEfforts, AppliedWrench, ChangedValues, Event, EventKind, Payload
from mbd_sim.simulation.live_values import PreparedValues
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.simulation.step_advice import TOLERATED

WAKE_UP_PERIOD = 1e-3  # s of real time between wake-ups where the step is shorter
FAST_BATCH = 1000  # steps between requests when running as fast as possible
REPEAT_PERIOD = 0.5  # s of real time between repeated states while paused, for subscribers that join later
BACKLOG = 200  # snapshots that may wait for publication when running as fast as possible
MAX_WAITING = 10_000  # snapshots that may wait at all; when publishing is that slow, further ones are dropped


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


class SteppingThread:
    """Steps a simulation until it is stopped; commands and requests take effect between two steps."""

    def __init__(
        self,
        simulation: Simulation,
        commands: CommandBuffer,
        rates: Rates,
        *,
        wrenches: WrenchBuffer | None = None,
        paused: bool = False,
    ) -> None:
        self.simulation, self.commands, self.rates = simulation, commands, rates
        self.wrenches = wrenches or WrenchBuffer(simulation.wrench_map, simulation.model.part_names, commands.timeout)
        self.output: SimpleQueue[Item] = SimpleQueue()
        self.pacer = Pacer()
        self.counters = Counters()
        self.paused = paused
        self.problem = self.advice = ""
        self.ticks = 0
        self._last_emitted = self._last_viewed = -1  # the tick of the last state that was emitted, and for the viewer
        self._clock_offset = 0
        self._error_threshold = TOLERATED
        self._step_ns = round(simulation.step_size * 1e9)
        self._wake = threading.Event()
        self._requests: RequestQueue[[]] = RequestQueue(self._wake.set)
        self._live_lock = threading.Lock()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="stepper", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    @property
    def thread_id(self) -> int:
        """The system's id of the thread, 0 before it has started."""
        return self._thread.native_id or 0

    def stop(self) -> None:
        """End the thread, then the output."""
        self._stopping = True
        self._wake.set()
        self._thread.join()
        self.output.put(None)

    @property
    def clock_ns(self) -> int:
        """The node's simulated clock in ns; it goes back only when a reset asks for it."""
        return self._clock_ticks * self._step_ns

    @property
    def _clock_ticks(self) -> int:
        """The steps since the clock was zero."""
        return self.ticks - self._clock_offset

    def pause(self, paused: bool) -> None:
        """Pause or resume; returns when it has taken effect."""
        self._requests.call(lambda: self._set_paused(paused), self._thread)

    def reset(self, rewind_clock: bool = False, *, state: bool = True) -> str:
        """Reset the state to the start state, the clock to zero, or both; returns the problem, or "" on success."""
        return self._call(lambda: self._reset(rewind_clock, state))

    def step(self, steps: int) -> str:
        """Take some steps while paused; returns the problem, or "" on success."""
        return self._call(lambda: self._step_paused(steps))

    def set_live(self, changes: Mapping[str, float]) -> str:
        """Change live values of the mechanism; returns the problem, and then nothing has changed, or "" on success.

        The new values are validated in the calling thread. Changes from several threads are applied one after another.
        """
        with self._live_lock:
            try:
                prepared = self.simulation.prepare_live(changes)
            except CommandError as error:
                return str(error)
            return self._call(lambda: self._apply_live(prepared))

    def request_moment(self) -> None:
        """Have a `Moment` put into the output between two steps; returns at once."""
        self._requests.submit(lambda: self.output.put(self.moment()))

    def moment(self) -> Moment:
        """Everything that determines the motion from here on; for the stepping thread, or before it starts."""
        return Moment.of(self.simulation, self.ticks, self.clock_ns)

    def restart_schedule(self) -> None:
        """Schedule the next steps from now on, as after a change of the real-time factor."""
        self._requests.call(self.pacer.anchor, self._thread)

    def _call(self, action: Callable[[], str]) -> str:
        """The answer of an action that the stepping thread executes between two steps."""
        answers: list[str] = []
        self._requests.call(lambda: answers.append(action()), self._thread)
        return answers[0] if answers else "the simulation has stopped"

    def _run(self) -> None:
        try:
            self._loop()
        except Exception as error:
            self.problem = self._report(EventKind.FAILED, repr(error)).text
            raise

    def _loop(self) -> None:
        self._emit(Due.ALL)
        for remark in self.simulation.remarks:
            self._report(EventKind.NOTE, remark)
        self.pacer.anchor()
        while not self._stopping:
            self._requests.serve_all()
            if self.paused:
                if not self._wake.wait(REPEAT_PERIOD):
                    self._emit(Due.ALL, repeated=True)
                self._wake.clear()
                self.pacer.anchor()
                continue
            steps = self._steps_until_due()
            self._advance(steps)
            factor = self.rates.real_time_factor
            if factor > 0.0:
                self.pacer.plan(steps * self.simulation.step_size / factor)
                while not (self.pacer.wait(self._wake) or self._stopping or self.paused):
                    self._wake.clear()
                    self._requests.serve_all()
            else:
                self.pacer.pass_deadline()
                self._wait_for_output()

    def _wait_for_output(self) -> None:
        while self.output.qsize() > BACKLOG and not self._stopping:
            time.sleep(1e-3)

    def _schedules(self) -> dict[Due, PublicationSchedule | None]:
        rates, step_size = self.rates, self.simulation.step_size
        return {
            Due.STATE: publication_schedule(rates.publish, step_size),
            Due.CLOCK: publication_schedule(rates.clock, step_size),
            Due.MARKERS: publication_schedule(rates.markers, step_size),
            Due.VIEW: publication_schedule(rates.view, step_size),
        }

    def _steps_until_due(self) -> int:
        """Steps to take at once: those of one wake-up period, and none beyond the next publication."""
        factor = self.rates.real_time_factor
        steps = max(1, round(WAKE_UP_PERIOD * factor / self.simulation.step_size)) if factor > 0.0 else FAST_BATCH
        for schedule in self._schedules().values():
            if schedule is not None:
                steps = min(steps, schedule.next_tick(self._clock_ticks) - self._clock_ticks)
        return steps

    def _advance(self, steps: int) -> str:
        """Apply commands, take the steps, hand out a snapshot if due; returns the problem, or ""."""
        self._apply_commands()
        began = time.perf_counter()
        try:
            self.simulation.step(steps)
        except DivergedError as error:
            self._set_paused(True)
            self.problem = self._report(EventKind.DIVERGED, str(error)).text
            return str(error)
        self.ticks += steps
        self._check_error_estimate()
        self.counters.stepping += time.perf_counter() - began
        if due := self._due():
            self._emit(due)
        return ""

    def _due(self) -> Due:
        """What is due at the present tick."""
        due = Due.NONE
        for message, schedule in self._schedules().items():
            if schedule is not None and schedule.is_due(self._clock_ticks):
                due |= message
        return due

    def _apply_commands(self) -> None:
        time_now = self.ticks * self.simulation.step_size
        for due in self.commands.due(time_now):
            self.simulation.set_efforts(due.efforts)
            self._report(due.kind, AppliedEfforts(due.efforts, due.expired))
        for due_wrench in self.wrenches.due(time_now):
            due_wrench.wrench.apply(self.simulation)
            part = due_wrench.wrench.part
            inputs = self.simulation.inputs[self.wrenches.input_range(part)].copy()
            self._report(due_wrench.kind, AppliedWrench(part, inputs))

    def _check_error_estimate(self) -> None:
        """Warn once of a step that is too large, and again when the estimated error has grown tenfold."""
        estimate = self.simulation.error_estimate
        if estimate > self._error_threshold:
            self._error_threshold = 10.0 * estimate
            self.advice = self.simulation.step_advice or ""
            self._report(EventKind.WARNING, self.advice)

    def _emit(self, due: Due, repeated: bool = False) -> None:
        if self.output.qsize() >= MAX_WAITING:
            self.counters.dropped += 1
            return
        if repeated and self._last_viewed == self.ticks:
            due &= ~Due.VIEW
        if Due.STATE in due:
            self._last_emitted = self.ticks
        if Due.VIEW in due:
            self._last_viewed = self.ticks
        self.output.put(
            Snapshot(
                ticks=self.ticks,
                clock_ns=self.clock_ns,
                time=self.simulation.time,
                y=self.simulation.state,
                inputs=self.simulation.inputs.copy(),
                start_energy=self.simulation.start_energy,
                due=due,
                repeated=repeated,
            )
        )

    def _report(self, kind: EventKind, payload: Payload = None) -> Event:
        event = Event(kind, payload, self.ticks, self.clock_ns)
        self.output.put(event)
        return event

    def _set_paused(self, paused: bool) -> None:
        if paused != self.paused:
            self.paused = paused
            self._report(EventKind.PAUSED if paused else EventKind.RUNNING)
            self._emit(Due.ALL)

    def _reset(self, rewind_clock: bool, state: bool) -> str:
        began = time.perf_counter()
        if state:
            try:
                self.simulation.reset()
            except ValueError as error:
                return f"the start state cannot be reached with the current live values: {error}"
            self._error_threshold, self.problem, self.advice = TOLERATED, "", ""
            self.commands.clear()
            self.wrenches.clear()
        if rewind_clock:
            self._clock_offset = self.ticks
        self._report(EventKind.RESET if state else EventKind.CLOCK_RESET)
        self._emit(Due.ALL)
        self.pacer.delay(time.perf_counter() - began)  # no step has to make up for it
        return ""

    def _apply_live(self, prepared: PreparedValues) -> str:
        try:
            self.simulation.apply_live(prepared)
        except CommandError as error:
            return str(error)
        self._report(EventKind.LIVE_VALUES, ChangedValues(prepared.changes, self.simulation.live))
        return ""

    def _step_paused(self, steps: int) -> str:
        if not self.paused:
            return "the simulation is running: pause it before stepping"
        left = steps
        while left > 0 and not self._stopping:
            batch = min(left, self._steps_until_due())
            if problem := self._advance(batch):
                return problem
            left -= batch
            self._wait_for_output()
        if self._last_emitted != self.ticks:
            self._emit(Due.STATE | Due.CLOCK)  # markers and the Rerun scene follow with the next repeated state
        return ""
