"""Robots on a floor for 20 s, see `floor_trials`, beside MuJoCo with ever smaller steps.

python -m benchmarks.floor_robots a1_stands ant_stands --seconds 20 --steps 1e-3 2.5e-4

MuJoCo gets the same mechanism as an MJCF, with elliptic cones, and contacts that take the speed of what lands in one
step: then its motion converges to that with rigid contacts, but for what slips in an impact. Its friction is that of a
convex problem, in which slip lifts: a point that strikes a plane with (1, -1) m/s and a coefficient of friction of 0.3
leaves it with (0.64, 0.19) m/s at any step, and not with (0.7, 0). `--moreau` compares with time stepping by the laws
of Coulomb and Newton, our method `moreau`, in ever smaller steps.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, field

import mujoco
import numpy as np

from benchmarks.floor_trials import TRIALS, Trial
from mbd_sim import Kinematics, MbdSimError, Simulation
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.mechanism.mechanism import Mechanism

RECOVERY = 0.02  # s, in which MuJoCo's contacts push bodies out of each other
HARD = [0.9999, 0.9999, 1e-3, 0.5, 2.0]  # solimp
STEP = 1e-3  # s, ours, and the time for which commands hold
WIDTHS = {0: 7, 1: 4, 2: 1, 3: 1}  # of qpos, by mjtJoint


@dataclass
class Course:
    """Positions of a run at instants, by the names of joints."""

    times: list[float] = field(default_factory=list)
    values: list[dict[str, np.ndarray]] = field(default_factory=list)
    seconds: float = 0.0
    steps: int = 0
    residual: float = 0.0  # J
    notes: list[str] = field(default_factory=list)


def ours(trial: Trial, mechanism: Mechanism, seconds: float, samples: int, method: str | None, own: int = 1) -> Course:
    """Our run, in `own` steps for each ms."""
    began = time.process_time()
    sim = Simulation(mechanism, step=STEP / own, method=method)
    found = Course()
    found.notes.append(f"build {time.process_time() - began:.1f} s")
    layout = Kinematics(mechanism).layout
    number = round(seconds / STEP)
    every = max(1, number // samples)
    took = 0.0
    each: list[float] = []
    for step in range(number + 1):
        if step % every == 0:
            found.times.append(sim.time)
            found.values.append({name: sim.q[layout.q[name]].copy() for name in mechanism.joints if name in layout.q})
        if step == number:
            break
        commands = trial.commands(step * STEP)
        began = time.process_time()
        if commands:
            sim.set_commands(commands)
            sim.step(own)
            each.append(time.process_time() - began)
        elif step % every == 0:
            sim.step(own * every)
        took += time.process_time() - began
    found.seconds, found.steps, found.residual = took, number, sim.energies.residual
    contacts = sim.contacts()
    closed = sum(reading.state != "open" for reading in contacts.values())
    found.notes += [
        f"{len(contacts)} gaps, {closed} closed",
        f"{took / number * 1e6:.0f} us a step",
        f"residual {found.residual:.1e} J",
        f"method {sim.model.method.name}",
    ]
    if each:
        middle, late = (1e6 * value for value in np.percentile(each, [50, 99]))
        overruns = sum(value > STEP for value in each)
        found.notes.append(f"a call with its commands: median {middle:.0f} us, 99 % {late:.0f} us")
        found.notes.append(f"{overruns} of {number} longer than a step, longest {1e3 * max(each):.0f} ms")
    return found


def theirs(trial: Trial, mechanism: Mechanism, seconds: float, samples: int, step: float) -> Course:
    """MuJoCo's run."""
    written = to_mjcf(mechanism)
    spec = mujoco.MjSpec.from_string(written.text)
    spec.option.timestep = step
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.tolerance, spec.option.iterations = 1e-14, 200
    for pair in spec.pairs:
        pair.solref, pair.solimp = [-1.0 / (RECOVERY * step), -1.0 / step], HARD
    model = spec.compile()
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    places = {model.joint(index).name: index for index in range(model.njnt)}
    found = Course()
    own = round(STEP / step)
    number, actuators = round(seconds / STEP), {model.actuator(i).name: i for i in range(model.nu)}
    every = max(1, number // samples)
    began = time.process_time()
    for count in range(number + 1):
        if count % every == 0:
            found.times.append(data.time)
            found.values.append(
                {
                    name: data.qpos[(at := int(model.jnt_qposadr[i])) : at + WIDTHS[int(model.jnt_type[i])]].copy()
                    for name, i in places.items()
                }
            )
        for name, value in trial.commands(count * STEP).items():
            data.ctrl[actuators[name]] = value
        mujoco.mj_step(model, data, own)
    found.seconds, found.steps = time.process_time() - began, number * own
    return found


def difference(one: Course, other: Course) -> list[float]:
    """The largest difference of a coordinate at each instant."""
    out = []
    for a, b in zip(one.values, other.values, strict=True):
        common = [name for name in a if name in b and a[name].size == b[name].size > 0]
        out.append(max(float(np.max(np.abs(a[name] - b[name]))) for name in common))
    return out


def main() -> None:
    """Run trials and print what they give."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="+", choices=[*TRIALS, "all"])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--steps", type=float, nargs="*", default=[1e-3, 2.5e-4, 6.25e-5])
    parser.add_argument("--moreau", type=int, nargs="*", default=[], help="steps of time stepping within 1 ms")
    parser.add_argument("--samples", type=int, default=10)
    parser.add_argument("--method")
    options = parser.parse_args()
    np.set_printoptions(precision=5, suppress=True, linewidth=200)
    for name in TRIALS if "all" in options.trials else options.trials:
        trial = TRIALS[name]
        print(f"== {name}: {trial.format}, {trial.task}", flush=True)
        try:
            mechanism = trial.build()
            run = ours(trial, mechanism, options.seconds, options.samples, options.method)
        except MbdSimError as error:
            print(f"  {type(error).__name__}: {error}"[:1500], flush=True)
            continue
        print("  ", "; ".join(run.notes), flush=True)
        shown = [name for name in trial.watch if name in run.values[0]] or [next(iter(run.values[0]))]
        for at, values in zip(run.times, run.values, strict=True):
            print(f"   {at:6.2f}", *(values[name] for name in shown))
        for own in options.moreau:
            other = ours(trial, mechanism, options.seconds, options.samples, "moreau", own)
            print(f"   moreau {STEP / own:g} s:", *(f"{d:.1e}" for d in difference(run, other)), flush=True)
        for step in options.steps:
            other = theirs(trial, mechanism, options.seconds, options.samples, step)
            print(
                f"   MuJoCo {step:g} s, {other.seconds / other.steps * 1e6:.0f} us a step:",
                *(f"{d:.1e}" for d in difference(run, other)),
                flush=True,
            )


if __name__ == "__main__":
    main()
