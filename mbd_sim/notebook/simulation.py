"""The `Simulation` of the public interface: that of the engine, with recordings, pictures and the lab."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from mbd_sim.simulation.run.arguments import RecordingOptions
from mbd_sim.simulation.run.simulation import BaseSimulation

if TYPE_CHECKING:
    from mbd_sim.lab.lab import Lab
    from mbd_sim.notebook.runs import RunPicture
    from mbd_sim.recordings.run.run_recorder import RunRecorder


class Simulation(BaseSimulation):  # noqa: D101
    __doc__ = BaseSimulation.__doc__

    def copy(self) -> Simulation:
        """Another simulation in the same state, which goes on by itself; both share the compiled equations.

        Recordings and the history of contact events stay with the original. `copy.copy` and `copy.deepcopy` do the
        same; copies of a subclass are a plain `Simulation`.
        """
        return self._copied_to(Simulation.__new__(Simulation))

    def recording(self, path: str | Path, **options: Unpack[RecordingOptions]) -> RunRecorder:
        """Record everything from here on to an MCAP file, until the `with` block ends or `close` is called.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("double_rod")
        >>> with sim.recording("run.mcap"):  # doctest: +SKIP
        ...     sim.run(until=3.0)

        `mbd_sim verify`, `view`, `plot`, `export` and `replay_node` accept the file. Recording needs no ROS.

        :param options: the keyword arguments of `RunRecorder`: `rate` in Hz, `reactions`, `contact_forces`,
            `violation`, `poses`, `accelerations`.
        :raises InputError, RecordingError: see `RunRecorder`.
        """
        from mbd_sim.recordings.run.run_recorder import RunRecorder

        return RunRecorder(self, path, **options)

    def plot(self, until: float, show: Sequence[str] = (), style: str = "screen", theme: str = "light") -> RunPicture:
        """Run to time `until` in s, and return a plot of energies, joints, residual and phase portrait.

        :param show: the panels to show; by default all for which there are data, as `mbd_sim plot`. A
            single one may be given by itself.
        :param style: `screen`, `slide` (10 in wide) or `paper` (3.5 in wide, without titles, with dashed lines).
        :param theme: `light` or `dark`.
        :raises InputError: there is no such panel, style or theme, or the simulation is being recorded already.
        :raises ValueError: the time is not finite, or is in the past.
        :raises DivergedError: see `advance`.
        """
        from mbd_sim.notebook.runs import plot

        return plot(self, until, show, style, theme)

    def animate(self, until: float, traces: Sequence[str] = ()) -> RunPicture:
        """Run to time `until` in s, and return an animation of the motion.

        :param traces: points, `part.point`, and parts, which stand for their ends, whose paths are drawn. A single
            one may be given by itself.
        :raises InputError: there is no such part or point.
        :raises ValueError: the time is not finite, or is in the past.
        :raises DivergedError: see `advance`.
        """
        from mbd_sim.notebook.runs import animate

        return animate(self, until, traces)

    def view(self, until: float) -> Any:
        """Run to time `until` in s, and return a widget that shows the run, and plots of it, in Rerun.

        The widget loads Rerun's viewer from the network, or, with the environment variable RERUN_NOTEBOOK_ASSET set to
        `serve-local` before this is called, from this machine.

        :raises MissingPackageError: rerun-notebook is not installed.
        :raises ValueError: the time is not finite, or is in the past.
        :raises DivergedError: see `advance`.
        """
        from mbd_sim.notebook.runs import view

        return view(self, until)

    def lab(self, port: int = 0, theme: Literal["light", "dark"] = "light", running: bool = False) -> Lab:
        """Open a page in the browser that starts where this simulation is, which itself stays as it is.

        In a notebook, the page is shown inline if this is the last line of a cell; elsewhere open the `url`.

        >>> from mbd_sim import Simulation
        >>> sim = Simulation.from_file("four_bar")
        >>> lab = sim.lab()  # doctest: +SKIP
        >>> lab.close()  # doctest: +SKIP

        :param port: 0: a free one.
        :param running: whether the motion goes on at once.
        :raises MissingPackageError: viser is not installed.
        """
        from mbd_sim.lab.lab import Lab

        return Lab(self.mechanism, port=port, theme=theme, running=running, start=self)

    def _repr_html_(self) -> str:
        from mbd_sim.notebook.runs import simulation_html

        return simulation_html(self)

    def _repr_png_(self) -> bytes:
        from mbd_sim.notebook.runs import simulation_png

        return simulation_png(self)
