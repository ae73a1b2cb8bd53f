"""The memory of the viewer's process while it writes a file: `python -m benchmarks.viewer_memory --samples 300000`."""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import psutil

from mbd_sim import Simulation
from mbd_sim.pictures.rerun import Viewer

ROWS = 50  # in each batch: those of a run at 1 kHz


def main() -> None:
    """Offer samples as fast as they are written, and print the memory of the process."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mechanism", default="double_rod")
    parser.add_argument("--samples", type=int, default=100_000)
    options = parser.parse_args()
    simulation = Simulation.from_file(options.mechanism)
    with (
        tempfile.TemporaryDirectory() as folder,
        Viewer(simulation.model, str(Path(folder) / "run.rrd"), rate=1000.0) as viewer,
    ):
        process = next(child for child in psutil.Process().children() if child.is_running())
        for sample in range(options.samples + 1):
            viewer.offer(1e-3 * sample, simulation.state, simulation.inputs.copy(), simulation.energies)
            simulation.step()
            if sample % ROWS == 0:
                time.sleep(0.05)  # as in a run: one batch
            if sample % 10_000 == 0:
                written = Path(viewer.address).stat().st_size
                memory = process.memory_info().rss
                print(f"{sample:8d} samples  {memory / 1e6:6.1f} MB, file {written / 1e6:7.1f} MB", flush=True)


if __name__ == "__main__":
    main()
