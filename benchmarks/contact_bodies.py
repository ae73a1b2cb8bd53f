"""Bodies of finite size in contact: errors beside closed forms and the cost of a step, beside MuJoCo's and Drake's.

python -m benchmarks.contact_bodies [--rounds 5]

MuJoCo runs with steps of 1 ms and its defaults, and with chosen settings: steps of 0.1 ms, elliptic cones, and hard
contacts. Drake, if it is installed, runs with steps of 1 ms and hydroelastic contacts, which a single point cannot
replace under a block. µs are those of processor time per simulated ms, of one call for each ms. The runs of all
simulators take turns, and the medians count.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TypeAlias

from mbd_sim import Simulation

Run: TypeAlias = Callable[[], tuple[float, float]]

G = 9.81
SPAN = 1.0  # s
DEFAULTS = '<option timestep="1e-3" gravity="{gravity}"/>'
CHOSEN = (
    '<option timestep="1e-4" gravity="{gravity}" cone="elliptic" impratio="100"><flag refsafe="disable"/></option>'
    '<default><geom solref="2e-4 1" solimp="0.9999 0.9999 0.001 0.5 2"/></default>'
)
STACK = """
mechanism: stack
parts:
  table: {shape: {type: block, size: [1, 1, 0.2], at: [0, 0, -0.1], mass: 1}}
  b{i}: {for: {i: 1..4}, shape: {type: block, size: [0.2, 0.2, 0.1], mass: 1}}
joints:
  table: {type: fixed, between: [ground, table]}
  b{i}:
    for: {i: 1..4}
    type: planar
    between: [ground, "b{i}"]
    axis: [0, -1, 0]
    x_axis: [1, 0, 0]
    position: [0, 0.1*i - 0.05, 0]
contacts:
  c1: {between: [b1, table], friction: 0.5}
  c2: {between: [b2, b1], friction: 0.5}
  c3: {between: [b3, b2], friction: 0.5}
  c4: {between: [b4, b3], friction: 0.5}
"""
GRIP = """
mechanism: grip
parameters: {force: 4}
parts:
  left: {shape: {type: block, size: [0.02, 0.1, 0.04], at: [-0.01, 0, 0], mass: 0.1}}
  right: {shape: {type: block, size: [0.02, 0.1, 0.04], at: [0.01, 0, 0], mass: 0.1}}
  block: {shape: {type: block, size: [0.06, 0.1, 2], mass: 0.5}}
joints:
  left: {type: prismatic, between: [ground, left], axis: [1, 0, 0], position: -0.03}
  right: {type: prismatic, between: [ground, right], axis: [1, 0, 0], position: 0.03}
  block: {type: planar, between: [ground, block], axis: [0, -1, 0], x_axis: [1, 0, 0]}
forces:
  one: {type: effort, coordinate: left, effort: force}
  two: {type: effort, coordinate: right, effort: -force}
contacts: {c: {between: [block, left], friction: 0.5}, d: {between: [block, right], friction: 0.5}}
"""
ROLLER = """
mechanism: roller
gravity: [1, 0, -9.81]
parts:
  table: {shape: {type: block, size: [4, 1, 0.2], at: [0, 0, -0.1], mass: 1}}
  roller: {shape: {type: cylinder, radius: 0.1, length: 0.4, mass: 2, axis: [0, 1, 0]}}
joints:
  table: {type: fixed, between: [ground, table]}
  roller: {type: free, between: [ground, roller], position: [0, 0, 0.1]}
contacts: {c: {between: [roller, table], friction: 0.5}}
"""
PLANAR = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 -1 0"/>'


@dataclass(frozen=True)
class Scene:
    """A mechanism, the same one for MuJoCo, and how far off in m it is at the end: `ours` of q, `theirs` of qpos."""

    text: str
    body: str
    ours: Callable[[list[float]], float]
    theirs: Callable[[list[float]], float]
    force: float = 0.0
    gravity: str = "0 0 -9.81"


def block(at: str, size: str, mass: float, joints: str, friction: float) -> str:
    """A body of MuJoCo with the geometry of a block, of half sizes."""
    geom = f'<geom type="box" size="{size}" mass="{mass}" friction="{friction} 0 0" condim="3"/>'
    return f'<body name="at {at}" pos="{at}">{joints}{geom}</body>'


def grip(force: float) -> Scene:
    """A block between two fingers, which hold it with 2 · 0.5 · force, or let it slip."""
    fall = 0.5 * max(0.0, G - force / 0.5) * SPAN**2
    slide = '<joint type="slide" axis="1 0 0" name="{}"/>'
    fingers = [
        block(f"{sign * 0.04} 0 0", "0.01 0.05 0.02", 0.1, slide.format(name), 0.5)
        for sign, name in ((-1, "left"), (1, "right"))
    ]
    body = "".join(fingers) + block("0 0 0", "0.03 0.05 1", 0.5, PLANAR, 0.5)
    return Scene(GRIP, body, lambda q: abs(q[3] + fall), lambda q: abs(q[3] + fall), force)


def scenes() -> dict[str, Scene]:
    """All scenes."""
    floor = '<geom type="box" size="2 0.5 0.1" pos="0 0 -0.1" friction="0.5 0 0" condim="3"/>'
    stack = floor + "".join(block(f"0 0 {0.1 * i - 0.05}", "0.1 0.1 0.05", 1.0, PLANAR, 0.5) for i in range(1, 5))
    heights = [0.1 * i - 0.05 for i in range(1, 5)]
    geom = '<geom type="cylinder" size="0.1 0.2" mass="2" euler="1.5707963267948966 0 0" friction="0.5 0 0"/>'
    roller = f'{floor}<body name="roller" pos="0 0 0.1"><freejoint/>{geom}</body>'
    way = SPAN**2 / 3.0
    return {
        "stack of four blocks": Scene(
            STACK,
            stack,
            lambda q: max(math.hypot(q[3 * i], q[3 * i + 1] - heights[i]) for i in range(4)),
            lambda q: max(math.hypot(q[3 * i], q[3 * i + 1]) for i in range(4)),
        ),
        "grip that holds": grip(5.0),
        "grip that slips": grip(4.0),
        "cylinder that rolls on a block": Scene(
            ROLLER, roller, lambda q: abs(q[0] - way), lambda q: abs(q[0] - way), gravity="1 0 -9.81"
        ),
    }


def ours(scene: Scene) -> Run:
    """A run, to call again and again: its processor time in s, and the error in m."""
    sim = Simulation.from_text(scene.text, set={"force": scene.force} if scene.force else {})

    def run() -> tuple[float, float]:
        sim.reset()
        began = time.thread_time()
        for _ in range(round(SPAN / sim.step_size)):
            sim.step(1)
        return time.thread_time() - began, scene.ours(sim.q.tolist())

    return run


def mujoco(scene: Scene, option: str) -> Run:
    """The same of MuJoCo."""
    import mujoco

    head = f'<compiler angle="radian"/>{option.format(gravity=scene.gravity)}'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{head}<worldbody>{scene.body}</worldbody></mujoco>")

    def run() -> tuple[float, float]:
        data = mujoco.MjData(model)
        if scene.force:
            data.qfrc_applied[:2] = scene.force, -scene.force
        began = time.thread_time()
        for _ in range(round(SPAN / 1e-3)):
            mujoco.mj_step(model, data, nstep=round(1e-3 / model.opt.timestep))
        return time.thread_time() - began, scene.theirs(data.qpos.tolist())

    return run


def drake(scene: Scene) -> Run:
    """The same of Drake."""
    from pydrake.geometry import SceneGraphConfig
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder, config = DiagramBuilder(), SceneGraphConfig()
    plant, graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.xml"
        file.write_text(f'<mujoco model="scene"><worldbody>{scene.body}</worldbody></mujoco>', encoding="utf-8")
        Parser(plant, graph).AddModels(str(file))
    config.default_proximity_properties.compliance_type = "compliant"
    config.default_proximity_properties.hydroelastic_modulus = 1e8
    graph.set_config(config)
    plant.set_contact_model(ContactModel.kHydroelasticWithFallback)
    plant.mutable_gravity_field().set_gravity_vector([float(value) for value in scene.gravity.split()])
    plant.Finalize()
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    own, start = plant.GetMyMutableContextFromRoot(context), simulator.get_context().Clone()

    def run() -> tuple[float, float]:
        context.SetTimeStateAndParametersFrom(start)
        efforts = [scene.force, -scene.force] + [0.0] * (plant.num_velocities() - 2)
        plant.get_applied_generalized_force_input_port().FixValue(own, efforts)
        simulator.Initialize()
        began = time.thread_time()
        for count in range(round(SPAN / 1e-3)):
            simulator.AdvanceTo((count + 1) * 1e-3)
        q = plant.GetPositions(own).tolist()
        if plant.num_positions() != plant.num_velocities():  # a free body: MuJoCo's order is the other one
            q = [*q[4:], *q[:4]]
        return time.thread_time() - began, scene.theirs(q)

    return run


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="runs of each, of which the median counts (default 5)")
    rounds, has_drake = parser.parse_args().rounds, find_spec("pydrake") is not None
    heads = ["MuJoCo, 1 ms", "MuJoCo, chosen settings", *(["Drake, 1 ms"] if has_drake else [])]
    print(f"| {SPAN:g} s | µs per ms | error, m | {' | '.join(f'{head} | | ratio' for head in heads)} |")
    print("| --- | --: | --: |" + " --: | --: | --: |" * len(heads))
    for name, scene in scenes().items():
        runs = [ours(scene), mujoco(scene, DEFAULTS), mujoco(scene, CHOSEN), *([drake(scene)] if has_drake else [])]
        found = [[run() for run in runs] for _ in range(rounds)]
        costs = [1e3 * statistics.median(each[k][0] for each in found) / SPAN for k in range(len(runs))]
        cells = [f"{costs[0]:.3g}", f"{found[0][0][1]:.0e}"]
        for cost, (_, error) in zip(costs[1:], found[0][1:], strict=True):
            cells += [f"{cost:.3g}", f"{error:.0e}", f"{cost / costs[0]:.2g}"]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print(f"\nLoad of the machine over the last minute: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores.")


if __name__ == "__main__":
    main()
