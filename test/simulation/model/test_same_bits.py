"""Neither the seed of Python's hashes nor the processor's linear algebra shows in equations, kernels, motions and recordings.

OpenBLAS and NumPy choose their routines by the processor; `OPENBLAS_CORETYPE`, `NPY_DISABLE_CPU_FEATURES` and
`GLIBC_TUNABLES` make them choose those of an old one, which has neither AVX2 nor fused operations.
`python -m test.simulation.model.test_same_bits` prints what is compared; to find the cause of a difference, vary the
seed or the processor alone.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from mbd_sim import Simulation, load_mechanism
from mbd_sim.base import disk_cache
from mbd_sim.compiler import kernel
from mbd_sim.compiler.code import machine_code
from mbd_sim.compiler.lists.packing import packed
from mbd_sim.compiler.lists.schedule import arranged
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import parse_mechanism
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.simulation.model import builder
from mbd_sim.simulation.model.live_values import LiveValues, names_with_matches
from mbd_sim.studies.optimization import SensitivityModel
from test.generators.legged_robots import legged

ROOT = Path(__file__).parents[3]
LIVE = ["gravity[*]", "parameters.*", "forces.*", "constraints.*"]  # joints have most keys: see `computed`
FEATURES = ("tippe_top", "duffing", "rocking", "freewheel")  # joints, elements, laws and contacts
SAMPLE = ("four_bar",)
OLD_PROCESSOR = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
}


def digest(*contents):
    return hashlib.sha256(repr(contents).encode()).hexdigest()


def derived(name):
    """Of the equations with live values of all sections."""
    mechanism = load_mechanism(name)
    live = LiveValues(mechanism, names_with_matches(mechanism, LIVE))
    numbers = live.parameters.symbolic
    equations = derive(mechanism, tuple(mechanism.parts), numbers)
    functions = [equations.rates, equations.project, equations.energies, equations.multipliers]
    serialized = [function and function.serialize() for function in functions]
    return digest(list(live.current.items()), numbers.base.tobytes(), numbers.columns.tobytes(), serialized)


def computed(name):
    """Of a motion with live values of joints as well, and of the key of its kernel."""
    keys, load, mechanism = [], disk_cache.load, load_mechanism(name)
    live = names_with_matches(mechanism, [*LIVE, "joints.*"])
    with patch.object(disk_cache, "load", lambda key: keys.append(key) or load(key)):
        sim = Simulation(mechanism, method="rk4", wrenches=list(mechanism.parts), live=live)
    sim.step(200)
    return digest(sim.state.tobytes(), sim.inputs.tobytes(), keys)


def of_series():
    """Of a motion by the method of series."""
    sim = Simulation.from_file("four_bar", method="taylor")
    sim.step(200)
    return digest(sim.state.tobytes(), sim.history.tobytes())


def differentiated():
    """Of the derivatives of a run, but for their last digits: they are products by the linear algebra of the processor."""
    model = SensitivityModel(load_mechanism("spherical_top"), (), method="tsitouras8", step=0.01)
    dx = model.run(24, efforts=np.ones((2, 3))).dx
    return digest(*((np.round(array, 9) + 0.0).tobytes() for array in (dx.by_parameters, dx.by_start, dx.by_efforts)))


def recorded():
    """Of a recording with live values, efforts and wrenches, which a process with another seed must read alike."""
    sim = Simulation.from_file("bead_on_wire", method="rk4", live=["parameters.*", "gravity[*]"], wrenches=["bead"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with sim.recording(path, violation=True):
            sim.set_live({key: 1.1 * value for key, value in sim.live.items()}, reassemble=True)
            sim.set_efforts(np.ones(len(sim.u)))
            sim.step(20)
        recording = open_recording(path)
        topics = {name: (topic.type, topic.count) for name, topic in recording.topics.items()}
        messages = [(message.topic, message.time_ns, message.payload) for message in recording.messages()]
    return digest(topics, messages)


def packed_legs():
    """Of the order and the packs of the operations of a robot with legs."""
    equations = derive(parse_mechanism(legged()))
    return digest(packed(arranged(equations.rates), equations.like_branches).units)


class EmittedError(Exception):
    """The module is written, and need not be compiled."""


def emitted(name):
    """Of the start of a mechanism, its inputs, and the module that is compiled for it."""
    modules, found = [], []

    def emit_only(module):
        modules.append(str(module))
        raise EmittedError

    def trace():
        found.append(derive(mechanism))
        return found[0]

    mechanism = load_mechanism(name)
    with patch.object(kernel, "compile_module", emit_only), pytest.raises(EmittedError):
        builder.build(mechanism, mechanism.method, trace, mechanism.step)
    return digest(modules[0], found[0].start_state.tobytes(), found[0].inputs_without_commands.tobytes())


def digests():
    machine_code.LEVEL = 0
    return (
        {name: derived(name) for name in FEATURES}
        | {"moving_support_pendulum, computed": computed("moving_support_pendulum")}
        | {f"{name}, emitted": emitted(name) for name in SAMPLE}
        | {"four_bar, taylor": of_series(), "legs, packed": packed_legs()}
        | {"spherical_top, differentiated": differentiated(), "bead_on_wire, recorded": recorded()}
    )


def test_a_process_with_other_hashes_and_linear_algebra_derives_and_computes_the_same(own_builds, monkeypatch):
    """Beside this process, in which Python chose the seed and other tests ran before."""
    monkeypatch.setenv("MBD_SIM_CACHE", "off")
    environment = {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore", "PYTHONHASHSEED": "2"}
    process = subprocess.Popen(
        [sys.executable, "-m", "test.simulation.model.test_same_bits"],
        env=os.environ | environment | {"OPENBLAS_NUM_THREADS": "1"} | OLD_PROCESSOR,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    first, other = digests(), json.loads(process.communicate()[0])
    assert process.returncode == 0
    assert len(first) == len(FEATURES) + len(SAMPLE) + 5
    assert [name for name in first if first[name] != other[name]] == []


if __name__ == "__main__":
    print(json.dumps(digests()))
