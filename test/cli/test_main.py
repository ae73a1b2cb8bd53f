"""The command `mbd_sim`, as it is typed."""

import errno
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mbd_sim import __version__
from mbd_sim.cli.main import COMMANDS, main
from mbd_sim.cli.mechanisms import convert
from mbd_sim.cli.shared.command import Command

FAR = """mechanism: far
parts: {wheel: {mass: 1, inertia: [1, 1, 1]}}
joints:
  pin: {type: revolute, between: [ground, wheel], axis: [0, 0, 1], position: 1e9 rad, spring: {force: sin(sqrt(2)*x)}}
"""


def answer(capsys, *arguments):
    code = main(arguments)
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def test_check_says_what_was_understood(capsys):
    code, out, _ = answer(capsys, "check", "double_rod")
    assert code == 0
    for words in (
        "upper",
        "Degrees of freedom  2  (coordinates: shoulder, elbow)",
        "6·2 - 10 = 2 (Kutzbach)",
        "2 kg",
        "kinetic 0 J",
    ):
        assert words in out
    assert "natural mode      0.426553 Hz" in out and "adams11 (order 11)" in out


def test_check_explains_a_closed_loop(capsys):
    _, out, _ = answer(capsys, "check", "four_bar")
    for words in (
        "closes a loop",
        "3 coordinates - rank 2 of 5 equations = 1",
        ", 1 in the plane",
        "holonomic, scleronomic",
    ):
        assert words in out
    assert "redundant         rocker_pin: displacement along y; tilt of the axis, 1; tilt of the axis, 2" in out


def test_check_tells_rolling_from_sliding(capsys):
    _, disc, _ = answer(capsys, "check", "knife_edge")
    assert "nonholonomic, scleronomic" in disc and "not integrable" in disc
    _, wheel, _ = answer(capsys, "check", "upright_wheel")
    assert "holonomic (the velocity constraints are integrable)" in wheel


def test_check_as_json_holds_the_same_numbers(capsys):
    code, out, _ = answer(capsys, "check", "tumbling", "--json")
    found = json.loads(out)
    assert code == 0
    assert (found["degrees_of_freedom"], found["mass"], found["gravity"]) == (6, 1.0, [0.0, 0.0, 0.0])
    assert found["start"]["kinetic"] == pytest.approx(0.5 * (1 * 0.01**2 + 2 * 2**2 + 3 * 0.01**2), rel=1e-15)


def test_check_closes_the_loops_at_another_start(capsys):
    _, out, _ = answer(capsys, "check", "four_bar", "--json", "--start", "crank_pivot=30 deg")
    crank, _, rocker = json.loads(out)["start"]["q"]
    pin, end = 0.5 * np.exp(1j * crank), 1.5 + 1.2 * np.exp(1j * rocker)
    assert crank == pytest.approx(np.pi / 6) and abs(end - pin) == pytest.approx(1.4)
    _, text, _ = answer(capsys, "check", "four_bar", "--start", "crank_pivot=30 deg")
    assert "crank_pivot as given; crank_pin, rocker_pivot found so that" in text.splitlines()[-1]
    code, _, problem = answer(capsys, "check", "double_rod", "--start", "elbo=1")
    assert code != 0 and "Did you mean 'elbow'" in problem


def test_check_remarks_on_limits_that_do_nothing(capsys, tmp_path):
    file = tmp_path / "limited.yaml"
    text = Path("config/open_chains/rod_pendulum.yaml").read_text(encoding="utf-8")
    file.write_text(text + "    limits: {lower: -2, upper: 2}\n", encoding="utf-8")
    _, out, _ = answer(capsys, "check", str(file))
    assert "limits of 'pin' do not act on the motion" in out


def test_run_reports_steps_speed_and_residual(capsys):
    code, out, _ = answer(capsys, "run", "rod_pendulum", "--time", "3", "--quiet")
    assert code == 0
    assert "3 s in 3000 steps of 0.001 s (adams11)" in out
    assert "× real time" in out
    assert "-1.4972379" in out


def test_run_says_that_the_energies_are_unknown_where_a_potential_is_not_computed(capsys, tmp_path):
    file = tmp_path / "far.yaml"
    file.write_text(FAR, encoding="utf-8")
    code, out, _ = answer(capsys, "run", str(file), "--time", "0.1", "--quiet")
    assert code == 0 and "WARNING          the energy balance is unknown: at this elongation the potential" in out


def test_run_with_method_step_and_effort(capsys):
    code, out, _ = answer(
        capsys,
        "run",
        "rod_pendulum",
        "--time",
        "1",
        "--quiet",
        "--method",
        "rk4",
        "--step",
        "0.01",
        "--effort",
        "pin=2",
    )
    assert code == 0
    assert "100 steps of 0.01 s (rk4)" in out
    applied = float(out.split("applied ")[1].split(",")[0])
    assert applied != 0.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["check", "dubble_rod"], "Did you mean 'double_rod'?"),
        (["run", "double_rod", "--effort", "elbw=1"], "Did you mean 'elbow'?"),
        (["run", "double_rod", "--effort", "elbow=x"], "'x' is not a number. Write for example elbow=2.5."),
        (["run", "double_rod", "--method", "rk5"], "no method 'rk5'"),
        (["run", "double_rod", "--time", "0.1", "--rerun", "spwan"], "no viewer sink 'spwan'"),
        (["run", "double_rod", "--effort", "elbow=1e306", "--quiet"], "became infinite"),
    ],
)
def test_a_wrong_call_is_answered_in_one_piece(capsys, arguments, words):
    code, _, err = answer(capsys, *arguments)
    assert code == 1
    assert words in err
    assert "Traceback" not in err


def test_the_command_itself_prints_urdf(capsys):
    command = str(Path(sys.executable).with_name("mbd_sim"))
    urdf = subprocess.run([command, "urdf", "double_rod"], check=True, capture_output=True, text=True).stdout
    assert '<robot name="double_rod">' in urdf
    assert "tumbling" in answer(capsys, "list")[1]


def test_every_module_of_cli_is_a_command():
    folder = Path(sys.modules[main.__module__].__file__).parent
    modules = {f"{path.parent.name}.{path.stem}" for path in folder.glob("*/*.py") if path.parent.name != "shared"}
    assert {module for module, _ in COMMANDS.values()} == {name for name in modules if not name.endswith("__init__")}
    for module in {module for module, _ in COMMANDS.values()}:
        own = {name for name, (other, _) in COMMANDS.items() if other == module}
        assert set(importlib.import_module(f"mbd_sim.cli.{module}").COMMANDS) == own


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["wrong"]])
def test_help_loads_nothing_heavy(arguments):
    heavy = ["rclpy", "rerun", "scipy", "casadi", "llvmlite", "numpy", "pydantic", "rich", "yaml", "mcap"]
    code = (
        "import sys; from mbd_sim.cli.main import main\n"
        f"try: main({arguments!r})\n"
        f"except SystemExit: print('loaded', [name for name in {heavy!r} if name in sys.modules])"
    )
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert printed.endswith("loaded []\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name, capsys):
    with pytest.raises(SystemExit, match="0"):
        main([name, "--help"])
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: mbd_sim {name} ") and ".\n\n" in printed


def test_the_package_runs_as_a_module():
    command = [sys.executable, "-m", "mbd_sim", "--version"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == f"mbd_sim {__version__}\n"


def test_a_wrong_command_is_answered_with_the_nearest(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["chek", "four_bar"])
    assert "there is no command 'chek'. Did you mean 'check'?" in capsys.readouterr().err


@pytest.mark.parametrize(("text", "words"), [("x", "is not a number"), ("-1", "is not a positive number")])
def test_wrong_numbers_are_usage_errors(capsys, text, words):
    with pytest.raises(SystemExit, match="2"):
        main(["run", "double_rod", "--time", text])
    assert words in capsys.readouterr().err


def test_quantities_of_options_may_have_their_units(capsys):
    plain = ["run", "rod_pendulum", "--quiet", "--time", "0.1", "--step", "0.002", "--effort", "pin=0.003"]
    units = ["run", "rod_pendulum", "--quiet", "--time", "100 ms", "--step", "2ms", "--effort", "pin=3 N*mm"]
    results = []
    for arguments in (plain, units):
        assert main(arguments) == 0
        results.append([line for line in capsys.readouterr().out.splitlines() if "computed" not in line])
    assert results[0] == results[1]
    with pytest.raises(SystemExit, match="2"):
        main(["run", "rod_pendulum", "--time", "2 m"])
    assert "the unit 'm' does not fit: a value in s is expected here" in capsys.readouterr().err
    assert main(["run", "rod_pendulum", "--time", "1ms", "--effort", "pin=3 N"]) == 1
    assert "a value in N*m is expected here" in capsys.readouterr().err
    assert main(["linearize", "rod_pendulum", "--at", "20 ms"]) == 0
    assert "at 0.02 s" in capsys.readouterr().out


@pytest.mark.parametrize("gravity", ["[0,0,-1.62]", "[0, 0, -1.62 m/s^2]"])
def test_a_list_is_set_as_in_a_file(capsys, gravity):
    assert main(["check", "rod_pendulum", "--set", f"gravity={gravity}"]) == 0
    assert "Gravity             [0, 0, -1.62] m/s²" in capsys.readouterr().out
    assert main(["check", "rod_pendulum", "--set", "gravity=[0,0,-1.62"]) == 1
    assert "--set gravity:1: not valid YAML" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["c-code", "--out", "x"], ["fmu", "--sources-only", "--out", "x.fmu"]])
def test_a_file_that_cannot_be_written_is_named_without_a_traceback(command, tmp_path, capsys):
    (tmp_path / "file").write_text("no folder")
    name, *options, out = command
    path = tmp_path / "file" / out
    assert main([name, "rod_pendulum", *options, str(path)]) == 1
    assert (
        capsys.readouterr().err == f"cannot read or write '{path}': Not a directory. Choose another file or folder.\n"
    )


@pytest.mark.parametrize(("number", "handled"), [(errno.ENOSPC, True), (errno.EBADF, False)])
def test_a_full_disk_is_reported_and_a_defect_is_not_hidden(number, handled, monkeypatch, capsys):
    def fail(_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setitem(convert.COMMANDS, "list", Command("", lambda parser: None, fail))
    if handled:
        assert main(["list"]) == 1
        assert capsys.readouterr().err.startswith("cannot read or write: No space left on device.")
    else:
        with pytest.raises(OSError, match="Bad file"):
            main(["list"])
