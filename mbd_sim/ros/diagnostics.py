"""`/diagnostics`, once a second: whether time is kept, the energies balance, and commands are understood."""

from __future__ import annotations

import gc
import time
from collections.abc import Mapping
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from mbd_sim.geometry.pose import Array
from mbd_sim.ros.publishing_thread import Outputs
from mbd_sim.ros.stepping_thread import Runner
from mbd_sim.ros.subscriptions import Inputs
from mbd_sim.simulation.compiled_model import Model

PERIOD = 1.0  # s of the steady clock
REMIND = 30.0  # s between warnings of bad timing on the console
SLOW = 0.01  # part of the real-time factor that may be missing
UNBALANCED = 1e-6  # part of the energies that the residual may be
OPEN = 1e-6  # m and m/s that constraints may be off
BUSY = "other programs hold the processor, or publish_rate is too high for it"
WAITING = 1000  # snapshots that may wait to be published


@dataclass
class Reading:
    """Counters as they stood at a moment of the steady clock, from which rates are told."""

    at: float
    simulated: float
    stepping: float
    publishing: float
    late: Array
    period: Array
    overruns: int
    rejected: int
    lost: int


class Diagnostics:
    """Reads the counters of a node's parts and publishes what they mean; `tick` is to be called once a second."""

    def __init__(self, node: Node, runner: Runner, inputs: Inputs, outputs: Outputs) -> None:
        self.runner, self.inputs, self.outputs = runner, inputs, outputs
        self.model: Model = runner.simulation.model
        self.notes: list[str] = []
        self._node = node
        self._name = node.get_fully_qualified_name()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.begin()

    def begin(self) -> None:
        """Count from now on."""
        self._last = self._reading()

    @property
    def overruns_of_late(self) -> int:
        """How often the schedule had to start anew since the last tick."""
        return self.runner.pacer.overruns - self._last.overruns

    def tick(self) -> None:
        """Publish, and collect garbage."""
        began = time.perf_counter()
        gc.collect()
        collecting = time.perf_counter() - began
        now = self._reading()
        statuses = [self._timing(now, collecting), self._mechanics(), self._commands(now), self._output(now)]
        self._last = now
        message = DiagnosticArray(status=statuses)
        seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
        message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
        self._publisher.publish(message)

    def _reading(self) -> Reading:
        runner, pacer = self.runner, self.runner.pacer
        recorder = self.outputs.recorder
        return Reading(
            at=time.perf_counter(),
            simulated=runner.ticks * runner.simulation.step_size,
            stepping=runner.counters.stepping,
            publishing=self.outputs.busy,
            late=pacer.lateness.counts(),
            period=pacer.period.counts(),
            overruns=pacer.overruns,
            rejected=self.inputs.rejected,
            lost=runner.counters.dropped + (recorder.dropped if recorder else 0),
        )

    def _timing(self, now: Reading, collecting: float) -> DiagnosticStatus:
        last, runner, pacer = self._last, self.runner, self.runner.pacer
        wall = now.at - last.at
        factor, wanted = (now.simulated - last.simulated) / wall, runner.rates.real_time_factor
        late, period = pacer.lateness.spread(last.late), pacer.period.spread(last.period)
        whole_late, whole_period = pacer.lateness.spread(), pacer.period.spread()
        stepping = (now.stepping - last.stepping) / wall
        publishing = (now.publishing - last.publishing) / wall
        missed = now.overruns - last.overruns
        text = "paused" if runner.paused else f"real-time factor {factor:.3f}"
        problem = ""
        if factor < wanted * (1.0 - SLOW) and not runner.paused and now.simulated > last.simulated > 0.0:
            why = BUSY if stepping < 0.5 else "stepping takes all the time: take a larger step or a cheaper method"
            problem = f"{text} instead of {wanted:g}: {why}"
        elif runner.rates.clock and self._node.count_publishers("/clock") > 1:
            problem = f"{text}, but another node publishes /clock as well: set clock_rate to 0 in all but one"
        elif missed:
            problem = f"{text}, but the schedule had to start anew {missed} times: {BUSY}"
        if problem:
            self._node.get_logger().warning(problem, throttle_duration_sec=REMIND)
        elif self.notes:
            text = "; ".join([text, *self.notes])
        return self._status("timing", problem or text, bool(problem), {
            "real_time_factor": f"{factor:.4f}",
            "real_time_factor wanted": f"{wanted:g}",
            "paused": str(runner.paused).lower(),
            "steps": str(runner.ticks),
            "lateness p50 (us)": _us(late.median),
            "lateness p99 (us)": _us(late.p99),
            "lateness max (us)": _us(late.maximum),
            "period p50 (us)": _us(period.median),
            "period p99 (us)": _us(period.p99),
            "period max (us)": _us(period.maximum),
            "lateness p99 of the run (us)": _us(whole_late.p99),
            "lateness max of the run (us)": _us(whole_late.maximum),
            "period p99 of the run (us)": _us(whole_period.p99),
            "period max of the run (us)": _us(whole_period.maximum),
            "overruns": str(now.overruns),
            "load of stepping (%)": f"{100.0 * stepping:.2f}",
            "load of publishing (%)": f"{100.0 * publishing:.2f}",
            "garbage collection (us)": _us(collecting),
        })  # fmt: skip

    def _mechanics(self) -> DiagnosticStatus:
        energies, snapshot, runner = self.outputs.energies, self.outputs.latest, self.runner
        values: dict[str, str] = {}
        problem = runner.problem and f"{runner.problem} ~/reset starts anew."
        advice = runner.advice
        if energies is not None:
            values |= {"energy residual (J)": f"{energies.residual:.3e}", "energy (J)": f"{energies.total:.6g}"}
            scale = max(1e-3, *(abs(value) for value in energies))
            if not problem and abs(energies.residual) > UNBALANCED * scale:
                problem = advice or f"the energies do not balance by {energies.residual:.2e} J: take a smaller step"
        if snapshot is not None and self.model.equations.rows:
            violation = self.model.violation(snapshot.time, snapshot.y, snapshot.inputs)
            values |= {
                "constraint violation (m)": f"{violation.position:.3e}",
                "constraint violation (m/s)": f"{violation.velocity:.3e}",
            }
            if not problem and max(violation) > OPEN:
                problem = "a loop or constraint does not hold: take a smaller step, or look at `mbd_sim check`"
        values["error of a step"] = f"{runner.simulation.error_estimate:.1e}"
        bad = bool(runner.problem)
        return self._status("mechanics", problem or advice or "energies balance", bool(problem or advice), values, bad)

    def _commands(self, now: Reading) -> DiagnosticStatus:
        inputs, commands, last = self.inputs, self.inputs.commands, self._last
        problem = ""
        if (rejected := now.rejected - last.rejected) and inputs.last_rejection is not None:
            topic, error = inputs.last_rejection
            problem = f"{rejected} messages rejected in the last second, the last one on {topic}: {error}"
        elif commands.lapsed:
            problem = (
                f"no command for {commands.timeout:g} s of simulated time: efforts are zero. "
                "Send commands more often, or raise command_timeout (0: never)"
            )
        return self._status("commands", problem or "OK", bool(problem), {
            "accepted": str(inputs.accepted),
            "rejected": str(now.rejected),
            "expired": str(inputs.expired),
            "command_timeout (s)": f"{commands.timeout:g}",
        })  # fmt: skip

    def _output(self, now: Reading) -> DiagnosticStatus:
        recorder, viewer = self.outputs.recorder, self.outputs.viewer
        waiting = self.runner.output.qsize()
        values = {"waiting": str(waiting), "dropped before publishing": str(self.runner.counters.dropped)}
        problem, text = "", "not recorded"
        if recorder is not None:
            text = f"{'recorded' if recorder.ended.is_set() else 'recording'} to {recorder.path}"
            values |= {
                "recording": str(recorder.path),
                "recorded": str(recorder.written),
                "dropped from the recording": str(recorder.dropped),
            }
            problem = recorder.failure
        if viewer is not None:
            values["dropped from Rerun"] = str(viewer.dropped)
        if not problem and now.lost > self._last.lost:
            problem = f"{now.lost - self._last.lost} messages lost in the last second: lower publish_rate"
        elif not problem and waiting > WAITING and self.runner.rates.real_time_factor:
            problem = f"{waiting} states wait to be published: lower publish_rate"
        return self._status("output", problem or text, bool(problem), values)

    def _status(
        self, name: str, text: str, warn: bool, values: Mapping[str, str], error: bool = False
    ) -> DiagnosticStatus:
        level = DiagnosticStatus.ERROR if error else DiagnosticStatus.WARN if warn else DiagnosticStatus.OK
        return DiagnosticStatus(
            level=level,
            name=f"{self._name}: {name}",
            message=text,
            hardware_id=self.runner.simulation.mechanism.name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )


def _us(seconds: float) -> str:
    return f"{1e6 * seconds:.0f}"
