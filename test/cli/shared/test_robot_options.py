"""`--base`, `--floor` and `--limits` of the commands, and the same as parameters of the node."""

import json

import pytest

from mbd_sim.cli.main import main
from mbd_sim.files.load import parse_mechanism
from mbd_sim.ros.node import setup
from test.files.test_on_floor import robot


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "tripod.urdf"
    path.write_text(robot())
    return str(path)


def test_a_robot_is_converted_on_a_floor_with_stops(urdf, capsys):
    """The friction of the new floor and the start can be changed in the same command."""
    assert main(["convert", urdf, "--base", "free", "--floor", "--limits", "stops"]) == 0
    mechanism = parse_mechanism(capsys.readouterr().out)
    assert mechanism.joints["base"].position[2] == pytest.approx(0.33)
    assert mechanism.joints["front_hip"].limits[0].restitution == 0.0
    assert {contact.name for contact in mechanism.contacts} == {"floor"}


def test_a_robot_is_run_on_a_floor_and_check_lists_its_contacts(urdf, capsys):
    options = ["--base", "free", "--floor", "--set", "contacts.floor.friction=0.2", "--start", "front_hip=0.2"]
    assert main(["run", urdf, *options, "--time", "0.01", "--quiet"]) == 0
    assert "tripod: 0.01 s" in capsys.readouterr().out
    assert main(["check", urdf, *options, "--json"]) == 0
    assert "front_foot" in json.dumps(json.loads(capsys.readouterr().out))


def test_the_node_has_the_same_as_parameters(urdf):
    given = {"mechanism": urdf, "base": "free", "floor": True, "limits": "stops", "control": ""}
    mechanism = setup.loaded_mechanism(given)
    assert mechanism.joints["base"].position[2] == pytest.approx(0.33)
    assert mechanism.joints["front_hip"].limits[0].restitution == 0.0
    plain = setup.loaded_mechanism({"mechanism": urdf, "base": "", "floor": False, "limits": "", "control": ""})
    assert plain.joints["base"].type == "fixed" and not plain.contacts
    with pytest.raises(ValueError, match="limits: 'stop' is not one of stops"):
        setup.loaded_mechanism({**given, "limits": "stop"})
