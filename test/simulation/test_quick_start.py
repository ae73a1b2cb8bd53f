"""Models that start with code that is not optimized, until a process in the background has built them."""

import contextlib
import gc
import os
import signal
import subprocess
import sys
import threading
import weakref

import numpy as np
import pytest

from mbd_sim import DivergedError, Ensemble, Simulation, disk_cache, simulation
from mbd_sim.compiler import machine_code
from mbd_sim.compiler.python_callable import STEPS_AT_ONCE
from mbd_sim.load import load_mechanism
from mbd_sim.simulation import quick_start
from mbd_sim.simulation.optimizing_process import LOCK
from mbd_sim.simulation.prepared_model import load_prepared, model_key
from test.waiting import PATIENCE, wait_until

UNSTABLE = """
mechanism: unstable
parts: {mass: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], stiffness: 1e12, position: 1}}
integrator: {method: METHOD, step: 1e-5}
"""
DISTANT = """
mechanism: distant
parts: {mass: {mass: 1}}
joints: {rail: {type: prismatic, between: [ground, mass], axis: [1, 0, 0], spring: {force: x + 0.1*x*sin(x)}}}
"""
pytestmark = pytest.mark.usefixtures("own_builds")


@pytest.fixture(autouse=True)
def allowed(tmp_path, monkeypatch):
    """Each test has a cache of its own, and a build before it is long ago."""
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("MBD_SIM_QUICK_START", "on")
    monkeypatch.setattr(machine_code, "LEVEL", 1)
    monkeypatch.setattr(quick_start, "APART", 0.0)


@pytest.fixture
def asked(monkeypatch):
    """The models to be built in the background, which nobody builds."""
    arguments = []
    monkeypatch.setattr(simulation, "optimize_later", lambda *given: arguments.append(given))
    return arguments


def adopt(asked):
    """Build a model as the background process does, and use its code."""
    _, kernel, key, order = asked.pop()
    order.store(key)
    kernel.adopt(load_prepared(key)[1])
    return kernel


def state(sim):
    return [array.tobytes() for array in (sim.y, sim.inputs, sim.history, np.array([sim.steps, sim.error_estimate]))]


CASES = {
    "adams11": ("double_rod", {}),
    "loops": ("four_bar", {}),
    "quaternions": ("rolling_disc", {}),
    "taylor": ("double_rod", {"method": "taylor"}),
    "rk4": ("slider_crank", {"method": "rk4"}),
    "rosenbrock": ("triple_rod_torsion", {"method": "rosenbrock"}),
    "rosenbrock_w": ("triple_rod_torsion", {"method": "rosenbrock_w"}),
    "gauss6": ("double_rod", {"method": "gauss6"}),
    "live values": ("double_rod", {"live": ["gravity[2]"]}),
    "wrenches": ("double_rod", {"wrenches": ["lower"]}),
    "sampled motors": ("six_axis_servo_arm", {}),
}


@pytest.mark.parametrize("case", CASES)
def test_the_code_changes_and_the_results_do_not(case, asked):
    name, options = CASES[case]
    sim = Simulation.from_file(name, **options)
    assert not sim.model.kernel.optimized
    step, poses = sim.step, sim.poses  # callables that a user keeps
    step(37)
    energies = sim.energies
    kernel = adopt(asked)
    assert kernel is sim.model.kernel and kernel.optimized
    assert sim.energies == energies
    for count in (1, 20, 300):
        step(count)
    other = Simulation.from_file(name, **options)  # from the cache
    assert other.model.kernel.optimized and not asked
    other.step(358)
    assert state(sim) == state(other)
    assert sim.energies == other.energies and repr(poses()) == repr(other.poses())
    copied = sim.copy()
    copied.step(5)
    other.step(5)
    assert state(copied) == state(other)


def test_the_compiled_step_calls_the_optimized_code(asked):
    """The same call runs other machine code: here, code of a mechanism with another gravity."""
    sim = Simulation.from_file("double_rod")
    other = Simulation.from_file("double_rod", set={"gravity": [0, 0, 0]}).model.kernel
    sim.model.kernel.adopt(other)
    sim.step(1)
    assert sim.q == pytest.approx(sim.model.start[:2], abs=0)  # at rest, without gravity


@pytest.mark.parametrize("method", ["rk4", "adams11"])
def test_a_long_call_that_fails_changes_nothing_and_says_the_same(method, asked, monkeypatch):
    sim, messages = Simulation.from_text(UNSTABLE.replace("METHOD", method)), []
    before = state(sim)[:3]
    monkeypatch.setenv("MBD_SIM_QUICK_START", "off")
    optimized = Simulation.from_text(UNSTABLE.replace("METHOD", method))
    for each in (sim, optimized):
        with pytest.raises(DivergedError) as raised:
            each.step(20 * STEPS_AT_ONCE)
        messages.append(str(raised.value))
        assert (state(each)[:3], each.steps) == (before, 0)
    assert messages[0] == messages[1] and sim.error_estimate == optimized.error_estimate
    sim.step(3)
    assert sim.steps == 3


@pytest.mark.parametrize("recorded", [False, True])
def test_an_interrupt_in_a_long_call_leaves_state_and_time_together(recorded, asked, tmp_path):
    """Of code that is not optimized, and of a run that is recorded, which is divided too."""

    def interrupt(*_):
        raise KeyboardInterrupt

    sim = Simulation.from_file("double_rod")
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        recording = sim.recording(tmp_path / "run.mcap") if recorded else contextlib.nullcontext()
        with recording, pytest.raises(KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, 0.05)
            while True:
                sim.step(10**9)
    finally:
        signal.signal(signal.SIGALRM, before)
    other = Simulation.from_file("double_rod")
    other.step(sim.steps)
    assert state(sim) == state(other)


def test_a_long_call_gives_way_to_the_optimized_code(asked, monkeypatch):
    """Between two parts of the call; from then on without gravity, which shows it."""
    sim, sizes, energies = Simulation.from_file("rod_pendulum"), [], []
    other = Simulation.from_file("rod_pendulum", set={"gravity": [0, 0, 0]}).model.kernel
    plain = type(sim._memory)._counted

    def counted(self, n):
        sizes.append(n)
        energies.append(sim.energies.kinetic)
        if len(sizes) == 4:
            sim.model.kernel.adopt(other)
        return plain(self, n)

    monkeypatch.setattr(type(sim._memory), "_counted", counted)
    sim.step(7 * STEPS_AT_ONCE + 5)
    assert sizes == 7 * [STEPS_AT_ONCE] + [5] and sim.steps == sum(sizes)
    assert len(set(np.round(energies[:4], 3))) == 4
    assert energies[4:] == pytest.approx([energies[3]] * 4, abs=1e-12)  # conserved


@pytest.mark.parametrize("written", ["off", "0", "", "OFF"])
def test_it_can_be_turned_off(written, asked, monkeypatch):
    monkeypatch.setenv("MBD_SIM_QUICK_START", written)
    assert Simulation.from_file("rod_pendulum").model.kernel.optimized and not asked


@pytest.mark.parametrize(("name", "value"), [("executable", ""), ("frozen", True)])
def test_programs_without_an_interpreter_wait_for_optimized_code(name, value, asked, monkeypatch):
    monkeypatch.setattr(sys, name, value, raising=False)
    assert Simulation.from_file("rod_pendulum").model.kernel.optimized and not asked


def test_where_nothing_can_be_stored_a_program_waits_for_optimized_code(asked, monkeypatch):
    monkeypatch.setenv("MBD_SIM_CACHE", "/dev/null/cache")
    assert Simulation.from_file("rod_pendulum").model.kernel.optimized and not asked


def test_a_model_starts_quickly_only_once(asked):
    """If its process was ended, as those of a container are with the program, the next start waits."""
    assert not Simulation.from_file("rod_pendulum").model.kernel.optimized
    asked.clear()
    assert Simulation.from_file("rod_pendulum").model.kernel.optimized and not asked


def test_while_another_model_is_being_optimized_a_program_waits(asked):
    with disk_cache.one_at_a_time(LOCK):
        assert Simulation.from_file("rod_pendulum").model.kernel.optimized and not asked


def test_what_is_not_stored_is_optimized_at_once(asked, monkeypatch):
    """Contacts, springs whose potential is not known everywhere, ensembles, and everything without a cache."""
    assert Simulation.from_file("bounce").model.kernel.optimized
    distant = Simulation.from_text(DISTANT).model
    assert distant.kernel.optimized and distant.equations.distant_springs is not None
    Ensemble.from_file("rod_pendulum", 4)
    monkeypatch.setenv("MBD_SIM_CACHE", "off")
    assert Simulation.from_file("double_rod").model.kernel.optimized
    assert not asked


def test_a_program_that_builds_one_model_after_another_waits_for_each(asked, monkeypatch):
    monkeypatch.setattr(quick_start, "APART", 3600.0)
    monkeypatch.setattr(quick_start, "_last_build", -3600.0)
    kernels = [Simulation.from_file(name).model.kernel for name in ("rod_pendulum", "double_rod", "simple_pendulum")]
    assert [kernel.optimized for kernel in kernels] == [False, True, True]


def test_the_process_builds_what_the_program_then_uses():
    sim = Simulation.from_file("double_rod", live=["gravity[2]"])
    kernel = sim.model.kernel
    wait_until(lambda: kernel.optimized, "optimized code", meanwhile=lambda: sim.step(10))
    other = Simulation.from_file("double_rod", live=["gravity[2]"])
    other.step(sim.steps)
    assert sim.state.tobytes() == other.state.tobytes()
    wait_until(lambda: "optimized code" not in {thread.name for thread in threading.enumerate()}, "the thread's end")
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)  # no process is left


PROGRAM = """
import sys
from mbd_sim import Simulation
sim = Simulation.from_file("double_rod")
sim.step()
print(sim.model.kernel.optimized, "casadi" in sys.modules)
"""


def output_of(program):
    return subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True, timeout=PATIENCE)


def test_the_next_start_has_the_optimized_code_although_the_first_program_has_ended():
    first = output_of(PROGRAM)
    assert (first.stdout, first.stderr) == ("False True\n", "")
    mechanism = load_mechanism("double_rod")
    key = model_key(mechanism, mechanism.method, (), mechanism.step)
    wait_until(lambda: load_prepared(key) is not None, "the model in the cache")
    assert output_of(PROGRAM).stdout == "True False\n"  # it has built nothing


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("raise SystemExit('no memory')", "no memory"),
        (f"import os; os.kill(os.getpid(), {int(signal.SIGKILL)})", "exit status -9"),
    ],
)
def test_a_process_that_fails_is_reported_and_the_run_goes_on(fault, reason, tmp_path, monkeypatch, caplog):
    (tmp_path / "failing.py").write_text(fault)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(quick_start, "PROGRAM", "failing")
    sim = Simulation.from_file("rod_pendulum")
    wait_until(lambda: caplog.messages, "a warning")
    assert f"two to five times as long ({reason})" in caplog.text and "MBD_SIM_QUICK_START=off" in caplog.text
    sim.step(10)
    assert not sim.model.kernel.optimized


def test_a_process_that_cannot_start_is_reported(monkeypatch, caplog):
    monkeypatch.setattr(sys, "executable", "/does/not/exist")
    Simulation.from_file("rod_pendulum").step()
    assert "two to five times as long ([Errno 2] No such file or directory" in caplog.text


@pytest.mark.parametrize(("module", "name"), [("tempfile", "TemporaryFile"), ("threading", "Thread")])
def test_what_cannot_be_had_is_reported(module, name, monkeypatch, caplog):
    def fail(*_, **__):
        raise RuntimeError("there is none")

    monkeypatch.setattr(getattr(quick_start, module), name, fail)
    Simulation.from_file("rod_pendulum").step()
    assert "there is none" in caplog.text and not quick_start._unfinished


def test_changed_modules_are_not_built_for_the_old_key(monkeypatch, caplog):
    monkeypatch.setattr(quick_start, "versions", lambda: "older modules")
    sim = Simulation.from_file("rod_pendulum")
    wait_until(lambda: caplog.messages, "a warning")
    assert "modules of mbd_sim have changed" in caplog.text
    assert load_prepared(sim.model.key) is None


@contextlib.contextmanager
def waiting_processes():
    """Let the processes wait, although the caller is not refused."""
    with pytest.MonkeyPatch.context() as patch, disk_cache.one_at_a_time(LOCK):
        patch.setattr(disk_cache, "is_locked", lambda name: False)
        yield


def test_a_model_that_is_not_used_any_more_is_not_kept(monkeypatch):
    """By the thread that waits for its process."""
    loaded = []
    monkeypatch.setattr(quick_start, "load_prepared", lambda key: loaded.append(key))
    with waiting_processes():
        sim = Simulation.from_file("rod_pendulum")
        kernel = weakref.ref(sim.model.kernel)
        del sim
        gc.collect()
        assert kernel() is None
    wait_until(lambda: "optimized code" not in {thread.name for thread in threading.enumerate()}, "the thread's end")
    assert not loaded


def test_two_simulations_of_a_mechanism_share_its_code():
    with waiting_processes():
        first, second = (Simulation.from_file("rod_pendulum") for _ in range(2))
        assert first.model.kernel is second.model.kernel and not first.model.kernel.optimized
        assert second.model.coordinate_names == ("pin",)
    wait_until(lambda: second.model.kernel.optimized, "optimized code")


FORKING = """
import os, time
from mbd_sim import Simulation
from mbd_sim.simulation import quick_start
sim = Simulation.from_file("double_rod")
kernel = sim.model.kernel
assert not kernel.optimized
child = os.fork()
deadline = time.monotonic() + 100
while not kernel.optimized and time.monotonic() < deadline:
    sim.step()
other = Simulation.from_file("double_rod", method="rk4")  # LLVM is not locked
other.step()
status = int(not kernel.optimized)
if child:
    status += os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
raise SystemExit(status)
"""


def test_a_forked_process_uses_the_optimized_code_as_well():
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", FORKING]
    subprocess.run(command, check=True, timeout=PATIENCE)


def test_other_data_than_those_of_the_code_are_not_used(asked):
    """A model that was built from other modules, for example."""
    sim = Simulation.from_file("double_rod")
    prepared, kernel, _, order = asked.pop()
    order._replace(method="rk4").store("0123")
    model = quick_start._QuickModel(prepared, weakref.ref(kernel))
    assert not model.adopt("0123") and not sim.model.kernel.optimized
    order.store("4567")
    assert model.adopt("4567") and sim.model.kernel.optimized
