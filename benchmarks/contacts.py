"""Contacts: what steps and events cost, and errors beside MuJoCo's against closed forms.

python -m benchmarks.contacts [--rounds 31]
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Mapping

import yaml

from benchmarks.contact_models import SYSTEMS, System, text
from mbd_sim import Ensemble, Simulation
from mbd_sim.files.load import load_mechanism, parse_mechanism

STEPS, MANY = 3000, 100
METHODS = ("tsitouras8", "rk4")  # methods of one step, a long and a short one
OPEN = {  # changes that keep everything open
    "bounce": {"h": 1e6},
    "stops": {"lim": 100.0},
    "rocking": {"joints.block.position[1]": -1e6},
    "elbow_stop": {"lim": 1e4, "joints.elbow.limits.lower": -1e4},
    "spinning_ball": {"z0": 1e6},
    "bowling": {"joints.ball.position[1]": -1e6},
}
CLOSED = {"bounce": 4.2, "incline": 0.1, "belt": 0.05, "rocking": 0.0, "bowling": 2.0}  # s
TWENTY = """
mechanism: twenty
parts:
  ball_{i}: {for: {i: 1..20}, shape: {type: sphere, mass: 1, radius: 0.1}}
joints:
  ball_{i}:
    for: {i: 1..20}
    type: planar
    between: [ground, "ball_{i}"]
    axis: [0, 1, 0]
    x_axis: [1, 0, 0]
    position: [0.3*i, -0.1, 0]
    velocity: [1, 0, 10]
constraints:
  floor_{i}: {for: {i: 1..20}, type: rolling, wheel: "ball_{i}", radius: 0.1, friction: 0.3}
"""
HOPPER = """
mechanism: hopper
parameters: {h: 0.5}
parts:
  body: {shape: {type: sphere, mass: 1, radius: 0.05}}
  foot: {shape: {type: sphere, mass: 0.1, radius: 0.02}}
joints:
  flight: {type: prismatic, between: [ground, body], axis: [0, 0, 1], position: h}
  leg:
    type: prismatic
    between: [body, foot]
    axis: [0, 0, -1]
    position: 0.3
    rest: 0.3
    stiffness: 2000
    damping: 2
constraints:
  floor: {type: on_plane, point: foot, bound: at_least, restitution: 0, friction: 0.5}
"""
MEMBERS, TIME = 1000, 2.0  # of an ensemble, and s


def each(sim: Simulation, steps: int, n: int) -> float:
    """Processor time in s for a step, in calls of n steps."""
    step, began = sim.step, time.thread_time()
    for _ in range(steps // n):
        step(n)
    return (time.thread_time() - began) / (steps // n * n)


def without(name: str, changes: Mapping[str, float], method: str | None = None) -> Simulation:
    """The same mechanism without its one-sided elements."""
    data = yaml.safe_load(load_mechanism(name).source.text)
    data.pop("constraints", None)
    for joint in data["joints"].values():
        joint.pop("limits", None)
    kept = {key: value for key, value in changes.items() if "limits" not in key}
    return Simulation.from_text(yaml.safe_dump(data, sort_keys=False), set=kept, method=method)


def opened(rounds: int) -> None:
    """Steps with everything open, beside the same mechanism without one-sided elements, by the same method."""
    for method in METHODS:
        print(f"\n| everything open, {method} | µs, `step(1)` | without | ratio ", end="")
        print("| µs, many per call | without | ratio |\n| --- | --: | --: | --: | --: | --: | --: |")
        for name, changes in OPEN.items():
            pair = Simulation.from_file(name, set=changes, method=method), without(name, changes, method)
            cells = [cell for n in (1, MANY) for cell in compared(pair, n, rounds)]
            if pair[0].contact_events:
                raise RuntimeError(f"{name}: a contact was not open")
            print(f"| {name} | {' | '.join(cells)} |", flush=True)


def compared(pair: tuple[Simulation, Simulation], n: int, rounds: int) -> list[str]:
    """The medians of the times of a step in µs in calls of n steps, and of their ratio, in alternating runs."""
    samples: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for sim, into in zip(pair, samples, strict=True):
            sim.reset()
            into.append(1e6 * each(sim, STEPS, n))
    ratio = statistics.median(a / b for a, b in zip(*samples, strict=True))
    return [*(f"{statistics.median(values):.3g}" for values in samples), f"{ratio:.2f}"]


def closed(rounds: int) -> None:
    """Steps with closed contacts."""
    print("\n| closed | contacts | µs, `step(1)` | µs, many per call |\n| --- | --: | --: | --: |")
    for name, at in {**CLOSED, "twenty balls that roll": 0.01}.items():
        sim = Simulation.from_file(name) if name in CLOSED else Simulation.from_text(TWENTY)
        sim.run(at)
        snapshot, count = sim.snapshot(), len(sim.contact_events)
        shut = sum(state.state != "open" for state in sim.contacts().values())
        medians = []
        for n in (1, MANY):
            samples = []
            for _ in range(rounds):
                sim.restore(snapshot)
                samples.append(1e6 * each(sim, 100, n))
            medians.append(statistics.median(samples))
        if len(sim.contact_events) != count:
            raise RuntimeError(f"{name}: there were events")
        print(f"| {name} | {shut} | {medians[0]:.3g} | {medians[1]:.3g} |", flush=True)


def timed_run(sim: Simulation, until: float) -> tuple[float, float, int]:
    """Processor times in s of a run in single steps and of its steps with events, and how many instants these have."""
    sim.reset()
    total = within = 0.0
    known = len(sim.contact_events)
    first = known
    for _ in range(round(until / sim.step_size)):
        began = time.thread_time()
        sim.step(1)
        took = time.thread_time() - began
        total += took
        if len(sim.contact_events) != known:
            known, within = len(sim.contact_events), within + took
    return total, within, len({event.time for event in sim.contact_events[first:]})


def error(found: tuple[list[float], list[float]], system: System) -> str:
    """The largest errors of q and u."""
    pairs = zip(found, (system.q, system.u), strict=True)
    return " / ".join(f"{max(abs(a - b) for a, b in zip(*pair, strict=True)):.0e}" for pair in pairs)


def events() -> None:
    """The cost of an event, the cost of a run in steps of 1 ms, and its error; MuJoCo's where it is installed."""
    print("\n| events | ms per event | µs per ms | error | MuJoCo, 1 ms | | MuJoCo, chosen settings | |")
    print("| --- | --: | --: | --: | --: | --: | --: | --: |")
    for name, system in SYSTEMS.items():
        sim = Simulation.from_file(name)
        runs = [timed_run(sim, system.until) for _ in range(5)]
        instants = runs[0][2]
        each_event = f"{1e3 * statistics.median(run[1] for run in runs) / instants:.2g}"
        whole = f"{1e3 * statistics.median(run[0] for run in runs) / system.until:.3g}"
        own = error((system.ours(sim.q.tolist()), system.ours(sim.u.tolist())), system)
        others = [cell for chosen in (False, True) for cell in mujoco_run(system, chosen)]
        print(f"| {name} | {each_event} | {whole} | {own} | {' | '.join(others)} |", flush=True)


def ensembles() -> dict[str, Ensemble]:
    """Ensembles of members with their own starts, on one thread."""
    shares = [index / MEMBERS for index in range(MEMBERS)]
    return {
        "bounce": Ensemble.from_file("bounce", [{"h": 0.5 + share} for share in shares], threads=1),
        "rocking": Ensemble.from_file("rocking", [{"th0": 0.1 + 0.14 * share} for share in shares], threads=1),
        "hopper": Ensemble(parse_mechanism(HOPPER), [{"h": 0.4 + 0.4 * share} for share in shares], threads=1),
    }


def members() -> None:
    """The cost of a step of a member of ensembles with contacts."""
    print(f"\n| {MEMBERS} members, µs per step of a member | a run of {TIME:g} s | `step(10)` | `step(1)` |")
    print("| --- | --: | --: | --: |")
    for name, ensemble in ensembles().items():
        cells = []
        for n in (round(TIME / ensemble.step_size), 10, 1):
            ensemble.reset()
            calls, began = max(1, 300 // n), time.thread_time()
            for _ in range(calls):
                ensemble.step(n)
            cells.append(f"{1e6 * (time.thread_time() - began) / (calls * n * MEMBERS):.2g}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def mujoco_run(system: System, chosen: bool) -> tuple[str, str]:
    """µs per simulated ms, and the errors."""
    try:
        import mujoco
    except ModuleNotFoundError:
        return "–", "–"
    model = mujoco.MjModel.from_xml_string(text(system, chosen))
    times = []
    for _ in range(1 if chosen else 5):
        data = mujoco.MjData(model)
        data.qvel[:] = system.start
        calls, inside = round(system.until / 1e-3), round(1e-3 / model.opt.timestep)
        began = time.thread_time()
        for _ in range(calls):
            mujoco.mj_step(model, data, nstep=inside)
        times.append(time.thread_time() - began)
    kept, offset = list(system.kept), system.offset or (0.0,) * len(system.kept)
    q = [value + shift for value, shift in zip(data.qpos[kept].tolist(), offset, strict=True)]
    return f"{1e3 * statistics.median(times) / system.until:.3g}", error((q, data.qvel[kept].tolist()), system)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=31, help="interleaved samples (default 31)")
    rounds = parser.parse_args().rounds
    opened(rounds)
    closed(rounds)
    events()
    members()
    print(f"\nLoad of the machine over the last minute: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
