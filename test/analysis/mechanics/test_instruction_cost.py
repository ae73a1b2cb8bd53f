"""The count of instructions: complete, and of the expected size."""

import json

import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.studies.report.elements import cost, cost_text


def counted(name, method=None):
    model = Simulation.from_file(name, method=method).model
    return cost(model.equations, model.method), model


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "rolling_disc"])
def test_the_kinds_add_up_to_what_is_compiled(name):
    found, model = counted(name)
    assert sum(found["accelerations"].values()) == model.kernel.instructions


def test_a_pendulum_has_one_angle():
    found, _ = counted("rod_pendulum", "rk4")
    assert found["accelerations"]["sines and cosines"] == 1
    assert found["accelerations"]["roots"] == 0
    assert found["back_to_constraints"] == {}
    assert found["step"] == 4 * sum(found["accelerations"].values())


def test_a_loop_is_projected_once_a_step():
    found, _ = counted("four_bar", "rk4")
    back = sum(found["back_to_constraints"].values())
    assert back > 0
    assert found["step"] == 4 * sum(found["accelerations"].values()) + back


def test_as_a_table_and_as_json(capsys):
    assert main(["check", "four_bar", "--cost"]) == 0
    found, _ = counted("four_bar")
    assert cost_text(found) in capsys.readouterr().out
    assert main(["check", "four_bar", "--cost", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cost"] == found
