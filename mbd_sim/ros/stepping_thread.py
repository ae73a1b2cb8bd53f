"""The simulation in its own thread, in real time: steps, and hands out snapshots. Knows no ROS."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from queue import SimpleQueue

from mbd_sim.errors import CommandError, DivergedError
from mbd_sim.recording.run_metadata import Moment
from mbd_sim.ros.command_buffer import CommandBuffer
from mbd_sim.ros.pacing import Pacer
from mbd_sim.ros.snapshots import Counters, Item, Snapshot
from mbd_sim.ros.wrench_buffer import WrenchBuffer
from mbd_sim.simulation.events import AppliedEfforts, AppliedWrench, ChangedValues, Event, EventKind, Payload
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.simulation.step_advice import TOLERATED

WAKE_UP = 1e-3  # seconds of real time between wake-ups, where the step is shorter
FAST_BATCH = 1000  # steps a wake-up when running as fast as possible
REPEAT = 0.5  # seconds of real time between repeated states while paused, for those who come to listen later
BACKLOG = 200  # snapshots that may wait when running as fast as possible
MOST_WAITING = 10_000  # snapshots that may wait at all; when what leaves the node is that slow, they are dropped


@dataclass
class Rates:
    """What may change while it runs: `real_time_factor` 0 is as fast as possible; rates in Hz of simulated time."""

    real_time_factor: float = 1.0
    publish: float = 100.0
    clock: float = 200.0


class Runner:
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
        self._emitted = -1  # the tick of the last state that was handed out
        self._clock_offset = 0
        self._bearable = TOLERATED
        self._step_ns = round(simulation.step_size * 1e9)
        self._requests: SimpleQueue[tuple[Callable[[], None], threading.Event]] = SimpleQueue()
        self._wake = threading.Event()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="stepper", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    @property
    def thread_id(self) -> int:
        """The system's number of the stepping thread, 0 before it has started."""
        return self._thread.native_id or 0

    def stop(self) -> None:
        """End the thread and the output; returns when it has ended."""
        self._stopping = True
        self._wake.set()
        self._thread.join()
        self.output.put(None)

    @property
    def clock_ns(self) -> int:
        """The node's simulated clock in ns; it never goes back unless a reset asks for it."""
        return (self.ticks - self._clock_offset) * self._step_ns

    def pause(self, paused: bool) -> None:
        """Pause or go on; returns when it is so."""
        self._ask(lambda: self._set_paused(paused))

    def reset(self, rewind_clock: bool = False, *, state: bool = True) -> str:
        """Back to the start state, unless that is not to be; the clock goes on, or starts at zero again.

        Returns what went wrong, or "".
        """
        return self._ask_whether(lambda: self._reset(rewind_clock, state))

    def step(self, steps: int) -> str:
        """Take some steps while paused; returns what went wrong, or ""."""
        return self._ask_whether(lambda: self._step_paused(steps))

    def set_live(self, changes: Mapping[str, float]) -> str:
        """Change live values of the mechanism; returns what went wrong, or "": then nothing has changed."""
        return self._ask_whether(lambda: self._set_live(changes))

    def mark(self) -> None:
        """Ask for a `Moment` in the output, between two steps; returns at once."""
        self._requests.put((lambda: self.output.put(self.moment()), threading.Event()))
        self._wake.set()

    def moment(self) -> Moment:
        """All that the motion depends on from here on; for the stepping thread, or before it starts."""
        return Moment.of(self.simulation, self.ticks, self.clock_ns)

    def repace(self) -> None:
        """Start the schedule anew, as after a change of the real-time factor."""
        self._ask(self.pacer.anchor)

    def _ask_whether(self, action: Callable[[], str]) -> str:
        outcome: list[str] = []
        self._ask(lambda: outcome.append(action()))
        return outcome[0] if outcome else "the simulation has stopped"

    def _ask(self, action: Callable[[], None]) -> None:
        done = threading.Event()
        self._requests.put((action, done))
        self._wake.set()
        while not done.wait(0.1):
            if not self._thread.is_alive():
                return

    def _run(self) -> None:
        try:
            self._step_on()
        except Exception as error:
            self.problem = self._report(EventKind.FAILED, repr(error)).text
            raise

    def _step_on(self) -> None:
        self._emit(state=True, clock=True)
        self.pacer.anchor()
        while not self._stopping:
            self._serve_requests()
            if self.paused:
                if not self._wake.wait(REPEAT):
                    self._emit(state=True, clock=True, repeated=True)
                self._wake.clear()
                self.pacer.anchor()
                continue
            steps = self._steps_until_due()
            self._advance(steps)
            factor = self.rates.real_time_factor
            if factor > 0.0:
                self.pacer.plan(steps * self.simulation.step_size / factor)
                while not self.pacer.wait(self._wake) and not self._stopping:
                    self._wake.clear()
                    self._serve_requests()
            else:
                self.pacer.anchor()
                self._let_output_catch_up()

    def _let_output_catch_up(self) -> None:
        while self.output.qsize() > BACKLOG and not self._stopping:
            time.sleep(1e-3)

    def _serve_requests(self) -> None:
        while not self._requests.empty():
            action, done = self._requests.get()
            action()
            done.set()

    def _every(self, rate: float) -> int:
        """Ticks between two publications at `rate`; 0 where it is never due."""
        return max(1, round(1.0 / (rate * self.simulation.step_size))) if rate > 0.0 else 0

    def _steps_until_due(self) -> int:
        """Steps to take at once: at most a wake-up's worth, and none beyond the next publication."""
        factor = self.rates.real_time_factor
        batch = max(1, round(WAKE_UP * factor / self.simulation.step_size)) if factor > 0.0 else FAST_BATCH
        for rate in (self.rates.publish, self.rates.clock):
            every = self._every(rate)
            if every:
                batch = min(batch, every - self.ticks % every)
        return batch

    def _advance(self, steps: int) -> str:
        """Apply what was commanded, take the steps, hand out what is due; returns what went wrong, or ""."""
        self._apply_commands()
        began = time.perf_counter()
        try:
            self.simulation.step(steps)
        except DivergedError as error:
            self._set_paused(True)
            self.problem = self._report(EventKind.DIVERGED, str(error)).text
            return str(error)
        self.ticks += steps
        self._warn()
        self.counters.stepping += time.perf_counter() - began
        publish, clock = self._every(self.rates.publish), self._every(self.rates.clock)
        state_due = bool(publish) and self.ticks % publish == 0
        clock_due = bool(clock) and self.ticks % clock == 0
        if state_due or clock_due:
            self._emit(state_due, clock_due)
        return ""

    def _apply_commands(self) -> None:
        time_now = self.ticks * self.simulation.step_size
        due = self.commands.due(time_now)
        if due is not None:
            self.simulation.set_efforts(due.efforts)
            self._report(due.kind, AppliedEfforts(due.efforts))
        for pushed in self.wrenches.due(time_now):
            pushed.wrench.apply(self.simulation)
            part = pushed.wrench.part
            inputs = self.simulation.inputs[self.wrenches.place(part)].copy()
            self._report(pushed.kind, AppliedWrench(part, inputs))

    def _warn(self) -> None:
        """Say that the step is too large, once, and again where it has become ten times worse."""
        estimate = self.simulation.error_estimate
        if estimate > self._bearable:
            self._bearable = 10.0 * estimate
            self.advice = self.simulation.step_advice or ""
            self._report(EventKind.WARNING, self.advice)

    def _emit(self, state: bool, clock: bool, repeated: bool = False) -> None:
        if self.output.qsize() >= MOST_WAITING:
            self.counters.dropped += 1
            return
        if state:
            self._emitted = self.ticks
        self.output.put(self._snapshot(state, clock, repeated))

    def _snapshot(self, state: bool, clock: bool, repeated: bool) -> Snapshot:
        return Snapshot(
            ticks=self.ticks,
            clock_ns=self.clock_ns,
            time=self.simulation.time,
            y=self.simulation.state,
            inputs=self.simulation.inputs.copy(),
            start_energy=self.simulation.start_energy,
            state=state,
            clock=clock,
            repeated=repeated,
        )

    def _report(self, kind: EventKind, payload: Payload = None) -> Event:
        event = Event(kind, payload, self.ticks, self.clock_ns)
        self.output.put(event)
        return event

    def _set_paused(self, paused: bool) -> None:
        if paused != self.paused:
            self.paused = paused
            self._report(EventKind.PAUSED if paused else EventKind.RUNNING)
            self._emit(state=True, clock=True)

    def _reset(self, rewind_clock: bool, state: bool) -> str:
        if state:
            try:
                self.simulation.reset()
            except ValueError as error:
                return f"no start state with these live values: {error}"
            self._bearable, self.problem, self.advice = TOLERATED, "", ""
            self.commands.clear()
            self.wrenches.clear()
        if rewind_clock:
            self._clock_offset = self.ticks
        self._report(EventKind.RESET if state else EventKind.CLOCK_RESET)
        self._emit(state=True, clock=True)
        return ""

    def _set_live(self, changes: Mapping[str, float]) -> str:
        try:
            self.simulation.set_live(changes)
        except CommandError as error:
            return str(error)
        self._report(EventKind.LIVE_VALUES, ChangedValues(dict(changes), self.simulation.live))
        return ""

    def _step_paused(self, steps: int) -> str:
        if not self.paused:
            return "running: pause before stepping"
        left = steps
        while left > 0 and not self._stopping:
            batch = min(left, self._steps_until_due())
            if problem := self._advance(batch):
                return problem
            left -= batch
            self._let_output_catch_up()
        if self._emitted != self.ticks:
            self._emit(state=True, clock=True)
        return ""
