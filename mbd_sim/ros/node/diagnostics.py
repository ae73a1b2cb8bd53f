"""`/diagnostics`, once a second: whether time is kept, energies balance, and commands are accepted."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from mbd_sim.base.errors import counted, listed
from mbd_sim.base.geometry.pose import Array
from mbd_sim.recordings.messages.events import attained_rate
from mbd_sim.recordings.messages.topics import DIAGNOSTICS
from mbd_sim.ros.node.subscriptions import Subscriptions, printable
from mbd_sim.ros.publishing.publishers import TopicPublisher
from mbd_sim.ros.publishing.thread import PublishingThread
from mbd_sim.ros.stepping.pacing import DurationSummary
from mbd_sim.ros.stepping.realtime import CollectionTime, waiting_time
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.model.model import UNKNOWN_ENERGY, Model

PERIOD = 1.0  # s of the steady clock
WARNING_PERIOD = 30.0  # s between warnings of bad timing on the console
MAX_LAG = 1.0  # simulated s behind a clock that is followed
MAX_SLOWNESS = 0.01  # relative shortfall of the real-time factor
MAX_RESIDUAL = 1e-6  # energy residual, relative to the energies
MAX_VIOLATION = 1e-6  # of the constraints, in m and m/s
MAX_WAITING = 1000  # snapshots that may wait to be published
LARGE_SHARE = 0.1  # of the last second, from which something counts as the cause of lost time
BUSY = "other programs are using the processor"
PUBLISHING = "publishing takes {share:.0%} of the time: {remedy}"
LOST = (
    "{count} with states and measurements of the last second were neither published nor recorded, as too many wait "
    "to be published: {remedy}"
)
COLLECTING = "Python's garbage collector searched for {seconds:.2g} s, after requests that made many objects"
UNKNOWN = "requests to this node, or a stall of the machine, kept the interpreter busy"
STEPS_TOO_EXPENSIVE = "stepping uses all available time: use a larger step or a cheaper method"


@dataclass
class CounterSample:
    """The counters at the `time` (s) of the steady clock; two samples give rates."""

    time: float
    running: float
    simulated: float
    stepping: float
    publishing: float
    lateness: Array
    period: Array
    overruns: int
    rejected: int
    limited: int
    dropped: int
    lost: int
    collecting: float
    waiting: float


class Diagnostics:
    """Publishes diagnostics from the counters of a node's parts; call `publish` once a second."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        subscriptions: Subscriptions,
        publishing_thread: PublishingThread,
    ) -> None:
        self.stepping_thread, self.publishing_thread = stepping_thread, publishing_thread
        self.subscriptions = subscriptions
        self.model: Model = stepping_thread.simulation.model
        self.notes: list[str] = []
        self.collection = CollectionTime()
        self._node = node
        self._name = node.get_fully_qualified_name()
        self._publisher = TopicPublisher(node, DIAGNOSTICS).publisher
        self.restart()

    def restart(self) -> None:
        """Measure rates from now on."""
        self._last = self._sample()

    @property
    def recent_overruns(self) -> int:
        """How often the schedule has been restarted since the last publication."""
        return self.stepping_thread.pacer.overruns - self._last.overruns

    def publish(self) -> None:
        """Publish."""
        now = self._sample()
        statuses = [self._timing(now), self._mechanics(), self._commands(now), self._output(now)]
        self._last = now
        message = DiagnosticArray(status=statuses)
        seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        self._publisher.publish(message)

    def _sample(self) -> CounterSample:
        stepping_thread, pacer = self.stepping_thread, self.stepping_thread.pacer
        recorder = self.publishing_thread.recorder
        return CounterSample(
            time=time.perf_counter(),
            running=pacer.running,
            simulated=stepping_thread.ticks * stepping_thread.simulation.step_size,
            stepping=stepping_thread.counters.stepping,
            publishing=self.publishing_thread.busy,
            lateness=pacer.lateness.counts(),
            period=pacer.period.counts(),
            overruns=pacer.overruns,
            rejected=self.subscriptions.rejected,
            limited=self.subscriptions.commands.limited,
            dropped=self._dropped + (recorder.dropped if recorder else 0),
            lost=self.stepping_thread.counters.dropped,
            collecting=self.collection.seconds,
            waiting=waiting_time(stepping_thread.thread_id),
        )

    @property
    def _dropped(self) -> int:
        """The states that were not published."""
        return self.stepping_thread.counters.dropped + self.publishing_thread.left_out

    def _timing(self, now: CounterSample) -> DiagnosticStatus:
        last, pacer = self._last, self.stepping_thread.pacer
        elapsed = now.time - last.time
        stepping = (now.stepping - last.stepping) / elapsed
        running, requested = now.running - last.running, self.stepping_thread.rates.real_time_factor
        factor = (now.simulated - last.simulated) / running if running > 0.0 else 0.0
        text = "paused" if self.stepping_thread.paused else f"real-time factor {factor:.3f}"
        problem = self._timing_problem(now, text, factor, stepping)
        if problem:
            self._node.get_logger().warning(problem, throttle_duration_sec=WARNING_PERIOD)
        elif self.notes:
            text = "; ".join([text, *self.notes])
        lateness, period = pacer.lateness.summary(last.lateness), pacer.period.summary(last.period)
        whole_lateness, whole_period = pacer.lateness.summary(), pacer.period.summary()
        return self._status("timing", problem or text, bool(problem), {
            "real_time_factor": f"{factor:.4f}",
            "real_time_factor wanted": f"{requested:g}",
            "paused": str(self.stepping_thread.paused).lower(),
            "steps": str(self.stepping_thread.ticks),
            **_in_microseconds("lateness", lateness),
            **_in_microseconds("period", period),
            "lateness p99 of the run (us)": _microseconds(whole_lateness.p99),
            "lateness max of the run (us)": _microseconds(whole_lateness.maximum),
            "period p99 of the run (us)": _microseconds(whole_period.p99),
            "period max of the run (us)": _microseconds(whole_period.maximum),
            "overruns": str(now.overruns),
            "load of stepping (%)": f"{100.0 * stepping:.2f}",
            "load of publishing (%)": f"{100.0 * (now.publishing - last.publishing) / elapsed:.2f}",
            "garbage collection (us)": _microseconds(now.collecting - last.collecting),
        })  # fmt: skip

    def _timing_problem(self, now: CounterSample, text: str, factor: float, stepping: float) -> str:
        """The problem with the timing since the last sample, or ""; `stepping` is the fraction of time in steps."""
        requested = self.stepping_thread.rates.real_time_factor
        # Only a schedule that was restarted has lost time: pauses, resets and changes of the factor have not.
        if overruns := now.overruns - self._last.overruns:
            slow = factor < requested * (1.0 - MAX_SLOWNESS) and not self.stepping_thread.paused
            cause = STEPS_TOO_EXPENSIVE if stepping >= 0.5 else self._cause(now)
            lost = f"{text} instead of {requested:g}" if slow else f"{text}, but time was lost"
            return f"{lost}, and the schedule was restarted {overruns} times: {cause}"
        return self._clock_problem(text)

    def _cause(self, now: CounterSample) -> str:
        """What has most likely kept the steps from being taken in time since the last sample."""
        last, elapsed = self._last, now.time - self._last.time
        seconds, share = now.collecting - last.collecting, (now.publishing - last.publishing) / elapsed
        shares = {
            COLLECTING.format(seconds=seconds): seconds / elapsed,
            BUSY: (now.waiting - last.waiting) / elapsed,
            # Its thread may use all time that is left.
            PUBLISHING.format(share=share, remedy=self._lighter): share - 0.5,
        }
        cause = max(shares, key=shares.__getitem__)
        return cause if shares[cause] >= LARGE_SHARE else UNKNOWN

    @property
    def _lighter(self) -> str:
        """What makes publishing cheaper: the sensors are named if these send more messages than states have."""
        thread = self.stepping_thread
        general, step = "lower publish_rate, or request fewer outputs", thread.simulation.step_size
        rates = {one.name: one.sampling.rate or 1.0 / step for one in thread.simulation.mechanism.sensors}
        if (total := sum(rates.values())) <= attained_rate(thread.rates.publish, step):
            return general
        names = sorted(rates, key=lambda name: -rates[name])
        sent = listed([f"{name} {rates[name]:g} Hz" for name in names], 4)
        key = f"sensors: {{{names[0]}: {{rate: 50 Hz}}}}"
        return f"{total:g} measurements per simulated second ({sent}): give sensors a lower rate, {key}; or {general}"

    def _clock_problem(self, text: str) -> str:
        """The problem with the clock that the node publishes or follows, or ""."""
        thread = self.stepping_thread
        publishers = self._node.count_publishers("/clock")
        if thread.waits_for_clock:
            return "no /clock yet: start the node that publishes it, or start this one with use_sim_time:=false"
        if thread.followed is not None and publishers > 1:
            return f"{text}, but {publishers} nodes publish /clock: start all but one with use_sim_time:=true"
        if self.publishing_thread.publishes_clock and publishers > 1:
            return f"{text}, but another node publishes /clock as well: start all nodes but one with use_sim_time:=true"
        if thread.lag > MAX_LAG and not thread.paused:
            slower = "slow down the node that publishes /clock"
            return f"{text}, but {thread.lag:.1f} s behind /clock: {STEPS_TOO_EXPENSIVE}, or {slower}"
        return ""

    def _mechanics(self) -> DiagnosticStatus:
        energies, snapshot = self.publishing_thread.energies, self.publishing_thread.latest
        stepping_thread = self.stepping_thread
        values: dict[str, str] = {}
        stopped_by, advice = stepping_thread.run.problem, stepping_thread.run.advice
        problem = stopped_by and f"{stopped_by} Call ~/reset to restart."
        if energies is not None:
            values |= {"energy residual (J)": f"{energies.residual:.3e}", "energy (J)": f"{energies.total:.6g}"}
            scale = max(1e-3, *(abs(value) for value in energies))
            if not problem and math.isnan(energies.residual):
                problem = UNKNOWN_ENERGY
            elif not problem and abs(energies.residual) > MAX_RESIDUAL * scale:
                problem = advice or f"the energy balance is off by {energies.residual:.2e} J: use a smaller step"
        if snapshot is not None and self.model.row_names:
            violation = self.model.violation(*snapshot.now)
            values |= {
                "constraint violation (m)": f"{violation.position:.3e}",
                "constraint violation (m/s)": f"{violation.velocity:.3e}",
            }
            if not problem and max(violation) > MAX_VIOLATION:
                problem = "a loop or constraint is violated: use a smaller step, or run `mbd_sim check`"
        values["error of a step"] = f"{stepping_thread.simulation.error_estimate:.1e}"
        text = problem or advice or "energies balance"
        return self._status("mechanics", text, bool(problem or advice), values, error=bool(stopped_by))

    def _commands(self, now: CounterSample) -> DiagnosticStatus:
        subscriptions, commands = self.subscriptions, self.subscriptions.commands
        problem, excess = "", commands.take_excess()
        if (rejected := now.rejected - self._last.rejected) and subscriptions.last_rejection is not None:
            topic, error = subscriptions.last_rejection
            problem = (
                f"{counted(rejected, 'message')} rejected in the last second, "
                f"the last one on {topic}: {printable(str(error))}"
            )
        elif commands.lapsed:
            problem = (
                f"no command for {listed(commands.lapsed)} in {commands.timeout:g} s of simulated time: "
                "the effort there is zero. "
                "Send commands more often, or raise command_timeout (0: never)"
            )
        elif limited := now.limited - self._last.limited:
            named = f": {excess}" if excess else ""
            problem = (
                f"{counted(limited, 'command')} beyond limits in the last second, reduced to them{named}. "
                "Command positions within 'limits', velocities up to 'velocity_limit', and efforts up to 'effort_limit'"
            )
            self._node.get_logger().warning(problem, throttle_duration_sec=WARNING_PERIOD)
        return self._status("commands", problem or "OK", bool(problem), {
            "accepted": str(subscriptions.accepted),
            "rejected": str(now.rejected),
            "expired": str(subscriptions.expired),
            "limited": str(now.limited),
            "command_timeout (s)": f"{commands.timeout:g}",
        })  # fmt: skip

    def _output(self, now: CounterSample) -> DiagnosticStatus:
        recorder = self.publishing_thread.recorder
        waiting = self.stepping_thread.output.qsize()
        rates, step_size = self.stepping_thread.rates, self.stepping_thread.simulation.step_size
        values = {
            "waiting": str(waiting),
            "dropped before publishing": str(self._dropped),
            "age of the last state (ms)": f"{1e3 * self.publishing_thread.age:.1f}",
            "publish_rate (Hz)": f"{attained_rate(rates.publish, step_size):g}",
            "clock_rate (Hz)": f"{attained_rate(rates.clock, step_size):g}",
            "marker_rate (Hz)": f"{attained_rate(rates.markers, step_size):g}",
        }
        problem, text = "", "not recorded"
        if recorder is not None:
            text = f"{'recorded' if recorder.ended.is_set() else 'recording'} to {recorder.path}"
            values |= {
                "recording": str(recorder.path),
                "recorded": str(recorder.written),
                "dropped from the recording": str(recorder.dropped),
            }
            problem = recorder.failure
        for viewer in self.publishing_thread.viewers:
            values[f"dropped from {viewer.program}"] = str(viewer.dropped)
        if lost := now.lost - self._last.lost:
            text_of_loss = LOST.format(count=counted(lost, "snapshot"), remedy=self._lighter)
            self._node.get_logger().warning(text_of_loss, throttle_duration_sec=WARNING_PERIOD)
            problem = problem or text_of_loss
        if not problem and (dropped := now.dropped - self._last.dropped) > 0:
            age = f", and states are {1e3 * self.publishing_thread.age:.0f} ms old when they are published"
            problem = f"{counted(dropped, 'message')} dropped in the last second"
            problem += f"{age if self.publishing_thread.left_out else ''}: {self._lighter}"
        elif not problem and waiting > MAX_WAITING and self.stepping_thread.rates.real_time_factor:
            problem = f"{waiting} states wait to be published: {self._lighter}"
        return self._status("output", problem or text, bool(problem), values)

    def _status(
        self, name: str, text: str, warn: bool, values: Mapping[str, str], error: bool = False
    ) -> DiagnosticStatus:
        level = DiagnosticStatus.ERROR if error else DiagnosticStatus.WARN if warn else DiagnosticStatus.OK
        return DiagnosticStatus(
            level=level,
            name=f"{self._name}: {name}",
            message=text,
            hardware_id=self.stepping_thread.simulation.mechanism.name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )


def _in_microseconds(name: str, durations: DurationSummary) -> dict[str, str]:
    return {
        f"{name} p50 (us)": _microseconds(durations.median),
        f"{name} p99 (us)": _microseconds(durations.p99),
        f"{name} max (us)": _microseconds(durations.maximum),
    }


def _microseconds(seconds: float) -> str:
    return f"{1e6 * seconds:.0f}"
