"""Set-up time and memory of one simulator, measured in a new process."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.engines import Candidate, load
from benchmarks.plan import Plan

ROOT = Path(__file__).resolve().parent.parent
PAGE = os.sysconf("SC_PAGE_SIZE")


def resident() -> int:
    """Memory of this process, bytes."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * PAGE


def in_fresh_process(candidate: Candidate, plan: Plan, step: float, seconds: float = 300.0) -> dict[str, float]:
    """`setup` and `again` in s, from the model to the end of the first step, and `memory` in MB of libraries and model.

    File caches of the simulators are empty for `setup`, and hold what it wrote for `again`.

    :raises RuntimeError: the process failed or timed out.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "job"
        file.write_bytes(pickle.dumps((candidate, plan, step)))
        environment = os.environ | {"HOME": folder, "XDG_CACHE_HOME": folder}
        command = [sys.executable, "-m", "benchmarks.fresh", str(file)]
        runs = []
        for _ in range(2):
            try:
                done = subprocess.run(
                    command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True, timeout=seconds
                )
            except subprocess.TimeoutExpired as error:
                raise RuntimeError(f"more than {seconds:g} s") from error
            except subprocess.CalledProcessError as error:
                raise RuntimeError(error.stderr.strip().splitlines()[-1]) from error
            runs.append(json.loads(done.stdout.splitlines()[-1]))
    return {"setup": runs[0]["setup"], "again": runs[1]["setup"], "memory": runs[0]["memory"]}


def main() -> None:
    """Measure the job in a file, and print it as JSON."""
    candidate, plan, step = pickle.loads(Path(sys.argv[1]).read_bytes())
    before = resident()
    load(candidate.module)
    began = time.perf_counter()
    engine = candidate.build(plan, step)
    engine.many(1)
    setup = time.perf_counter() - began
    print(json.dumps({"setup": setup, "memory": (resident() - before) / 1e6}))


if __name__ == "__main__":
    main()
