"""Actuators: what a step of a mechanism costs with motors and servos on all joints, compared with one without.

python -m benchmarks.actuators
"""

from __future__ import annotations

import statistics
import time

from mbd_sim import Simulation
from mbd_sim.load import load_mechanism

ROUNDS, STEPS = 31, 1000
DC = "type: dc_motor, torque_constant: 0.05, resistance: 1.2, gear_ratio: 10, rotor_inertia: 2e-5, voltage_limit: 24"
GAINS = "controls: position, kp: 40, ki: 10, kd: 1"
SAMPLED, CONTINUOUS = f"servo: {{{GAINS}, sample_rate: 500 Hz}}", f"servo: {{{GAINS}}}"
ACTUATORS = {
    "effort motors": "type: effort, effort_limit: 50",
    "effort motors, sampled PID": f"type: effort, effort_limit: 50, {SAMPLED}",
    "effort motors, continuous PID": f"type: effort, effort_limit: 50, {CONTINUOUS}",
    "DC motors": DC,
    "DC motors with inductance": f"{DC}, inductance: 2 mH",
    "DC motors with inductance, sampled PID": f"{DC}, inductance: 2 mH, {SAMPLED}",
}
MECHANISMS, METHODS = ("double_rod", "six_axis_arm"), ("rk4", "tsitouras8")


def with_actuators(name: str, actuator: str) -> str:
    """The file of a shipped mechanism with an actuator on each of its coordinates; none if it is empty."""
    mechanism = load_mechanism(name)
    entries = [f"  m{n}: {{{actuator}, joint: {joint}}}\n" for n, joint in enumerate(mechanism.coordinate_names)]
    return mechanism.source.text + ("\nactuators:\n" + "".join(entries) if actuator else "")


def each(sim: Simulation) -> float:
    """Processor time in µs for a step."""
    sim.reset()
    began = time.thread_time()
    sim.step(STEPS)
    return 1e6 * (time.thread_time() - began) / STEPS


def costs(name: str, method: str) -> tuple[float, dict[str, float]]:
    """The time of a step without actuators in µs, and with each kind as a multiple of that: medians of ratios."""
    sims = {kind: Simulation.from_text(with_actuators(name, text), method=method) for kind, text in ACTUATORS.items()}
    plain = Simulation.from_text(with_actuators(name, ""), method=method)
    times = [(each(plain), {kind: each(sim) for kind, sim in sims.items()}) for _ in range(ROUNDS)]
    ratios = {kind: statistics.median(row[kind] / base for base, row in times) for kind in ACTUATORS}
    return min(base for base, _ in times), ratios


def main() -> None:
    """Print a table."""
    found = {(name, method): costs(name, method) for name in MECHANISMS for method in METHODS}
    heads = [f"{name}, {method}" for name, method in found]
    print("| on all joints | " + " | ".join(heads) + " |\n|---|" + "---|" * len(heads))
    print("| none | " + " | ".join(f"{base:.3f} µs" for base, _ in found.values()) + " |")
    for kind in ACTUATORS:
        print(f"| {kind} | " + " | ".join(f"{ratios[kind]:.2f}" for _, ratios in found.values()) + " |")


if __name__ == "__main__":
    main()
