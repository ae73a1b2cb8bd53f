"""Shows a motion to Foxglove from a separate process, so that the simulation never waits for it."""

from __future__ import annotations

from mbd_sim.pictures.rerun.sinks import UnknownSinkError
from mbd_sim.pictures.rerun.viewer import Viewer

LARGEST_PORT = 65535
DEFAULT_PORT = 8765  # the one that Foxglove proposes


class FoxgloveViewer(Viewer):
    """A server for Foxglove that accepts samples of a motion, with the arguments and methods of `Viewer`.

    The sink is the port on which the server listens, on this machine only, `0` for any that is free; `address` is what
    to give to Foxglove, and `watched` is set once somebody looks. What was sent before is not kept.

    >>> with FoxgloveViewer(sim.model, "8765") as viewer:
    ...     while sim.time < 10.0:
    ...         viewer.offer(sim.time, sim.state, sim.inputs.copy(), sim.energies)
    ...         sim.step(10)
    """

    keeps_time = True
    program = "Foxglove"
    _package = "foxglove"
    _worker_module = "mbd_sim.pictures.foxglove.worker"

    def _check(self, sink: str) -> None:
        checked_port(sink)


def checked_port(port: str) -> str:
    """The port, if it can be one.

    :raises UnknownSinkError: it cannot.
    """
    if port.isdecimal() and int(port) <= LARGEST_PORT:
        return port
    raise UnknownSinkError(
        f"there is no port '{port}' for Foxglove",
        f"Give a whole number up to {LARGEST_PORT}, such as {DEFAULT_PORT}; 0 is any that is free.",
    )
