"""The thread that steps the simulation in real time and emits snapshots and events. Independent of ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from queue import SimpleQueue

from mbd_sim.errors import CommandError, DivergedError
from mbd_sim.messages.snapshot import Due, Snapshot
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.followed_clock import FollowedClock
from mbd_sim.ros.pacing import Pacer
from mbd_sim.ros.rates import Rates
from mbd_sim.ros.requests import RequestQueue
from mbd_sim.ros.snapshots import Counters, Item
from mbd_sim.ros.wrench_buffer import WrenchBuffer
from mbd_sim.simulation.events import (
    AppliedEfforts,
    AppliedWrench,
    ChangedValues,
    Event,
    EventKind,
    NewState,
    Payload,
)
from mbd_sim.simulation.live_values import PreparedValues
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.simulation.state_values import StateValues
from mbd_sim.simulation.step_advice import TOLERATED

WAKE_UP_PERIOD = 1e-3  # s of real time between wake-ups where the step is shorter
FAST_BATCH = 1000  # steps between requests when running as fast as possible
REPEAT_PERIOD = 0.5  # s of real time between repeated states while paused, for subscribers that join later
BACKLOG = 200  # snapshots that may wait for publication when running as fast as possible
MAX_LEAD = 0.5  # simulated s by which a thread may be ahead of those that follow, as fast as possible
MAX_WAITING = 10_000  # snapshots that may wait at all; when publishing is that slow, further ones are dropped


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
        followed: FollowedClock | None = None,
    ) -> None:
        """Prepare the thread; with a `followed` clock, steps are taken up to its time, instead of in real time."""
        self.simulation, self.commands, self.rates = simulation, commands, rates
        self.wrenches = wrenches or WrenchBuffer(simulation.wrench_map, simulation.model.part_names, commands.timeout)
        self.output: SimpleQueue[Item] = SimpleQueue()
        self.pacer = Pacer()
        self.counters = Counters()
        self.paused = paused
        self.problem = self.advice = ""
        self.ticks = 0
        self.followed = followed
        self.start_values: StateValues | None = None  # to which a reset returns; None: the start of the file
        self.followers: list[SteppingThread] = []  # threads of this program that follow this clock
        self._held_moments = 0  # requested before the followed clock has begun
        self._last_emitted = self._last_viewed = -1  # the tick of the last state that was emitted, and for the viewer
        self._emitted_at = 0.0  # s of the steady clock
        self._clock_zero_ns = 0  # the clock at tick 0
        self._error_threshold = TOLERATED
        self._step_ns = round(simulation.step_size * 1e9)
        self._wake = threading.Event()
        self._requests: RequestQueue[[]] = RequestQueue(self._wake.set)
        self._live_lock = threading.Lock()
        if followed is not None:
            followed.on_time = self._wake.set
        self._stopping = self._follows = False
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
        if self._thread.is_alive():
            self._thread.join()
        self.output.put(None)

    @property
    def clock_ns(self) -> int:
        """The node's simulated clock in ns; it goes back only when a reset asks for it, or the followed clock does."""
        return self._clock_zero_ns + self.ticks * self._step_ns

    @property
    def _clock_ticks(self) -> int:
        """The whole steps since the clock was zero."""
        return self.clock_ns // self._step_ns

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

    def set_state(self, given: StateValues) -> str:
        """Set positions and speeds by name; returns the problem, and then nothing has changed, or "" on success."""
        return self._call(lambda: self._set_state(given))

    def warn(self, text: str) -> None:
        """Report a warning as an event between two steps; returns at once."""

        def report() -> None:
            self._report(EventKind.WARNING, text)

        self._requests.submit(report)

    def request_moment(self) -> None:
        """Have a `Moment` put into the output between two steps; returns at once."""
        self._requests.submit(self._put_moment)

    def moment(self) -> Moment:
        """Everything that determines the motion from here on; for the stepping thread, or before it starts."""
        return Moment.of(self.simulation, self.ticks, self.clock_ns)

    def restart_schedule(self) -> None:
        """Schedule the next steps from now on, as after a change of the real-time factor."""
        self._requests.call(self.pacer.anchor, self._thread)

    def _call(self, action: Callable[[], str]) -> str:
        """The answer of an action that the stepping thread executes between two steps."""
        answers: list[str] = []
        self._requests.call(lambda: answers.append(action()), self._thread, await_start=True)
        return answers[0] if answers else "the simulation has stopped"

    def _run(self) -> None:
        try:
            self._loop()
        except Exception as error:
            self.problem = self._report(EventKind.FAILED, repr(error)).text
            raise

    def _loop(self) -> None:
        self._lead()
        if self.followed is None:
            self._emit(Due.ALL)
        for remark in self.simulation.remarks:
            self._report(EventKind.NOTE, remark)
        self.pacer.anchor()
        while not self._stopping:
            self._requests.serve_all()
            if self.followed is not None and (beginning := self.followed.take_beginning()) is not None:
                self._follow_beginning(beginning)
            if self.waits_for_clock:
                self._wake.wait()
                self._wake.clear()
                continue
            if self.paused:
                if not self._wake.wait(REPEAT_PERIOD):
                    self._emit(Due.ALL, repeated=True)
                self._wake.clear()
                self.pacer.anchor()
                continue
            if self.followed is not None:
                self._follow(self.followed)
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

    def _put_moment(self) -> None:
        if self.waits_for_clock:
            self._held_moments += 1
        else:
            self.output.put(self.moment())

    @property
    def waits_for_clock(self) -> bool:
        """Whether there is a clock to follow that has not begun."""
        return self.followed is not None and not self._follows

    @property
    def lag(self) -> float:
        """How far the node is behind the clock that it follows, in s."""
        if self.followed is None or self.followed.time_ns is None or self.waits_for_clock:
            return 0.0
        return max(0, self.followed.time_ns - self.clock_ns) * 1e-9

    def _follow(self, followed: FollowedClock) -> None:
        """Take steps up to the time of the followed clock, or wait until it goes on."""
        time_ns = followed.time_ns or 0
        steps = min(self._steps_until_due(), (time_ns - self.clock_ns) // self._step_ns)
        if steps > 0:
            self._advance(steps)
            self._wait_for_output()
        else:
            self._wake.wait(REPEAT_PERIOD)
            self._wake.clear()
            if time.perf_counter() - self._emitted_at >= REPEAT_PERIOD:  # a leader that is paused repeats its time
                self._emit(Due.ALL, repeated=self._last_emitted == self.ticks)
        self.pacer.pass_deadline()

    def _follow_beginning(self, time_ns: int) -> None:
        """Set the clock to a followed clock that has begun; return to the start if it has restarted."""
        restarted, self._follows = self._follows, True
        self._clock_zero_ns = time_ns - self.ticks * self._step_ns
        for _ in range(self._held_moments):
            self.output.put(self.moment())
        self._held_moments = 0
        if not restarted:
            self._report(EventKind.NOTE, f"following /clock from {1e-9 * time_ns:.9g} s")
            self._emit(Due.ALL)
            return
        self._report(EventKind.CLOCK_SET, f"to {1e-9 * time_ns:.9g} s: /clock has restarted")
        if problem := self._reset(rewind_clock=False, state=True):
            self._report(EventKind.WARNING, f"/clock has restarted, but {problem}")

    def _wait_for_output(self) -> None:
        while (self.output.qsize() > BACKLOG or self._is_far_ahead()) and not self._stopping:
            time.sleep(1e-3)

    def _lead(self) -> None:
        """Pass the clock to the threads that follow."""
        for follower in self.followers:
            if follower.followed is not None:
                follower.followed.take(self.clock_ns)

    def _is_far_ahead(self) -> bool:
        """Whether a thread that follows is behind by more than `MAX_LEAD`; one that is paused or has failed is not."""
        return any(f.lag > MAX_LEAD and not f.paused and f._thread.is_alive() for f in self.followers)

    def _steps_until_due(self) -> int:
        """Steps to take at once: those of one wake-up period, and none beyond the next publication."""
        factor = self.rates.real_time_factor if self.followed is None else 0.0
        steps = max(1, round(WAKE_UP_PERIOD * factor / self.simulation.step_size)) if factor > 0.0 else FAST_BATCH
        return self.rates.steps_until_due(self._clock_ticks, self.simulation.step_size, at_most=steps)

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
        self._lead()
        self._check_error_estimate()
        self.counters.stepping += time.perf_counter() - began
        if due := self.rates.due(self._clock_ticks, self.simulation.step_size):
            self._emit(due)
        return ""

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
        if self.waits_for_clock:
            return
        if self.output.qsize() >= MAX_WAITING:
            self.counters.dropped += 1
            return
        if repeated and self._last_viewed == self.ticks:
            due &= ~Due.VIEW
        if Due.STATE in due:
            self._last_emitted, self._emitted_at = self.ticks, time.perf_counter()
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
            if self.lag and not paused:  # the clock has gone on, the motion has not
                time_ns = self.clock_ns + round(1e9 * self.lag)
                self._clock_zero_ns = time_ns - self.ticks * self._step_ns
                self._report(EventKind.CLOCK_SET, f"to {1e-9 * time_ns:.9g} s after the pause")
            self._report(EventKind.PAUSED if paused else EventKind.RUNNING)
            self._emit(Due.ALL)

    def _reset(self, rewind_clock: bool, state: bool) -> str:
        if rewind_clock and self.followed is not None:
            return "the clock is that of /clock: reset the node that publishes it, and set reset_rewinds_clock to false"
        began = time.perf_counter()
        if state:
            before = self.simulation.snapshot()
            try:
                self.simulation.reset()
                if self.start_values is not None:
                    self.simulation.set_state(*self.start_values)
            except ValueError as error:
                self.simulation.restore(before)
                return f"the start state cannot be reached with the current live values: {error}"
            self._error_threshold, self.problem, self.advice = TOLERATED, "", ""
            self.commands.clear()
            self.wrenches.clear()
        if rewind_clock:
            self._clock_zero_ns = -self.ticks * self._step_ns
            self._lead()
        self._report(EventKind.RESET if state else EventKind.CLOCK_RESET)
        if state and self.start_values is not None:
            self._report(EventKind.NEW_STATE, self._new_state())
        self._emit(Due.ALL)
        self.pacer.delay(time.perf_counter() - began)  # no step has to make up for it
        return ""

    def _new_state(self) -> NewState:
        simulation = self.simulation
        inputs, live = simulation.inputs.copy(), simulation.live
        return NewState(simulation.steps, simulation.state, inputs, simulation.start_energy, live)

    def _set_state(self, given: StateValues) -> str:
        began = time.perf_counter()
        try:
            self.simulation.set_state(*given)
        except CommandError as error:
            return str(error)
        self._error_threshold, self.problem, self.advice = TOLERATED, "", ""
        self._report(EventKind.NEW_STATE, self._new_state())
        self._report(EventKind.NOTE, f"state set: {given}")
        self._emit(Due.ALL)
        self.pacer.delay(time.perf_counter() - began)
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
        if self.waits_for_clock:
            return "no /clock has arrived yet: start the node that publishes it"
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
