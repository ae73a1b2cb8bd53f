"""Trajectories with derivatives: the time of a step, beside one without, and beside CasADi's `trajectory`.

python -m benchmarks.sensitivities
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from mbd_sim import Simulation, load_mechanism
from mbd_sim.studies.optimization import CasadiFunctions, SensitivityModel, trajectory

ROUNDS, STEPS, STEP, METHOD = 9, 200, 1e-3, "tsitouras8"
CASES: Sequence[tuple[str, Sequence[str], bool]] = (
    ("double_rod", ("m", "l"), False),
    ("double_rod", ("m", "l"), True),
    ("four_bar", ("crank", "coupler"), False),
    ("four_bar", ("crank", "coupler"), True),
    ("rolling_disc", (), True),
    ("spherical_top", (), True),
    ("six_axis_arm", ("parts.upper_arm.mass",), False),
    ("six_axis_arm", ("parts.upper_arm.mass",), True),
)


def by_casadi(own: CasadiFunctions, *, by_all: bool) -> Callable[[], object]:
    """A trajectory with its derivatives by parameters, and by start state and constant efforts, of CasADi."""
    function = trajectory(own, STEPS, STEP, METHOD)
    x0, e, p = (
        ca.MX.sym(name, len(given)) for name, given in zip("xep", (own.start, own.efforts, own.values), strict=True)
    )
    given = ca.vertcat(p, x0, e) if by_all else p
    whole = ca.MX.sym("given", given.shape[0])
    count = len(own.values)
    parts = (
        ca.vertsplit(whole, [0, count, count + len(own.start), given.shape[0]])
        if by_all
        else [whole, own.start, own.efforts]
    )
    states = function(0.0, parts[1], ca.repmat(parts[2], 1, STEPS), parts[0])[:, -1]
    jacobian = ca.Function("derivatives", [whole], [states, ca.jacobian(states, whole)])
    at = np.concatenate([own.values, own.start, own.efforts]) if by_all else own.values
    return lambda: jacobian(at)


def row(name: str, parameters: Sequence[str], *, by_all: bool) -> str:
    """Of the table: processor time in µs per step, the least of interleaved rounds."""
    mechanism = load_mechanism(name)
    sim = Simulation(mechanism, method=METHOD, step=STEP)
    model = SensitivityModel(mechanism, parameters, method=METHOD, step=STEP, by_start=by_all, by_efforts=by_all)
    start = sim.snapshot()

    def plain() -> None:
        sim.restore(start)
        for _ in range(10):
            sim.step(STEPS)

    calls = {
        10 * STEPS: plain,
        STEPS: lambda: model.run(STEPS, every=STEPS),
        -STEPS: by_casadi(model.functions, by_all=by_all),
    }
    best = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for steps, call in calls.items():
            began = time.process_time()
            call()
            best[steps] = min(best[steps], 1e6 * (time.process_time() - began) / abs(steps))
    own = model.functions
    columns = len(own.values) + by_all * (len(own.start) + len(own.efforts))
    one, exact, casadi = best.values()
    ratios = f"{exact / one:.1f} | {2 * columns} | {casadi / exact:.0f}"
    return f"| {name} | {columns} | {one:.2f} | {exact:.2f} | {casadi:.0f} | {ratios} |"


def main() -> None:
    """Print a table."""
    titles = (
        "",
        "derivatives by",
        "step, µs",
        "with derivatives",
        "by CasADi",
        "/ step",
        "differences / step",
        "CasADi /",
    )
    print(f"| {' | '.join(titles)} |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|")
    for name, parameters, by_all in CASES:
        print(row(name, parameters, by_all=by_all), flush=True)


if __name__ == "__main__":
    main()
