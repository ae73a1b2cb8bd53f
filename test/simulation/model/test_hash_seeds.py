"""Equations, inputs and kernels do not depend on the seed of Python's hashes, with live values of all sections."""

import json
import os
import subprocess
import sys
from pathlib import Path

from test.generators.shipped_features import mechanisms_with_all_features

ROOT = Path(__file__).parents[3]
PROGRAM = """
import hashlib, json, sys
from mbd_sim import Simulation, load_mechanism
from mbd_sim.dynamics.equations import derive
from mbd_sim.simulation.model.live_values import names_with_matches
from mbd_sim.simulation.model.live_values import LiveValues
from mbd_sim.base import disk_cache
from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.lists.packing import packed
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.files.load import parse_mechanism
from test.generators.legged_robots import legged

LIVE = ["gravity[*]", "parameters.*", "forces.*", "constraints.*"]  # joints have most keys: below, for two mechanisms


def digest(*contents):
    return hashlib.sha256(repr(contents).encode()).hexdigest()


machine_code.LEVEL, found = 0, {}
for name in sys.argv[1:]:
    mechanism = load_mechanism(name)
    live = LiveValues(mechanism, names_with_matches(mechanism, LIVE))
    numbers = live.parameters.symbolic
    equations = derive(mechanism, tuple(mechanism.parts), numbers)
    functions = [equations.rates, equations.project, equations.energies, equations.multipliers]
    found[name] = digest(list(live.current.items()), numbers.base.tobytes(), numbers.columns.tobytes(),
                         [function and function.serialize() for function in functions])
keys = []
load = disk_cache.load
disk_cache.load = lambda key: keys.append(key) or load(key)
for name in ("bead_on_wire", "moving_support_pendulum"):
    mechanism = load_mechanism(name)
    live = names_with_matches(mechanism, [*LIVE, "joints.*"])
    sim = Simulation(mechanism, method="rk4", wrenches=list(mechanism.parts), live=live)
    sim.step(200)
    found[f"{name}, computed"] = digest(sim.state.tobytes(), sim.inputs.tobytes(), keys)
sim = Simulation.from_file("four_bar", method="taylor")
sim.step(200)
found["four_bar, taylor"] = digest(sim.state.tobytes(), sim.history.tobytes(), keys)
equations = derive(parse_mechanism(legged()))
found["legs, packed"] = digest(packed(arranged(equations.rates), equations.like_branches).units)
print(json.dumps(found))
"""


def test_processes_of_several_hash_seeds_derive_and_compute_the_same():
    processes, names = [], mechanisms_with_all_features(most_joints=3)  # longer chains are those of what these have
    for seed in ("1", "2"):
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT), "MBD_SIM_CACHE": "off"}
        command = [sys.executable, "-c", PROGRAM, *names]
        processes.append(subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True))
    outputs = [process.communicate()[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    first, *others = [json.loads(output) for output in outputs]
    assert len(first) == len(names) + 4 and len(names) > 12
    for other in others:
        assert [name for name in first if first[name] != other[name]] == []
