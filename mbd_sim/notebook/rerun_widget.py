"""A run in Rerun's viewer, within a notebook."""

from __future__ import annotations

import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

from mbd_sim.packages import require_packages
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.viewer import Viewer

RATE = 60.0  # states that are shown for each second
HEIGHT = 560  # px


def view(simulation: Simulation, until: float) -> Any:
    """Run to a time and show the run in Rerun; see `Simulation.view`."""
    require_packages("rerun_notebook", purpose="Rerun in a notebook", otherwise="or use animate().")
    with tempfile.TemporaryDirectory(prefix="mbd_sim_") as folder:
        path = Path(folder, "run.rrd")
        begin = simulation.time
        with Viewer(simulation.model, str(path), rate=None) as viewer:
            _offer(viewer, simulation)
            for number in range(1, 1 + int((until - begin) * RATE + 1e-9)):
                simulation.run(begin + number / RATE)
                _offer(viewer, simulation)
            simulation.run(until)
            viewer.flush()
        content = path.read_bytes()
    widget = import_module("rerun_notebook").Viewer(width="auto", height=HEIGHT)
    widget.send_rrd(content)
    return widget


def _offer(viewer: Viewer, simulation: Simulation) -> None:
    viewer.offer(simulation.time, simulation.state, simulation.inputs.copy(), simulation.energies)
