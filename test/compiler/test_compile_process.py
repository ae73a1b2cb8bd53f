"""The processes that compile long modules: their code has the results of others; they end if their caller is gone."""

import ctypes
import fcntl
import io
import os
import resource
import signal
import sys
from contextlib import closing
from pathlib import Path

import casadi as ca
import llvmlite.binding as llvm
import numpy as np
import pytest

from mbd_sim.compiler import compile_process, machine_code
from mbd_sim.compiler.compile_process import CodeInProgress, CompileProcesses, compile_apart
from mbd_sim.compiler.host_module import new_module
from mbd_sim.compiler.lowering import lower
from mbd_sim.compiler.object_code import object_code
from mbd_sim.compiler.readers import export
from mbd_sim.compiler.schedule import arranged


def swapping_module():
    """A function whose outputs are stored one beside the other."""
    x = ca.SX.sym("x", 4)
    swapped = ca.vertcat(x[0] / x[1], x[2] * x[3] + x[1], x[0], x[1], ca.sin(x), 1.0, 1.0)
    module = new_module()
    export(module, "read", lower(module, ca.Function("f", [x], [swapped]), inline=True))
    return str(module)


def host():
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def test_code_compiled_with_the_options_for_long_code_has_the_same_bits():
    text, given, results = swapping_module(), np.array([0.1, 3.0, -0.7, 40.0]), []
    codes = [object_code(text, *host(), 1), compile_apart(text, *host(), 1)]
    assert codes[0] != codes[1]  # neighbors are stored together only without the options
    for key, code in zip(("short", "long"), codes, strict=True):
        loaded, out = machine_code.linked({key: code}), np.empty(10)
        call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("read"))
        call(given.ctypes.data, out.ctypes.data)
        results.append(out)
    assert results[0].tobytes() == results[1].tobytes()
    np.testing.assert_allclose(results[1][4:8], np.sin(given), rtol=0.0, atol=1e-16)


@pytest.mark.parametrize("fused", [True, False])
def test_blocks_with_many_multiply_adds_are_selected_together_with_the_same_bits(fused):
    x, value = ca.SX.sym("x", 200), ca.SX(1.0)
    for index in range(0, 200, 2):  # Horner's scheme
        value = value * x[index] + x[index + 1]
    function = arranged(ca.Function("f", [x], [value]), fused=fused)
    module = new_module(level=0)
    export(module, "read", lower(module, function, inline=True))
    text, given, results = str(module), np.linspace(-0.3, 0.4, 200), []
    codes = [object_code(text, *host(), 0, is_long=True), compile_apart(text, *host(), 0)]
    assert (codes[0] == codes[1]) is not fused
    for key, code in zip(("one by one", "in blocks"), codes, strict=True):
        loaded, out = machine_code.linked({key: code}), np.empty(1)
        ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(loaded.address("read"))(
            given.ctypes.data, out.ctypes.data
        )
        results.append(out)
    assert results[0].tobytes() == results[1].tobytes() and np.all(np.isfinite(results[0]))


def test_the_server_ends_with_its_caller_and_before_it_has_a_module():
    processes = CompileProcesses(*host(), 1)
    processes.start()
    server = processes._server
    processes._connection.close()
    assert server.wait(10.0) == 0
    processes.end()
    with CompileProcesses(*host(), 1) as processes:
        processes.start()
        server = processes._server
    assert server.returncode < 0  # without having loaded LLVM


def test_a_module_that_fails_or_that_nobody_waits_for_does_not_end_the_server(capfd):
    text = swapping_module()
    with CompileProcesses(*host(), 1) as processes:
        processes.compile(text).close()
        for given, succeeds in (("no module", False), (text, True)):
            with closing(processes.compile(given)) as begun:
                assert (begun.code() is not None) == succeeds
    assert capfd.readouterr() == ("", "")


FAILING_SERVER = """
import os, signal
from mbd_sim.compiler import compile_server, object_code
object_code.object_code = lambda *_, **__: os.kill(os.getppid(), signal.SIGKILL)
compile_server.main()
"""


def test_a_server_that_has_failed_compiles_nothing(monkeypatch, tmp_path):
    (program := tmp_path / "failing_server.py").write_text(FAILING_SERVER)
    monkeypatch.setattr(compile_process, "PROGRAM", program)
    with CompileProcesses(*host(), 1) as processes:
        with closing(processes.compile("")) as begun:
            assert begun.code() is None
        processes._server.wait()
        processes.use_all_processors()
        assert processes.compile("") is None


FORKLESS_SERVER = """
import os
from mbd_sim.compiler import compile_server
def fork():
    raise BlockingIOError("no more processes")
os.fork = fork
compile_server.main()
"""


def test_without_more_processes_or_files_nothing_is_compiled_apart(monkeypatch, tmp_path, capfd):
    (program := tmp_path / "forkless_server.py").write_text(FORKLESS_SERVER)
    monkeypatch.setattr(compile_process, "PROGRAM", program)
    with CompileProcesses(*host(), 1) as processes:
        for _ in range(2):
            with closing(processes.compile("")) as begun:
                assert begun.code() is None
        monkeypatch.setattr("tempfile.TemporaryFile", failing)
        assert processes.compile("") is None
    monkeypatch.setattr("socket.socketpair", failing)
    assert compile_apart("", *host(), 1) is None
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("length", [5000, 3_000_000])  # within and beyond the buffer of a file
def test_without_room_on_the_disk_nothing_is_compiled_apart(length):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with CompileProcesses(*host(), 1) as processes:
        processes.start()
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
        try:
            assert processes.compile("x" * length) is None
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def failing(*_, **__):
    raise OSError("too many open files")


def test_paths_that_are_no_texts_are_left_out_as_imports_do(monkeypatch):
    monkeypatch.setattr(sys, "path", [Path("/does/not/exist"), *sys.path])
    assert compile_apart(swapping_module(), *host(), 1) is not None


def test_the_server_ends_while_another_process_holds_the_socket():
    with CompileProcesses(*host(), 1) as processes:
        processes.compile("").close()
        server, held = processes._server, os.dup(processes._connection.fileno())
    os.close(held)
    assert server.returncode == 0


def test_a_server_that_does_not_end_is_killed(monkeypatch):
    monkeypatch.setattr(compile_process, "ENDING", 0.01)
    with CompileProcesses(*host(), 1) as processes:
        processes.compile("").close()
        server = processes._server
        server.send_signal(signal.SIGSTOP)
    assert server.returncode == -signal.SIGKILL


def test_ctrl_c_while_the_server_ends_stays_an_interrupt(monkeypatch):
    with CompileProcesses(*host(), 1) as processes:
        processes.compile("").close()
        server = processes._server

        def interrupted(timeout):
            type(server).wait(server, timeout)  # as Popen.wait does: it waits once more, and raises the interrupt
            raise KeyboardInterrupt

        monkeypatch.setattr(server, "wait", interrupted)
        with pytest.raises(KeyboardInterrupt):
            processes.end()
    assert server.returncode == 0


def test_code_is_awaited_also_with_many_open_files():
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limits[1], limits[1]))
    try:
        reader, writer = os.pipe()
        far = fcntl.fcntl(reader, fcntl.F_DUPFD, 1100)
        os.write(writer, b"d")
        with closing(CodeInProgress(io.BytesIO(b"code"), far)) as begun:
            assert begun.code() == b"code"
        os.close(reader)
        os.close(writer)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_progress_is_logged(monkeypatch, caplog):
    monkeypatch.setattr(compile_process, "REPORT_PERIOD", 0.001)
    with caplog.at_level("INFO", logger=compile_process.__name__):
        compile_apart(swapping_module(), *host(), 1)
    messages = [record.message for record in caplog.records]
    assert messages[0] == "compiling 0.0 MB of intermediate code"
    assert {message.partition(": ")[0] for message in messages[1:-1]} == {"still compiling"}
    assert messages[-1].startswith("compiled in ")


def test_without_the_process_long_code_is_compiled_in_the_same_way(monkeypatch):
    text = swapping_module()
    short, apart = object_code(text, *host(), 1), compile_apart(text, *host(), 1)
    monkeypatch.setattr(machine_code, "LEVEL", 1)
    monkeypatch.setattr(machine_code, "LONG", 0)
    monkeypatch.setattr(sys, "executable", "/does/not/exist")
    assert compile_apart(text, *host(), 1) is None
    assert machine_code._compiled(text, *host(), 1) == apart != short
    assert object_code(text, *host(), 1) == short  # the options of long code have ended


def test_options_are_part_of_the_key(monkeypatch):
    before = machine_code.compiler_identity()
    monkeypatch.setattr("mbd_sim.compiler.object_code.LONG_CODE_OPTIONS", ())
    assert machine_code.compiler_identity() != before


@pytest.mark.parametrize("changed", ["near_addresses.py", "memory_order.py"])
def test_the_passes_over_assembly_code_are_part_of_the_key(changed, monkeypatch, tmp_path):
    before, digest = machine_code.compiler_identity(), sys.modules[object_code.__module__]._near_addresses_digest
    for name in ("near_addresses.py", "memory_order.py"):
        text = Path(sys.modules[object_code.__module__].__file__).with_name(name).read_text()
        (tmp_path / name).write_text("# another pass" if name == changed else text)
    with monkeypatch.context() as patch:
        patch.setattr("mbd_sim.compiler.object_code.__file__", str(tmp_path / "object_code.py"))
        digest.cache_clear()
        assert machine_code.compiler_identity() != before
    digest.cache_clear()
    assert machine_code.compiler_identity() == before
