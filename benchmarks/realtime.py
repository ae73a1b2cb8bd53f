"""`sim_node` stepping and publishing at 1 kHz: steps lost, real-time factor, period, CPU and memory.

python -m benchmarks.realtime --seconds 600
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.node_process import load, percentiles, running


def main() -> None:
    """Run the node, receive its states in this process, and print the statistics."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("parameters", nargs="*", help="parameters of the node, name:=value")
    options = parser.parse_args()
    with running(options.parameters) as node:
        first = len(node.stamps)
        began, cpu = time.perf_counter(), node.process.cpu_times()
        memory = []
        while time.perf_counter() - began < options.seconds:
            time.sleep(1.0)
            memory.append(node.process.memory_info().rss)
        seconds, used = time.perf_counter() - began, node.process.cpu_times()
        stamps, arrivals = np.array(node.stamps[first:]), np.array(node.arrivals[first:])
        values = dict(node.diagnostics)
    gaps = np.diff(stamps)
    wall, simulated = arrivals[-1] - arrivals[0], (stamps[-1] - stamps[0]) * 1e-9
    first_memory, settled, last_memory = (memory[i] / 1e6 for i in (0, min(60, len(memory) // 2), -1))
    loads = f"stepping {values['load of stepping (%)']} %, publishing {values['load of publishing (%)']} %"
    percent = 100 * (used.user + used.system - cpu.user - cpu.system) / seconds
    print(f"states              {len(stamps)} in {wall:.1f} s, gaps of {np.unique(gaps) / 1e6} ms between stamps")
    print(f"real-time factor    {simulated / wall:.5f}")
    print(f"period of arrivals  {percentiles(np.diff(arrivals))}")
    print(
        f"period of stepping  p99 {values['period p99 of the run (us)']} µs, "
        f"max {values['period max of the run (us)']} µs; "
        f"late by p99 {values['lateness p99 of the run (us)']} µs; overruns {values['overruns']}"
    )
    print(f"load                {loads}")
    print(f"CPU                 {percent:.1f} % of one core")
    print(f"memory              {first_memory:.1f} MB at first, {settled:.1f} settled, {last_memory:.1f} at the end")
    print(load())


if __name__ == "__main__":
    main()
