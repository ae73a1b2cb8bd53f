"""Steps of a simulation, and who follows them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Unpack, cast

from mbd_sim import simulation
from mbd_sim.errors import DivergedError, InputError
from mbd_sim.simulation.argument_checks import step_at, step_count
from mbd_sim.simulation.options import RecordingOptions
from mbd_sim.simulation.readings import Readings
from mbd_sim.simulation.run_reports import RunListener, RunReports

if TYPE_CHECKING:
    from mbd_sim import RunRecorder
    from mbd_sim.simulation.simulation import Simulation

RUN_CHUNK = 20_000  # steps between two calls of `progress` in `run`


class Stepping(Readings, RunReports):
    """The part of a `Simulation` that takes steps, and reports them to a listener if there is one."""

    def step(self, n: int = 1) -> None:
        """Advance by n steps.

        This is compiled code, at 0.05 µs a call. A subclass may override it; then `super().step(n)` costs 1 µs. So it
        does with sensors, and some µs more whenever one measures.

        :raises DivergedError: the state would become infinite; it stays as it was before this call, or at the last
            measurement of a sensor.
        :raises TypeError, ValueError: n is not an integer, or negative.
        """
        n = step_count(n)
        for part in self._sampled((n,) if self._listener is None else self._listener.parts_of(n)):
            if not self._memory.advance(part):
                from mbd_sim.simulation.undefined_expressions import undefined_expression

                undefined = undefined_expression(self.model, self._live.mechanism, self._memory, part)
                raise simulation.divergence(self.model, self.time, part, self.step_size, self.step_advice, undefined)
            self._report_contacts()

    def advance(self, n: int) -> None:
        """Take n steps; if the state becomes infinite, take as many of them as possible.

        :raises DivergedError: the next step cannot be taken.
        """
        try:
            self.step(n)
        except DivergedError:
            if n == 1:
                raise
            self.advance(n // 2)
            self.advance(n - n // 2)

    def run(self, until: float, progress: Callable[[float], None] | None = None) -> None:
        """Advance to the step nearest to time `until` in s; `progress` is called with the time every 20,000 steps.

        :raises DivergedError: see `advance`.
        :raises ValueError: the time is not finite, or is in the past.
        """
        last = step_at(until, self.step_size, self.steps)
        while self.steps < last:
            self.advance(min(last - self.steps, RUN_CHUNK))
            if progress is not None:
                progress(self.time)

    def recording(self, path: str | Path, **options: Unpack[RecordingOptions]) -> RunRecorder:
        """Record everything from here on to an MCAP file, until the `with` block ends or `close` is called.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("double_rod")
        >>> with sim.recording("run.mcap"):  # doctest: +SKIP
        ...     sim.run(until=3.0)

        `mbd_sim verify`, `view`, `plot`, `export` and `replay_node` accept the file. Recording needs no ROS.

        :param options: the keyword arguments of `RunRecorder`: `rate` in Hz, `reactions`, `violation`, `poses`,
            `accelerations`.
        :raises InputError, RecordingError: see `RunRecorder`.
        """
        from mbd_sim import RunRecorder

        return RunRecorder(cast("Simulation", self), path, **options)

    def listen(self, listener: RunListener | None) -> None:
        """Report steps and commands to a listener from here on; None: to nobody.

        :raises InputError: there is another listener already.
        """
        if listener is not None and self._listener is not None:
            raise InputError("this simulation is being recorded already", "Close the other recording first.")
        self._listener, self._contacts_seen = listener, self._contact_count
        self._unobserved[0] = listener is None
        if listener is None:
            self._use_compiled_step()
        else:
            vars(self).pop("step", None)  # the method divides the steps, which compiled code does not

    def _use_compiled_step(self) -> None:
        if type(self).step is Stepping.step and self._samples is None:  # a subclass with its own `step` keeps it
            vars(self).pop("step", None)
            vars(self)["step"] = self._memory.compiled_step(self.step)  # calls the method of this name if a step fails
