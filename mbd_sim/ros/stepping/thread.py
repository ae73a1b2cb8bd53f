"""The thread that steps the simulation in real time and emits snapshots and events. Independent of ROS."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Mapping
from queue import Empty, SimpleQueue
from typing import Generic, ParamSpec

from mbd_sim.base.errors import CommandError, DivergedError
from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.ros.commands.command_buffer import CommandBuffer
from mbd_sim.ros.commands.wrenches import WrenchBuffer
from mbd_sim.ros.stepping.clock import FollowedClock, Followers, Rates
from mbd_sim.ros.stepping.pacing import Pacer
from mbd_sim.ros.stepping.run import SteppedRun
from mbd_sim.simulation.run.changes import StateValues
from mbd_sim.simulation.run.events import EventKind
from mbd_sim.simulation.run.simulation import BaseSimulation

P = ParamSpec("P")


class RequestQueue(Generic[P]):
    """Functions to call in the serving thread, in the order of their submission."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """`wake` is called after each submission, to interrupt the serving thread's sleep."""
        self._wake = wake
        self._requests: SimpleQueue[tuple[Callable[P, None], threading.Event]] = SimpleQueue()

    def submit(self, action: Callable[P, None]) -> threading.Event:
        """Add a request and return at once; the event is set when it has been served."""
        done = threading.Event()
        self._requests.put((action, done))
        self._wake()
        return done

    def call(self, action: Callable[P, None], server: threading.Thread, *, await_start: bool = False) -> None:
        """Add a request and wait until the serving thread has served it, or has ended.

        :param await_start: wait also for a thread that has not started yet; otherwise it serves the request later.
        """
        done = self.submit(action)
        while not done.wait(0.1):
            if not server.is_alive() and not (await_start and server.ident is None):
                return

    def serve_next(self, *args: P.args, **kwargs: P.kwargs) -> bool:
        """Serve the oldest request; False if there is none."""
        try:
            action, done = self._requests.get_nowait()
        except Empty:
            return False
        try:
            action(*args, **kwargs)
        finally:
            done.set()
        return True

    def serve_all(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Serve all requests that wait."""
        while self.serve_next(*args, **kwargs):
            pass


WAKE_UP_PERIOD = 1e-3  # s of real time between wake-ups where the step is shorter
FAST_BATCH = 1000  # most steps between requests
REPEAT_PERIOD = 0.5  # s of real time between repeated states while paused, for subscribers that join later
BACKLOG = 200  # snapshots that may wait for publication when running as fast as possible


class SteppingThread:
    """Steps a simulation until it is stopped; commands and requests take effect between two steps."""

    def __init__(
        self,
        simulation: BaseSimulation,
        commands: CommandBuffer,
        rates: Rates,
        *,
        wrenches: WrenchBuffer | None = None,
        paused: bool = False,
        followed: FollowedClock | None = None,
        start: StateValues | None = None,
    ) -> None:
        """Prepare the thread; with a `followed` clock, steps are taken up to its time, instead of in real time.

        :param start: to which resets return, if it is not that of the file.
        """
        wrenches = wrenches or WrenchBuffer(simulation.wrench_map, simulation.model.part_names, commands.timeout)
        self.run = SteppedRun(simulation, commands, wrenches, start, silent=followed is not None)
        self.simulation, self.clock, self.rates = simulation, self.run.clock, rates
        self._output = self.run.output
        self.output, self.counters = self._output.queue, self._output.counters
        self.pacer = Pacer()
        self._remarks = simulation.remarks  # whose search imports the schema
        self.paused, self.followed = paused, followed
        self.followers = Followers()  # threads of this program that follow this clock
        self._wake = threading.Event()
        self._requests: RequestQueue[[]] = RequestQueue(self._wake.set)
        self._live_lock = threading.Lock()
        if followed is not None:
            followed.on_time = self._wake.set
        self._stopping = self._follows = self._failed = False
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
        self.simulation.listen(None)
        self.output.put(None)

    @property
    def ticks(self) -> int:
        """The steps since the node started."""
        return self.clock.ticks

    def pause(self, paused: bool) -> None:
        """Pause or resume; returns when it has taken effect."""
        self._requests.call(lambda: self._set_paused(paused), self._thread)

    def reset(self, rewind_clock: bool = False, *, state: bool = True) -> str:
        """Reset the state to the start state, the clock to zero, or both; returns the problem, or "" on success."""
        return self.between_steps(lambda: self._reset(rewind_clock, state))

    def step(self, steps: int, each: Callable[[], bool] | None = None) -> str:
        """Take some steps while paused; returns the problem, or "" on success.

        :param each: is called after each single step, in the stepping thread; the rest is left out if it returns false.
        """
        return self.between_steps(lambda: self._step_paused(steps, each))

    def set_live(self, changes: Mapping[str, float], *, reassemble: bool = False) -> str:
        """Change live values of the mechanism; returns the problem, and then nothing has changed, or "" on success.

        With `reassemble`, lengths in closed loops may change: see `Simulation.set_live`. Values are validated in the
        calling thread. Changes from several threads are applied one after another.
        """
        with self._live_lock:
            try:
                prepared = self.simulation.prepare_live(changes, reassemble=reassemble)
            except CommandError as error:
                return str(error)
            change = self.run.live_change(prepared)
            return self.between_steps(lambda: self._set_live(change))

    def set_state(self, given: StateValues | Callable[[], StateValues], *, told: bool = True) -> str:
        """Set positions and speeds by name; returns the problem, and then nothing has changed, or "" on success.

        :param given: the values, or a function of the present state, which is called between two steps.
        :param told: see `SteppedRun.set_state`.
        """
        return self.between_steps(lambda: self._set_state(given, told))

    def warn(self, text: str) -> None:
        """Report a warning as an event between two steps; returns at once."""
        self.tell(EventKind.WARNING, text)

    def tell(self, kind: EventKind, text: str) -> None:
        """Report an event between two steps; returns at once."""

        def report() -> None:
            self._output.report(kind, text)

        self._requests.submit(report)

    def shown(self) -> Snapshot:
        """The newest state that is known, to be shown on a page; a newer one follows with the next step."""
        self._output.shows = True
        return self._output.shown

    def request_moment(self) -> None:
        """Have a state for a recording put into the output between two steps; returns at once."""
        if threading.current_thread() is self._thread:  # between two steps of a request, perhaps of many
            self._output.put_moment()
        else:
            self._requests.submit(self._output.put_moment)

    def moment(self) -> Snapshot:
        """Everything that determines the motion from here on; for the stepping thread, or before it starts."""
        return self._output.journal.snapshot(Due.RECORDING)

    def restart_schedule(self) -> None:
        """Schedule the next steps from now on, as after a change of the real-time factor."""
        self._requests.call(self.pacer.anchor, self._thread)

    def between_steps(self, action: Callable[[], str]) -> str:
        """The answer of an action that the stepping thread executes between two steps."""
        answers: list[str] = []
        self._requests.call(lambda: answers.append(action()), self._thread, await_start=True)
        if answers:
            return answers[0]
        return "an error of the program, see the console" if self._thread.is_alive() else "the simulation has stopped"

    def _run(self) -> None:
        self._guarded(self._begin)
        while not self._stopping:
            self._guarded(self._loop)

    def _guarded(self, action: Callable[[], None]) -> None:
        """Call a function; its failure pauses the run until a reset."""
        try:
            action()
        except Exception as error:
            traceback.print_exception(error)
            self.run.report_failure(error)
            self._failed = self._failed or not self.paused
            self.paused = True

    def _begin(self) -> None:
        self.followers.take(self.clock.ns)
        if self.followed is None:
            self._output.emit(Due.NEW)
        for remark in self._remarks:
            self._output.report(EventKind.NOTE, remark)
        self.pacer.anchor()

    def _loop(self) -> None:
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
                    self._output.emit(Due.ALL, repeated=True)
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

    @property
    def waits_for_clock(self) -> bool:
        """Whether there is a clock to follow that has not begun."""
        return self.followed is not None and not self._follows

    @property
    def has_ended(self) -> bool:
        """Whether the thread has been stopped."""
        return self._stopping

    @property
    def is_stepping(self) -> bool:
        """Whether the thread runs and is not paused."""
        return self._thread.is_alive() and not self.paused

    @property
    def lag(self) -> float:
        """How far the node is behind the clock that it follows, in s."""
        if self.followed is None or self.followed.time_ns is None or self.waits_for_clock:
            return 0.0
        return max(0, self.followed.time_ns - self.clock.ns) * 1e-9

    def _follow(self, followed: FollowedClock) -> None:
        """Take steps up to the time of the followed clock, or wait until it goes on."""
        time_ns = followed.time_ns or 0
        steps = min(self._steps_until_due(), (time_ns - self.clock.ns) // self.clock.step_ns)
        if steps > 0:
            self._advance(steps)
            self._wait_for_output()
        else:
            self._wake.wait(REPEAT_PERIOD)
            self._wake.clear()
            if self._output.silence >= REPEAT_PERIOD:  # a leader that is paused repeats its time
                self._output.emit(Due.ALL, repeated=self._output.last_emitted == self.ticks)
        self.pacer.pass_deadline()

    def _follow_beginning(self, time_ns: int) -> None:
        """Set the clock to a followed clock that has begun; return to the start if it has restarted."""
        restarted, self._follows = self._follows, True
        self.clock.set(time_ns)
        self._output.begin()
        if not restarted:
            self._output.report(EventKind.NOTE, f"following /clock from {1e-9 * time_ns:.9g} s")
            self._output.emit(Due.NEW)
            return
        self._output.report(EventKind.CLOCK_SET, f"to {1e-9 * time_ns:.9g} s: /clock has restarted")
        if problem := self._reset(rewind_clock=False, state=True):
            self._output.report(EventKind.WARNING, f"/clock has restarted, but {problem}")

    def _wait_for_output(self) -> None:
        while (self.output.qsize() > BACKLOG or self.followers.are_far_behind) and not self._stopping:
            time.sleep(1e-3)

    @property
    def _pace(self) -> float:
        """The real-time factor; 0 where a clock or requests decide: those to a paused run are served at full speed."""
        return self.rates.real_time_factor if self.followed is None and not self.paused else 0.0

    def _steps_until_due(self) -> int:
        """Steps to take at once: none beyond the next publication or sample, and in real time one wake-up period."""
        steps = FAST_BATCH
        if pace := self._pace:
            steps = min(steps, max(1, round(WAKE_UP_PERIOD * pace / self.simulation.step_size)))
        steps = self.run.steps_to_command(steps)
        return self._output.steps_until_due(self.rates, at_most=steps)

    def _advance(self, steps: int) -> str:
        """Apply commands, take the steps, hand out a snapshot if due; returns the problem, or ""."""
        try:
            self.run.advance(steps)
        except DivergedError as error:
            self._set_paused(True)
            self.run.report_divergence(error)
            return str(error)
        self.followers.take(self.clock.ns)
        if due := self._output.due(self.rates):
            self._output.emit(due, in_real_time=self._pace > 0.0)
        self._output.show()
        return ""

    def _set_paused(self, paused: bool) -> None:
        self._failed = False
        if paused != self.paused:
            self.paused = paused
            if self.lag and not paused:  # the clock has gone on, the motion has not
                time_ns = self.clock.ns + round(1e9 * self.lag)
                self.clock.set(time_ns)
                self._output.report(EventKind.CLOCK_SET, f"to {1e-9 * time_ns:.9g} s after the pause")
            self._output.report(EventKind.PAUSED if paused else EventKind.RUNNING)
            self._output.emit(Due.ALL)

    def _reset(self, rewind_clock: bool, state: bool) -> str:
        if rewind_clock and self.followed is not None:
            return "the clock is that of /clock: reset the node that publishes it, and set reset_rewinds_clock to false"
        began = time.perf_counter()
        if problem := self.run.reset(rewind_clock, state):
            return problem
        if rewind_clock:
            self.followers.take(self.clock.ns)
        self._show_change(Due.NEW if state else Due.ALL, began)
        if state and self._failed:
            self._set_paused(False)
        return ""

    def _set_state(self, given: StateValues | Callable[[], StateValues], told: bool) -> str:
        began = time.perf_counter()
        if not (problem := self.run.set_state(given, told=told)):
            self._show_change(Due.NEW, began)
        return problem

    def _set_live(self, change: Callable[[], str]) -> str:
        began, before = time.perf_counter(), self.simulation.state.tobytes()
        problem = change()
        if self.simulation.state.tobytes() != before:  # the mechanism has been assembled anew
            self._show_change(Due.ALL, began)
        self._output.show()
        return problem

    def _show_change(self, due: Due, began: float) -> None:
        """Hand out a snapshot after a change that began at a time in s of the steady clock."""
        self._output.emit(due)
        self.pacer.delay(time.perf_counter() - began)  # no step has to make up for it

    def _step_paused(self, steps: int, each: Callable[[], bool] | None) -> str:
        if not self.paused:
            return "the simulation is running: pause it before stepping"
        if self.waits_for_clock:
            return "no /clock has arrived yet: start the node that publishes it"
        left = steps
        while left > 0 and not self._stopping:
            batch = min(left, self._steps_until_due()) if each is None else 1
            if problem := self._advance(batch):
                return problem
            left -= batch
            self._wait_for_output()
            if each is not None and not each() and left > 0:
                return ""  # what is shown at the end follows with the rest
        if self._output.last_emitted != self.ticks:
            self._output.emit(Due.STATE | Due.CLOCK)  # markers and the Rerun scene follow with the next repeated state
        return ""
