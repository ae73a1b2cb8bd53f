"""What a run starts from, and the numbers in its equations, do not depend on the processor's linear algebra.

OpenBLAS and NumPy choose their routines by the processor; `OPENBLAS_CORETYPE` and `NPY_DISABLE_CPU_FEATURES` make them
choose those of others. `python -m test.simulation.model.test_same_bits` prints what is compared.
"""

import hashlib
import json
import os
import subprocess
import sys

import pytest

SAMPLE = ("four_bar", "rssr", "bennett", "scissor_lift", "driveline", "snap_latch", "six_axis_arm", "air_spring")
PROCESSORS = {
    "Nehalem": {"NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3", "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
    "Haswell": {"NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512_SKX"},
    "Prescott": {},
}


class EmittedError(Exception):
    """The module is written, and need not be compiled."""


def digest_of(name):
    """A digest of the start of a mechanism, its inputs, and the module that is compiled for it."""
    from mbd_sim.compiler import kernel
    from mbd_sim.dynamics.equations import derive
    from mbd_sim.files.load import load_mechanism
    from mbd_sim.simulation.model import builder

    emitted, found = [], []

    def emit_only(module):
        emitted.append(str(module))
        raise EmittedError

    kernel.compile_module = emit_only
    mechanism = load_mechanism(name)

    def trace():
        found.append(derive(mechanism))
        return found[0]

    with pytest.raises(EmittedError):
        builder.build(mechanism, mechanism.method, trace, mechanism.step)
    numbers = [found[0].start_state, found[0].inputs_without_commands]
    return hashlib.sha256(b"".join([emitted[0].encode(), *(one.tobytes() for one in numbers)])).hexdigest()


def digests(**environment):
    """The digests of the sample in a process with its own environment."""
    variables = {
        **os.environ,
        "MBD_SIM_CACHE": "off",
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONWARNINGS": "ignore",
        **environment,
    }
    command = [sys.executable, "-m", "test.simulation.model.test_same_bits"]
    return json.loads(subprocess.run(command, env=variables, capture_output=True, text=True, check=True).stdout)


@pytest.fixture(scope="module")
def own():
    return digests()


@pytest.mark.skipif(sys.platform != "linux" or os.uname().machine != "x86_64", reason="the names are of x86-64")
@pytest.mark.parametrize("processor", PROCESSORS)
def test_start_and_equations_are_the_same_on_every_processor(own, processor):
    assert digests(OPENBLAS_CORETYPE=processor, **PROCESSORS[processor]) == own


if __name__ == "__main__":
    print(json.dumps({name: digest_of(name) for name in sys.argv[1:] or SAMPLE}))
