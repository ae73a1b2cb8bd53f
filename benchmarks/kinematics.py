"""Kinematics and terms of the equations of motion from Python: the time of a call, beside Pinocchio if it is installed.

python -m benchmarks.kinematics
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from mbd_sim import Simulation
from mbd_sim.analysis.linear.linearization import linearize_at
from mbd_sim.analysis.mechanics.load_sharing import LoadSharing
from mbd_sim.files.urdf.writer import to_urdf

ROUNDS, CALLS = 31, 3000
TOOL = "tool"
NAME = "six_axis_arm"
LINEARIZED = "double_rod", "six_axis_arm", "four_bar", "bennett"


def microseconds(call: Callable[[], object], rounds: int = ROUNDS, calls: int = CALLS) -> float:
    """Processor time in µs of a call: the least of the rounds."""
    best = np.inf
    for _ in range(rounds):
        began = time.thread_time()
        for _ in range(calls):
            call()
        best = min(best, (time.thread_time() - began) / calls)
    return 1e6 * float(best)


def linear_table() -> list[str]:
    """Rows of a table: `linearize()` and `reactions()`, compiled and evaluated by CasADi's virtual machine."""
    rows = []
    for name in LINEARIZED:
        sim = Simulation.from_file(name)
        sim.run(until=0.1)
        equations = sim.model.equations
        calls: list[Callable[[], object]] = [
            sim.linearize,
            partial(linearize_at, equations, sim.time, sim.y, sim.inputs),
            sim.reactions,
            partial(LoadSharing(sim.mechanism, equations).reactions, sim.time, sim.y, np.array(sim.inputs)),
        ]
        for call in calls:
            call()
        rows.append(f"| {name} | " + " | ".join(f"{microseconds(call, 15, 100):.3g}" for call in calls) + " |")
    return rows


def own_calls(sim: Simulation) -> dict[str, Callable[[], object]]:
    """What is measured."""
    point, frame, rates = sim.point(TOOL), sim.frame(TOOL), np.ones(len(sim.u))
    return {
        "point(…).position": lambda: point.position,
        "point(…).jacobian": lambda: point.jacobian,
        "frame(…).jacobian": lambda: frame.jacobian,
        "frame(…).jacobian_rate": lambda: frame.jacobian_rate,
        "mass_matrix()": sim.mass_matrix,
        "bias_terms()": sim.bias_terms,
        "inverse_dynamics(u_rates)": lambda: sim.inverse_dynamics(rates),
        "forward_dynamics()": sim.forward_dynamics,
        "momentum()": sim.momentum,
    }


def pinocchio_calls(sim: Simulation) -> dict[str, Callable[[], object]]:
    """The same of Pinocchio; empty if it is not installed."""
    try:
        import pinocchio as pin
    except ImportError:
        return {}
    model = pin.buildModelFromXML(to_urdf(sim.mechanism))
    data, q, v = model.createData(), pin.integrate(model, pin.neutral(model), np.array(sim.q)), np.array(sim.u)
    tool, rates = model.getFrameId(TOOL), np.ones(model.nv)

    def position() -> object:
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[tool].translation.copy()

    def rate() -> object:
        pin.computeJointJacobiansTimeVariation(model, data, q, v)
        return pin.getFrameJacobianTimeVariation(model, data, tool, pin.LOCAL_WORLD_ALIGNED)

    return {
        "point(…).position": position,
        "frame(…).jacobian": lambda: pin.computeFrameJacobian(model, data, q, tool, pin.LOCAL_WORLD_ALIGNED),
        "frame(…).jacobian_rate": rate,
        "mass_matrix()": lambda: pin.crba(model, data, q),
        "bias_terms()": lambda: pin.nonLinearEffects(model, data, q, v),
        "inverse_dynamics(u_rates)": lambda: pin.rnea(model, data, q, v, rates),
        "forward_dynamics()": lambda: pin.aba(model, data, q, v, rates),
        "momentum()": lambda: pin.computeCentroidalMomentum(model, data, q, v),
    }


def main() -> None:
    """Print a table."""
    sim = Simulation.from_file(NAME)
    sim.run(until=0.1)
    others = pinocchio_calls(sim)
    print(f"| {NAME}, µs | mbd_sim | Pinocchio |\n|---|--:|--:|")
    for name, call in own_calls(sim).items():
        other = f"{microseconds(others[name]):.2f}" if name in others else "–"
        print(f"| `{name}` | {microseconds(call):.2f} | {other} |")
    print("\n| µs | linearize() | by CasADi | reactions() | by CasADi |\n|---|--:|--:|--:|--:|")
    print("\n".join(linear_table()))


if __name__ == "__main__":
    main()
