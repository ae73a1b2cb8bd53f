"""Actuators: what a step of a mechanism costs with motors and servos on all joints, compared with one without.

python -m benchmarks.actuators
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping

from mbd_sim import Simulation
from mbd_sim.files.load import load_mechanism

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
LIFT, PLACE = "hydraulic_scissor_lift", "between: [ground.base, second.eye]"
CYLINDER = f"{PLACE}, areas: [20 cm^2, 14 cm^2], retracted: 360 mm, stroke: 320 mm, dead_volumes: [1e-4, 1e-4]"
GAS = f"type: pneumatic_cylinder, {CYLINDER}, conductance: 2e-7, supply: 50 bar, pressures: [40 bar, 5 bar]"
OIL = f"type: hydraulic_cylinder, {CYLINDER}, rated_flow: 16 L/min, supply: 120 bar, pressures: [49 bar, 10 bar]"
CYLINDERS = {
    "effort": f"type: effort, {PLACE}",
    "hydraulic cylinder": OIL,
    "pneumatic cylinder, isothermal": GAS,
    "pneumatic cylinder, polytropic": f"{GAS}, exponent: 1.3",
}
MECHANISMS, METHODS = ("double_rod", "six_axis_arm"), ("rk4", "tsitouras8", "adams11")


def with_actuators(name: str, actuator: str) -> str:
    """The file of a shipped mechanism with an actuator on each of its coordinates; none if it is empty."""
    mechanism = load_mechanism(name)
    entries = [f"  m{n}: {{{actuator}, joint: {joint}}}\n" for n, joint in enumerate(mechanism.coordinate_names)]
    return mechanism.source.text + ("\nactuators:\n" + "".join(entries) if actuator else "")


def with_cylinder(cylinder: str) -> str:
    """The file of the lift with another cylinder in place of its own; none if it is empty."""
    text = load_mechanism(LIFT).source.text
    before, after = text[: text.index("actuators:")], text[text.index("integrator:") :]
    return before + (f"actuators:\n  cylinder: {{{cylinder}}}\n" if cylinder else "") + after


def each(sim: Simulation) -> float:
    """Processor time in µs for a step."""
    sim.reset()
    began = time.thread_time()
    sim.step(STEPS)
    return 1e6 * (time.thread_time() - began) / STEPS


def costs(plain_text: str, texts: Mapping[str, str], method: str) -> tuple[float, dict[str, float]]:
    """The time of a step without actuators in µs, and with each kind as a multiple of that: medians of ratios.

    Kinds that the method does not integrate are left out: `adams11` has no sampled servos.
    """
    texts = {kind: text for kind, text in texts.items() if method != "adams11" or "sample_rate" not in text}
    sims = {kind: Simulation.from_text(text, method=method) for kind, text in texts.items()}
    plain = Simulation.from_text(plain_text, method=method)
    times = [(each(plain), {kind: each(sim) for kind, sim in sims.items()}) for _ in range(ROUNDS)]
    ratios = {kind: statistics.median(row[kind] / base for base, row in times) for kind in texts}
    return min(base for base, _ in times), ratios


def main() -> None:
    """Print a table of motors on all joints, and one of the cylinder of a lift."""
    motors = {
        (name, method): costs(
            with_actuators(name, ""), {kind: with_actuators(name, text) for kind, text in ACTUATORS.items()}, method
        )
        for name in MECHANISMS
        for method in METHODS
    }
    cylinders = {kind: with_cylinder(text) for kind, text in CYLINDERS.items()}
    lifts = {(LIFT, method): costs(with_cylinder(""), cylinders, method) for method in METHODS}
    for title, kinds, found in (("on all joints", ACTUATORS, motors), ("between two points", CYLINDERS, lifts)):
        heads = [f"{name}, {method}" for name, method in found]
        print(f"| {title} | " + " | ".join(heads) + " |\n|---|" + "---|" * len(heads))
        print("| none | " + " | ".join(f"{base:.3f} µs" for base, _ in found.values()) + " |")
        for kind in kinds:
            cells = (f"{ratios[kind]:.2f}" if kind in ratios else "–" for _, ratios in found.values())
            print(f"| {kind} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
