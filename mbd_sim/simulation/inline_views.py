"""How notebooks show a simulation. The drawing is imported when it is needed."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

from mbd_sim.simulation.run_steps import Stepping

if TYPE_CHECKING:
    from mbd_sim import RunPicture


class InlineViews(Stepping):
    """The pictures of a `Simulation`."""

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
        return cast("RunPicture", import_module("mbd_sim.notebook.runs").plot(self, until, show, style, theme))

    def animate(self, until: float, traces: Sequence[str] = ()) -> RunPicture:
        """Run to time `until` in s, and return an animation of the motion.

        :param traces: points, `part.point`, and parts, which stand for their ends, whose paths are drawn. A single
            one may be given by itself.
        :raises InputError: there is no such part or point.
        :raises ValueError: the time is not finite, or is in the past.
        :raises DivergedError: see `advance`.
        """
        return cast("RunPicture", import_module("mbd_sim.notebook.runs").animate(self, until, traces))

    def view(self, until: float) -> Any:
        """Run to time `until` in s, and return a widget that shows the run, and plots of it, in Rerun.

        The widget loads Rerun's viewer from the network, or, with the environment variable RERUN_NOTEBOOK_ASSET set to
        `serve-local` before this is called, from this machine.

        :raises MissingPackageError: rerun-notebook is not installed.
        :raises ValueError: the time is not finite, or is in the past.
        :raises DivergedError: see `advance`.
        """
        return import_module("mbd_sim.notebook.rerun_widget").view(self, until)

    def _repr_html_(self) -> str:
        return cast("str", import_module("mbd_sim.notebook.views").simulation_html(self))

    def _repr_png_(self) -> bytes:
        return cast("bytes", import_module("mbd_sim.notebook.views").simulation_png(self))
