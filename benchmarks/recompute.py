"""Every shipped mechanism under random commands, recorded and recomputed with several methods.

python -m benchmarks.recompute --seconds 60
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from mbd_sim.cli.runs.verify import verify_text
from mbd_sim.files.text.library import shipped
from mbd_sim.recordings.run.verification import verify
from test.recordings.runs import record_run

METHODS = ["dop853", "rk4", "rosenbrock"]


def main() -> None:
    """Record each run in this process, as fast as possible, verify it, and print the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--methods", nargs="+", default=METHODS)
    parser.add_argument("--mechanisms", nargs="+", default=list(shipped()))
    options = parser.parse_args()
    agreeing = runs = 0
    for seed, name in enumerate(options.mechanisms):
        for method in options.methods:
            with tempfile.TemporaryDirectory() as folder:
                commands = max(10, round(2 * options.seconds))
                path = record_run(
                    Path(folder), name, seconds=options.seconds, seed=seed, commands=commands, publish_rate=20.0,
                    method=method,
                )  # fmt: skip
                (found,) = verify(path)
            runs += 1
            agreeing += found.agrees
            simulated = found.steps * found.step
            print(
                f"{name:24s} {method:10s} {'agrees' if found.agrees else 'DIFFERS':8s} {simulated:6.3g} s, "
                f"{sum(found.commands.values())} commands, {simulated / found.wall_time:.0f} × real time",
                flush=True,
            )
            if not found.agrees:
                print(verify_text(found), flush=True)
    print(f"{agreeing} of {runs} runs agree")


if __name__ == "__main__":
    main()
